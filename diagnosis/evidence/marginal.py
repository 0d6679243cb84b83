"""Log marginal likelihood of a fitted set of effects beside the discrepancy.

    log Z = log p(e | a) + 1/2 log|(J_s' J_s)^-1| + log p(theta_s) - n log(catalogue)

at the mode, with J_s the Jacobian of the effects' parameters beyond all others (Laplace); the discrepancy's functions
are integrated out, its amplitude a summed over.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial

import numpy as np

from diagnosis.evidence.discrepancy import Discrepancy, Responses
from diagnosis.evidence.families import Families
from diagnosis.evidence.linearised import Linearised
from diagnosis.evidence.mode import at_mode
from diagnosis.evidence.prior import forms, log_density
from diagnosis.evidence.sizes import Sizes
from diagnosis.linear import AT_ONCE, Linear, score
from diagnosis.motion import motion_of
from diagnosis.nuisance import Nuisance
from diagnosis.screen import Screen
from identification.fit_result import Fit
from identification.problem import Problem
from plant.effects.effect import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Explanation:
    """A set of effects, fitted and weighed.

    Attributes:
        names: of the effects beyond the base model.
        fit: of all of them.
        log_marginal: log Z.
        discrepancy: beside it.
        screen: to ask what more there may be.
        families: that the discrepancy is made of, with errors of the measurement as large as `noise` [rad].
        observer: bandwidth of the observer that the base model needs [rad/s].
    """

    names: frozenset[str]
    fit: Fit
    log_marginal: float
    discrepancy: Discrepancy
    screen: Screen
    families: Families
    noise: float
    observer: float

    @cached_property
    def sizes(self) -> Sizes:
        """Of the effects and of the discrepancy."""
        functions = self.discrepancy.posterior.functions
        return Sizes.of(self.fit, self.names, self.families, self.noise, functions, self.observer)


def weigh(
    fit: Fit, base: Collection[str], families: Families, *, catalogue: int, observer: float
) -> Explanation | None:
    """A fit as an explanation; None where a motion or what depends on it grows without bound.

    Args:
        fit: of a model with effects, by least squares.
        base: names of those effects that every explanation has.
        families: the same for all that are compared.
        catalogue: number of effects that might be named.
        observer: bandwidth of the observer that the base model needs [rad/s].
    """
    names = frozenset(effect.name for effect in fit.model.effects) - set(base)
    here = Linearised.at(fit, fit.bandwidth)
    if here is None:
        return None
    noise = float(np.sqrt(np.sum(here.innovations**2) / fit.samples))  # masked samples are zero and do not count
    found = _Weighed.at(fit, here, families, noise, names)
    beside = found.discrepancy.posterior
    if beside.scale.any():
        fit, noise = at_mode(fit, found.responses, beside), float(np.sqrt(beside.variance))
        here = Linearised.at(fit, fit.bandwidth)
        if here is None:
            return None
        found = _Weighed.at(fit, here, families, noise, names)
    return _explanation(found, families, noise, names, catalogue, observer)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Weighed:
    """A fit, linearised, and what the discrepancy beside it leaves: the likelihood over all that is free."""

    fit: Fit
    here: Linearised
    responses: Responses
    discrepancy: Discrepancy
    log_likelihood: float

    @classmethod
    def at(cls, fit: Fit, here: Linearised, families: Families, noise: float, names: Collection[str]) -> _Weighed:
        responses = Responses.of(families, here.filters, noise)
        discrepancy = Discrepancy.learned(here.nuisance(), responses, here.innovations, fit.samples)
        own = [row for row, place in enumerate(fit.free) if fit.model.names[place].split(".")[0] in names]
        held = _held(fit, here, own, here.innovations - responses.columns @ discrepancy.posterior.functions)
        if held:
            discrepancy = Discrepancy.learned(here.nuisance(held), responses, here.innovations, fit.samples)
        volume = _volume(fit, here, [row for row in own if row not in held])
        likelihood = discrepancy.posterior.log_likelihood + volume
        return cls(fit=fit, here=here, responses=responses, discrepancy=discrepancy, log_likelihood=likelihood)


def _explanation(
    found: _Weighed, families: Families, noise: float, names: frozenset[str], catalogue: int, observer: float
) -> Explanation:
    fit, here, discrepancy = found.fit, found.here, found.discrepancy
    torque, reading = score(here.filters, discrepancy.beyond(here.innovations)[:, None])
    problem = Problem.of(fit.log, fit.model, known=fit.known)
    motion = replace(
        motion_of(fit, problem, list(here.told), fit.bandwidth, (torque, reading)),
        chance=cache(partial(_chance, here.filters, discrepancy)),
    )
    counted = sum(forms(type(effect)) for effect in fit.model.effects if effect.name in names)
    return Explanation(
        names=names,
        fit=fit,
        log_marginal=found.log_likelihood - counted * float(np.log(catalogue)),
        discrepancy=discrepancy,
        screen=Screen(fit=fit, motion=motion, innovations=here.innovations, nuisance=discrepancy, filters=here.filters),
        families=families,
        noise=noise,
        observer=observer,
    )


def families_along(fit: Fit) -> Families | None:
    """The families along the motion of a fitted model; None where that grows without bound."""
    here = Linearised.at(fit, fit.bandwidth)
    if here is None:
        return None
    problem, nothing = Problem.of(fit.log, fit.model, known=fit.known), np.zeros((here.innovations.size, 1))
    return Families.along(motion_of(fit, problem, list(here.told), fit.bandwidth, (nothing, nothing)))


def _held(fit: Fit, here: Linearised, own: list[int], remaining: Array) -> list[int]:
    """Rows of the effects' parameters that their bounds hold, once the discrepancy is taken out of the innovations.

    There the likeliest value lies beyond the bound, and what would be won there must not count.
    """
    if not own:
        return []
    beyond = here.beyond_the_rest(own)
    size = np.maximum(np.linalg.norm(beyond, axis=0), 1e-300)
    step = -np.linalg.lstsq(beyond / size, remaining, rcond=1e-9)[0] / size
    problem = Problem.of(fit.log, fit.model, known=fit.known)
    ends = problem.pack(fit.model.values, fit.initial)[own] + step
    return [row for row, end in zip(own, ends, strict=True) if not problem.lower[row] <= end <= problem.upper[row]]


def _volume(fit: Fit, here: Linearised, free: list[int]) -> float:
    """Log of the volume that the effects' free parameters have left, times their density before."""
    if not free:
        return 0.0
    beyond = here.beyond_the_rest(free)
    information = beyond.T @ beyond
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    sign, log_determinant = np.linalg.slogdet(information / np.outer(scale, scale))
    if sign <= 0.0:
        return -np.inf
    inverse = np.linalg.inv(information / np.outer(scale, scale))
    deviations = fit.noise_std * np.sqrt(np.maximum(np.diag(inverse), 0.0)) / scale
    density = sum(
        log_density(fit, fit.model.names[fit.free[row]], float(std)) for row, std in zip(free, deviations, strict=True)
    )
    return density - 0.5 * float(log_determinant) - float(np.sum(np.log(scale)))


def _chance(filters: tuple[Linear, ...], nuisance: Nuisance) -> tuple[Array, Array]:
    draws = np.random.default_rng(0).normal(size=(len(nuisance.shared), AT_ONCE))
    return score(filters, nuisance.beyond(draws))
