"""What an effect that was refitted scores, among rivals and against nothing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from diagnosis.model_probability import parameter_cost, probabilities, visibility_cost
from diagnosis.refit import evidence_of, is_its_special_case, is_plausible, widening
from identification.fit_result import Fit
from plant.effects import Effect

_STRANGE = float(np.log(1000.0))  # charge for values that a cause hardly ever has: in one of a thousand


@dataclass(frozen=True, kw_only=True, eq=False)
class Hypothesis:
    """An effect as it was refitted in a round.

    Attributes:
        effect: with the values that were found.
        coefficients: the parameters of it that are not the search's.
        charge: for the search that found it and for the catalogue.
    """

    effect: Effect
    coefficients: int
    charge: float

    @classmethod
    def of(cls, fit: Fit, name: str, *, coefficients: int, charge: float) -> Hypothesis:
        """The effect of that name in a fit."""
        (effect,) = (effect for effect in fit.model.effects if effect.name == name)
        freed = sum(not spec.fitted for spec in effect.parameters()) if effect.freed else 0
        return cls(effect=effect, coefficients=coefficients + freed, charge=charge)

    def score(self, fit: Fit, than: Fit, evidence: float | None = None) -> float:
        """Of a fit with it over one without, among the names; with the evidence of `evidence_of` if none is given."""
        evidence = evidence_of(fit, than) if evidence is None else evidence
        return evidence - 0.5 * (parameter_cost(fit, than) + visibility_cost(self.coefficients)) - self._charged(fit)

    def visible(self, fit: Fit, than: Fit, evidence: float | None = None) -> float:
        """The same, against nothing."""
        evidence = evidence_of(fit, than) if evidence is None else evidence
        return evidence - visibility_cost(self.coefficients) - self._charged(fit)

    def discounted(self, rise: float, dispersion: float) -> float:
        """Evidence of a rise in likelihood, if parts of the log disagree about it by such a factor.

        Only what goes beyond the charge for the search: that knows already how high the peaks of what is left are.
        """
        beyond = rise - self.charge
        return self.charge + (beyond / dispersion if beyond > 0.0 else beyond)

    def _charged(self, fit: Fit) -> float:
        """For the search, and for values that such a cause hardly ever has."""
        return self.charge + (0.0 if is_plausible(fit, self.effect.name) else _STRANGE)


def posterior_of(contest: Mapping[str, Hypothesis], fits: Mapping[str, Fit], than: Fit) -> dict[str, float]:
    """Probabilities of rivals, fitted, over the model without them.

    Among the names the likeliest one's colour counts for all; against nothing each has its own.
    """
    over = widening(max(fits.values(), key=lambda fit: fit.log_likelihood), than) if fits else None
    scores = {name: contest[name].score(fit, than, evidence_of(fit, than, over=over)) for name, fit in fits.items()}
    scores |= {name: -np.inf for name, fit in fits.items() if is_its_special_case(fit, name)}
    return probabilities(scores, {name: contest[name].visible(fit, than) for name, fit in fits.items()})
