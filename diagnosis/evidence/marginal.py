"""Log marginal likelihood of a fitted set of effects with the discrepancy.

    log Z = log p(e | a) + 1/2 log|(J_s' J_s)^-1| + log p(theta_s) - n log(catalogue)

with J_s the Jacobian of the effects' parameters beyond all others (Laplace). The coefficients of the discrepancy are
integrated out; the likelihood is summed over its amplitudes a.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial

import numpy as np

from diagnosis.evidence.discrepancy import Discrepancy
from diagnosis.evidence.families import Families
from diagnosis.evidence.linearised import Linearised
from diagnosis.evidence.prior import forms
from diagnosis.evidence.set_likelihood import SetLikelihood
from diagnosis.evidence.sizes import Sizes
from diagnosis.linear import AT_ONCE, Filter, score
from diagnosis.motion import motion_of
from diagnosis.nuisance import Nuisance
from diagnosis.score_test import Screen
from identification.fit_result import Fit
from identification.problem import Problem
from plant.effects.effect import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Explanation:
    """A fitted set of effects with its evidence.

    Attributes:
        names: of the effects beyond the base model.
        likelihood: the fit of the whole set, with the discrepancy.
        log_marginal: log Z.
        screen: the linearised fit, to rank further effects.
        families: basis functions of the discrepancy.
        observer: bandwidth of the observer that the base model needs [rad/s].
        excluded: effects of the catalogue that are not candidates.
    """

    names: frozenset[str]
    likelihood: SetLikelihood
    log_marginal: float
    screen: Screen
    families: Families
    observer: float
    excluded: frozenset[str] = frozenset()

    @property
    def fit(self) -> Fit:
        """The fit of the base model with the effects."""
        return self.likelihood.fit

    @property
    def discrepancy(self) -> Discrepancy:
        """The discrepancy at the fit."""
        return self.likelihood.discrepancy

    @cached_property
    def sizes(self) -> Sizes:
        """Sizes of the effects and of the discrepancy."""
        at = self.likelihood
        found = Sizes.of(at.fit, self.names, self.families, at.noise, at.posterior.functions, self.observer)
        return replace(found, excluded=self.excluded)

    @property
    def may_be(self) -> frozenset[str]:
        """Its effects, and the special cases that may take their place."""
        return self.names | {special for special, _ in self.sizes.beyond_special.values() if special is not None}


def marginal_likelihood(
    fit: Fit,
    base: Collection[str],
    families: Families,
    *,
    catalogue: int,
    observer: float,
    excluded: Collection[str] = (),
) -> Explanation | None:
    """The evidence of a fit; None if its motion or its sensitivities grow without bound.

    Args:
        fit: of a model with effects.
        base: names of the effects of the base model.
        families: basis functions of the discrepancy, the same for all sets that are compared.
        catalogue: number of candidate effects.
        observer: bandwidth of the observer that the base model needs [rad/s].
        excluded: effects of the catalogue that are not candidates.
    """
    names = frozenset(effect.name for effect in fit.model.effects) - set(base)
    found = SetLikelihood.at(fit, names, families)
    if found is None:
        return None
    here, discrepancy = found.here, found.discrepancy
    # The discrepancy may absorb a missing effect, so scores are calculated beyond it and beyond the parameters alone.
    views = (discrepancy.beyond(here.innovations), discrepancy.left)
    torque, measurement = score(here.filters, np.column_stack(views))
    problem = Problem.of(fit.log, fit.model, known=fit.known)
    motion = replace(
        motion_of(fit, problem, list(here.predictions), fit.bandwidth, (torque, measurement)),
        chance=cache(partial(_chance, here.filters, discrepancy)),
    )
    counted = sum(forms(type(effect)) for effect in fit.model.effects if effect.name in names)
    return Explanation(
        names=names,
        likelihood=found,
        log_marginal=found.log_likelihood - counted * float(np.log(catalogue)),
        screen=Screen(fit=fit, motion=motion, innovations=here.innovations, nuisance=discrepancy, filters=here.filters),
        families=families,
        observer=observer,
        excluded=frozenset(excluded),
    )


def families_along(fit: Fit) -> Families | None:
    """The families along the motion of a fitted model; None if that grows without bound."""
    here = Linearised.at(fit, fit.bandwidth)
    if here is None:
        return None
    problem, nothing = Problem.of(fit.log, fit.model, known=fit.known), np.zeros((here.innovations.size, 1))
    return Families.along(motion_of(fit, problem, list(here.predictions), fit.bandwidth, (nothing, nothing)))


def _chance(filters: tuple[Filter, ...], nuisance: Nuisance) -> tuple[Array, Array]:
    draws = np.random.default_rng(0).normal(size=(len(nuisance.shared), AT_ONCE))
    return score(filters, nuisance.beyond(draws))
