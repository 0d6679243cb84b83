"""The reference governor: a reference that the torques can follow."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from mpc.corridor import SOFT
from mpc.kernel import Kernel, unrolled
from mpc.prepared import prepared
from mpc.slots import Path
from mpc.split import MACHINE, reach
from mpc.weights import TUNING

Array = NDArray[np.float64]

_USED = 0.85
"""Share of the reachable acceleration that the governed reference may ask for; the rest is left to feedback."""

_SURE = 0.75
"""Share of that acceleration, and of its mean in both senses, with which it brakes before a limit: friction helps to
brake, but ends with the motion."""


_ANY = 1e30
"""Of a change of the acceleration: any, where nothing has to be kept together."""

_THERE = 1e-6
"""Distance at which a move is over, in units of what the torques attain in a sample."""

_JUMP = 8.0
"""Change of the reference's speed that is a jump, in units of what the torques attain in a sample: to follow it takes
several samples."""


def time_optimal_acceleration(error: Any, rate: Any, limits: tuple[Any, Any], step: Any) -> Any:
    """Acceleration that brings a double integrator to rest at zero in least time, in discrete time, as an expression.

    The control law of Han ("From PID to active disturbance rejection control", 2009, eq. 3), with one limit for each
    sense: unlike the switching curve of continuous time it ends exactly at zero after finitely many steps and does not
    chatter there. The curve is that of the sense which brakes.

    Args:
        error, rate: position and its rate [rad], [rad/s].
        limits: greatest acceleration backward and forward [rad/s^2], both above zero.
        step: time step [s].
    """
    backward, forward = limits
    a0 = step * rate
    y = error + a0
    d = ca.if_else(y > 0, forward, backward) * step**2
    a1 = ca.sqrt(d * (d + 8.0 * ca.fabs(y)))
    a = a0 + ca.if_else(ca.fabs(y) <= d, y, ca.copysign((a1 - d) / 2.0, y))
    return ca.fmax(ca.fmin(-a / step**2, forward), -backward)


def _fastest(room: Any, acceleration: Any, dt: Any) -> Any:
    """Greatest speed from which it can still be stopped within some room, in discrete time [rad/s]."""
    braked = acceleration * (ca.sqrt(ca.fmax(dt**2 / 4, 2 * room / acceleration)) - dt / 2)
    return ca.fmax(braked, ca.fmin(room / dt, acceleration * dt))


def unhurried(distance: Any, jerk: Any) -> Any:
    """Acceleration at which a move over a distance takes so long that the torques can change in a quarter of it.

    From full acceleration to full braking, with a greatest rate of change [rad/s^3] of four times `jerk`.
    """
    return (ca.fmin(jerk, _ANY) * ca.sqrt(ca.fabs(distance))) ** (2 / 3)


@cache
def hurry() -> Any:
    """How fast a move is made, as a `casadi.Function`.

    (governed and wanted angle, the same function's answer one sample before, attainable change, `jerk` of `unhurried`)
    -> acceleration beside that of the reference [rad/s^2]; as of the farthest sample of the move, zero without one.
    """
    path, wanted, before = ca.SX.sym("path"), ca.SX.sym("wanted"), ca.SX.sym("before")
    attainable, jerk = ca.SX.sym("attainable"), ca.SX.sym("jerk")
    off, held = path - wanted, ca.if_else(before >= 0, before, 0)
    kept = ca.if_else(ca.fabs(off) > _THERE * attainable, held, 0)
    pull = ca.fmax(unhurried(off, jerk), kept)
    return ca.Function("hurry", [path, wanted, before, attainable, jerk], [pull], {"cse": True})


@cache
def governed(limited: bool = False) -> Any:
    """One sample of the governed reference, as a `casadi.Function`.

    (angle and rate (2,), wanted angle now and at the two samples to come (3,), greatest acceleration backward and
    forward, and beside that of the reference (3,), soft limits (see `SoftLimits.numbers`), sample time) -> angle and
    rate (2,) at the next sample. If it is limited it brakes before a limit, whatever is wanted.
    """
    path, wanted, limits, dt = ca.SX.sym("path", 2), ca.SX.sym("wanted", 3), ca.SX.sym("limits", 3), ca.SX.sym("dt")
    soft, asked = ca.SX.sym("soft", SOFT), wanted
    if limited:
        asked = ca.fmin(ca.fmax(wanted, soft[0]), soft[1])
    (angle, rate), (backward, forward, most) = ca.vertsplit(path), ca.vertsplit(limits)
    speed = (asked[1] - asked[0]) / dt
    turn = ((asked[2] - asked[1]) / dt - speed) / dt
    own = ca.fmin(ca.fmax(turn, -backward), forward)
    least = 0.2 * ca.fmin(forward, backward)
    room = [ca.fmin(ca.fmax(left, least), most) for left in (backward + own, forward - own)]
    pull = time_optimal_acceleration(angle - asked[0], rate - speed, (room[0], room[1]), dt)
    next_angle, next_rate = angle + dt * rate, rate + dt * ca.fmin(ca.fmax(own + pull, -backward), forward)
    if limited:
        least, greatest = (_SURE * ca.fmin(brake, (backward + forward) / 2) for brake in (forward, backward))
        up = ca.fmin(_fastest(soft[1] - next_angle, greatest, dt), soft[2])
        down = ca.fmin(_fastest(next_angle - soft[0], least, dt), soft[2])
        next_rate = ca.fmin(next_rate, ca.fmax(up, rate - dt * backward))
        next_rate = ca.fmax(next_rate, -ca.fmax(down, -rate - dt * forward))
    return ca.Function("govern", [path, wanted, limits, soft, dt], [ca.vertcat(next_angle, next_rate)], {"cse": True})


@cache
def jump() -> Any:
    """Whether the reference jumps to a sample, as a `casadi.Function`.

    (wanted angle around that sample (3,), attainable change) -> whether it does.
    """
    wanted, attainable = ca.SX.sym("wanted", 3), ca.SX.sym("attainable")
    before, change = wanted[1] - wanted[0], wanted[2] - wanted[1]
    jumps = ca.logic_and(ca.fabs(before - change) > _JUMP * attainable, ca.fabs(change) < ca.fabs(before))
    return ca.Function("jump", [wanted, attainable], [jumps])


@cache
def early() -> Any:
    """Whether it is time to set out for a jump of the reference that is seen ahead, as a `casadi.Function`.

    (angle and rate (2,), wanted angle around that sample (3,), how many samples ahead it is, greatest acceleration
    backward and forward (2,), sample time, `jerk` of `unhurried`) -> whether it is time, and the change of the wanted
    angle from there on, in a sample.

    A jump is followed with least squared error by a move that has its middle where the jump is: so it is time if the
    sample is no farther ahead than half of the least time to it takes, and a move that is under way goes on.
    """
    path, wanted, limits = ca.SX.sym("path", 2), ca.SX.sym("wanted", 3), ca.SX.sym("limits", 2)
    count, dt, jerk, change = ca.SX.sym("count"), ca.SX.sym("dt"), ca.SX.sym("jerk"), wanted[2] - wanted[1]
    error, rate = path[0] - (wanted[1] - count * change), path[1] - change / dt
    a = ca.fmin(ca.fmin(limits[0], limits[1]), unhurried(error, jerk))
    sense = ca.sign(error + rate * ca.fabs(rate) / (2 * a))
    least = sense * rate / a + 2 * ca.sqrt(ca.fmax(rate**2 / (2 * a**2) + sense * error / a, 0))
    due = count * dt <= least / ca.if_else(sense * rate < 0, 1, 2)
    return ca.Function("early", [path, wanted, count, limits, dt, jerk], [due, change], {"cse": True})


@cache
def followable() -> Any:
    """What the torques can follow, as a `casadi.Function`.

    (angle and velocity of the load, torque that it takes without accelerating, machine, tuning) -> greatest
    acceleration backward and forward (2,) [rad/s^2], and from how far off [rad] the governed reference begins anew.
    """
    state, load = ca.SX.sym("state", 2), ca.SX.sym("load")
    numbers, tuning = ca.SX.sym("machine", MACHINE), ca.SX.sym("tuning", TUNING)
    inertia, greatest, wave = tuning[4], tuning[5], tuning[6]
    ends = reach()(state[1], 0.0, numbers)
    floor = 0.1 * greatest
    backward = ca.fmax(_USED * (load - ends[0]), floor) / inertia
    forward = ca.fmax(_USED * (ends[1] - load), floor) / inertia
    near = 10 * ((backward + forward) / 2 / wave**2)
    return ca.Function("followable", [state, load, numbers, tuning], [ca.vertcat(backward, forward), near])


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
        speeds: (N + 1,) of what was governed last, each until the next sample [rad/s].
        path: all that is remembered: whether there is a governed reference, its angle [rad] and rate [rad/s], and how
            fast the move is made that is under way, see `hurry`.
    """

    sample_time: float
    soft: Array | None = None
    attainable: float = float("inf")
    jerk: float = float("inf")
    speeds: Array = field(default_factory=lambda: np.zeros(0), init=False)
    path: Array = field(default_factory=lambda: np.zeros(len(Path)), init=False)

    def restart(self, angle: float, rate: float) -> None:
        """Begin at an angle [rad] and speed [rad/s]."""
        self.path[:] = 1.0, angle, rate, 0.0

    def distance(self, angle: float) -> float:
        """How far an angle is from the governed reference now [rad]; inf before the first restart."""
        return abs(angle - float(self.path[Path.ANGLE])) if self.path[Path.GOVERNED] else float("inf")

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
            self._along[wanted.size] = _along(wanted.size, self.sample_time, self.soft)
        govern = self._along[wanted.size]
        start, windows, greatest, *_ = govern.inputs
        start[:] = self.path[Path.ANGLE : Path.MOVE]
        last = wanted.size - 1
        speed = wanted[-1] - wanted[-2]  # with this the reference goes on
        longer = np.append(wanted, wanted[-1] + np.arange(1.0, last + 3.0) * speed)
        lead, change = self._lead(longer, last, limits) if previewed else (0, 0.0)
        for place in range(3):
            windows[place::3] = longer[lead + place : lead + place + wanted.size] - lead * change
        move = self._hurry.inputs
        move[0][0], move[1][0], move[2][0] = self.path[Path.ANGLE], windows[0], self.path[Path.MOVE]
        self.path[Path.MOVE] = self._hurry()[0][0]
        greatest[0::3], greatest[1::3], greatest[2::3] = *limits, self.path[Path.MOVE]
        (path,) = govern()
        path = path.reshape(-1, 2)
        before, speed = self.path[Path.ANGLE : Path.MOVE]
        self.path[Path.ANGLE : Path.MOVE] = path[0]
        self.speeds = np.append(speed, path[:-1, 1])
        return np.append(before, path[:-1, 0])

    def _lead(self, wanted: Array, last: int, limits: tuple[float, float]) -> tuple[int, float]:
        """To which sample it sets out now, and the change of the wanted angle from there on.

        Behind the last sample that is known it goes on at its speed, so there is no jump.
        """
        if last not in self._jumps:
            self._jumps[last] = Kernel(unrolled(jump().map(last - 1), last - 1, jump()))
            self._jumps[last].inputs[1][:] = self.attainable
        jumps = self._jumps[last]
        for place in range(3):
            jumps.inputs[0][place::3] = wanted[place : place + last - 1]
        (found,) = jumps()
        count = int(found.argmax()) + 1
        if not found[count - 1]:
            return 0, 0.0
        early = self._early
        early.inputs[0][:], early.inputs[3][:] = self.path[Path.ANGLE : Path.MOVE], limits
        early.inputs[1][:], early.inputs[2][0] = wanted[count - 1 : count + 2], count
        due, change = early()
        return (count, float(change[0])) if due[0] else (0, 0.0)

    @cached_property
    def _hurry(self) -> Kernel:
        return Kernel(hurry(), {3: np.array([self.attainable]), 4: np.array([self.jerk])})

    @cached_property
    def _early(self) -> Kernel:
        return Kernel(early(), {4: np.array([self.sample_time]), 5: np.array([self.jerk])})

    @cached_property
    def _jumps(self) -> dict[int, Kernel]:
        return {}

    @cached_property
    def _along(self) -> dict[int, Kernel]:
        return {}


def _along(samples: int, sample_time: float, soft: Array | None) -> Kernel:
    of_time = prepared(governed(soft is not None))
    one = of_time.function
    kernel = Kernel(unrolled(one.mapaccum(samples), samples, one))
    if soft is not None:
        kernel.inputs[3][:] = np.tile(soft, samples)
    kernel.inputs[4][:] = np.tile(of_time.of(np.array([sample_time])), samples)
    return kernel
