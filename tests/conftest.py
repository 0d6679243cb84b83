"""The longest tests begin first, so that none of them is left to one process while the others have nothing to do."""

from __future__ import annotations

import pytest

LONG = (
    "test_datasets",
    "test_emps",
    "test_hidden_effects",
    "test_search",
    "test_separating_file",
    "test_unknown",
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files of long tests first, the others in their order."""
    items.sort(key=lambda item: item.path.stem not in LONG)
