"""The motion of a fitted model along a log, from which effects compute their signatures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
Place: TypeAlias = Literal["torque", "measurement"]
"""Where an effect adds: to the torque on the load, or to the measurement."""
TURN = 2.0 * np.pi


@dataclass(frozen=True, kw_only=True)
class Covered:
    """Range of a log.

    Attributes:
        low, high: least and greatest angle of the load [rad].
        speed: typical [rad/s].
        duration: of the longest run [s].
        inertia: of the load, by the present model [N m s^2/rad].
        turn: of the load [rad]; 0 on a linear axis.
        travelled: path length of the load, in both directions, before an instant [s] and after it [rad].
    """

    low: float
    high: float
    speed: float
    duration: float
    inertia: float
    turn: float
    travelled: Callable[[float], tuple[float, float]]

    @property
    def travel(self) -> float:
        """From the least angle to the greatest [rad]."""
        return self.high - self.low


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """Motion of a fitted model along one log, from which an effect computes its signature.

    Attributes:
        time: (T,) [s].
        angle: (T,) filtered load angle [rad].
        velocity: (T,) filtered load velocity [rad/s].
        acceleration: (T,) of the model [rad/s^2].
        command: (T,) as in the log: a torque, or servo gain times set-point [N m].
        servo_gain: (T,) decrease of the drive's torque with the angle [N m/rad]; 0 where the log gives the torque.
        torque: (T,) torque command after the drive's law [N m].
        score: (T, S) improvement of the fit by a load torque at each sample: reduction of half the squared innovations,
            per N m [rad^2/(N m)]; for each of S assumptions on the rest of the model.
        reading_score: (T, S) the same for a measurement error at each sample, per rad [rad^2/rad].
        chance: the first of both scores (T, M) for M draws of white noise in place of the innovations; by default there
            are none.
        run: (T,) index of the run of each sample.
        inertia: J of the fitted model [N m s^2/rad].
        velocity_resolution: velocity below which its sign is not known [rad/s].
        law: torque (T,) of the drive's law for a command (T,), at the measured angle [N m].
        arriving: torque at the load (T,) for a torque (T,) after the drive's law, by the present model [N m].
        turn: of the load [rad]; 0 on a linear axis.
    """

    time: Array
    angle: Array
    velocity: Array
    acceleration: Array
    command: Array
    servo_gain: Array
    torque: Array
    score: Array
    reading_score: Array
    run: NDArray[np.intp]
    inertia: float
    velocity_resolution: float
    law: Callable[[Array], Array] = field(default=lambda command: command)
    arriving: Callable[[Array], Array] = field(default=lambda torque: torque)
    chance: Callable[[], tuple[Array, Array]] | None = None
    turn: float = TURN

    def scores(self, acts_on: Place) -> tuple[Array, Array]:
        """The scores (T, S) of an effect on the torque or the measurement, and those (T, M) of white noise."""
        place = ("torque", "measurement").index(acts_on)
        score = (self.score, self.reading_score)[place]
        return score, self.chance()[place] if self.chance is not None else np.empty((len(score), 0))

    @property
    def sample_time(self) -> float:
        """Median time step [s]."""
        return float(np.median(np.diff(self.time)))

    @property
    def sign(self) -> Array:
        """(T,) direction of motion, soft where the velocity is below its resolution."""
        return np.tanh(self.velocity / self.velocity_resolution)

    def visible(self, columns: Array, acts_on: Place = "torque") -> Array:
        """(m,) coefficients at which the columns (T, m) of a signature are visible, each half of the one before.

        The first one gives a tenth of the rms torque, or a measurement error of a fiftieth of the angle's standard
        deviation.
        """
        level = 0.1 * np.sqrt(np.mean(self.torque**2)) if acts_on == "torque" else 0.02 * np.std(self.angle)
        rms = np.sqrt(np.mean(columns**2, axis=0))
        share = 0.5 ** np.arange(columns.shape[1])
        return np.asarray(level * np.divide(share, rms, out=np.zeros_like(rms), where=rms > 0.0))

    def by_run(self, follow: Callable[[NDArray[np.intp]], Array]) -> Array:
        """(T, ...) concatenated results of `follow` for the samples of each run."""
        return np.concatenate([follow(np.flatnonzero(self.run == run)) for run in np.unique(self.run)])
