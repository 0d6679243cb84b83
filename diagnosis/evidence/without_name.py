"""Non-parametric effects that compete with those of the catalogue: curve, varying law, loop, lag, ripple.

The discrepancy is a part of every set, but small, and linear. A cause that the catalogue does not have may be neither;
then the name that looks most like it is far likelier than nothing. So what follows no law of the catalogue is fitted
exactly too where a name stands, and weighed like that.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from diagnosis.evidence.marginal import Explanation
from diagnosis.evidence.proposals import Proposal
from diagnosis.linear import response
from diagnosis.nuisance import Nuisance
from diagnosis.score_test import Screen
from plant.effects.nonparametric import unnamed
from plant.effects.nonparametric_curve import Nonparametric

_ALIKE = 1e-9  # of the largest direction of columns, below which one is rounding


def without_name(less: Explanation) -> list[Proposal]:
    """What may stand in the place of the effects that a set is short of, the most promising first."""
    discrepancy = less.discrepancy
    alone = replace(less.screen, nuisance=Nuisance(own=discrepancy.own, shared=discrepancy.shared))
    return [
        Proposal(value=value, worth=lambda gain: gain, starts=((start.begun(),),))
        for value, start in promising(alone, unnamed.values())
    ]


def promising(screen: Screen, kinds: Iterable[type[Nonparametric]]) -> list[tuple[float, Nonparametric]]:
    """Where the fits of some kinds begin that promise anything, and what they promise, the best first.

    Args:
        screen: of a fit, beyond its parameters alone.
        kinds: that are asked.
    """
    fit, found = screen.fit, list[tuple[float, Nonparametric]]()
    for kind in kinds:
        if kind.beside(fit.model) and fit.log.shows(kind):
            found.extend(sorted(_asked(screen, kind), key=lambda pair: -pair[0])[:1])
    return sorted((pair for pair in found if pair[0] > 0.0), key=lambda pair: -pair[0])


def _asked(screen: Screen, kind: type[Nonparametric]) -> Iterator[tuple[float, Nonparametric]]:
    """Log-likelihood that each shape of a kind promises, less what its sizes and the search cost, and the shape."""
    left = screen.nuisance.beyond(screen.innovations)
    for trace in kind.traces(screen.motion):
        columns = -response(screen.filters, trace.columns, on_reading=trace.acts_on == "reading")
        beyond = screen.nuisance.beyond(np.asarray(np.where(np.isfinite(columns), columns, 0.0)))
        sizes = np.asarray(np.linalg.lstsq(beyond, left, rcond=_ALIKE)[0], dtype=np.float64)
        share = float(np.sum((left - beyond @ sizes) ** 2) / max(float(left @ left), 1e-300))
        cost = 0.5 * len(sizes) * np.log(screen.fit.samples) + np.log(trace.searched)
        start = trace.start(sizes)
        if isinstance(start, Nonparametric):
            yield -0.5 * screen.fit.samples * np.log(max(share, 1e-12)) - cost, start
