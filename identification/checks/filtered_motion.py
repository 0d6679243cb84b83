"""A recording after filters of several widths, and Student's t of what the command has in common with its motion.

The log is cut into blocks with equal squares of the regressor, so that each has equal information; Student's t tests
the agreement of the blocks.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from identification.checks.equation_error import gaussian, middle, motion_terms, resampled_evenly
from identification.recording import Array, Recording

Products: TypeAlias = tuple[Array, Array]

WIDTHS = (1.5, 3.0, 6.0, 12.0, 24.0)  # standard deviations of the filter, in samples
BLOCKS = 12
SURE, DOUBTFUL = 8.0, 4.0  # Student's t: one log in 300 000, in 1000 by chance


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

    def inertia(self, command: Array) -> Products:
        """Products of the acceleration with a command (T,), whose mean is in proportion to the inertia."""
        return products(beyond(self.acceleration, self.terms), beyond(self.behind(command), self.terms))

    def driven(self, command: Array) -> Array:
        """(3,) sums of acceleration and command (T,) beyond the terms: of their product, and of the square of each."""
        effect, cause = beyond(self.acceleration, self.terms), beyond(self.behind(command), self.terms)
        return np.array([effect @ cause, effect @ effect, cause @ cause])

    def work(self, command: Array) -> Products:
        """Work on the load, without that against gravity."""
        return products(beyond(self.speed, self.gravity), beyond(self.behind(command), self.gravity))

    def power(self, command: Array) -> Array:
        """(N,) power of a command (T,)."""
        return self.behind(command) * self.speed

    def unexplained(self, command: Array) -> Array:
        """(N,) squared residuals of a command after regression on acceleration, angle and speed, over its variance."""
        basis = np.linalg.qr(np.column_stack([self.terms, self.acceleration]))[0]
        centred = self.behind(command) - self.behind(command).mean()
        variance = float(centred @ centred) / len(centred)
        return beyond(centred, basis) ** 2 / variance if variance > 0 else np.ones_like(centred)


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


def products(regressor: Array, target: Array) -> Products:
    """Products (N,) of a regressor with a target, and the squares of the regressor as their weights."""
    return (regressor * target, regressor**2) if target.any() else (np.zeros(0), np.zeros(0))


def over_runs(found: Iterable[Products]) -> float:
    """Student's t of the products of all runs."""
    values, weights = zip(*found, strict=True)
    return student(np.concatenate(values), np.concatenate(weights))


def student(values: Array, weight: Array) -> float:
    """Student's t of the mean of values (N,) over blocks of equal weight (N,)."""
    gathered = np.cumsum(weight)
    if not gathered.size or not gathered[-1] > 0:
        return 0.0
    edges = np.searchsorted(gathered / gathered[-1], np.linspace(0, 1, BLOCKS + 1)[1:-1])
    sums = np.array([block.sum() for block in np.split(values, edges)])
    scatter = float(sums.std(ddof=1)) * np.sqrt(BLOCKS)
    return float(sums.sum()) / scatter if scatter > 0 else 0.0


def undisputed(statistics: Sequence[float]) -> float:
    """The largest t in magnitude over the views; 0 if another view contradicts it."""
    best = max(statistics, key=abs)
    return 0.0 if any(t * np.sign(best) < -DOUBTFUL for t in statistics) else best
