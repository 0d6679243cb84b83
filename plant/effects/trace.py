"""How an effect would show in a log: the motion of a fitted model, and the traces that effects draw along it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from plant.effects.effect import Effect

Array: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """What a fitted model did over one log, for an effect to say how its trace would look.

    Attributes:
        time: (T,) [s].
        angle: (T,) filtered load angle [rad].
        velocity: (T,) filtered load velocity [rad/s].
        acceleration: (T,) of the model [rad/s^2].
        command: (T,) as the log has it: a torque, or servo gain times goal [N m].
        torque: (T,) torque command after the drive's law [N m].
        score: (T,) how much a load torque at each sample would improve the fit: half the squared innovations that it
            would take away, per N m [rad^2/(N m)].
        reading_score: (T,) the same for an error of the reading at each sample, per rad [rad^2/rad].
        run: (T,) index of the run of each sample.
        inertia: J of the fitted model [N m s^2/rad].
        velocity_resolution: velocity below which its sign is not known [rad/s].
        arriving: what of a torque (T,) behind the drive's law arrives at the load (T,), by the model at hand [N m].
    """

    time: Array
    angle: Array
    velocity: Array
    acceleration: Array
    command: Array
    torque: Array
    score: Array
    reading_score: Array
    run: NDArray[np.intp]
    inertia: float
    velocity_resolution: float
    arriving: Callable[[Array], Array] = field(default=lambda torque: torque)

    @property
    def sample_time(self) -> float:
        """Median time step [s]."""
        return float(np.median(np.diff(self.time)))

    @property
    def sign(self) -> Array:
        """(T,) direction of motion, soft where the velocity is below its resolution."""
        return np.tanh(self.velocity / self.velocity_resolution)

    def by_run(self, follow: Callable[[NDArray[np.intp]], Array]) -> Array:
        """(T, ...) what `follow` gives for the samples of each run, one run after the other."""
        return np.concatenate([follow(np.flatnonzero(self.run == run)) for run in np.unique(self.run)])


@dataclass(frozen=True, kw_only=True, eq=False)
class Trace:
    """The torque, or the error of the reading, by which a small effect would show, at one choice of its shape.

    Attributes:
        columns: (T, m) torque on the load [N m], or error of the reading [rad], per unit of each coefficient.
        start: the effect that coefficients (m,) found by regression suggest.
        positive: (m,) which coefficients cannot be negative; none by default.
        searched: how many shapes were compared to find this one; where there are many peaks, the search is charged for.
        acts_on: whether the columns are torques or readings.
        prior: (m, m) covariance of the coefficients up to a factor, where they are not free but a smooth curve's.
    """

    columns: Array
    start: Callable[[Array], Effect]
    positive: tuple[bool, ...] = ()
    searched: int = 1
    acts_on: Literal["torque", "reading"] = "torque"
    prior: Array | None = None
