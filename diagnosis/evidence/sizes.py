"""How large effects are beside the discrepancy, in one currency: what each of them changes in the innovations.

Torques, delays, lags and measurement errors compare in it, but only where the innovations are white: of a free-run
simulation the slowest of them would be all. So it is asked behind the observer that the base model needs.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from diagnosis.evidence.discrepancy import Responses
from diagnosis.evidence.families import Families
from diagnosis.evidence.linearised import Linearised, is_bounded, predicted
from diagnosis.levels import INEXACT
from diagnosis.nuisance import Nuisance, basis
from identification.fit_result import Fit
from plant.effects.effect import Array
from plant.effects.nonparametric import unnamed


@dataclass(frozen=True, kw_only=True, eq=False)
class Sizes:
    """Norms of changes of the innovations, beyond what all other parameters can follow [rad].

    Attributes:
        fit: of a set of effects.
        names: of them.
        bandwidth: of the observer behind which is asked [rad/s].
        here: the fit behind it; None where its motion grows without bound: then each effect is larger than all else.
        discrepancy: of what has no name.
        excluded: effects of the catalogue that may not be named.
    """

    fit: Fit
    names: frozenset[str]
    bandwidth: float
    here: Linearised | None
    discrepancy: float
    excluded: frozenset[str] = frozenset()

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
    def without_name(self) -> float:
        """Of the discrepancy, and of what stands without a name in the place of an effect."""
        instead = [self.effects[each] for each in sorted(self.names.intersection(unnamed)) if self.here is not None]
        return float(np.hypot.reduce([self.discrepancy, *instead]))

    def to_exceed(self, name: str) -> float:
        """What an effect has to be larger than: what has no name, and what the law of another may be wrong by."""
        others = (size for other, size in self.effects.items() if other != name)
        return max(self.without_name, INEXACT * max(others, default=0.0))

    @cached_property
    def effects(self) -> dict[str, float]:
        """Of each effect, if it is taken out."""
        return {name: self.beyond(name) for name in sorted(self.names)}

    def beyond(self, name: str, without: frozenset[str] = frozenset()) -> float:
        """Of an effect, if it is taken out where others are out already, which then hide nothing of it."""
        if self.here is None or name not in self._changes:
            return np.inf
        owners = [self.fit.model.names[place].split(".")[0] for place in self.fit.free]
        rows = [row for row, owner in enumerate(owners) if owner not in without | {name}]
        change = self._triangle[:, len(owners) + list(self._changes).index(name)]
        held = basis(self._triangle[:, rows])
        return float(np.linalg.norm(change - held @ (held.T @ change)))

    @cached_property
    def beyond_special(self) -> dict[str, tuple[str | None, float]]:
        """Of those that have a simpler effect as a special case: its name if it may have one, and what is beyond it."""
        found: dict[str, tuple[str | None, float]] = {}
        for effect in self.fit.model.effects if self.here is not None else ():
            for special in effect.reduced()[:1] if effect.name in self.names else ():
                if self.fit.model.effect(special.name) is None:
                    narrow = self.fit.model.without_effect(effect.name).with_effect(special)
                    _, told = predicted(self.fit, narrow, self.bandwidth)
                    change = np.inf
                    if is_bounded(told) and self.here is not None:
                        other = np.concatenate([p.innovations for p in told])
                        change = float(np.linalg.norm(Nuisance.of(told).beyond(other - self.here.innovations)))
                    found[effect.name] = None if special.name in self.excluded else special.name, change
        return found

    @cached_property
    def _changes(self) -> dict[str, Array]:
        """(T,) what each effect changes in the innovations, but for those without which the motion runs off."""
        found = {}
        for name in sorted(self.names) if self.here is not None else ():
            less = self.fit.model.without_effect(name)
            _, told = predicted(self.fit, less, self.bandwidth, sensitivities=False)
            if is_bounded(told) and self.here is not None:
                found[name] = np.concatenate([p.innovations for p in told]) - self.here.innovations
        return found

    @cached_property
    def _triangle(self) -> Array:
        """(F + E, F + E) the slopes of the parameters and what effects change, in a basis of what they span."""
        assert self.here is not None
        rows = range(len(self.fit.free))
        columns = np.column_stack((self.here.slopes(rows), *self._changes.values()))
        return np.asarray(np.linalg.qr(self.here.nuisance(rows).beyond_initial_states(columns), mode="r"))
