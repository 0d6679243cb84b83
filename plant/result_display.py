"""What a result shows of itself in Python: a table, a picture, a page, and itself in a notebook.

Results come from packages that do not plot. The package antidrive draws them, and is imported by its name when a
picture is wanted, as pandas imports its plotting library.
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
    """Base of what tab completion lists only in part."""

    _internal: ClassVar[frozenset[str]] = frozenset()
    """Names that are left out: they are for the other packages."""

    def __dir__(self) -> Iterable[str]:
        """What a user needs; everything else is reached by its name."""
        return [name for name in super().__dir__() if name not in self._internal]


class Tabled(Listed):
    """Base of what is a table, also in a notebook."""

    def to_frame(self) -> pd.DataFrame:
        """The result as a table; `attrs` has the units that no column tells."""
        frame: pd.DataFrame = importlib.import_module(_DRAWS).to_frame(self)
        return frame

    def _repr_html_(self) -> str:
        """The result in a notebook: its first line and its table."""
        html: str = importlib.import_module(_DRAWS).html(self)
        return html


class Drawn(Tabled):
    """Base of results with a picture."""

    def plot(self, axes: Any = None) -> Any:
        """Draw the result with matplotlib.

        Args:
            axes: to draw in: as many as a drawing without them has; new ones by default.

        Returns:
            The axes: one, or an array of them.
        """
        return importlib.import_module(_DRAWS).plot(self, axes)


class Presented(Drawn):
    """Base of results with a picture and a report."""

    def report(self, path: Path | str) -> Path:
        """Write the result as one page that opens offline.

        Args:
            path: of the HTML file.

        Raises:
            BadParameter: nothing can be written there.
        """
        written: Path = importlib.import_module(_DRAWS).report(self, Path(path))
        return written
