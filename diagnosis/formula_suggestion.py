"""A short formula for a non-parametric curve, suggested from its knots and not fitted to the log.

Formulas of one or two terms are fitted to the heights of the knots by least squares, weighted with the information
matrix of the heights. A viscous term is added for a curve over velocity, for viscous friction of the model can absorb
it. A formula is reported only if it leaves less than a hundredth of the curve's weighted square; two terms are tried
only if no single term does so. A ripple is reported by its harmonics with more than a hundredth of its power.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import combinations

import numpy as np

from diagnosis.residual_torque import effects_over
from identification.fit_result import Fit
from plant.effects.effect import Array, Stage
from plant.effects.friction_over_velocity import FrictionOverVelocity
from plant.effects.nonparametric import plain
from plant.effects.nonparametric_curve import KNOTS, Curve
from plant.effects.ripple import HARMONICS, Ripple

Term = Callable[[Array], Array]

_LEFT = 0.01  # share of a curve's weighted square that a formula may leave
_TERMS: Mapping[str, Mapping[str, Term]] = {
    "velocity": {
        "1": np.ones_like,
        "sgn(v)": np.sign,
        "|v|": np.abs,
        "v |v|": lambda v: v * np.abs(v),
        "v^2": np.square,
        "v^3": lambda v: v**3,
    },
    "angle": {
        "1": np.ones_like,
        "x": np.positive,
        "x^2": np.square,
        "x^3": lambda x: x**3,
        "sin(x)": np.sin,
        "cos(x)": np.cos,
    },
    "position": {  # of a linear axis, which has no turn
        "1": np.ones_like,
        "x": np.positive,
        "x^2": np.square,
        "x^3": lambda x: x**3,
    },
    "torque": {
        "1": np.ones_like,
        "u": np.positive,
        "|u|": np.abs,
        "u |u|": lambda u: u * np.abs(u),
        "u^3": lambda u: u**3,
    },
}
_TAKEN_OVER: Mapping[str, Term] = {"velocity": np.positive}  # absorbed by viscous friction
_SYMBOL = {"velocity": "v", "angle": "x", "torque": "u", "time": "t"}


def suggested_formula(fit: Fit) -> str | None:
    """A sentence with a formula for the non-parametric ripple or curve of a fitted model, or None."""
    over, law = _of_a_ripple(fit) or _of_a_curve(fit) or ("", "")
    if not law:
        return None
    variable, torque = effects_over(over, fit.log.axis), effects_over("torque", fit.log.axis)
    return (
        f"Over {variable} {_SYMBOL[over]} the {torque} that the model lacks looks like {law}. "
        "This is a suggestion from the curve, not a finding."
    )


def _of_a_ripple(fit: Fit) -> tuple[str, str] | None:
    """Variable and harmonics of a torque ripple."""
    ripple = next((effect for effect in fit.model.effects if isinstance(effect, Ripple)), None)
    if ripple is None or ripple.stage is not Stage.LOAD:
        return None
    (over,) = ripple.variables
    turns = [f"{k * ripple.rate:.4g} {_SYMBOL[over]}" for k in range(1, HARMONICS + 1)]
    waves = [f"{wave}({turn})" for turn in turns for wave in ("sin", "cos")]
    sizes = dict(zip(waves, map(float, ripple.values[1:]), strict=True))
    least = _LEFT * sum(size**2 for size in sizes.values())
    shown = {wave: size for wave, size in sizes.items() if size**2 > least}
    return (over, f"{_sum_of(shown)} [{fit.log.command_unit}]") if shown else None


def _of_a_curve(fit: Fit) -> tuple[str, str] | None:
    """Variable and formula of a curve, if a formula describes it."""
    curve = next((effect for effect in fit.model.effects if type(effect) in plain.values()), None)
    if not isinstance(curve, Curve) or curve.over not in _TERMS:
        return None
    rows = [row for row, place in enumerate(fit.free) if fit.model.names[place].startswith(f"{curve.name}.c")]
    if len(rows) < KNOTS:
        return None
    over = effects_over(curve.over, fit.log.axis)
    information = np.asarray(np.linalg.pinv(fit.covariance[np.ix_(rows, rows)]), dtype=float)
    places = np.array([float(knot) for knot in curve.knots(curve.low, curve.high)])
    heights = np.array(curve.values[2 : 2 + KNOTS], dtype=float)
    found = formula_terms(over if over in _TERMS else curve.over, places, heights, information)
    dry = "dry and " if curve.name == FrictionOverVelocity.name else ""
    beside = f", beside {dry}viscous friction" if curve.over in _TAKEN_OVER else ""
    return (curve.over, f"{_sum_of(found)} [{fit.log.command_unit}]{beside}") if found else None


def _sum_of(terms: Mapping[str, float]) -> str:
    return " ".join(f"{size:+.3g}{'' if name == '1' else f' {name}'}" for name, size in terms.items()).removeprefix("+")


def formula_terms(over: str, places: Array, heights: Array, information: Array) -> dict[str, float]:
    """Terms over a variable, with their sizes, that describe heights (K,) at places (K,); empty if none do.

    Args:
        over: the variable.
        places: of the knots.
        heights: of the curve.
        information: (K, K) of the heights, inverse of their covariance.
    """
    values, vectors = np.linalg.eigh(0.5 * (information + information.T))
    root = vectors.T * np.sqrt(np.maximum(values, 0.0))[:, None]
    taken = [_TAKEN_OVER[over](places)] if over in _TAKEN_OVER else []
    whole = _left(root, taken, heights)[0]
    if whole <= 0.0:
        return {}
    for count in (1, 2):
        tried = {names: [_TERMS[over][name](places) for name in names] for names in combinations(_TERMS[over], count)}
        fits = {names: _left(root, [*taken, *columns], heights) for names, columns in tried.items()}
        best = min(fits, key=lambda names: fits[names][0])
        left, sizes = fits[best]
        if left < _LEFT * whole:
            return dict(zip(best, map(float, sizes[len(taken) :]), strict=True))
    return {}


def _left(root: Array, columns: list[Array], heights: Array) -> tuple[float, Array]:
    """Weighted square of the heights after a least-squares fit of the columns, and the coefficients."""
    if not columns:
        return float(np.sum((root @ heights) ** 2)), np.zeros(0)
    shape = np.column_stack(columns)
    sizes = np.linalg.lstsq(root @ shape, root @ heights, rcond=None)[0]
    return float(np.sum((root @ (heights - shape @ sizes)) ** 2)), np.asarray(sizes)
