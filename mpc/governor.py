"""The reference governor: it turns the reference into one that the torques can follow."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from mpc.kernel import Kernel, fused
from mpc.prepared import prepared
from mpc.slots import Path
from mpc.soft_limits import SOFT
from mpc.time_optimal_law import early, governed, hurry, jump

Array = NDArray[np.float64]


def governed_path(
    limited: bool,
    path: Any,
    requested: Any,
    changes: Any,
    limits: Any,
    soft: Any,
    attainable: Any,
    jerk: Any,
    numbers: Any,
) -> tuple[Any, Any, Any]:
    """The governed reference, as expressions: the path at the next sample, governed angles and speeds (N + 1,).

    Args:
        limited: whether there are soft limits.
        path: see `Governor`.
        requested, changes: (N + 1,), (N + 2,) see `Governor.ask`.
        limits: (2,) greatest acceleration backward and forward [rad/s^2].
        soft: see `SoftLimits.numbers`.
        attainable, jerk: see `Governor`.
        numbers: prepared from the sample time, see `mpc.prepared`.
    """
    govern = prepared(governed(limited)).function
    move = hurry()(path[Path.ANGLE], requested[0], path[Path.MOVE], attainable, jerk)
    bounds, now = ca.vertcat(limits, move), ca.vertcat(path[Path.ANGLE] - requested[0], path[Path.RATE])
    ahead, speeds = [], []
    for k in range(requested.numel()):
        ahead.append(requested[k] + now[0])
        speeds.append(now[1])
        now = govern(now, requested[k], changes[k : k + 2], bounds, soft, numbers)
    return ca.vertcat(path[Path.GOVERNED], ahead[1], speeds[1], move), ca.vertcat(*ahead), ca.vertcat(*speeds)


@lru_cache(maxsize=64)
def jumps(samples: int) -> Any:
    """(wanted, attainable) -> whether the reference jumps, for each sample but the first and the last."""
    wanted, attainable = ca.MX.sym("wanted", samples), ca.MX.sym("attainable")
    found = [jump()(wanted[k : k + 3], attainable) for k in range(samples - 2)]
    return ca.Function("jumps", [wanted, attainable], [ca.vertcat(*found)]).expand()


@dataclass(eq=False, kw_only=True)
class Governor:
    """Follow the wanted angle as closely as a bounded acceleration allows.

    With a horizon much shorter than the braking time the controller brakes too late; with saturated torques the loop
    then overshoots or has a limit cycle. So the controller follows a governed reference: it equals the wanted one as
    long as the torques can follow that, and approaches it in minimum time otherwise.

    Attributes:
        sample_time: [s].
        soft: limits of angle and speed as numbers (see `SoftLimits.numbers`), None if there are none.
        attainable: greatest second difference of the angle that the torques can give in a sample [rad].
        jerk: a quarter of the greatest rate of the acceleration in a move [rad/s^3].
        path: the state: whether there is a governed reference, its angle [rad] and rate [rad/s], and the acceleration
            of the present move, see `mpc.time_optimal_law.hurry`.
    """

    sample_time: float
    soft: Array | None = None
    attainable: float = float("inf")
    jerk: float = float("inf")
    path: Array = field(default_factory=lambda: np.zeros(len(Path)), init=False)

    def restart(self, angle: float, rate: float) -> None:
        """Restart at an angle [rad] and speed [rad/s]."""
        self.path[:] = 1.0, angle, rate, 0.0

    def govern(self, wanted: Array, limits: tuple[float, float], previewed: bool = False) -> Array:
        """The governed reference over the horizon; the state moves on by one sample.

        Args:
            wanted: (N + 1,) wanted angle from now on [rad].
            limits: greatest acceleration backward and forward [rad/s^2], both above zero.
            previewed: whether `wanted` is known in advance and not extrapolated; a move to a jump then starts early.

        Returns:
            (N + 1,) governed angle from now on [rad].
        """
        if not self.path[Path.GOVERNED]:
            self.restart(float(wanted[0]), 0.0)
        if wanted.size not in self._along:
            self._along[wanted.size] = self._over(wanted.size)
        along = self._along[wanted.size]
        _, requested, changes, greatest, *_ = along.inputs
        self.ask(
            wanted, np.diff(wanted), requested, changes, limits if previewed and self.sees_a_jump(wanted) else None
        )
        greatest[:] = limits
        path, ahead, _ = along()
        self.path[:] = path
        return ahead.copy()

    def ask(
        self, wanted: Array, steps: Array, requested: Array, changes: Array, limits: tuple[float, float] | None
    ) -> None:
        """Fill the target (N + 1,) and its changes (N + 2,): the wanted angle, extended at its last speed.

        With `limits` it is the wanted angle after the first jump, as soon as the move to that jump has to start.
        """
        last = steps.size
        requested[:], changes[:last], changes[last:] = wanted, steps, steps[-1]
        lead, change = (0, 0.0) if limits is None else self._lead(wanted, limits)
        if lead:
            longer = np.append(wanted, wanted[-1] + np.arange(1.0, last + 1.0) * (wanted[-1] - wanted[-2]))
            requested[:] = longer[lead : lead + last + 1] - lead * change
            changes[: last - lead], changes[last - lead :] = steps[lead:], steps[-1]

    def sees_a_jump(self, wanted: Array) -> bool:
        """Whether the wanted angle (N + 1,) has a jump. After its end it continues at its last speed."""
        return wanted.size > 2 and bool(self._jumps(wanted).any())

    def _lead(self, wanted: Array, limits: tuple[float, float]) -> tuple[int, float]:
        """Sample of the jump to which a move starts now (0: none), and change of the wanted angle per sample there."""
        count = int(self._jumps(wanted).argmax()) + 1
        early = self._early
        early.inputs[0][:], early.inputs[3][:] = self.path[Path.ANGLE : Path.MOVE], limits
        early.inputs[1][:], early.inputs[2][0] = wanted[count - 1 : count + 2], count
        due, change = early()
        return (count, float(change[0])) if due[0] else (0, 0.0)

    def _jumps(self, wanted: Array) -> Array:
        if wanted.size not in self._found:
            self._found[wanted.size] = Kernel(jumps(wanted.size), {1: np.array([self.attainable])})
        found = self._found[wanted.size]
        found.inputs[0][:] = wanted
        return found()[0]

    def _over(self, samples: int) -> Kernel:
        limited = self.soft is not None
        soft = np.zeros(SOFT) if self.soft is None else self.soft
        arrays = {"path": self.path, "requested": np.zeros(samples), "changes": np.zeros(samples + 1)}
        arrays |= {"limits": np.zeros(2), "soft": soft, "attainable": np.array([self.attainable])}
        arrays["jerk"] = np.array([self.jerk])
        arrays["numbers"] = prepared(governed(limited)).of(np.array([self.sample_time]))

        def build(**given: Any) -> dict[str, Any]:
            return dict(zip(("path", "ahead", "speeds"), governed_path(limited, **given), strict=True))

        return fused("governed", arrays, " ".join(arrays), build, operations=100 * samples)

    @cached_property
    def _early(self) -> Kernel:
        return Kernel(early(), {4: np.array([self.sample_time]), 5: np.array([self.jerk])})

    @cached_property
    def _found(self) -> dict[int, Kernel]:
        return {}

    @cached_property
    def _along(self) -> dict[int, Kernel]:
        return {}
