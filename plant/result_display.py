"""Display of a result in Python: as a table, a figure, a page, and in a notebook.

Results come from packages that do not plot. The package antidrive draws them; it is imported by name when a figure is
requested, as pandas imports its plotting library.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

if TYPE_CHECKING:
    import pandas as pd

_DRAWS = "antidrive.presentation"


class Listed:
    """Base of classes whose tab completion hides internal names."""

    _internal: ClassVar[frozenset[str]] = frozenset()
    """Names that are hidden: they are for the other packages."""

    def __dir__(self) -> Iterable[str]:
        """Names for users; the hidden ones remain accessible."""
        return [name for name in super().__dir__() if name not in self._internal]


class Tabled(Listed):
    """Base of results with a table, in a notebook too, and a report."""

    def to_frame(self) -> pd.DataFrame:
        """The result as a table; `attrs` has the units that no column gives."""
        frame: pd.DataFrame = importlib.import_module(_DRAWS).to_frame(self)
        return frame

    def _repr_html_(self) -> str:
        """The result in a notebook: its first line and its table."""
        html: str = importlib.import_module(_DRAWS).html(self)
        return html

    def report(self, path: Path | str) -> Path:
        """Write the result as one page that opens offline.

        Args:
            path: of the HTML file.

        Raises:
            BadParameter: the file cannot be written.
        """
        written: Path = importlib.import_module(_DRAWS).report(self, Path(path))
        return written


class Drawn(Tabled):
    """Base of results with a figure too."""

    def plot(self, axes: Any = None) -> Any:
        """Draw the result with matplotlib.

        Args:
            axes: axes to draw in, as many as the drawing has; new ones by default.

        Returns:
            The axes: one, or an array of them.
        """
        return importlib.import_module(_DRAWS).plot(self, axes)
