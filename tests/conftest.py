"""How the tests share the processors: one thread of linear algebra each, and the longest tests begin first.

Compiled modules are kept even where that is switched off: the tests start a hundred programs, each of which would
compile all of its libraries again for four seconds.
"""

from __future__ import annotations

import os
import sys

import pytest

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # of numpy and scipy, which are not loaded yet

os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# One processor for each worker: two with threads of their own would take each other's.
if hasattr(os, "sched_setaffinity") and (worker := os.environ.get("PYTEST_XDIST_WORKER", "")).startswith("gw"):
    own = sorted(os.sched_getaffinity(0))
    os.sched_setaffinity(0, {own[int(worker[2:]) % len(own)]})

LONG = (
    "test_bundled_loops",
    "test_datasets",
    "test_demo",
    "test_docs",
    "test_hidden_effects",
    "test_notebooks",
    "test_paper_scenarios",
    "test_readme",
    "test_unknown_causes",
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files of long tests first, the others in their order."""
    items.sort(key=lambda item: item.path.stem not in LONG)
