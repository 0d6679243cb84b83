"""How large an effect could be without being noticed: the limit of detection of a log in which nothing is missing.

Beside everything that the fit can absorb, the coefficient of an effect's trace has a standard error s. An effect of
size c then raises the log-likelihood by c^2 / (2 s^2) on average, from which its charge is taken; it is noticed when
the rest is at least the log odds from which it is told that something is missing. Said only of effects whose trace has
one shape and whose only parameter is its size, for there the screen is exact to first order.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from diagnosis.explanation.hypothesis_comparison import NOTICED
from diagnosis.linear import response
from diagnosis.result import Candidate, Estimate
from diagnosis.score_test import Screen
from identification.fit_result import Fit
from identification.noise import coloured_information
from plant.effects import Trace, catalogue


def detectable(fit: Fit, tried: Iterable[Candidate]) -> dict[str, Estimate]:
    """Size at which each effect would be noticed as often as not, by its name, for the effects of which it can be said.

    Args:
        fit: in which nothing is missing.
        tried: the effects that were asked, with what they were charged.
    """
    screens = [screen for screen, _ in Screen.views(fit)]
    found: dict[str, Estimate] = {}
    for candidate in tried:
        kind = catalogue.get(candidate.effect)
        specs = () if kind is None else kind.parameters()
        traces = [list(kind.traces(screen.motion)) for screen in screens] if kind is not None else []
        if len(specs) != 1 or any(len(shapes) != 1 or shapes[0].columns.shape[1] != 1 for shapes in traces):
            continue
        error = min(_standard_error(screen, trace) for screen, (trace,) in zip(screens, traces, strict=True))
        size = error * float(np.sqrt(2.0 * max(NOTICED + candidate.evidence - candidate.visible, 0.0)))
        unit = specs[0].unit_on(fit.model.axis, fit.model.torque_unit)
        found[candidate.effect] = Estimate(value=size, std=None, unit=unit)
    return found


def _standard_error(screen: Screen, trace: Trace) -> float:
    """Of the trace's coefficient, for innovations of the colour that they have."""
    seen = screen.nuisance.beyond(response(screen.filters, trace.columns, on_reading=trace.acts_on == "reading"))
    information = float((seen**2).sum())
    if information <= 0.0:
        return np.inf
    return float(np.sqrt(coloured_information(seen, screen.innovations).item())) / information
