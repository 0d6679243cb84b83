"""Smooth interpolation between knots, in numbers or symbols."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import casadi as ca

from plant.effects.effect import Array, Expression


def slopes(knots: Sequence[Expression], heights: Sequence[Expression] | Array) -> list[Expression]:
    """At each knot, of the parabola through it and its two neighbours; at the first and last, of the one next to it."""
    widths = [after - before for before, after in pairwise(knots)]
    rises = [(after - before) / width for (before, after), width in zip(pairwise(heights), widths, strict=True)]
    bends = [(b - a) / (v + w) for (a, b), (v, w) in zip(pairwise(rises), pairwise(widths), strict=True)]
    inner = [rise + width * bend for rise, width, bend in zip(rises, widths, bends, strict=False)]
    return [rises[0] - widths[0] * bends[0], *inner, rises[-1] + widths[-1] * bends[-1]]


def interpolated(value: Expression, knots: Sequence[Expression], heights: Sequence[Expression] | Array) -> Expression:
    """Cubic between knots with those slopes (Bessel's interpolation, de Boor 2001, ch. IV), constant outside.

    It passes through the heights, is smooth, and has every parabola as it is.
    """
    steep, total = slopes(knots, heights), heights[0]
    for k, (before, after) in enumerate(pairwise(knots)):
        width, rise = after - before, heights[k + 1] - heights[k]
        s = ca.fmax(ca.fmin((value - before) / width, 1), 0)
        bulge = width * s * (1 - s) * ((1 - s) * steep[k] - s * steep[k + 1])
        total = total + rise * s * s * (3 - 2 * s) + bulge
    return total
