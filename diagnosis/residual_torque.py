"""The residual torque: the torque that a fitted model lacks to follow the measurement.

It is the torque needed for the measured motion less the torque of the model, both after the same zero-phase low-pass
filter. The noise determines the cutoff: above it the second derivative of the encoder noise would dominate. The plot
shows the user where a model error occurs. It decides nothing, because the fitted parameters have already absorbed a
part of the error.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from diagnosis.jackknife import jackknife
from identification.fit_result import Fit
from identification.inverse import filtered_motion, lowest_cutoff, needed_torque
from identification.inverse_log import cutoff_of
from identification.run_parameters import own_model
from plant.effects.effect import Array, Axis

_TORQUE_SHARE = 0.03  # noise of the residual torque, as a share of the rms torque command
_BINS = 24
_REST = 0.02  # of the largest speed: below it a sample counts as at rest


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """The residual torque as a function of one variable.

    Attributes:
        variable: "velocity", "angle", "torque" or "time"; on a linear axis "position" and "force".
        unit: of the variable.
        centre, mean, band: (B,) middle of each bin, mean residual torque in it and half width of its 95 % band [N m].
        share: of the residual torque's variance that this variable alone explains, corrected for chance [-], and
            share_std its standard error.
    """

    variable: str
    unit: str
    centre: Array
    mean: Array
    band: Array
    share: float
    share_std: float = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class ResidualTorque:
    """Filtered load torque that a model lacks, over a log.

    Attributes:
        time, torque, band: (T,) [s], [N m], half width of the 95 % band [N m].
        angle, velocity, command: (T,) filtered motion and torque [rad, rad/s, N m].
        run: (T,) index of the run.
        curves: over velocity, angle, torque and time, the one with the largest share first.
        unit: of the torque.
        cutoff: of the low pass [Hz].
    """

    time: Array
    torque: Array
    band: Array
    angle: Array
    velocity: Array
    command: Array
    run: NDArray[np.intp]
    curves: tuple[Curve, ...]
    unit: str
    cutoff: float

    def curves_of(self, torque: Array) -> tuple[Curve, ...]:
        """Curves of another torque (T,) along the same motion, over the same variables."""
        variables = {
            "velocity": self.velocity,
            "angle": self.angle,
            "position": self.angle,
            "torque": self.command,
            "force": self.command,
            "time": self.time,
        }
        independent = self._independent
        return tuple(_curve(c.variable, c.unit, variables[c.variable], torque, independent) for c in self.curves)

    def folded(self, period: float, torque: Array) -> Curve | None:
        """A torque (T,) over the angle within one period; None without a measured angle, or two periods of it.

        Samples at rest are left out: stiction takes any value there.
        """
        over = next((curve for curve in self.curves if curve.variable in ("angle", "position")), None)
        if over is None or np.ptp(self.angle) < 2.0 * period:
            return None
        name = f"{over.variable} modulo {period:.4g} {over.unit}"
        moves = np.abs(self.velocity) > _REST * np.max(np.abs(self.velocity))
        return _curve(name, over.unit, np.mod(self.angle[moves], period), torque[moves], self._independent)

    @property
    def _independent(self) -> float:
        """Independent values per sample after the low pass."""
        return 2.0 * self.cutoff * float(np.median(np.diff(self.time)))

    @property
    def excess(self) -> float:
        """Residual torque beyond the part due to encoder noise, as a share of the rms torque command [-]."""
        noise = float(np.mean((self.band / 1.96) ** 2))
        level = float(np.mean(self.command**2))
        return float(np.sqrt(max(self.rms**2 - noise, 0.0) / level)) if level > 0.0 else 0.0

    @property
    def rms(self) -> float:
        """Root mean square of the residual torque [N m]."""
        return float(np.sqrt(np.mean(self.torque**2)))

    @property
    def rms_std(self) -> float:
        """Standard error of `rms` [N m]."""
        return jackknife(np.sqrt, self.torque**2)


def residual_torque(fit: Fit, cutoff: float | None = None) -> ResidualTorque:
    """The torque that a fitted model lacks over the log that it was fitted to.

    Args:
        fit: of the model.
        cutoff: of the low pass [Hz]; by default as high as the noise allows. Compare two models at the same cutoff.
    """
    cutoff = noise_cutoff(fit) if cutoff is None else cutoff
    parts = []
    for run in fit.log.runs:
        motion = filtered_motion(run, cutoff, fit.model)
        edge = min(motion.time.size // 10, round(1.0 / (cutoff * run.sample_time)))
        inner = slice(edge, motion.time.size - edge)
        missing = needed_torque(own_model(run, fit.model), motion) - motion.torque
        parts.append([a[inner] for a in (motion.time, missing, motion.angle, motion.velocity, motion.torque)])
    time, torque, angle, velocity, command = (np.concatenate(column) for column in zip(*parts, strict=True))
    run_index = np.repeat(np.arange(len(parts)), [part[0].size for part in parts])
    length, force = "m" if fit.log.axis == "linear" else "rad", fit.log.command_unit
    independent = 2.0 * cutoff * fit.log.runs[0].sample_time  # independent values per sample after the low pass
    variables = (
        ("velocity", f"{length}/s", velocity),
        (effects_over("angle", fit.log.axis), length, angle),
        (effects_over("torque", fit.log.axis), force, command),
        ("time", "s", time),
    )
    curves = [
        _curve(name, unit, values, torque, independent)
        for name, unit, values in variables
        if values is not angle or fit.log.response != "velocity"
    ]
    noise = 1.96 * _noise_torque(fit, cutoff)
    return ResidualTorque(
        time=time,
        torque=torque,
        band=np.full(time.size, noise),
        angle=angle,
        velocity=velocity,
        command=command,
        run=run_index,
        curves=tuple(sorted(curves, key=lambda curve: -curve.share)),
        unit=force,
        cutoff=cutoff,
    )


def torque_of(fit: Fit, effect: str) -> tuple[float, float]:
    """rms torque that one effect of a fitted model explains along the measured motion, and its share [N m; -].

    The share is of the power of the residual torque without the effect, from 0 to 1.
    """
    left = residual_torque(fit)
    rest = fit.model.without_effect(effect)
    lacked = residual_torque(replace(fit, model=rest, initial=fit.initial_of(rest)), left.cutoff)
    rms = float(np.sqrt(np.mean((lacked.torque - left.torque) ** 2)))
    share = 1.0 - (left.rms / lacked.rms) ** 2 if lacked.rms > 0.0 else 0.0
    return rms, float(np.clip(share, 0.0, 1.0))


def effects_over(variable: str, axis: Axis) -> str:
    """Name of a variable on an axis: on a linear axis "position" for angle and "force" for torque."""
    return {"angle": "position", "torque": "force"}.get(variable, variable) if axis == "linear" else variable


def noise_cutoff(fit: Fit) -> float:
    """Cutoff [Hz] at which the encoder noise is 3 % of the rms torque, at most 1/10 of the sampling rate.

    For an inverse model it is that of its log.
    """
    dt = fit.log.runs[0].sample_time
    if fit.log.response == "torque":
        return cutoff_of(dt)
    torque = np.concatenate([run.drive for run in fit.log.runs])
    target = _TORQUE_SHARE * float(np.sqrt(np.mean(torque**2)))
    lowest, highest = min(lowest_cutoff(fit.log), 0.05 / dt), 0.1 / dt
    per_unit = _noise_torque(fit, 1.0)
    if per_unit <= 0.0 or target <= 0.0:
        return highest
    return float(np.clip((target / per_unit) ** 0.4, lowest, highest))


def _noise_torque(fit: Fit, cutoff: float) -> float:
    """Standard deviation of J times the second derivative of white encoder noise after an ideal low pass [N m].

    The noise has a density of 2 sigma^2 dt [rad^2/Hz]; (2 pi f)^4 of it integrated up to the cutoff.
    """
    dt = fit.log.runs[0].sample_time
    if fit.log.response == "torque":  # the motion is given without error
        return 0.0
    power = 2.0 * fit.slow_noise**2 * dt * (2.0 * np.pi) ** 4 * cutoff**5 / 5.0
    return float(fit.model.inertia * np.sqrt(power))


def _curve(name: str, unit: str, values: Array, torque: Array, independent: float) -> Curve:
    """Bin means of the torque over one variable, with bands for `independent` values per sample."""
    low, high = np.quantile(values, [0.001, 0.999])
    if not high > low:
        return Curve(variable=name, unit=unit, centre=values[:1], mean=torque[:1] * 0, band=torque[:1] * 0, share=0.0)
    edges = np.linspace(low, high, _BINS + 1)
    place = np.clip(np.digitize(values, edges) - 1, 0, _BINS - 1)
    count = np.bincount(place, minlength=_BINS)
    used = count > 0
    mean = np.bincount(place, weights=torque, minlength=_BINS)[used] / count[used]
    residual = torque - mean[np.cumsum(used) - 1][place]
    scatter = np.bincount(place, weights=residual**2, minlength=_BINS)[used] / count[used]
    effective = np.maximum(count[used] * min(independent, 1.0), 1.0)
    total = float(np.var(torque))
    degrees = max(torque.size * min(independent, 1.0) - used.sum(), 1.0)
    chance = (used.sum() - 1) / (degrees + used.sum())

    def explained(left: float, square: float, level: float) -> float:
        return 1.0 - left / (square - level**2) if square > level**2 else 0.0

    records = (residual**2, torque**2, torque)
    share = explained(*(float(np.mean(record)) for record in records)) if total > 0.0 else 0.0
    return Curve(
        variable=name,
        unit=unit,
        centre=(0.5 * (edges[1:] + edges[:-1]))[used],
        mean=mean,
        band=1.96 * np.sqrt(scatter / effective),
        share=float(np.clip((share - chance) / (1.0 - chance), 0.0, 1.0)),
        share_std=jackknife(explained, *records) / (1.0 - chance),
    )
