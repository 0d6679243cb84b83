"""How the load moved, as the sensor saw it: what a sentence about the motion may say, whatever a fit made of the log.

The speed is the slope of the angle behind a Gaussian filter, the narrowest whose noise is small beside the speed. The
noise of the reading is told from its sixth differences, which leave nothing of the motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.checks.equation_error import gaussian
from identification.log import Log
from identification.run import Run
from plant.effects.effect import Array

_CLEAR = 0.03  # share of the speed that its noise may have
_WIDTHS = (1.0, 2.0, 4.0, 8.0, 16.0)  # standard deviations of the filter, in samples
_SLOW = 0.1  # share of the greatest speed at which the hump of breaking away has fallen to a third
_FEW = 0.05  # a share that counts as hardly any


@dataclass(frozen=True, kw_only=True)
class MeasuredMotion:
    """What the sensor and the command show.

    Attributes:
        turned: farthest way between two places [rad or m].
        back: share of all the way that was made in the lesser direction [-].
        fastest, slowest: speed [rad/s or m/s]; the fastest is the 99 % quantile.
        slow: share of the time below a tenth of the fastest speed [-].
        spread: standard deviation of the speed's size while the load moves, as a share of its mean [-].
        change: standard deviation of the speed as a share of its root mean square [-].
        through: share of the torque's time with the lesser of its signs [-].
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
        torque = np.concatenate([run.command - run.servo_gain * run.output for run in log.runs])
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
        """Why gravity may not show."""
        turned = float(np.degrees(self.turned))
        return None if turned >= 90.0 else f"the load turns by {turned:.2g} degrees only"

    def dry(self) -> str | None:
        """Why dry friction may not show."""
        return None if self.back > _FEW else f"the load {'hardly' if self.back > 0.0 else 'never'} turns back"

    def breakaway(self, speed: str) -> str | None:
        """Why stiction may not show; `speed` is its unit."""
        if self.slow > _FEW:
            return None
        if self.slowest > _FEW * self.fastest:
            return f"the load is never slower than {self.slowest:.2g} {speed}"
        return f"the load is slower than {_SLOW * self.fastest:.2g} {speed} in {100.0 * self.slow:.2g} % of the time"

    def zone(self) -> str | None:
        """Why a dead zone may not show."""
        return None if self.through > _FEW else f"the torque {'hardly' if self.through else 'never'} changes its sign"

    def viscous(self) -> str | None:
        """Why viscous friction may not show."""
        return None if self.spread > 2 * _FEW else "the load moves at one speed only"

    def inertia(self) -> str | None:
        """Why inertia may not show."""
        return None if self.change > 2 * _FEW else "the load hardly speeds up"


def reading_noise(run: Run) -> float:
    """Standard deviation of what the readings of a run hold beside any smooth motion, its steps at least [rad or m]."""
    output = run.output[run.valid]
    levels = np.unique(output)
    count = float(np.diff(levels).min()) if levels.size > 1 else 0.0
    sixth = float(np.std(np.diff(output, 6)) / np.sqrt(924.0)) if output.size > 12 else 0.0
    return max(sixth, count / float(np.sqrt(12.0)))


def speed_of(run: Run) -> Array:
    """(N,) measured speed of a run at even times [rad/s or m/s], without its ends."""
    clock = run.time[0] + run.sample_time * np.arange(round(run.duration / run.sample_time) + 1)
    output = np.interp(clock, run.time[run.valid], run.output[run.valid])
    noise, speed = reading_noise(run), np.gradient(output, run.sample_time)
    for sigma in _WIDTHS:
        edge = int(np.ceil(4.0 * sigma))
        if output.size < 4 * edge:
            break
        speed = gaussian(output, sigma, 1)[edge:-edge] / run.sample_time
        # of the derivative of a Gaussian of standard deviation sigma, on white noise
        doubt = noise / (run.sample_time * np.sqrt(4.0 * np.sqrt(np.pi) * sigma**3))
        if doubt < _CLEAR * np.sqrt(np.mean(speed**2)):
            break
    return np.asarray(speed, dtype=np.float64)
