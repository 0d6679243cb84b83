"""What a result shows of itself in Python: a picture, a table, a page, and itself in a notebook.

Results come from packages that know nothing of pictures. The front door draws them, and is asked for by its name when
somebody wants to see something, as pandas asks for the library that plots.
"""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd

_DRAWS = "antidrive.presentation"


class Presented:
    """Base of results that can be looked at."""

    def plot(self, axes: Any = None) -> Any:
        """Draw the result with matplotlib.

        Args:
            axes: to draw in: as many as a drawing without them has; new ones by default.

        Returns:
            The axes: one, or an array of them.
        """
        return importlib.import_module(_DRAWS).plot(self, axes)

    def to_frame(self) -> pd.DataFrame:
        """The result as a table; `attrs` has the units that no column tells."""
        frame: pd.DataFrame = importlib.import_module(_DRAWS).to_frame(self)
        return frame

    def report(self, path: Path | str) -> Path:
        """Write the result as one page that opens offline.

        Args:
            path: of the HTML file.

        Raises:
            BadParameter: nothing can be written there.
        """
        written: Path = importlib.import_module(_DRAWS).report(self, Path(path))
        return written

    def _repr_html_(self) -> str:
        """The result in a notebook: its first line and its table."""
        html: str = importlib.import_module(_DRAWS).html(self)
        return html
