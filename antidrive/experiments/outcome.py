"""Results of an experiment: sentences, numbers compared with the paper's, a table and figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from plant.result_display import Drawn

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Curve:
    """One curve of a figure: name, colour, x (T,) and y (T,); `points` for values at a few places."""

    name: str
    colour: str
    x: Array
    y: Array
    points: bool = False


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A figure with its caption: axis titles, and curves."""

    caption: str
    x: str
    y: str
    curves: Sequence[Curve]


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome(Drawn):
    """Report of an experiment.

    Attributes:
        title: for users.
        results: results in sentences.
        comparison: rows of quantity, the paper's value ("" if it gives none), and the result.
        found: the numbers of summary.json, SI units.
        columns: of trajectory.csv, all of one length.
        pictures: figures of the report.
    """

    title: str
    results: Sequence[str]
    comparison: Sequence[tuple[str, str, str]]
    found: Mapping[str, Any]
    columns: Mapping[str, Array]
    pictures: Sequence[Picture]

    def __str__(self) -> str:
        """The results in sentences."""
        return "\n".join(self.results)

    def sentences(self) -> list[str]:
        """The results in sentences."""
        return list(self.results)

    def summary(self) -> dict[str, Any]:
        """The numbers for JSON."""
        return {"schema": 1, "synthetic": True, **self.found}

    def table(self) -> pd.DataFrame:
        """The recorded signals, SI units."""
        import pandas as pd

        return pd.DataFrame(dict(self.columns))
