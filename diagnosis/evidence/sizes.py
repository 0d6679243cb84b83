"""How large effects are beside the discrepancy, in one currency: what each of them changes in the innovations.

Torques, delays, lags and measurement errors compare in it, but only where the innovations are white: of a free-run
simulation the slowest of them would be all. So it is asked behind the observer that the base model needs.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from diagnosis.evidence.discrepancy import Responses
from diagnosis.evidence.families import Families
from diagnosis.evidence.linearised import Linearised, is_bounded, predicted
from diagnosis.nuisance import Nuisance
from identification.fit_result import Fit
from plant.effects.effect import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Sizes:
    """Norms of changes of the innovations, beyond what all other parameters can follow [rad].

    Attributes:
        fit: of a set of effects.
        names: of them.
        bandwidth: of the observer behind which is asked [rad/s].
        here: the fit behind it; None where its motion grows without bound: then each effect is larger than all else.
        discrepancy: of what has no name.
    """

    fit: Fit
    names: frozenset[str]
    bandwidth: float
    here: Linearised | None
    discrepancy: float
    _known: dict[frozenset[str], Array | None] = field(default_factory=dict, repr=False)

    @classmethod
    def of(
        cls, fit: Fit, names: Collection[str], families: Families, noise: float, functions: Array, observer: float
    ) -> Sizes:
        """Of the effects of a fitted set and of a discrepancy with such coefficients (M + R,), behind an observer."""
        bandwidth = max(observer, fit.bandwidth)
        here, discrepancy = Linearised.at(fit, bandwidth), 0.0
        if here is not None:
            columns = Responses.of(families, here.filters, noise).columns
            discrepancy = float(np.linalg.norm(here.nuisance().beyond(columns @ functions)))
        return cls(fit=fit, names=frozenset(names), bandwidth=bandwidth, here=here, discrepancy=discrepancy)

    @cached_property
    def effects(self) -> dict[str, float]:
        """Of each effect, if it is taken out."""
        return {name: self.beyond(name) for name in sorted(self.names)}

    def beyond(self, name: str, without: frozenset[str] = frozenset()) -> float:
        """Of an effect, if it is taken out where others are out already, which then hide nothing of it."""
        out = without | {name}
        before, after = self._innovations(without), self._innovations(out)
        if self.here is None or before is None or after is None:
            return np.inf
        return float(np.linalg.norm(self.here.nuisance(self._rows(out)).beyond(after - before)))

    @cached_property
    def beyond_special(self) -> dict[str, tuple[str, float]]:
        """Of those that have a simpler effect as a special case: its name, and what they change beyond it."""
        found = {}
        for effect in self.fit.model.effects if self.here is not None else ():
            for special in effect.reduced()[:1] if effect.name in self.names else ():
                if self.fit.model.effect(special.name) is None:
                    narrow = self.fit.model.without_effect(effect.name).with_effect(special)
                    _, told = predicted(self.fit, narrow, self.bandwidth)
                    change = np.inf
                    if is_bounded(told) and self.here is not None:
                        other = np.concatenate([p.innovations for p in told])
                        change = float(np.linalg.norm(Nuisance.of(told).beyond(other - self.here.innovations)))
                    found[effect.name] = special.name, change
        return found

    def _innovations(self, out: frozenset[str]) -> Array | None:
        """(T,) of the model without some effects; None where they run off."""
        if not out and self.here is not None:
            return self.here.innovations
        if out not in self._known:
            model = self.fit.model
            for name in sorted(out):
                model = model.without_effect(name)
            _, told = predicted(self.fit, model, self.bandwidth)
            self._known[out] = np.concatenate([p.innovations for p in told]) if is_bounded(told) else None
        return self._known[out]

    def _rows(self, names: Collection[str]) -> list[int]:
        """Rows of the effects' parameters among the free ones."""
        return [row for row, place in enumerate(self.fit.free) if self.fit.model.names[place].split(".")[0] in names]
