"""Input delay: the command acts later, by whole samples and fractions of a sample."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from plant.effects.effect import Array, Effect, Expression, Motion, Regressors, Stage, parameter, within


@dataclass(frozen=True, kw_only=True)
class InputDelay(Effect):
    """Dead time between the command and the torque: bus cycles, computation.

    A delay within a sample switches from the old to the new command at that instant. The average of both would be
    wrong, because later stages are nonlinear. `plant.discrete` splits the step there.
    """

    name = "input_delay"
    title = "input delay"
    stage = Stage.ACTUATOR
    equation = r"\tau(t) \leftarrow \tau(t - T_d)"
    signature = "phase falls with frequency, amplitude does not"
    confused_with = ("actuator_lag", "compliance", "sensor_lag")

    time: float = parameter("s", "dead time", lower=0.0, lag=True)

    def delay(self) -> Expression:
        """The dead time."""
        return self.time

    @classmethod
    def regressors(cls, motion: Motion) -> Iterator[Regressors]:
        """The delayed command less the command, for delays from half a sample to a few tens of samples."""
        samples = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
        for delay in (n * motion.sample_time for n in samples):
            yield Regressors(
                columns=(motion.arriving(delayed(motion, delay)) - motion.arriving(motion.torque))[:, None],
                positive=(True,),
                start=lambda c, delay=delay: cls(time=within(delay * min(c[0], 2.0), cls, "time", floor=0.1 * delay)),  # type: ignore[misc]
                searched=len(samples),
            )


def delayed(motion: Motion, delay: float) -> Array:
    """(T,) mean over each sample of the held command, delayed [N m]."""
    past = np.empty_like(motion.torque)
    for run in np.unique(motion.run):
        of_run = motion.run == run
        time, torque = motion.time[of_run], motion.torque[of_run]
        charge = np.concatenate(([0.0], np.cumsum(torque[:-1] * np.diff(time))))
        dt = np.append(np.diff(time), motion.sample_time)
        edges = np.clip(np.stack((time, time + dt)) - delay, time[0], time[-1])
        past[of_run] = np.diff(np.interp(edges, time, charge), axis=0)[0] / dt
        past[of_run] = np.where(edges[0] <= time[0], torque[0], past[of_run])
    return past
