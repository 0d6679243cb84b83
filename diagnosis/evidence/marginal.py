"""Log marginal likelihood of a fitted set of effects beside the discrepancy, and the size of each against it.

    log Z = log p(e | a) + 1/2 log|(J_s' J_s)^-1| + log p(theta_s) - n log(catalogue)

at the exact fit, with J_s the Jacobian of the effects' parameters beyond all others (Laplace); the discrepancy's
functions are integrated out, its amplitude a summed over.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial

import numpy as np

from diagnosis.evidence.discrepancy import Discrepancy
from diagnosis.evidence.families import Families
from diagnosis.evidence.prior import forms, log_density
from diagnosis.linear import AT_ONCE, Linear, linearised, score
from diagnosis.motion import motion_of
from diagnosis.nuisance import Nuisance
from diagnosis.screen import Screen
from identification.fit_result import Fit
from identification.predictor import Prediction
from identification.problem import Problem
from plant.effects.effect import Array

_HUGE = 1e100  # what has overflowed, or will when it is squared


@dataclass(frozen=True, kw_only=True, eq=False)
class Explanation:
    """A set of effects, fitted and weighed.

    Attributes:
        names: of the effects beyond the base model.
        fit: of all of them.
        log_marginal: log Z.
        discrepancy: beside it.
        screen: to ask what more there may be.
    """

    names: frozenset[str]
    fit: Fit
    log_marginal: float
    discrepancy: Discrepancy
    screen: Screen

    @cached_property
    def sizes(self) -> dict[str, float]:
        """Of each effect: what it changes in the innovations beyond the rest, as a norm [rad]."""
        told = _predicted(self.fit, self.names)
        return {name: _size(self.fit, told, self.names, name) for name in self.names}

    @cached_property
    def beyond_special(self) -> dict[str, tuple[str, float]]:
        """Of the effects with a simpler one as a special case: its name, and what they change beyond it [rad]."""
        return dict(_beyond_special(self.fit, self.names))


def weigh(fit: Fit, base: Collection[str], families: Families, *, catalogue: int) -> Explanation | None:
    """A fit as an explanation; None where a motion or what depends on it grows without bound.

    Args:
        fit: of a model with effects.
        base: names of those effects that every explanation has.
        families: the same for all that are compared.
        catalogue: number of effects that might be named.
    """
    names = frozenset(effect.name for effect in fit.model.effects) - set(base)
    told = _predicted(fit, names)
    innovations = np.concatenate([p.innovations for p in told])
    if not all(np.abs(p.jacobian).max() < _HUGE and np.abs(p.innovations).max() < _HUGE for p in told):
        return None
    problem = Problem.of(fit.log, fit.model, known=fit.known)
    filters = tuple(
        linearised(fit.model, run, p, fit.bandwidth, substeps=problem.predictor.substeps, colour=problem.log.colour)
        for run, p in zip(problem.log.runs, told, strict=True)
    )
    discrepancy = Discrepancy.learned(Nuisance.of(told), families, filters, innovations, fit.samples)
    torque, reading = score(filters, discrepancy.beyond(innovations)[:, None])
    motion = replace(
        motion_of(fit, problem, told, fit.bandwidth, (torque, reading)),
        chance=cache(partial(_chance, filters, discrepancy)),
    )
    likelihood = discrepancy.posterior.log_likelihood + _volume(fit, told, names)
    return Explanation(
        names=names,
        fit=fit,
        log_marginal=likelihood - _counted(fit, names) * float(np.log(catalogue)),
        discrepancy=discrepancy,
        screen=Screen(fit=fit, motion=motion, innovations=innovations, nuisance=discrepancy, filters=filters),
    )


def families_along(fit: Fit) -> Families:
    """The families along the motion of a fitted model."""
    told, problem = _predicted(fit, ()), Problem.of(fit.log, fit.model, known=fit.known)
    nothing = np.zeros((sum(len(run) for run in fit.log.runs), 1))
    return Families.along(motion_of(fit, problem, told, fit.bandwidth, (nothing, nothing)))


def _free(fit: Fit, names: Collection[str]) -> list[int]:
    """Places of the parameters that are free in the end: what a bound holds of an effect follows nothing."""
    return [p for p in fit.free if not (fit.parameters[p].at_bound and fit.model.names[p].split(".")[0] in names)]


def _predicted(fit: Fit, names: Collection[str]) -> list[Prediction]:
    """Predictions with the Jacobian of the free parameters and the initial states."""
    problem, free = Problem.of(fit.log, fit.model, known=fit.known), _free(fit, names)
    told = problem.predictor.predict(fit.model.values, fit.initial, bandwidth=fit.bandwidth, width=0.0)
    kept = [row for row, place in enumerate(fit.free) if place in free]
    kept += range(len(fit.free), told[0].jacobian.shape[1])
    return told if len(free) == len(fit.free) else [replace(p, jacobian=p.jacobian[:, kept]) for p in told]


def _counted(fit: Fit, names: Collection[str]) -> int:
    """As how many effects of the catalogue the named ones count."""
    return sum(forms(type(effect)) for effect in fit.model.effects if effect.name in names)


def _volume(fit: Fit, told: list[Prediction], names: Collection[str]) -> float:
    """Log of the volume that the effects' parameters have left, times their density before."""
    free = _free(fit, names)
    own = [row for row, place in enumerate(free) if fit.model.names[place].split(".")[0] in names]
    if not own:
        return 0.0
    beyond = _beyond_the_rest(told, own)
    information = beyond.T @ beyond
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    sign, log_determinant = np.linalg.slogdet(information / np.outer(scale, scale))
    if sign <= 0.0:
        return -np.inf
    inverse = np.linalg.inv(information / np.outer(scale, scale))
    deviations = fit.noise_std * np.sqrt(np.maximum(np.diag(inverse), 0.0)) / scale
    density = sum(
        log_density(fit, fit.model.names[free[row]], float(std)) for row, std in zip(own, deviations, strict=True)
    )
    return density - 0.5 * float(log_determinant) - float(np.sum(np.log(scale)))


def _size(fit: Fit, told: list[Prediction], names: Collection[str], name: str) -> float:
    """Norm of what an effect changes in the innovations, beyond what the other parameters could take over."""
    rest = fit.model.without_effect(name)
    problem = Problem.of(fit.log, rest, known=fit.known)
    without = problem.predictor.predict(
        rest.values, fit.initial, bandwidth=fit.bandwidth, width=0.0, sensitivities=False
    )
    own = [row for row, place in enumerate(_free(fit, names)) if fit.model.names[place].split(".")[0] == name]
    return _change(without, told, _nuisance(told, own))


def _beyond_special(fit: Fit, names: Collection[str]) -> Iterator[tuple[str, tuple[str, float]]]:
    """Of each wider effect, its special case and what it changes beyond all that the model with that can take over."""
    for effect in fit.model.effects:
        for special in effect.reduced()[:1] if effect.name in names else ():
            if fit.model.effect(special.name) is None:
                narrow = fit.model.without_effect(effect.name).with_effect(special)
                problem = Problem.of(fit.log, narrow, known=fit.known)
                other = problem.predictor.predict(narrow.values, fit.initial, bandwidth=fit.bandwidth, width=0.0)
                yield effect.name, (special.name, _change(other, _predicted(fit, names), Nuisance.of(other)))


def _change(other: list[Prediction], told: list[Prediction], nuisance: Nuisance) -> float:
    """Norm of the difference of two predictions beyond what parameters can follow; infinite where it runs off."""
    with np.errstate(over="ignore", invalid="ignore"):
        change = np.concatenate([w.innovations - t.innovations for w, t in zip(other, told, strict=True)])
    sound = np.abs(change).max() < _HUGE and all(np.abs(p.jacobian).max(initial=0.0) < _HUGE for p in other)
    return float(np.linalg.norm(nuisance.beyond(change))) if sound else np.inf


def _beyond_the_rest(told: list[Prediction], rows: list[int]) -> Array:
    """(T, len(rows)) Jacobian of some parameters beyond all others and the initial states."""
    return _nuisance(told, rows).beyond(np.vstack([p.jacobian[:, rows] for p in told]))


def _nuisance(told: list[Prediction], rows: list[int]) -> Nuisance:
    """What the parameters but for some can follow."""
    kept = [row for row in range(told[0].jacobian.shape[1]) if row not in rows]
    return Nuisance.of([replace(p, jacobian=p.jacobian[:, kept]) for p in told])


def _chance(filters: tuple[Linear, ...], nuisance: Nuisance) -> tuple[Array, Array]:
    draws = np.random.default_rng(0).normal(size=(len(nuisance.shared), AT_ONCE))
    return score(filters, nuisance.beyond(draws))
