"""The reference governor: a reference that the torques can follow."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from mpc.corridor import SOFT
from mpc.kernel import Kernel, fused
from mpc.prepared import prepared
from mpc.slots import Path
from mpc.time_optimal_law import early, governed, hurry, jump

Array = NDArray[np.float64]


def governed_path(
    limited: bool, path: Any, asked: Any, changes: Any, limits: Any, soft: Any, attainable: Any, jerk: Any, numbers: Any
) -> tuple[Any, Any, Any]:
    """The governed reference, as expressions: the path one sample on, governed angles and speeds (N + 1,).

    Args:
        limited: whether there are soft limits.
        path: see `Governor`.
        asked, changes: (N + 1,), (N + 2,) see `Governor.ask`.
        limits: (2,) greatest acceleration backward and forward [rad/s^2].
        soft: see `SoftLimits.numbers`.
        attainable, jerk: see `Governor`.
        numbers: prepared sample time.
    """
    govern = prepared(governed(limited)).function
    move = hurry()(path[Path.ANGLE], asked[0], path[Path.MOVE], attainable, jerk)
    bounds, now = ca.vertcat(limits, move), ca.vertcat(path[Path.ANGLE] - asked[0], path[Path.RATE])
    ahead, speeds = [], []
    for k in range(asked.numel()):
        ahead.append(asked[k] + now[0])
        speeds.append(now[1])
        now = govern(now, asked[k], changes[k : k + 2], bounds, soft, numbers)
    return ca.vertcat(path[Path.GOVERNED], ahead[1], speeds[1], move), ca.vertcat(*ahead), ca.vertcat(*speeds)


@lru_cache(maxsize=64)
def jumps(samples: int) -> Any:
    """Whether the reference jumps to each but the first and the last of so many samples: (wanted, attainable) ->."""
    wanted, attainable = ca.MX.sym("wanted", samples), ca.MX.sym("attainable")
    found = [jump()(wanted[k : k + 3], attainable) for k in range(samples - 2)]
    return ca.Function("jumps", [wanted, attainable], [ca.vertcat(*found)]).expand()


@dataclass(eq=False, kw_only=True)
class Governor:
    """Follow the wanted angle as closely as a bounded acceleration allows.

    A horizon much shorter than the time that it takes to brake cannot see that it goes too fast; with torques at
    their limits the loop then overshoots or cycles. So the controller follows a governed reference: equal to the wanted
    one as long as this can be followed, and time-optimal towards it otherwise.

    Attributes:
        sample_time: [s].
        soft: limits of angle and speed as numbers, None if there are none.
        attainable: by how much the torques can bend a path in a sample [rad]; what bends more is a jump.
        jerk: a quarter of how fast the acceleration may change in a move [rad/s^3].
        path: all that is remembered: whether there is a governed reference, its angle [rad] and rate [rad/s], and how
            fast the move is made that is under way, see `mpc.time_optimal_law.hurry`.
    """

    sample_time: float
    soft: Array | None = None
    attainable: float = float("inf")
    jerk: float = float("inf")
    path: Array = field(default_factory=lambda: np.zeros(len(Path)), init=False)

    def restart(self, angle: float, rate: float) -> None:
        """Begin at an angle [rad] and speed [rad/s]."""
        self.path[:] = 1.0, angle, rate, 0.0

    def govern(self, wanted: Array, limits: tuple[float, float], previewed: bool = False) -> Array:
        """The governed reference over the horizon, and one sample on.

        Args:
            wanted: (N + 1,) wanted angle from now on [rad].
            limits: greatest acceleration backward and forward [rad/s^2], both above zero.
            previewed: whether that is known and not only how the reference may go on; it then sets out early for what
                it could not follow.

        Returns:
            (N + 1,) governed angle from now on [rad].
        """
        if not self.path[Path.GOVERNED]:
            self.restart(float(wanted[0]), 0.0)
        if wanted.size not in self._along:
            self._along[wanted.size] = self._over(wanted.size)
        along = self._along[wanted.size]
        _, asked, changes, greatest, *_ = along.inputs
        self.ask(wanted, np.diff(wanted), asked, changes, limits if previewed and self.sees_a_jump(wanted) else None)
        greatest[:] = limits
        path, ahead, _ = along()
        self.path[:] = path
        return ahead.copy()

    def ask(
        self, wanted: Array, steps: Array, asked: Array, changes: Array, limits: tuple[float, float] | None
    ) -> None:
        """What is asked for at each sample (N + 1,), and its changes (N + 2,): the wanted angle, goes on at its speed.

        With limits it is the wanted angle behind the first jump, if it is time to set out for that.
        """
        last = steps.size
        asked[:], changes[:last], changes[last:] = wanted, steps, steps[-1]
        lead, change = (0, 0.0) if limits is None else self._lead(wanted, limits)
        if lead:
            longer = np.append(wanted, wanted[-1] + np.arange(1.0, last + 1.0) * (wanted[-1] - wanted[-2]))
            asked[:] = longer[lead : lead + last + 1] - lead * change
            changes[: last - lead], changes[last - lead :] = steps[lead:], steps[-1]

    def sees_a_jump(self, wanted: Array) -> bool:
        """Whether the wanted angle (N + 1,) jumps somewhere. Behind its end it goes on at its speed."""
        return wanted.size > 2 and bool(self._jumps(wanted).any())

    def _lead(self, wanted: Array, limits: tuple[float, float]) -> tuple[int, float]:
        """To which sample it sets out now, and the change of the wanted angle from there on."""
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
        arrays = {"path": self.path, "asked": np.zeros(samples), "changes": np.zeros(samples + 1)}
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
