"""Lost motion of two opposed drives, from sweeps of their preload at standstill.

While the preload is swept through both signs, each drive changes from one flank to the other, and the load nearly
stands still. On the flank s = +-1 of drive i its twist, rotor less load as seen from the load, is

    q_i - x = c_i + s gap_i/2 + T_i/k_i,    T_i = D_i -+ s (f_i + mu_i |T_i|)

with D_i the torque of the drive, T_i the torque that its contact transmits, k_i the contact stiffness, f_i constant
friction and mu_i the coefficient of load-dependent friction (- while |T_i| grows, + while it falls). Solved for T_i the
twist is linear in five numbers per drive: c_i, the intercepts of loading and unloading, the slopes of both.

The motors' encoders are finer than the load's by the gear ratio. Their difference does not depend on the load's angle
and gives the sum of both backlashes; only its division between the drives needs the load's encoder. The measurements of
that encoder have the likelihood of rounded values. All numbers are estimated at once by maximum likelihood.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.errors import Unidentifiable
from identification.log import Log
from identification.lost_motion.flank_visits import FlankSamples, flank_samples
from identification.lost_motion.likelihood import most_likely
from plant.drive_train import DriveTrain
from plant.result_display import Drawn
from plant.uncertain_number import measured

Array = NDArray[np.float64]

_LEAST = 50  # samples on each flank


@dataclass(frozen=True, kw_only=True)
class Measured:
    """A value and its standard error, extremely large if the log does not determine the value."""

    value: float
    std: float


@dataclass(frozen=True, kw_only=True)
class DriveLostMotion:
    """Lost motion of one drive, referred to the load.

    Attributes:
        gap: backlash from flank to flank [rad].
        stiffness: of the contact [N m/rad].
        friction: load-independent friction of the motor and its gears at the speed of the sweep [N m].
        friction_coefficient: friction per transmitted torque [-].
    """

    gap: Measured
    stiffness: Measured
    friction: Measured
    friction_coefficient: Measured


@dataclass(frozen=True, kw_only=True)
class LostMotion(Drawn):
    """Result of sweeps of the preload.

    Attributes:
        drives: of each drive.
        total_gap: sum of both backlashes [rad], from the motors' encoders.
        encoder_noise: of the load's angle before quantisation, standard deviation [rad].
        samples, visits: numbers that were used.
    """

    drives: tuple[DriveLostMotion, DriveLostMotion]
    total_gap: Measured
    encoder_noise: float
    samples: int
    visits: int

    def __str__(self) -> str:
        """The backlashes with their standard errors."""
        first, second, both = (
            measured(1e3 * gap.value, 1e3 * gap.std, "mrad")
            for gap in (*(drive.gap for drive in self.drives), self.total_gap)
        )
        return f"backlash {first} and {second}; together {both}"


def lost_motion(log: Log, gears: DriveTrain) -> LostMotion:
    """Backlash, stiffness and friction of both drives, from a log in which the preload is swept at standstill.

    The log has `torque_1`, `torque_2`, `angle`, `angle_1` and `angle_2`; its longest run is used. Each flank should be
    visited several times; in each visit the preload rises and falls slowly, and does not reach zero before it reverses.
    Resolution and noise of the encoders are estimated from the measurements; those of a motor, referred to the load,
    must be small compared with the backlash. The backlash does not depend on the scale of the torques; the rest does.
    If the noise of the load's encoder is below a third of a count, the load must move slowly over a few counts during
    the sweep, more slowly than the contact deflection changes.

    Raises:
        MalformedLog: a channel is missing.
        Unidentifiable: there are too few samples on one of the flanks, or the load's measurement never changes.
    """
    samples = flank_samples(max(log.runs, key=len), gears)
    _need_both_flanks(samples)
    found = most_likely(samples)
    values, slopes = _physical(found.numbers), _slopes(found.numbers)
    std = np.sqrt(np.diag(slopes @ found.covariance @ slopes.T))
    lines = [Measured(value=float(value), std=float(each)) for value, each in zip(values, std, strict=True)]
    return LostMotion(
        drives=(_drive(lines[0:4]), _drive(lines[4:8])),
        total_gap=lines[8],
        encoder_noise=found.noise,
        samples=samples.measured.size,
        visits=int(np.unique(samples.visit).size),
    )


def _need_both_flanks(samples: FlankSamples) -> None:
    for flank in (-1.0, 1.0):
        for loading in (True, False):
            found = int(np.min(np.sum((samples.flank == flank) & (samples.loading == loading), axis=0)))
            if found < _LEAST:
                way = "grows" if loading else "falls"
                raise Unidentifiable(
                    f"the torque on flank {flank:+.0f} of each drive {way} in only {found} samples: sweep the preload "
                    "up and down in both directions, and let the load move more slowly than the sweep."
                )
    if np.ptp(samples.measured) == 0.0:
        raise Unidentifiable(
            "the load encoder never changes: let the load move slowly over a few counts during the sweep."
        )


def _drive(lines: list[Measured]) -> DriveLostMotion:
    backlash, stiffness, friction, coefficient = lines
    return DriveLostMotion(gap=backlash, stiffness=stiffness, friction=friction, friction_coefficient=coefficient)


def _physical(numbers: NDArray[Any]) -> NDArray[Any]:
    """(9,) gap, k, f, mu of each drive and the sum of the gaps, from the (10,) numbers of `SweepEstimate`.

    With L = 1 loading and -1 unloading, intercept = gap/2 - L f slope and slope = 1/(k (1 + L mu)).
    """
    found = []
    for _, loaded, unloaded, give, give_back in numbers.reshape(2, 5):
        friction = (unloaded - loaded) / (give + give_back)
        stiffness = 0.5 * (1.0 / give + 1.0 / give_back)
        found += [2.0 * (loaded + friction * give), stiffness, friction, (give_back - give) / (give_back + give)]
    return np.array([*found, found[0] + found[4]])


def _slopes(numbers: Array) -> Array:
    """(9, 10) derivatives of `_physical`, by complex steps."""
    return np.column_stack([_physical(numbers + 1e-30j * row).imag / 1e-30 for row in np.eye(numbers.size)])
