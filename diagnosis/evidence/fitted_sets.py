"""The sets of effects that a search has fitted. Each is fitted from another fit, with a given observer."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from diagnosis.evidence.families import Families
from diagnosis.evidence.marginal import Explanation, marginal_likelihood
from diagnosis.evidence.proposals import Proposal
from diagnosis.refit import fitted_from, is_its_special_case, most_promising, problem_near
from identification.fit_result import Fit
from identification.noise import log_likelihood
from plant.discrete import Structure
from plant.effects import Effect, catalogue
from plant.effects.nonparametric_curve import Nonparametric
from plant.servo import ServoModel

_STAGES = (0, 1, 2, 2)  # of a search among similar shapes
_ITERATIONS = 20  # of a fit; a fit that needs more is rarely of a present effect, and would end at implausible values


@dataclass(eq=False)
class FittedSets:
    """The sets that were fitted, by their effects and the bandwidth of the observer [rad/s].

    Attributes:
        null: fit of the base model alone; the families are evaluated along its motion.
        effects: effects of the catalogue that are candidates.
        tell: receives lines on progress.
        families: the same for all sets.
        doubtful: the most likely fit of the base model if that is of no use; then `null` has a slower observer.
        fits: the best fit of each set at each bandwidth.
        proposed: the effects that were proposed in addition to each set.
        held: whether all sets are predicted with the observer that stabilises a chaotic motion.
        cached_fits: cached fits, by their starting point; the search requests the same fit several times.
        answered: cached evidence of each fit.
    """

    null: Fit
    effects: Mapping[str, type[Effect]]
    tell: Callable[[str], None]
    families: Families
    doubtful: Fit | None = None
    fits: dict[tuple[frozenset[str], float], Explanation] = field(default_factory=dict)
    proposed: dict[tuple[frozenset[str], float], list[Proposal]] = field(default_factory=dict)
    held: bool = False
    cached_fits: dict[tuple[Any, ...], Fit] = field(default_factory=dict)
    answered: dict[Fit, Explanation | None] = field(default_factory=dict)

    @property
    def fastest(self) -> float:
        """Bandwidth of the fastest observer: the one that the base model needs to follow the log [rad/s]."""
        return (self.doubtful or self.null).bandwidth

    @property
    def known(self) -> dict[frozenset[str], Explanation]:
        """Each set at the bandwidth with its highest log marginal likelihood."""
        ranked = sorted(self.fits.values(), key=lambda each: each.log_marginal)
        return {each.names: each for each in ranked}

    @property
    def best(self) -> Explanation:
        """The set with the highest log marginal likelihood."""
        return max(self.fits.values(), key=lambda each: each.log_marginal)

    def add(self, explanations: Iterable[Explanation | None]) -> None:
        """Keep the better fit of each set at each bandwidth."""
        for each in filter(None, explanations):
            key = each.names, each.fit.bandwidth
            if key not in self.fits or each.log_marginal > self.fits[key].log_marginal:
                self.fits[key] = each

    def fitted(self, start: Fit, models: list[ServoModel], bandwidth: float) -> Fit:
        """The best fit of some models at a bandwidth, from another fit."""
        begun = start.initial.tobytes(), bandwidth, *(part for model in (start.model, *models) for part in _key(model))
        if begun not in self.cached_fits:
            self.cached_fits[begun] = fitted(start, models, bandwidth)
        return self.cached_fits[begun]

    def with_one(self, fit: Fit, proposal: Proposal) -> Fit:
        """The model of a fit with one effect, fitted from the first of its starts with the same observer."""
        return self.fitted(fit, [fit.model.with_effect(proposal.starts[0][0])], fit.bandwidth)

    def fitted_with(self, fit: Fit, proposal: Proposal, bandwidth: float, least: float | None = None) -> Fit:
        """The model of a fit with the proposed effects, fitted from there.

        Among similar shapes a local search follows only if the best so far has at least the log-likelihood `least`, by
        default that of the fit.
        """
        models = [fit.model]
        for starts in proposal.starts:
            models = [self._with(model, start) for model in models for start in starts]
        found = self.fitted(fit, models, bandwidth)
        least = _likelihood(fit, bandwidth) if least is None else least
        for starts in proposal.starts:
            found = self._among_confounded(found, starts[0].name, bandwidth, least)
        return found

    def _with(self, model: ServoModel, start: Effect) -> ServoModel:
        """A model with an effect; parameters that a non-parametric effect replaces are reset to the base model's."""
        if isinstance(start, Nonparametric):
            base = dict(zip(self.null.model.names, self.null.model.values.tolist(), strict=True))
            stays = {name: base[name] for name in start.shape() if name in base}
            values = dict(zip(model.names, model.values.tolist(), strict=True)) | stays
            model = model.with_values([values[name] for name in model.names])
        return model.with_effect(start)

    def _among_confounded(self, fit: Fit, name: str, bandwidth: float, least: float) -> Fit:
        """The best of similar shapes, between which a descent cannot choose: first over the whole range, then nearby.

        The local search is left out if the best of the whole range has a log-likelihood below `least`.
        """
        for stage in _STAGES:
            effect = fit.model.effect(name)
            similar = () if effect is None else effect.similar_shapes(stage)
            if not similar:
                break
            rest = fit.model.without_effect(name)
            less = replace(fit, model=rest, initial=fit.initial_of(rest))
            other = self.fitted(less, [rest.with_effect(each) for each in similar], bandwidth)
            fit = max((fit, other), key=lambda each: each.log_likelihood)
            if stage == 0 and fit.log_likelihood < least:
                break
        return fit

    def explanation_of(self, fit: Fit) -> Explanation | None:
        """Evidence of a fit; of the fit with the special case if an effect has reduced to that; None without any."""
        if fit not in self.answered:
            self.answered[fit] = self._explained(fit)
        return self.answered[fit]

    def _explained(self, fit: Fit) -> Explanation | None:
        held = {effect.name for effect in self.null.model.effects}
        names = {effect.name for effect in fit.model.effects} - held
        for name in sorted(names):
            if is_its_special_case(fit, name):
                (narrow,) = self.narrowed(fit, name) or (None,)
                return None if narrow is None else self.explanation_of(narrow)
        if not fit.converged:
            return self._continued(fit)
        excluded = catalogue.keys() - self.effects.keys()
        return marginal_likelihood(
            fit, held, self.families, catalogue=len(self.effects), observer=self.fastest, excluded=excluded
        )

    def _continued(self, fit: Fit) -> Explanation | None:
        """Evidence of a fit that was stopped by the number of iterations, after as many again; None without any.

        They are worth it only if it is already likelier than all sets with its observer.
        """
        others = (each.fit.log_likelihood for (_, bandwidth), each in self.fits.items() if bandwidth == fit.bandwidth)
        if fit.log_likelihood <= max(others, default=-np.inf):
            return None
        more = self.fitted(fit, [fit.model], fit.bandwidth)
        return self.explanation_of(more) if more.converged else None

    def narrowed(self, fit: Fit, name: str) -> list[Fit]:
        """The fit with the special case in place of an effect; empty without one, or if it is not a candidate."""
        effect, rest = fit.model.effect(name), fit.model.without_effect(name)
        special = effect.reduced()[:1] if effect is not None else ()
        return [
            self.fitted(fit, [rest.with_effect(each)], fit.bandwidth)
            for each in special
            if each.name in self.effects and not rest.holds(each.name)
        ]


def _key(model: ServoModel) -> tuple[Structure, bytes]:
    """What a fit that starts from a model depends on."""
    return Structure(model), model.values.tobytes()


def _likelihood(fit: Fit, bandwidth: float) -> float:
    """Log-likelihood of a fit with an observer of another bandwidth, without fitting again."""
    if fit.bandwidth == bandwidth:
        return fit.log_likelihood
    problem = problem_near(fit, fit.model)
    cost = problem.cost(problem.pack(fit.model.values, fit.initial), bandwidth, 0.0)
    return log_likelihood(cost, fit.samples)


def fitted(start: Fit, models: list[ServoModel], bandwidth: float) -> Fit:
    """The best fit of some models at a bandwidth, from another fit."""
    near = replace(start, bandwidth=bandwidth)
    problems = [problem_near(start, model) for model in models]
    if len(problems) > 1:
        problems = most_promising(problems, near, bandwidth)[:1]
    (problem,) = problems
    return fitted_from(near, problem, _ITERATIONS)
