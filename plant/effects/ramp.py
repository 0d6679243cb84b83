"""A ramp: the state follows the input with a limited slope."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from plant.effects.effect import Array, Effect, Expression, Motion, Regressors
from plant.recursion_cache import recursion

_SLOWER = np.array([2.0, 5.0, 12.0, 30.0, 75.0, 150.0])  # ratios of the fastest change of the input to candidate rates


@dataclass(frozen=True, kw_only=True)
class Ramp(Effect):
    """An effect whose state follows its input by at most `rate` per second, in the unit of the input."""

    rate: float

    def advance(self, state: Expression, torque: Expression, h: Expression) -> Expression:
        """A ramp towards the input."""
        reach = self.rate * h
        return state + ca.fmax(ca.fmin(torque - state, reach), -reach)

    def settling_time(self, state: Expression, command: Expression) -> Expression:
        """Time until the ramp ends."""
        return ca.fabs(command - state) / self.rate

    def mean(self, state: Expression, torque: Expression, h: Expression) -> Expression:
        """Exact mean of the ramp and of the constant after it."""
        reach = self.rate * h
        share = ca.fmin(ca.fabs(torque - state) / ca.fmax(reach, 1e-30), 1)  # fraction of the time on the ramp
        return state + (self.advance(state, torque, h) - state) * (1 - share / 2)

    @classmethod
    def ramps(cls, motion: Motion, wanted: Array, command: Callable[[Array], Array]) -> Iterator[Regressors]:
        """Signatures for rates of 1/2 to 1/150 of the fastest change of the input: torque with the ramp less without.

        A limit above the fastest change has no effect. A step is a change within one sample.

        Args:
            motion: of the fitted model.
            wanted: (T,) input of the ramp.
            command: the drive's command (T,) [N m] for the output of the ramp (T,).
        """
        changes = motion.by_run(lambda rows: np.abs(np.diff(wanted[rows], prepend=wanted[rows[:1]])))
        fastest = float(np.max(changes)) / motion.sample_time
        if fastest <= 0.0:
            return
        rates = fastest / _SLOWER
        followed = motion.by_run(lambda rows: _followed(wanted[rows], rates * motion.sample_time))
        for place, rate in enumerate(rates):
            arriving = motion.arriving(motion.law(command(followed[:, place])))
            yield Regressors(
                columns=(arriving - motion.arriving(motion.torque))[:, None],
                positive=(True,),
                start=lambda c, rate=rate: cls(rate=float(rate)),  # type: ignore[misc]
                searched=_SLOWER.size,
            )


def _followed(wanted: Array, reach: Array) -> Array:
    """(T, R) mean over each sample of a state that follows `wanted` (T,) by at most `reach` (R,) a sample."""
    return _ramps(reach.size)((np.full(reach.size, wanted[0]),), wanted[:, None], reach)[1][0]


@recursion(carried=1)
def _ramps(count: int) -> Any:
    """Several ramps in parallel, and their means over a sample."""
    state, reach, wanted = ca.SX.sym("state", count), ca.SX.sym("reach", count), ca.SX.sym("wanted")
    difference = wanted - state
    step = ca.fmax(ca.fmin(difference, reach), -reach)
    share = ca.fmin(ca.fabs(difference) / reach, 1)  # fraction of the sample on the ramp
    outputs = [state + step, state + step * (1 - share / 2)]
    return ca.Function("ramps", [state, wanted, reach], outputs)
