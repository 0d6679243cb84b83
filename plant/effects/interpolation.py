"""Smooth interpolation between knots, for numbers or symbols."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import casadi as ca

from plant.effects.effect import Array, Expression


def slopes_and_curvatures(
    knots: Sequence[Expression], heights: Sequence[Expression] | Array
) -> tuple[list[Expression], list[Expression]]:
    """Slopes between adjacent knots, and half the second derivatives of the parabolas through three adjacent knots."""
    rises = [(b - a) / (w - v) for (v, w), (a, b) in zip(pairwise(knots), pairwise(heights), strict=True)]
    curvatures = [(b - a) / (w - v) for v, w, (a, b) in zip(knots[:-2], knots[2:], pairwise(rises), strict=True)]
    return rises, curvatures


def interpolated(value: Expression, knots: Sequence[Expression], heights: Sequence[Expression] | Array) -> Expression:
    """Between two knots a weighted mean of two parabolas: through both and the knot before, or the knot after.

    In the first and last interval there is only one such parabola; outside the knots the value is constant. It is the
    piecewise cubic of Bessel (de Boor 2001, ch. IV; Overhauser 1968): it passes through the heights, has a continuous
    slope, and reproduces every parabola exactly.
    """
    value = ca.fmax(ca.fmin(value, knots[-1]), knots[0])
    rises, curvatures = slopes_and_curvatures(knots, heights)
    past = [value >= knot for knot in knots[1:-1]]

    def here(one_for_each_piece: Sequence[Expression] | Array) -> Expression:
        steps = zip(past, pairwise(one_for_each_piece), strict=True)
        return one_for_each_piece[0] + sum(is_past * (after - before) for is_past, (before, after) in steps)

    since, until = value - here(knots[:-1]), value - here(knots[1:])
    curvature, other = here([curvatures[0], *curvatures]), here([*curvatures, curvatures[-1]])
    return here(heights[:-1]) + since * (
        here(rises) + until * (curvature + since / (since - until) * (other - curvature))
    )
