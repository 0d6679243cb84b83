"""The constraints at one instant as named rows: torque limits, contact, rates, lost drives."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from allocation.limits import Limits

Array = NDArray[np.float64]
Names = tuple[str, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Rows:
    """The constraints on the magnitudes x (m,) of the drive torques in their directions [N m].

        lower <= x <= upper,    preload[:, 0] <= P x <= preload[:, 1]

    P is the projection onto the null space of the structure: P x is the part of each drive's torque without effect on
    the joints. The rows are feasible for every demand, because `inside` satisfies all of them.

    Attributes:
        lower, upper: (m,) [N m].
        lower_names, upper_names: origin of each bound.
        projection: (m, m) P.
        inside: (m,) a feasible point [N m].
        preload: (m, 2) limits of P x [N m], or None.
    """

    lower: Array
    upper: Array
    lower_names: Names
    upper_names: Names
    projection: Array
    inside: Array
    preload: Array | None = None

    @classmethod
    def of(cls, bounds: Limits, acceleration: Array, floor: Array) -> Rows:
        """The bounds of each drive at joint accelerations (n,) [rad/s^2] (a number for one joint).

        If the greatest torque of a drive cannot keep contact, its lower bound is that greatest torque.
        """
        wanted = bounds.lower(acceleration, floor)
        flank = wanted > np.minimum(floor, bounds.least)
        numbers = range(1, bounds.structure.drives + 1)
        null_space = bounds.structure.signs[:, None] * bounds.structure.null_space
        lower = np.minimum(wanted, bounds.greatest)
        return cls(
            lower=lower,
            upper=bounds.greatest,
            lower_names=tuple(
                f"drive {i}: {'contact' if f else 'minimum'} torque" for i, f in zip(numbers, flank, strict=True)
            ),
            upper_names=tuple(f"drive {i}: greatest torque" for i in numbers),
            projection=null_space @ null_space.T,
            inside=lower,
        )

    def without(self, lost: NDArray[np.bool_], reversible: NDArray[np.bool_], reverse_torque: Array) -> Rows:
        """Rows with zero torque for lost drives and down to -`reverse_torque` for reversible ones."""
        lower = np.where(lost, 0.0, np.where(reversible, -reverse_torque, self.lower))
        upper = np.where(lost, 0.0, self.upper)
        lower_names = _renamed(_renamed(self.lower_names, reversible, "reverse torque"), lost, "lost")
        return replace(self, lower=lower, upper=upper, lower_names=lower_names, inside=np.clip(0.0, lower, upper))

    def limit_rate(self, before: Array, change: float, exempt: NDArray[np.bool_]) -> Rows:
        """Rows in which no torque changes by more than `change` [N m] from `before`; bounds beyond it are clipped."""
        least = np.where(exempt, -np.inf, before - change)
        most = np.where(exempt, np.inf, before + change)
        lower, upper = np.clip(self.lower, least, most), np.clip(self.upper, least, most)
        return replace(
            self,
            lower=lower,
            upper=upper,
            inside=np.clip(before, lower, upper),
            lower_names=_renamed(self.lower_names, lower != self.lower, "torque rate"),
            upper_names=_renamed(self.upper_names, upper != self.upper, "torque rate"),
        )

    def limit_preload_rate(self, before: Array, change: float) -> Rows:
        """Rows in which no drive's preload part changes by more than `change` [N m], unless other rows require it."""
        inside = np.clip(before, self.lower, self.upper)
        now, moved = self.projection @ before, self.projection @ inside
        window = np.stack((np.minimum(now - change, moved), np.maximum(now + change, moved)), axis=-1)
        return replace(self, preload=window, inside=inside)

    def binding(self, x: Array, tolerance: float) -> Names:
        """Names of the rows that hold with equality within `tolerance` [N m]."""
        at_lower, at_upper = x - self.lower <= tolerance, self.upper - x <= tolerance
        names = [
            *(name for name, held in zip(self.lower_names, at_lower, strict=True) if held),
            *(n for n, held, also in zip(self.upper_names, at_upper, at_lower, strict=True) if held and not also),
        ]
        if self.preload is not None:
            part = (self.projection @ x)[:, None]
            if np.any(np.abs(part - self.preload) <= tolerance):
                names.append("preload rate")
        return tuple(names)


def _renamed(names: Names, changed: NDArray[np.bool_], row: str) -> Names:
    """The names with the part after "drive 1: " replaced by `row` where the bound has changed."""
    return tuple(f"{name.split(':')[0]}: {row}" if moved else name for name, moved in zip(names, changed, strict=True))
