"""The sets of effects that a search has fitted, and how one is: exactly, near another fit, behind a given observer."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from diagnosis.evidence.families import Families
from diagnosis.evidence.marginal import Explanation, weigh
from diagnosis.evidence.proposals import Proposal
from diagnosis.refit import fitted_from, is_its_special_case, most_promising, problem_near
from identification.fit_result import Fit
from identification.noise import log_likelihood
from plant.discrete import Structure
from plant.effects import Effect, catalogue
from plant.effects.nonparametric_curve import Nonparametric
from plant.servo import ServoModel

_STAGES = (0, 1, 2, 2)  # of a search among shapes that look alike
_ITERATIONS = 20  # of a fit; what takes longer hardly belongs there, and would be followed to odd values


@dataclass(eq=False)
class Explored:
    """The sets that were fitted, by their names and the bandwidth of the observer [rad/s].

    Attributes:
        null: the base model alone, along whose motion the families are drawn.
        proposed: what was proposed beside each of them.
        held: whether all are predicted behind one observer that holds a motion in which small errors grow.
        asked: fits that were asked for, by where they began; the search comes by the same ones on several ways.
        answered: what came of weighing a fit.
    """

    null: Fit
    effects: Mapping[str, type[Effect]]
    tell: Callable[[str], None]
    families: Families
    fits: dict[tuple[frozenset[str], float], Explanation] = field(default_factory=dict)
    proposed: dict[tuple[frozenset[str], float], list[Proposal]] = field(default_factory=dict)
    held: bool = False
    asked: dict[tuple[Any, ...], Fit] = field(default_factory=dict)
    answered: dict[Fit, Explanation | None] = field(default_factory=dict)

    @property
    def known(self) -> dict[frozenset[str], Explanation]:
        """Each set behind the observer that suits it best."""
        ranked = sorted(self.fits.values(), key=lambda each: each.log_marginal)
        return {each.names: each for each in ranked}

    @property
    def best(self) -> Explanation:
        """The likeliest."""
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
        if begun not in self.asked:
            self.asked[begun] = fitted(start, models, bandwidth)
        return self.asked[begun]

    def gained(self, fit: Fit, proposal: Proposal) -> float:
        """Log-likelihood that one effect brings a fit from the first of its starts, behind the same observer."""
        model = fit.model.with_effect(proposal.starts[0][0])
        return self.fitted(fit, [model], fit.bandwidth).log_likelihood - fit.log_likelihood

    def fitted_with(self, fit: Fit, proposal: Proposal, bandwidth: float, least: float = 0.0) -> Fit:
        """The model of a fit with what is proposed, fitted from there.

        Among shapes that look alike the best is looked for where the first brings at least so much log-likelihood.
        """
        models = [fit.model]
        for starts in proposal.starts:
            models = [self._with(model, start) for model in models for start in starts]
        found = self.fitted(fit, models, bandwidth)
        least += _likelihood(fit, bandwidth)
        for starts in proposal.starts:
            found = self._among_look_alikes(found, starts[0].name, bandwidth, least)
        return found

    def _with(self, model: ServoModel, start: Effect) -> ServoModel:
        """A model with an effect; what of it something without a name could be stays as in the base model."""
        if isinstance(start, Nonparametric):
            base = dict(zip(self.null.model.names, self.null.model.values.tolist(), strict=True))
            stays = {name: base[name] for name in start.shape() if name in base}
            values = dict(zip(model.names, model.values.tolist(), strict=True)) | stays
            model = model.with_values([values[name] for name in model.names])
        return model.with_effect(start)

    def _among_look_alikes(self, fit: Fit, name: str, bandwidth: float, least: float) -> Fit:
        """The best among shapes of an effect between which a descent cannot choose; at first anywhere, then nearby.

        Where the best of all has less log-likelihood than is asked for there is nothing to be looked for nearby.
        """
        for stage in _STAGES:
            effect = fit.model.effect(name)
            alike = () if effect is None else effect.similar_shapes(stage)
            if not alike:
                break
            rest = fit.model.without_effect(name)
            other = self.fitted(replace(fit, model=rest), [rest.with_effect(each) for each in alike], bandwidth)
            fit = max((fit, other), key=lambda each: each.log_likelihood)
            if stage == 0 and fit.log_likelihood < least:
                break
        return fit

    def weighed(self, fit: Fit) -> Explanation | None:
        """A fit as an explanation, where an effect came out as its special case with that; None where it is none."""
        if fit not in self.answered:
            self.answered[fit] = self._weighed(fit)
        return self.answered[fit]

    def _weighed(self, fit: Fit) -> Explanation | None:
        held = {effect.name for effect in self.null.model.effects}
        names = {effect.name for effect in fit.model.effects} - held
        for name in sorted(names):
            if is_its_special_case(fit, name):
                (narrow,) = self.narrowed(fit, name) or (None,)
                return None if narrow is None else self.weighed(narrow)
        if not fit.converged:
            return None
        excluded = catalogue.keys() - self.effects.keys()
        return weigh(
            fit, held, self.families, catalogue=len(self.effects), observer=self.null.bandwidth, excluded=excluded
        )

    def narrowed(self, fit: Fit, name: str) -> list[Fit]:
        """A fit with the special case of an effect in its place, if that has one and it may be named."""
        effect, rest = fit.model.effect(name), fit.model.without_effect(name)
        special = effect.reduced()[:1] if effect is not None else ()
        return [
            self.fitted(fit, [rest.with_effect(each)], fit.bandwidth)
            for each in special
            if each.name in self.effects and not rest.holds(each.name)
        ]


def _key(model: ServoModel) -> tuple[Structure, bytes]:
    """What a fit from a model depends on."""
    return Structure(model), model.values.tobytes()


def _likelihood(fit: Fit, bandwidth: float) -> float:
    """Log-likelihood of a fit as it is, behind an observer."""
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
