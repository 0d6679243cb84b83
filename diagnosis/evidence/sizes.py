"""How large effects are beside the discrepancy, in one currency: what each of them changes in the innovations.

Torques, delays, lags and measurement errors compare in it, but only where the innovations are white: of a free-run
simulation the slowest of them would be all. So it is asked behind the observer that the base model needs.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from diagnosis.evidence.discrepancy import Responses
from diagnosis.evidence.families import Families
from diagnosis.evidence.linearised import Linearised, is_bounded, predicted
from diagnosis.nuisance import Nuisance
from identification.fit_result import Fit
from identification.predictor import Prediction
from plant.effects.effect import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Sizes:
    """Norms of changes of the innovations, beyond what all other parameters can follow [rad].

    Attributes:
        effects: of each effect, if it is taken out.
        beyond_special: of those that have a simpler effect as a special case: its name, and what they change beyond it.
        discrepancy: of what has no name.
    """

    effects: dict[str, float]
    beyond_special: dict[str, tuple[str, float]]
    discrepancy: float

    @classmethod
    def of(
        cls,
        fit: Fit,
        names: Collection[str],
        families: Families,
        noise: float,
        functions: Array,
        observer: float,
    ) -> Sizes:
        """Of the effects of a fitted set and of a discrepancy with such coefficients (M + R,), behind an observer."""
        bandwidth = max(observer, fit.bandwidth)
        here = Linearised.at(fit, bandwidth)
        if here is None:
            return cls(effects=dict.fromkeys(names, np.inf), beyond_special={}, discrepancy=0.0)
        columns = Responses.of(families, here.filters, noise).columns
        return cls(
            effects={name: _size(fit, here, name, bandwidth) for name in names},
            beyond_special=dict(_beyond_special(fit, here, names, bandwidth)),
            discrepancy=float(np.linalg.norm(here.nuisance().beyond(columns @ functions))),
        )


def _size(fit: Fit, here: Linearised, name: str, bandwidth: float) -> float:
    _, without = predicted(fit, fit.model.without_effect(name), bandwidth)
    own = [row for row, place in enumerate(fit.free) if fit.model.names[place].split(".")[0] == name]
    return _change(without, here, here.nuisance(own))


def _beyond_special(
    fit: Fit, here: Linearised, names: Collection[str], bandwidth: float
) -> Iterator[tuple[str, tuple[str, float]]]:
    for effect in fit.model.effects:
        for special in effect.reduced()[:1] if effect.name in names else ():
            if fit.model.effect(special.name) is None:
                narrow = fit.model.without_effect(effect.name).with_effect(special)
                _, other = predicted(fit, narrow, bandwidth)
                yield effect.name, (special.name, _change(other, here, Nuisance.of(other)))


def _change(other: Sequence[Prediction], here: Linearised, nuisance: Nuisance) -> float:
    """Norm of the difference of two predictions beyond what parameters can follow; infinite where one runs off."""
    if not is_bounded(other):
        return np.inf
    change = np.concatenate([p.innovations for p in other]) - here.innovations
    return float(np.linalg.norm(nuisance.beyond(change)))
