"""Figures of a page, as data: `templates/draw.js` draws curves in the browser, bars are plain HTML.

A drawing library for the browser is two megabytes, compressed. Reports only need curves, points with error bars, bands,
a colour map, zoom, and values under the pointer; one short script provides them.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from antidrive.downsampling import downsample

Array = NDArray[np.float64]

MEASURED, BEFORE, AFTER, SECOND, THIRD = "#8a929b", "#e07b27", "#2f7fd1", "#2a9d6f", "#b65fa0"
"""Distinct in light and dark mode and for colour-blind readers: grey, orange, blue, green, purple."""

Style: TypeAlias = Literal["line", "dashes", "points", "rings", "band"]

_DIGITS = 5  # significant digits, relative to the range of the values
_BAND = 1000  # points of each edge of a band


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """One curve of a figure.

    Attributes:
        name: in the legend, once for all curves of that name and colour; "" for none.
        colour: #rrggbb.
        x, y: (T,) with NaN where the line breaks.
        style: how it is drawn; a band extends from `y` to `high`.
        high: (T,) upper edge of a band.
        error: (T,) half length of an error bar of a point.
        width: of the line [px].
    """

    name: str
    colour: str
    x: Array
    y: Array
    style: Style = "line"
    high: Array | None = None
    error: Array | None = None
    width: float = 1.6


@dataclass(frozen=True, kw_only=True, eq=False)
class Row:
    """One of the plots that share an x axis.

    Attributes:
        title: of the y axis, with its unit.
        curves: curves to draw.
        levels: heights of dotted lines.
        share: relative height of the row.
        map: instead of curves, a colour map over x (X,) and y (Y,) with values (X, Y); NaN is left empty.
        what: title of those values, with their unit.
    """

    title: str
    curves: Sequence[Curve] = ()
    levels: Sequence[float] = ()
    share: float = 1.0
    map: tuple[Array, Array, Array] | None = None
    what: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Figure:
    """Rows of plots with a common x axis.

    Attributes:
        x: title of the x axis, with its unit.
        rows: from the top.
        height: of all rows together [px].
    """

    x: str
    rows: Sequence[Row]
    height: int

    def __html__(self) -> Markup:
        """An empty element for the plot, followed by its data."""
        text = json.dumps(self.to_dict(), separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
        return Markup('<div class="plot"></div>\n<script type="application/json">{}</script>').format(Markup(text))

    def to_dict(self) -> dict[str, Any]:
        """Data for the script."""
        return {"x": self.x, "height": self.height, "rows": [_row(row) for row in self.rows]}


@dataclass(frozen=True, kw_only=True)
class Bar:
    """One bar.

    Attributes:
        name: in front of it.
        length: in the unit of `Bars.full`.
        label: after it.
        colour: #rrggbb.
        error: half length of its error bar.
    """

    name: str
    length: float
    label: str
    colour: str = AFTER
    error: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Bars:
    """Horizontal bars.

    Attributes:
        bars: from the top.
        full: length of a full bar.
        marker: position of a dotted line, if any.
    """

    bars: Sequence[Bar]
    full: float
    marker: float | None = None

    def __html__(self) -> Markup:
        """Name, bar and label in one line each; without a script."""
        return Markup('<div class="bars">{}</div>').format(Markup("").join(self._line(bar) for bar in self.bars))

    def _line(self, bar: Bar) -> Markup:
        length, low, high = (self._share(at) for at in (bar.length, bar.length - bar.error, bar.length + bar.error))
        parts = [_BAR.format(length, bar.colour)]
        if bar.error:
            parts.append(_ERROR.format(low, high - low))
        if self.marker is not None:
            parts.append(_MARKER.format(self._share(self.marker)))
        return _LINE.format(bar.name, Markup("").join(parts), bar.label)

    def _share(self, length: float) -> float:
        """Length as a percentage of a full bar."""
        return round(100.0 * min(max(length / self.full, 0.0), 1.0), 2)


_LINE = Markup('<div class="bar"><span>{}</span><span class="track">{}</span><b>{}</b></div>\n')
_BAR = Markup('<i style="width:{}%;background:{}"></i>')
_ERROR = Markup('<s style="left:{}%;width:{}%"></s>')
_MARKER = Markup('<u style="left:{}%"></u>')


def _row(row: Row) -> dict[str, Any]:
    found: dict[str, Any] = {
        "title": row.title,
        "share": row.share,
        "levels": [float(level) for level in row.levels],
        "curves": [_curve(curve) for curve in row.curves],
    }
    if row.map is not None:
        x, y, values = row.map
        found["map"] = {
            "x": _numbers(x),
            "y": _numbers(y),
            "z": [_numbers(column) for column in values],
            "title": row.what,
        }
    return found


def _curve(curve: Curve) -> dict[str, Any]:
    """A curve, with as many points as a screen can show."""
    x, y, kept = curve.x, curve.y, np.arange(curve.x.size)
    if curve.style == "band" and curve.high is not None:
        kept = np.union1d(downsample(y, _BAND), downsample(curve.high, _BAND))
    elif curve.style in ("line", "dashes"):
        kept = downsample(y)
    found = {"name": curve.name, "colour": curve.colour, "style": curve.style, "width": curve.width}
    edges = {"high": curve.high, "error": curve.error}
    return (
        found
        | {"x": _numbers(x[kept]), "y": _numbers(y[kept])}
        | {name: _numbers(values[kept]) for name, values in edges.items() if values is not None}
    )


def _numbers(values: Array) -> list[float | None]:
    """Numbers with the precision of a drawing, None for NaN and infinity."""
    exact = np.asarray(values, dtype=float)
    there = exact[np.isfinite(exact)]
    reach = float(np.ptp(there)) or float(np.abs(there).max()) if there.size else 0.0
    places = _DIGITS - 1 - int(np.floor(np.log10(reach))) if reach > 0.0 else 0
    return [round(float(value), places) if np.isfinite(value) else None for value in exact]
