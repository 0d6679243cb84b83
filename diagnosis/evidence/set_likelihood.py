"""Marginal likelihood of a fitted model with the discrepancy, linearised at the fit."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from diagnosis.evidence.discrepancy import Discrepancy, Posterior, Responses
from diagnosis.evidence.families import Families
from diagnosis.evidence.linearised import Linearised
from diagnosis.evidence.prior import log_density
from diagnosis.linear import response
from identification.fit_result import Fit
from identification.problem import Problem
from identification.unsettled_start import charge, hidden_starts
from plant.effects.effect import Array
from plant.effects.nonparametric_curve import Nonparametric

_FOLLOWED = 1e-4  # share of a parameter's Jacobian beyond all others; with less it is collinear, not determined


@dataclass(frozen=True, kw_only=True, eq=False)
class SetLikelihood:
    """Marginal likelihood of a model with the discrepancy, linearised at a fit.

    Attributes:
        fit: the point of linearisation.
        here: its linearised predictions.
        noise: rms innovation, the unit of measurement errors [rad].
        unmodelled: (T,) change of the innovations by the most probable unmodelled torque.
        discrepancy: at the fit.
        log_likelihood: marginalised over coefficients and amplitudes of the discrepancy and parameters of the effects.
    """

    fit: Fit
    here: Linearised
    noise: float
    unmodelled: Array
    discrepancy: Discrepancy
    log_likelihood: float

    @classmethod
    def at(cls, fit: Fit, names: Collection[str], families: Families) -> SetLikelihood | None:
        """For a fit with some effects beyond the base model; None if the motion grows without bound."""
        here, problem = Linearised.at(fit, fit.bandwidth), Problem.of(fit.log, fit.model, known=fit.known)
        if here is None:
            return None
        noise = float(np.sqrt(np.sum(fit.innovations**2) / fit.samples))  # masked samples are zero and do not count
        responses = Responses.of(families, here.filters, noise)
        discrepancy = Discrepancy.learned(here.nuisance(), responses, here.innovations, fit.samples)
        own = _charged(fit, here, names)
        held = _held(fit, here, own, here.innovations - responses.columns @ discrepancy.posterior.functions)
        if held:
            discrepancy = Discrepancy.learned(here.nuisance(held), responses, here.innovations, fit.samples)
        torques = responses.torques
        volume = _volume(fit, here, [row for row in own if row not in held], held)
        return cls(
            fit=fit,
            here=here,
            noise=noise,
            unmodelled=responses.columns[:, :torques] @ discrepancy.posterior.functions[:torques],
            discrepancy=discrepancy,
            log_likelihood=discrepancy.posterior.log_likelihood + volume - _start(problem, discrepancy.posterior),
        )

    @property
    def posterior(self) -> Posterior:
        """Posterior of the discrepancy."""
        return self.discrepancy.posterior

    def by_block(self, blocks: int) -> Array:
        """(B,) log-likelihood of the blocks of the log, with the most probable discrepancy."""
        variance = self.posterior.variance
        left = self.discrepancy.left - self.discrepancy.columns @ self.posterior.functions
        weight = np.concatenate([run.weight for run in self.here.filters])
        log_density = -0.5 * weight * (np.log(2.0 * np.pi * variance) + left**2 / variance)
        return np.array([part.sum() for part in np.array_split(log_density, blocks)])

    @cached_property
    def share(self) -> float:
        """Size of the unmodelled torque divided by that of the whole torque [-], as changes of the innovations."""
        torque = np.concatenate([run.drive for run in self.fit.log.runs])
        whole = self.discrepancy.beyond_initial_states(
            response(self.here.filters, torque[:, None], on_measurement=False)
        )
        beyond = self.here.nuisance().beyond(self.unmodelled)
        return float(np.linalg.norm(beyond)) / max(float(np.linalg.norm(whole)), 1e-300)


def _start(problem: Problem, beside: Posterior) -> float:
    """Cost of hidden initial states with a prior as wide as one sample tells (Kass and Wasserman 1995).

    The likelihood has one degree of freedom less for each; their prior density makes up for its unit.
    """
    return charge(problem) + 0.5 * hidden_starts(problem) * float(np.log(2.0 * np.pi * beside.variance))


def _charged(fit: Fit, here: Linearised, names: Collection[str]) -> list[int]:
    """Rows of the effects' parameters that have a prior cost.

    A non-parametric effect may replace parameters of the base model, which are then fixed. In exchange the same number
    of its coefficients, those with the largest Jacobian, have no prior cost, like the parameters of the base model.
    """
    rows = list[int]()
    for effect in fit.model.effects:
        owned = [row for row, place in enumerate(fit.free) if fit.model.names[place].split(".")[0] == effect.name]
        if isinstance(effect, Nonparametric) and effect.name in names:
            size = np.linalg.norm(here.slopes(owned), axis=0)
            less = Problem.of(fit.log, fit.model.without_effect(effect.name), known=fit.known)
            fixed = len({less.model.names[place] for place in less.free}.intersection(effect.shape()))
            owned = [owned[place] for place in np.sort(np.argsort(-size, kind="stable")[fixed:])]
        rows += owned if effect.name in names else []
    return rows


def _held(fit: Fit, here: Linearised, own: list[int], remaining: Array) -> list[int]:
    """Rows of the effects' parameters that are fixed: collinear with the others, or stopped by a bound.

    For the bounds the discrepancy is first subtracted from the innovations: if the most probable value lies beyond a
    bound, the gain beyond it must not count. The parameters are fixed one by one, the most collinear or the first to
    reach its bound: of two collinear parameters one remains free, and with it what the log determines of both.
    """
    problem = Problem.of(fit.log, fit.model, known=fit.known)
    values, held = problem.pack(fit.model.values, fit.initial), list[int]()
    while free := [row for row in own if row not in held]:
        beyond = here.beyond_the_rest(free, held)
        size = np.maximum(np.linalg.norm(beyond, axis=0), 1e-300)
        moved = size / np.maximum(np.linalg.norm(here.slopes(free), axis=0), 1e-300)
        if moved.min() <= _FOLLOWED:
            held.append(free[int(np.argmin(moved))])
            continue
        step = -np.linalg.lstsq(beyond / size, remaining, rcond=1e-9)[0] / size
        ends = np.where(step > 0.0, problem.upper[free], problem.lower[free])
        share = np.divide(ends - values[free], step, out=np.full(len(free), np.inf), where=step != 0.0)
        if share.min() >= 1.0:
            break
        held.append(free[int(np.argmin(share))])
    return held


def _volume(fit: Fit, here: Linearised, free: list[int], held: list[int]) -> float:
    """Log of the posterior volume of the effects' free parameters (Laplace), times their prior density."""
    if not free:
        return 0.0
    beyond = here.beyond_the_rest(free, held)
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
