"""Non-parametric effects that compete with those of the catalogue: curve, varying law, loop, lag, ripple.

The discrepancy is a part of every set, but it is small and linear. A cause outside the catalogue may be large or
nonlinear; then the effect that resembles it most is far more probable than none. So non-parametric effects are also
fitted exactly in place of effects, and their evidence is calculated in the same way.
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
from identification.threads import in_threads
from plant.effects.nonparametric import unnamed
from plant.effects.nonparametric_curve import Nonparametric

_RANK_TOLERANCE = 1e-9  # share of the largest singular value; smaller ones are rounding errors


def nonparametric_proposals(less: Explanation) -> list[Proposal]:
    """Non-parametric effects to add to a set in place of removed effects, the highest linearised evidence first."""
    discrepancy = less.discrepancy
    alone = replace(less.screen, nuisance=Nuisance(own=discrepancy.own, shared=discrepancy.shared))
    return [
        Proposal(value=value, evidence=lambda gain: gain, starts=((start.begun(),),))
        for value, start in promising(alone, unnamed.values())
    ]


def promising(screen: Screen, kinds: Iterable[type[Nonparametric]]) -> list[tuple[float, Nonparametric]]:
    """Linearised evidence and start of some kinds of non-parametric effects, the best first, if positive.

    Args:
        screen: of a fit, beyond its parameters alone.
        kinds: candidates.
    """
    fit = screen.fit
    if not np.isfinite(screen.innovations).all():  # the motion grows without bound
        return []
    shown = [kind for kind in kinds if kind.beside(fit.model) and fit.log.shows(kind)]
    shapes = in_threads(lambda kind: list(_by_shape(screen, kind)), shown)
    best = [max(some, key=lambda pair: pair[0]) for some in shapes if some]
    return sorted((pair for pair in best if pair[0] > 0.0), key=lambda pair: -pair[0])


def _by_shape(screen: Screen, kind: type[Nonparametric]) -> Iterator[tuple[float, Nonparametric]]:
    """Each shape of a kind with its expected gain in log-likelihood, less the costs of its sizes and of the search."""
    left = screen.nuisance.beyond(screen.innovations)
    for each in kind.regressors(screen.motion):
        columns = -response(screen.filters, each.columns, on_measurement=each.acts_on == "measurement")
        beyond = screen.nuisance.beyond(columns)
        sizes = np.asarray(np.linalg.lstsq(beyond, left, rcond=_RANK_TOLERANCE)[0], dtype=np.float64)
        share = float(np.sum((left - beyond @ sizes) ** 2) / max(float(left @ left), 1e-300))
        cost = 0.5 * len(sizes) * np.log(screen.fit.samples) + np.log(each.searched)
        start = each.start(sizes)
        if isinstance(start, Nonparametric):
            yield -0.5 * screen.fit.samples * np.log(max(share, 1e-12)) - cost, start
