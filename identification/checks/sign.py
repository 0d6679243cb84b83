"""Test whether the command drives the motion or has the wrong sign, also for each of two torques.

Torque is inertia times acceleration plus terms of angle and speed. So the residual of the torque after regression on
these terms is proportional to that of the acceleration, and the slope is the inertia. Filters of several widths are
tried. The log is cut into blocks of equal squared acceleration, so that each has equal information; Student's t tests
the agreement of the blocks. A second statistic must not contradict: the work of the torque on the load. The first one
is unreliable for a single sine, because acceleration is then proportional to the angle; the second one is unreliable in
a loop that resists an external force, because the load does work there.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identification.checks.equation_error import gaussian, middle, motion_terms, resampled_evenly
from identification.recording import Array, Finding, Recording

WIDTHS = (1.5, 3.0, 6.0, 12.0, 24.0)  # standard deviations of the filter, in samples
BLOCKS = 12
SURE, DOUBTFUL, WORKS = 8.0, 4.0, 2.0  # Student's t: one log in 300 000, in 1000, in 30 by chance
_ONE_WAY = 0.9  # share of the absolute work by which braking must exceed driving


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """A recording after one filter: (N,) acceleration, speed and rows, and (N, n) other regressors.

    terms: orthonormal basis of friction, gravity and a constant; gravity: that of gravity and a constant; friction:
    regressors of friction alone.
    """

    sigma: float
    rows: NDArray[np.int64]
    acceleration: Array
    speed: Array
    terms: Array
    friction: Array
    gravity: Array

    def behind(self, command: Array) -> Array:
        """(N,) a command (T,) after the filter."""
        return np.asarray(gaussian(command, self.sigma)[self.rows])

    def inertia(self, command: Array) -> float:
        """Student's t of the inertia."""
        own = beyond(self.acceleration, self.terms)
        return agreement(own, beyond(self.behind(command), self.terms))

    def work(self, command: Array) -> float:
        """Student's t of the work on the load, without that against gravity."""
        return agreement(beyond(self.speed, self.gravity), beyond(self.behind(command), self.gravity))

    def unexplained(self, command: Array) -> Array:
        """(N,) squared residuals of a command after regression on acceleration, angle and speed, over its variance."""
        basis = np.linalg.qr(np.column_stack([self.terms, self.acceleration]))[0]
        centred = self.behind(command) - self.behind(command).mean()
        variance = float(centred @ centred) / len(centred)
        return beyond(centred, basis) ** 2 / variance if variance > 0 else np.ones_like(centred)


@dataclass(frozen=True, kw_only=True)
class Witnesses:
    """Student's t of inertia and of work."""

    inertia: float = 0.0
    work: float = 0.0

    @property
    def along(self) -> bool:
        """Whether the command significantly drives the motion."""
        return self.inertia > SURE and self.work > -WORKS

    @property
    def against(self) -> bool:
        """Whether the command significantly has the wrong sign."""
        return self.inertia < -SURE and self.work < WORKS


def views(recording: Recording) -> tuple[Recording, list[View]]:
    """The middle of a recording at even times, and its views (one per filter) that are long enough."""
    part = middle(recording)
    dt = float(np.median(np.diff(part.time)))
    count = round((part.time[-1] - part.time[0]) / dt) + 1
    if count > 4 * len(part):
        return part, []
    clock = part.time[0] + dt * np.arange(count)
    sound, output, command, _ = resampled_evenly(part, clock)

    def at(values: Array) -> Array:
        return np.asarray(np.interp(clock, part.time, values))

    part = replace(
        part,
        time=clock,
        command=command,
        output=output,
        servo_gain=at(part.servo_gain),
        servo_damping=at(part.servo_damping),
        others={name: at(values) for name, values in part.others.items()},
    )
    return part, [view for sigma in WIDTHS if (view := _view(part, sound, sigma)) is not None]


def _view(part: Recording, sound: Array, sigma: float) -> View | None:
    edge, dt = int(np.ceil(4 * sigma)), part.time[1] - part.time[0]
    rows = np.arange(edge, len(part.time) - edge, max(1, int(sigma / 4)), dtype=np.int64)
    rows = rows[gaussian(1.0 - sound, sigma)[rows] < 1e-3]
    if len(rows) * max(1, int(sigma / 4)) < 4 * sigma * BLOCKS or len(rows) < 5 * BLOCKS:
        return None
    output, velocity = gaussian(part.output, sigma), gaussian(part.output, sigma, 1) / dt
    if not np.ptp(velocity[rows]) > 0:
        return None
    terms = motion_terms(part, output, velocity, sigma)[rows]
    turning = [0, -2, -1] if part.axis == "rotary" else [0]  # a constant, and the cosine and sine of the angle
    return View(
        sigma=sigma,
        rows=rows,
        acceleration=gaussian(part.output, sigma, 2)[rows] / dt**2,
        speed=velocity[rows],
        terms=np.linalg.qr(terms)[0],
        friction=terms[:, 1:6],
        gravity=np.linalg.qr(terms[:, turning])[0],
    )


def beyond(values: Array, basis: Array) -> Array:
    """Residual of values (N,) after projection onto an orthonormal basis (N, n); zero if it is only rounding."""
    left = values - basis @ (basis.T @ values)
    return left if left @ left > 1e-16 * float(values @ values) else np.zeros_like(left)


def agreement(regressor: Array, target: Array) -> float:
    """Student's t of a slope over blocks with an equal sum of squares of the regressor (N,)."""
    return student(regressor * target, regressor**2) if target.any() else 0.0


def student(values: Array, weight: Array) -> float:
    """Student's t of the mean of values (N,) over blocks of equal weight (N,)."""
    gathered = np.cumsum(weight)
    if not gathered[-1] > 0:
        return 0.0
    edges = np.searchsorted(gathered / gathered[-1], np.linspace(0, 1, BLOCKS + 1)[1:-1])
    sums = np.array([block.sum() for block in np.split(values, edges)])
    scatter = float(sums.std(ddof=1)) * np.sqrt(BLOCKS)
    return float(sums.sum()) / scatter if scatter > 0 else 0.0


def undisputed(statistics: Sequence[float]) -> float:
    """The largest t in magnitude over the views; 0 if another view contradicts it."""
    best = max(statistics, key=abs)
    return 0.0 if any(t * np.sign(best) < -DOUBTFUL for t in statistics) else best


def usable_witnesses(command: Array, seen: Sequence[View]) -> Witnesses:
    """Both statistics of a command (T,)."""
    statistics = [view.inertia(command) for view in seen]
    view = seen[int(np.argmax(np.abs(statistics)))]
    return Witnesses(inertia=undisputed(statistics), work=view.work(command))


def opposed(first: Array, second: Array, seen: Sequence[View]) -> bool:
    """Whether the motion explains the difference of two torques (T,) significantly better than their sum."""
    statistics = []
    for view in seen:
        of_sum, of_difference = view.unexplained(first + second), view.unexplained(first - second)
        statistics.append(student(of_sum - of_difference, of_sum + of_difference))
    return undisputed(statistics) > SURE


def sign_of_the_command(recording: Recording) -> Iterable[Finding]:
    """A command against the acceleration makes the log unusable; one that only brakes gives a warning."""
    if recording.servo_gain.any():
        return
    part, seen = views(recording)
    if not seen:
        return
    command, output = recording.name("command"), recording.name("output")
    turned = _turned(part, seen)
    if turned:
        text = (
            f"{recording.label}: '{output}' accelerates against '{command}', as if the inertia were below zero, so one "
            f"of them has the wrong sign: {_options(turned)} turns it"
        )
        if len(turned) == 1 and pinion_torques(part) is not None:
            first, second = recording.name("torque_1"), recording.name("torque_2")
            text = (
                f"{recording.label}: '{output}' moves with the difference of '{first}' and '{second}' and not with "
                f"their sum, so one of them has the wrong sign: {_options(turned)} turns it"
            )
        yield Finding(kind="sign of the command", repaired=False, text=text, unusable=True)
    elif _brakes(part, seen):
        columns = (_column(part),) if pinion_torques(part) is None else ("torque_1", "torque_2")
        text = (
            f"{recording.label}: '{command}' opposes the motion almost all the time. Unless something else drives the "
            f"load, its sign is reversed: {_options(columns)} turns it"
        )
        yield Finding(kind="brakes", repaired=False, text=text)


def _turned(part: Recording, seen: Sequence[View]) -> tuple[str, ...]:
    """Columns that need the other sign for the command to drive the motion; none if it does or if this is uncertain."""
    pair = pinion_torques(part)
    if pair is None:
        return (_column(part),) if usable_witnesses(part.command, seen).against else ()
    first, second = pair
    if opposed(first, second, seen):
        witnesses = usable_witnesses(first - second, seen)
        drives = witnesses.inertia if abs(witnesses.inertia) > SURE else witnesses.work
        return ("torque_2",) if drives > 0 else ("torque_1",)
    return ("torque_1", "torque_2") if usable_witnesses(part.command, seen).against else ()


def _options(columns: Sequence[str]) -> str:
    return " ".join(f"--scale {column}=-1" for column in columns)


def _column(recording: Recording) -> str:
    """The column for the option --scale."""
    known = [name for name in ("torque", "force", "current", "voltage") if name in recording.names]
    return known[0] if known else "force" if recording.axis == "linear" else "torque"


def _brakes(part: Recording, seen: Sequence[View]) -> bool:
    """Whether the command does negative work nearly always, so that the load drives the motor."""
    power = seen[0].behind(part.command) * seen[0].speed
    return bool(power.sum() < -_ONE_WAY * np.abs(power).sum()) and seen[0].work(part.command) < -DOUBTFUL


def pinion_torques(recording: Recording) -> tuple[Array, Array] | None:
    """The part (T,) of each of two pinions in the command, if the command is their sum by the gears (eq. 2)."""
    if "torque_1" not in recording.others or "torque_2" not in recording.others:
        return None
    pinions = np.column_stack([recording.others["torque_1"], recording.others["torque_2"]])
    size = np.abs(pinions).max(axis=0)
    if not np.all(size > 0):
        return None
    ratio, *_ = np.linalg.lstsq(pinions / size, recording.command, rcond=1e-9)
    parts = pinions / size * ratio
    left = recording.command - parts.sum(axis=1)
    return (parts[:, 0], parts[:, 1]) if left @ left < 1e-12 * float(recording.command @ recording.command) else None
