"""Names that have changed: the old ones still work, with a warning."""

from __future__ import annotations

import warnings
from typing import Any


def warn_of(old: str, new: str) -> None:
    """Warn the code that uses an old name."""
    warnings.warn(f"{old} is now called {new}.", DeprecationWarning, stacklevel=3)


EFFECTS = {"goal_rate_limit": "setpoint_rate_limit"}
"""Effects of model files by their old names, without a warning: nobody can change a file that was written."""


class Renamed:
    """The old name of an attribute, in the class that has it."""

    def __init__(self, new: str) -> None:
        """Refer to the attribute `new`."""
        self._new = new

    def __set_name__(self, owner: type, name: str) -> None:
        """Keep the old name."""
        self._old = name

    def __get__(self, instance: Any, owner: type | None = None) -> Any:
        """The attribute under its new name."""
        if instance is None:
            return self
        warn_of(self._old, self._new)
        return getattr(instance, self._new)
