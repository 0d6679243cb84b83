"""What has no name: curves over one variable compete on the catalogue's footing, and carry the gain without a name."""

from __future__ import annotations

import numpy as np
from scipy.linalg import block_diag

from diagnosis.odds import schwarz_cost, search_charge
from diagnosis.refit import evidence_of, refit
from diagnosis.screen import Screen
from diagnosis.unseen import holds_up
from identification.fit_result import Fit
from plant.effects import CoulombFriction, Trace
from plant.effects.curve import KNOTS, Curve, curves

_CLEARS = np.log(1000.0)  # score that a curve needs before it is believed
_MOST = 2  # curves that a model may carry


def unnamed_dependence(fit: Fit) -> tuple[tuple[str, float, Curve], ...]:
    """Variables over which a curve of missing torque would explain more than chance: with its score and the curve.

    Over velocity the curve has a jump at zero besides, so that dry friction does not pass for a smooth curve's failure.
    """
    held = {effect.name for effect in fit.model.effects}
    asked = {variable: kind for variable, kind in curves.items() if kind.name not in held}
    found: dict[str, tuple[float, Curve]] = {}
    for screen, loss in Screen.views(fit):
        traces = [(variable, trace) for variable, kind in asked.items() for trace in kind.traces(screen.motion)]
        tried = [_with_jump(trace, screen) if variable == "velocity" else trace for variable, trace in traces]
        answers = screen.regress(tried, discounted=True)
        for (variable, trace), (_, evidence, coefficients) in zip(traces, answers, strict=True):
            value = evidence - loss - search_charge(searched=1, catalogue=len(asked))
            curve = trace.start(coefficients[: trace.columns.shape[1]])
            if value > max(_CLEARS, found[variable][0] if variable in found else 0.0) and isinstance(curve, Curve):
                found[variable] = value, curve
    ranked = sorted(found.items(), key=lambda item: -item[1][0])
    return tuple((variable, value, curve) for variable, (value, curve) in ranked)


def _with_jump(trace: Trace, screen: Screen) -> Trace:
    columns = np.column_stack((trace.columns, screen.motion.sign))
    prior = None if trace.prior is None else block_diag(trace.prior, np.eye(1))
    return Trace(columns=columns, prior=prior, start=lambda c: CoulombFriction(torque=0.0))


def carried(fit: Fit) -> tuple[Fit, ...]:
    """The fit with an unnamed curve more, and another, as long as they pay and hold up unseen."""
    path: list[Fit] = []
    while len(path) < _MOST:
        at = path[-1] if path else fit
        longer = _one_more(at)
        if longer is None:
            break
        path.append(longer)
    return tuple(path)


def _one_more(fit: Fit) -> Fit | None:
    for _, _, curve in unnamed_dependence(fit):
        after = refit(fit, curve, fixed=curve.shape())
        if evidence_of(after, fit) > _CLEARS + schwarz_cost(KNOTS, fit.samples) and holds_up(fit, after):
            return after
    return None
