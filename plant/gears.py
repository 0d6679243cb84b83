"""The gear train: from tooth counts to speed ratios, torque map and preload direction.

Two driving gears D1, D2 mesh with one output gear F. "Pinion" is the driving gear of this final mesh; "motor" is the
shaft before the pre-reduction. Directions in the pre-reduction are counted so that a positive motor speed turns its
pinion positively. The only minus sign is that of the external final mesh in equations (1) and (2).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plant.drive_train import DriveTrain
from plant.errors import BadParameter
from plant.number import finite, refuse_huge, whole

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Ratios(DriveTrain):
    """One or two drives with known ratios instead of tooth counts: belts, worms, racks, gearboxes.

    Attributes:
        ratios: torque on the load for one newton metre of each drive, on a linear axis force [N/(N m)]; positive if
            both are counted in the same direction, negative otherwise.
        pre_reduction: turns of each motor for one turn of its drive; a number, or one each.

    Raises:
        BadParameter: no ratio or more than two, one that is zero or not a finite number, or a pre-reduction that is not
            above zero.
    """

    ratios: tuple[float, ...]
    pre_reduction: float | tuple[float, ...] = 1.0

    def __post_init__(self) -> None:
        """Check every number."""
        if not 1 <= len(self.ratios) <= 2:
            raise BadParameter(f"ratios must hold one number for each of one or two drives, not {self.ratios!r}.")
        for ratio in self.ratios:
            if not finite(ratio):
                raise BadParameter(f"A ratio must be a finite number other than 0, not {ratio!r}.")
            _refuse_extreme("ratio", ratio)
        given = np.asarray(self.pre_reduction, dtype=np.float64)
        if given.shape not in ((), (len(self.ratios),)) or not (np.isfinite(given).all() and (given > 0).all()):
            raise BadParameter(
                f"pre_reduction must be a number above zero, or one for each drive, not {self.pre_reduction!r}."
            )
        for turns in given.ravel().tolist():
            _refuse_extreme("pre_reduction", turns)

    @classmethod
    def parse(cls, text: str | float) -> Ratios:
        """From "8.05" for both drives, or one for each: "8.05,-8.05".

        Raises:
            BadParameter: the text has another form.
        """
        try:
            first, *others = (float(ratio) for ratio in str(text).split(","))
        except ValueError:
            raise BadParameter(
                f"The ratio is {text!r}; write it as 8.05, or one for each drive as 8.05,-8.05."
            ) from None
        if len(others) > 1:
            raise BadParameter(f"The ratio is {text!r}; there are two drives, so give one number or two.")
        return cls(ratios=(first, *(others or (first,))))

    @property
    def torque_map(self) -> Array:
        """(m,) torque on the load for one newton metre of each drive."""
        return np.array(self.ratios, dtype=np.float64)

    @property
    def pre_reductions(self) -> Array:
        """(m,) turns of each motor for one turn of its drive."""
        return np.broadcast_to(np.asarray(self.pre_reduction, dtype=np.float64), (len(self.ratios),)).copy()

    def __str__(self) -> str:
        """Text that `parse` reads."""
        return ",".join(f"{float(ratio)!r}" for ratio in self.ratios)


@dataclass(frozen=True, kw_only=True)
class GearTrain(DriveTrain):
    """Two pinions on one output gear, each with the same pre-reduction.

    With theta the angle of the output gear, tau_f its torque, and phi_i and xi_i the angle and torque of pinion i:

        phi_i = -(Nf/Ni) theta                                        (1)
        tau_f = -(Nf/N1) xi1 - (Nf/N2) xi2                            (2)
        xi    = particular(tau_f) + lambda [N1, -N2]                  (3)

    (equations 1 to 3 of the drive/anti-drive paper). The lambda term causes no motion: it only preloads the meshes, in
    the direction [+ -] for lambda > 0.

    Attributes:
        pinion_teeth: teeth (N1, N2) of the two driving gears.
        output_teeth: teeth Nf of the output gear.
        stages: (driven, driving) teeth of each pre-reduction stage between a motor and its pinion; empty if there is
            none.

    Raises:
        BadParameter: a tooth count that is not a positive whole number, or a stage that is not a pair.
    """

    pinion_teeth: tuple[int, int]
    output_teeth: int
    stages: tuple[tuple[int, int], ...] = ()

    def __post_init__(self) -> None:
        """Check every tooth count."""
        if len(self.pinion_teeth) != 2:
            raise BadParameter(f"pinion_teeth must hold two tooth counts (N1, N2), not {self.pinion_teeth!r}.")
        for stage in self.stages:
            if len(stage) != 2:
                raise BadParameter(f"Each stage must be a pair (driven teeth, driving teeth), not {stage!r}.")
        for count in chain(self.pinion_teeth, (self.output_teeth,), *self.stages):
            if (whole(count) or 0) < 1:
                raise BadParameter(f"A tooth count must be a positive whole number, not {count!r}.")

    @classmethod
    def paper(cls) -> GearTrain:
        """The paper's gear train: 46/18, 41/17, 42/21 and 161/20, a reduction of 99.231 to 1."""
        return cls(pinion_teeth=(20, 20), output_teeth=161, stages=((46, 18), (41, 17), (42, 21)))

    @classmethod
    def parse(cls, text: str) -> GearTrain:
        """The final mesh as text: "20,20:161" are two pinions of 20 teeth on a gear of 161.

        One count before the colon is that of both pinions. The torques are then those of the pinion shafts in their own
        direction, which the mesh reverses (eq. 2); for torques counted in the direction of the load, see `Ratios`.

        Raises:
            BadParameter: the text has another form, or a count is not a positive whole number.
        """
        pinions, colon, output = text.partition(":")
        try:
            counts = [int(count) for count in pinions.split(",")]
            if not colon or len(counts) > 2:
                raise ValueError(text)
            return cls(pinion_teeth=(counts[0], counts[-1]), output_teeth=int(output))
        except ValueError:
            raise BadParameter(
                f"The gears are {text!r}; write the teeth of both pinions and of the gear they drive as 20,20:161."
            ) from None

    @property
    def pre_reduction(self) -> float:
        """Motor turns for one turn of the pinion."""
        return float(np.prod([driven / driving for driven, driving in self.stages]))

    @property
    def pre_reductions(self) -> Array:
        """(2,) the pre-reduction of each drive; both are equal."""
        return np.full(2, self.pre_reduction)

    @property
    def torque_map(self) -> Array:
        """(2,) output torque for one newton metre on each pinion, equation (2)."""
        return -(self.output_teeth / np.array(self.pinion_teeth, dtype=np.float64))

    @property
    def null_vector(self) -> Array:
        """(2,) pinion torques [N1, -N2] that put no torque on the output gear, equation (3)."""
        n1, n2 = self.pinion_teeth
        return np.array([n1, -n2], dtype=np.float64)

    def __str__(self) -> str:
        """Text that `parse` reads."""
        first, second = self.pinion_teeth
        return f"{first},{second}:{self.output_teeth}"


def _refuse_extreme(name: str, ratio: float) -> None:
    """Raise `BadParameter` for a ratio that no gear has, too high or too low."""
    refuse_huge(name, ratio)
    refuse_huge(f"1/{name}", 1 / ratio)


def drive_train(text: Any) -> GearTrain | Ratios:
    """Tooth counts, "20,20:161", or ratios, "8.05" or "8.05,-8.05", from their text.

    Raises:
        BadParameter: it is neither.
    """
    return GearTrain.parse(str(text)) if ":" in str(text) else Ratios.parse(str(text))
