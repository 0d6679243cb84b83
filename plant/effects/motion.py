"""The motion of a fitted model along a log, for effects to say how they would show in it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
Place: TypeAlias = Literal["torque", "reading"]
"""What a cause adds to: the torque on the load, or the reading."""
TURN = 2.0 * np.pi


@dataclass(frozen=True, kw_only=True)
class Covered:
    """What a log covers.

    Attributes:
        low, high: least and greatest angle of the load [rad].
        speed: typical [rad/s].
        duration: of the longest run [s].
        inertia: of the load, by the model at hand [N m s^2/rad].
        turn: of the load [rad]; 0 on a linear axis, which has none.
        ways: how far the load goes, forth and back, before an instant [s] and after it [rad].
    """

    low: float
    high: float
    speed: float
    duration: float
    inertia: float
    turn: float
    ways: Callable[[float], tuple[float, float]]

    @property
    def travel(self) -> float:
        """From the least angle to the greatest [rad]."""
        return self.high - self.low


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """What a fitted model did over one log, for an effect to say how its trace would look.

    Attributes:
        time: (T,) [s].
        angle: (T,) filtered load angle [rad].
        velocity: (T,) filtered load velocity [rad/s].
        acceleration: (T,) of the model [rad/s^2].
        command: (T,) as the log has it: a torque, or servo gain times goal [N m].
        servo_gain: (T,) fall of the drive's torque with the angle [N m/rad]; 0 where the log gives the torque.
        torque: (T,) torque command after the drive's law [N m].
        score: (T, S) how much a load torque at each sample would improve the fit: half the squared innovations that it
            would take away, per N m [rad^2/(N m)]; by each of S views of what else there is.
        reading_score: (T, S) the same for an error of the reading at each sample, per rad [rad^2/rad].
        chance: the first of both scores (T, M) for M draws of white noise in place of the innovations; by default there
            are none.
        run: (T,) index of the run of each sample.
        inertia: J of the fitted model [N m s^2/rad].
        velocity_resolution: velocity below which its sign is not known [rad/s].
        law: torque (T,) that the drive gives for a command (T,), at the measured angle [N m].
        arriving: what of a torque (T,) behind the drive's law arrives at the load (T,), by the model at hand [N m].
        turn: of the load [rad]; 0 on a linear axis, which has none.
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
        """The scores (T, S) of what acts there, and those (T, M) that chance has."""
        place = ("torque", "reading").index(acts_on)
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
        """(m,) coefficients with which the columns (T, m) of a trace show: each half as much as the one before.

        The first by a tenth of the rms torque, or as an error of the reading by a fiftieth of the angle's spread.
        """
        level = 0.1 * np.sqrt(np.mean(self.torque**2)) if acts_on == "torque" else 0.02 * np.std(self.angle)
        rms = np.sqrt(np.mean(columns**2, axis=0))
        share = 0.5 ** np.arange(columns.shape[1])
        return np.asarray(level * np.divide(share, rms, out=np.zeros_like(rms), where=rms > 0.0))

    def by_run(self, follow: Callable[[NDArray[np.intp]], Array]) -> Array:
        """(T, ...) what `follow` gives for the samples of each run, one run after the other."""
        return np.concatenate([follow(np.flatnonzero(self.run == run)) for run in np.unique(self.run)])
