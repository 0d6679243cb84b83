"""The measured motion of the load, for sentences about the motion that do not depend on a fit.

The speed is the derivative of the angle after a Gaussian filter, the narrowest one with small noise compared with the
speed. The measurement noise is estimated from sixth differences, from which smooth motion vanishes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.checks.equation_error import gaussian
from identification.log import Log
from identification.run import Run
from plant.effects.effect import Array

_CLEAR = 0.03  # largest ratio of noise to rms speed
_WIDTHS = (1.0, 2.0, 4.0, 8.0, 16.0)  # standard deviations of the filter, in samples
_SLOW = 0.1  # share of the highest speed at which the modelled breakaway torque has fallen to 1/e
_FEW = 0.05  # a share that counts as hardly any


@dataclass(frozen=True, kw_only=True)
class MeasuredMotion:
    """Properties of the measured motion and torque.

    Attributes:
        turned: largest range of angles or positions in a run [rad or m].
        back: share of the travel in the direction with less travel [-].
        fastest, slowest: speed [rad/s or m/s]; the fastest is the 99 % quantile.
        slow: share of the time below a tenth of the fastest speed [-].
        spread: standard deviation of the absolute speed while the load moves, divided by its mean [-].
        change: standard deviation of the speed divided by its root mean square [-].
        through: share of the time in which the torque has its less frequent sign [-].
    """

    turned: float
    back: float
    fastest: float
    slowest: float
    slow: float
    spread: float
    change: float
    through: float

    @classmethod
    def of(cls, log: Log) -> MeasuredMotion:
        """The motion of all runs together."""
        speed = np.concatenate([speed_of(run) for run in log.runs])
        size = np.abs(speed)
        fastest = float(np.quantile(size, 0.99))
        moving = size[size > _FEW * fastest] if fastest > 0.0 else size
        torque = np.concatenate([run.drive for run in log.runs])
        rms, signs = float(np.sqrt(np.mean(speed**2))), np.sign(torque[torque != 0.0])
        return cls(
            turned=max(float(np.ptp(run.output[run.valid])) for run in log.runs),
            back=float(min(size[speed > 0].sum(), size[speed < 0].sum()) / max(size.sum(), 1e-300)),
            fastest=fastest,
            slowest=float(size.min()),
            slow=float(np.mean(size < _SLOW * fastest)),
            spread=float(moving.std() / max(float(moving.mean()), 1e-300)) if moving.size else 0.0,
            change=float(speed.std()) / max(rms, 1e-300),
            through=float(min(np.mean(signs > 0), np.mean(signs < 0))) if signs.size else 0.0,
        )

    def gravity(self) -> str | None:
        """Why the motion may not identify gravity; None if it may."""
        turned = float(np.degrees(self.turned))
        return None if turned >= 90.0 else f"the load turns by {turned:.2g} degrees only"

    def dry(self) -> str | None:
        """Why the motion may not identify dry friction; None if it may."""
        return None if self.back > _FEW else f"the load {'hardly' if self.back > 0.0 else 'never'} turns back"

    def breakaway(self, speed: str) -> str | None:
        """Why the motion may not identify stiction, None if it may; `speed` is the unit of speed."""
        if self.slow > _FEW:
            return None
        if self.slowest > _FEW * self.fastest:
            return f"the load is never slower than {self.slowest:.2g} {speed}"
        return f"the load is slower than {_SLOW * self.fastest:.2g} {speed} in {100.0 * self.slow:.2g} % of the time"

    def zone(self) -> str | None:
        """Why the torque may not identify a dead zone; None if it may."""
        return None if self.through > _FEW else f"the torque {'hardly' if self.through else 'never'} changes its sign"

    def viscous(self) -> str | None:
        """Why the motion may not identify viscous friction; None if it may."""
        return None if self.spread > 2 * _FEW else "the load moves at one speed only"

    def inertia(self) -> str | None:
        """Why the motion may not identify inertia; None if it may."""
        return None if self.change > 2 * _FEW else "the load hardly speeds up"


def measurement_noise(run: Run) -> float:
    """Standard deviation of the measurement noise of a run, quantisation included [rad or m]."""
    output = run.output[run.valid]
    return float(np.std(np.diff(output, 6)) / np.sqrt(924.0)) if output.size > 12 else 0.0


def speed_of(run: Run) -> Array:
    """(N,) measured speed of a run at equidistant times [rad/s or m/s], without its ends."""
    clock = run.time[0] + run.sample_time * np.arange(round(run.duration / run.sample_time) + 1)
    output = np.interp(clock, run.time[run.valid], run.output[run.valid])
    noise, speed = measurement_noise(run), np.gradient(output, run.sample_time)
    for sigma in _WIDTHS:
        edge = int(np.ceil(4.0 * sigma))
        if output.size < 4 * edge:
            break
        speed = gaussian(output, sigma, 1)[edge:-edge] / run.sample_time
        # of the derivative of a Gaussian of standard deviation sigma, on white noise
        std = noise / (run.sample_time * np.sqrt(4.0 * np.sqrt(np.pi) * sigma**3))
        if std < _CLEAR * np.sqrt(np.mean(speed**2)):
            break
    return np.asarray(speed, dtype=np.float64)
