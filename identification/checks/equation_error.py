"""Equation-error regression: the filtered equation of motion, linear in its parameters, for any shift of the command.

    x'' = b tau(t + d) - k v - k2 v |v| - friction(sgn v) - gravity(cos x, sin x) + c

Every term passes the same Gaussian filter, so that derivatives of a noisy measurement can be used and the filter itself
causes no delay (the modulating functions of Shinbrot 1957, with a kernel in place of a window). It needs no simulation
and no starting values, so that data can be checked before any model is fitted. `d` is the time by which the command
column lags behind the output column.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.recording import Array, Recording

WIDTHS = (0.01, 0.02, 0.04, 0.08, 0.16)  # standard deviations of the filter [s]
UNEXPLAINED = 0.3  # most residual share of the acceleration not explained by motion terms, for a usable filter
_NARROWEST = 1.5  # samples
_LONGEST = 40_000  # most samples that are used
_ROWS = 3000  # of them in the regression
_REACH, _LEAST_REACH = 0.4, 30  # [s], samples: largest shift
_KINKS = (0.02, 0.2)  # of the rms speed: widths over which friction changes its sign


@dataclass(frozen=True, kw_only=True, eq=False)
class Profile:
    """Residual of the regression over the shift of the command.

    width: standard deviation of the filter [s]; sample_time [s].
    shifts: (D,) [s], positive if the command column lags behind the output column.
    residual: (D,) unexplained share of the acceleration that the motion terms alone do not explain.
    slope: (D,) acceleration per unit of command: one over the inertia.
    blocks: (B, D) the residual, by blocks of time.
    independent: number of independent samples after the filter.
    """

    width: float
    sample_time: float
    shifts: Array
    residual: Array
    slope: Array
    blocks: Array
    independent: float

    @property
    def best(self) -> int:
        """Index of the least residual."""
        return int(np.argmin(self.residual))

    @property
    def serves(self) -> bool:
        """True if the command explains the motion, at a shift within reach."""
        inside = 0 < self.best < len(self.shifts) - 1
        return inside and bool(self.residual[self.best] < UNEXPLAINED)

    @property
    def lag(self) -> float:
        """The shift of the least residual, interpolated by a parabola [s]."""
        k = self.best
        left, least, right = self.residual[k - 1 : k + 2]
        curvature = left - 2 * least + right
        part = 0.5 * (left - right) / curvature if curvature > 0 else 0.0
        return float(self.shifts[k] + part * (self.shifts[1] - self.shifts[0]))

    def evidence(self, start: float, stop: float) -> float:
        """Gain in log-likelihood of the best shift over all shifts outside (start, stop) [s].

        It is 0 if one of the two sides is out of range, or if the gain comes from a single block of time.
        """
        outside = (self.shifts <= start) | (self.shifts >= stop)
        if outside[self.best] or not (outside[0] and outside[-1]):
            return 0.0
        second_best = int(np.argmin(np.where(outside, self.residual, np.inf)))
        gain = self.blocks[:, second_best] - self.blocks[:, self.best]
        least = max(float(self.residual[self.best]), 1e-12)
        if gain.sum() <= gain.max():
            return 0.0
        return 0.5 * self.independent * float(np.log(self.residual[second_best] / least))


def profiles(recording: Recording, count: int = 2) -> list[Profile]:
    """Profiles of the narrowest usable filters, at most `count`: a narrow filter smooths friction less."""
    part = middle(recording)
    found: list[Profile] = []
    for width in WIDTHS:
        profile = _profile(part, width)
        if profile is not None and profile.serves:
            found.append(profile)
        if len(found) == count:
            break
    return found


def middle(recording: Recording) -> Recording:
    """The middle of a long recording, enough for the checks."""
    over = max(0, len(recording) - _LONGEST)
    return recording.take(slice(over // 2, len(recording) - (over - over // 2)))


def _profile(recording: Recording, width: float) -> Profile | None:
    dt = float(np.median(np.diff(recording.time)))
    sigma = width / dt
    reach = max(_LEAST_REACH, round(_REACH / dt))
    reach = min(reach, len(recording) // 8)
    edge = int(np.ceil(4 * sigma)) + reach
    count = round((recording.time[-1] - recording.time[0]) / dt) + 1
    if sigma < _NARROWEST or count > 4 * len(recording) or count - 2 * edge < max(50, 20 * sigma):
        return None
    rows = np.arange(edge, count - edge, max(1, int(sigma / 4), (count - 2 * edge) // _ROWS))
    clock = recording.time[0] + dt * np.arange(count)
    sound, output, command, returned = resampled_evenly(recording, clock)
    rows = rows[gaussian(1.0 - sound, sigma)[rows] < 1e-3]  # no masked or saturated sample in the filter
    if len(rows) < 50:
        return None
    acceleration = gaussian(output, sigma, 2) / dt**2
    velocity = gaussian(output, sigma, 1) / dt
    known = motion_terms(recording, gaussian(output, sigma), velocity, sigma)[rows]
    step = max(1, int(sigma / 8))
    steps = np.arange(-(reach // step), reach // step + 1) * step
    pushes = [gaussian(command, sigma)[rows[:, None] + steps] - gaussian(returned, sigma)[rows, None]]
    if not returned.any():  # a dead zone, or a gain that depends on the size
        soft = np.tanh(command / max(0.1 * float(command.std()), 1e-300))
        pushes.append(gaussian(soft, sigma)[rows[:, None] + steps])
    basis = np.linalg.qr(known)[0]

    def beyond(values: Array) -> Array:
        return values - basis @ (basis.T @ values)

    target = beyond(acceleration[rows])
    size = float(target @ target)
    freed = [beyond(push) for push in pushes]
    if size <= 0 or any(float(np.abs(push).max()) <= 0 for push in freed):
        return None
    slope, left = _two_column_fit(freed, target)
    residual = np.sum(left**2, axis=0) / size
    blocks = np.stack([np.sum(block**2, axis=0) / size for block in np.array_split(left, 12)])
    return Profile(
        width=width,
        sample_time=dt,
        shifts=np.asarray(steps * dt, dtype=np.float64),
        residual=residual,
        slope=slope,
        blocks=blocks,
        independent=min(len(rows), len(rows) * (rows[1] - rows[0]) / (2 * np.sqrt(np.pi) * sigma)),
    )


def resampled_evenly(recording: Recording, clock: Array) -> tuple[Array, Array, Array, Array]:
    """Validity, output, command and the servo's feedback (gain times output) at even times."""
    drive = recording.drive
    sound = recording.valid & (np.abs(drive) < recording.command_limit)

    def at(values: Array) -> Array:
        return np.interp(clock, recording.time, values)

    returned = at(recording.servo_gain * (recording.output - recording.output.mean()))
    command = at(recording.command - recording.servo_gain * recording.output.mean())
    return at(sound.astype(np.float64)), at(recording.output), command, returned


def motion_terms(recording: Recording, output: Array, velocity: Array, sigma: float) -> Array:
    """(T, n) regressors other than the command, from filtered output and speed: friction, gravity, a constant."""
    usual = float(np.sqrt(np.mean(velocity**2))) or 1.0
    speed = velocity / usual
    terms = [np.ones_like(output), speed, speed * np.abs(speed), np.abs(speed)]
    terms += [gaussian(np.tanh(speed / kink), sigma) for kink in _KINKS]
    if recording.axis == "rotary":
        terms += [np.cos(output), np.sin(output)]
    return np.column_stack(terms)


def _two_column_fit(columns: list[Array], target: Array) -> tuple[Array, Array]:
    """Least squares for all shifts at once: slope (D,) of the first column and residuals (rows, D)."""
    first = columns[0]
    squares = np.maximum(np.sum(first**2, axis=0), 1e-300)
    left = target[:, None] - first * (target @ first / squares)
    slope = target @ first / squares
    for second in columns[1:]:
        shared = np.sum(first * second, axis=0) / squares
        own = second - first * shared
        weight = np.sum(own**2, axis=0)
        share = np.where(weight > 1e-6 * np.sum(second**2, axis=0), np.sum(own * left, axis=0), 0.0)
        share = share / np.maximum(weight, 1e-300)
        left = left - own * share
        slope = slope - shared * share
    return slope, left


def gaussian(values: Array, sigma: float, order: int = 0) -> Array:
    """Gaussian filter (T,), or its derivative per sample; the ends within 4 sigma must not be used."""
    from scipy.signal import oaconvolve

    place = np.arange(-int(np.ceil(4 * sigma)), int(np.ceil(4 * sigma)) + 1)
    kernel = np.exp(-0.5 * (place / sigma) ** 2)
    kernel /= kernel.sum()
    if order == 1:
        kernel = -place / sigma**2 * kernel
        kernel /= -float(place @ kernel)
    elif order == 2:
        kernel = (place**2 / sigma**4 - 1 / sigma**2) * kernel
        kernel -= kernel.mean()
        kernel *= 2 / float(place**2 @ kernel)
    centred = values - values.mean() if order else values
    return np.asarray(oaconvolve(centred, kernel, mode="same"), dtype=np.float64)


__all__ = ["Profile", "gaussian", "middle", "motion_terms", "profiles", "resampled_evenly"]
