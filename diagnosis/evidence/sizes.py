"""Sizes of the effects and of the discrepancy, in one unit: the change of the innovations by each of them.

In this unit torques, delays, lags and measurement errors are comparable, but only if the innovations are white: in a
free simulation the slowest errors would dominate. So sizes are calculated with the observer that the base model needs.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import erf

from diagnosis.evidence.discrepancy import Responses
from diagnosis.evidence.families import Families
from diagnosis.evidence.linearised import Linearised, is_bounded, predicted
from diagnosis.levels import INEXACT
from diagnosis.nuisance import Nuisance, basis
from identification.fit_result import Fit
from plant.effects.effect import Array
from plant.effects.nonparametric import unnamed

_NOTHING = 1e-10  # share of the largest direction; smaller ones are rounding errors


@dataclass(frozen=True, kw_only=True, eq=False)
class Sizes:
    """Norms of changes of the innovations, beyond the directions of all other parameters [rad].

    Attributes:
        fit: of a set of effects.
        names: of these effects.
        bandwidth: of the observer used here [rad/s].
        here: the fit linearised with it; None if its motion grows without bound: then each effect has infinite size.
        discrepancy: size of the discrepancy.
        excluded: effects of the catalogue that are not candidates.
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
        """Sizes for a fitted set and a discrepancy with coefficients `functions` (M + R,), with an observer."""
        bandwidth = max(observer, fit.bandwidth)
        here, discrepancy = Linearised.at(fit, bandwidth), 0.0
        if here is not None:
            columns = Responses.of(families, here.filters, noise).columns
            discrepancy = float(np.linalg.norm(here.nuisance().beyond(columns @ functions)))
        return cls(fit=fit, names=frozenset(names), bandwidth=bandwidth, here=here, discrepancy=discrepancy)

    @cached_property
    def unexplained(self) -> float:
        """Size of the unexplained part: of the discrepancy and the non-parametric effects together."""
        instead = [self.effects[each] for each in sorted(self.names.intersection(unnamed)) if self.here is not None]
        return float(np.hypot.reduce([self.discrepancy, *instead]))

    def to_exceed(self, name: str) -> float:
        """Size an effect has to exceed: the unexplained part, and a hundredth of the largest other effect."""
        others = (size for other, size in self.effects.items() if other != name)
        return max(self.unexplained, INEXACT * max(others, default=0.0))

    @cached_property
    def effects(self) -> dict[str, float]:
        """Size of each effect: the change if it is removed."""
        return {name: self.beyond(name) for name in sorted(self.names)}

    def beyond(self, name: str, without: frozenset[str] = frozenset()) -> float:
        """Size of an effect if the effects `without` are removed too; their parameters then absorb nothing of it."""
        if self.here is None or name not in self._changes:
            return np.inf
        change, others = self._apart(name, without)
        held = basis(others)
        return float(np.linalg.norm(change - held @ (held.T @ change)))

    def is_left(self, name: str, without: frozenset[str] = frozenset()) -> float:
        """Probability that what other terms leave of an effect is more than the error of their laws [-].

        No law is more exact than to a hundredth, here a standard deviation. Of a gravity offset of 4 N m beside 10 N m
        of a dead zone, 0.1 N m may be left, which is such an error. The effects `without` are removed, as in `beyond`.
        """
        if self.here is None or name not in self._changes:
            return 1.0
        change, others = self._apart(name, without)
        scale = np.maximum(np.linalg.norm(others, axis=0), 1e-300)
        absorbing = np.linalg.lstsq(others / scale, change, rcond=_NOTHING)[0]
        largest = max(float(np.linalg.norm(change)), float(np.max(np.abs(absorbing), initial=0.0)))
        return float(erf(self.beyond(name, without) / max(np.sqrt(2.0) * INEXACT * largest, 1e-300)))

    def _apart(self, name: str, without: frozenset[str]) -> tuple[Array, Array]:
        """Change by an effect, and the Jacobian of the parameters that may absorb it, both reduced to F + E rows."""
        owners = [self.fit.model.names[place].split(".")[0] for place in self.fit.free]
        rows = [row for row, owner in enumerate(owners) if owner not in without | {name}]
        return self._triangle[:, len(owners) + list(self._changes).index(name)], self._triangle[:, rows]

    @cached_property
    def beyond_special(self) -> dict[str, tuple[str | None, float]]:
        """For each effect with a special case: the name of that (None if excluded), and the size of the rest."""
        found: dict[str, tuple[str | None, float]] = {}
        for effect in self.fit.model.effects if self.here is not None else ():
            for special in effect.reduced()[:1] if effect.name in self.names else ():
                if self.fit.model.effect(special.name) is None:
                    narrow = self.fit.model.without_effect(effect.name).with_effect(special)
                    _, predictions = predicted(self.fit, narrow, self.bandwidth)
                    change = np.inf
                    if is_bounded(predictions) and self.here is not None:
                        other = np.concatenate([p.innovations for p in predictions])
                        change = float(np.linalg.norm(Nuisance.of(predictions).beyond(other - self.here.innovations)))
                    found[effect.name] = None if special.name in self.excluded else special.name, change
        return found

    @cached_property
    def _changes(self) -> dict[str, Array]:
        """(T,) change of the innovations if an effect is removed; left out if the motion then diverges."""
        found = {}
        for name in sorted(self.names) if self.here is not None else ():
            less = self.fit.model.without_effect(name)
            _, predictions = predicted(self.fit, less, self.bandwidth, sensitivities=False)
            if is_bounded(predictions) and self.here is not None:
                found[name] = np.concatenate([p.innovations for p in predictions]) - self.here.innovations
        return found

    @cached_property
    def _triangle(self) -> Array:
        """(F + E, F + E) triangular factor of the Jacobian of the parameters and the changes by the effects."""
        assert self.here is not None
        rows = range(len(self.fit.free))
        columns = np.column_stack((self.here.slopes(rows), *self._changes.values()))
        return np.asarray(np.linalg.qr(self.here.nuisance(rows).beyond_initial_states(columns), mode="r"))
