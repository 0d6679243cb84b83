"""Hidden effects of a drawn machine: selection, and parameters for a torque of a given size along its motion.

Names, parameters and units are the catalogue's; the equations are in `load`, `actuator` and `motion`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Values = dict[str, float]


@dataclass(frozen=True, kw_only=True, eq=False)
class Basis:
    """The motion of the machine without effects, to which they are scaled: (T,) each, of all runs.

    Attributes:
        level: rms of the torque [N m].
        fastest: highest frequency of the motion [rad/s].
        noise: of a measurement [rad].
    """

    time: Array
    angle: Array
    velocity: Array
    acceleration: Array
    torque: Array
    inertia: float
    gravity: float
    dead_zone: float
    sample_time: float
    fastest: float
    noise: float
    level: float
    servo: bool

    @property
    def low(self) -> float:
        return float(self.angle.min())

    @property
    def high(self) -> float:
        return float(self.angle.max())

    @property
    def span(self) -> float:
        return self.high - self.low

    @property
    def speed(self) -> float:
        return rms(self.velocity)


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


Draw = Callable[[np.random.Generator, Basis, float], Values | None]


def _even(rng: np.random.Generator, low: float, high: float) -> float:
    """Uniformly distributed in the logarithm."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _coulomb(rng: np.random.Generator, b: Basis, size: float) -> Values:
    return {"torque": size}


def _stribeck(rng: np.random.Generator, b: Basis, size: float) -> Values:
    coulomb = size * rng.uniform(0.3, 0.9)
    return {
        "coulomb": coulomb,
        "excess": coulomb * _even(rng, 0.2, 1.5),
        "velocity": _even(rng, 0.03, 0.3) * b.speed,
    }


def _asymmetric(rng: np.random.Generator, b: Basis, size: float) -> Values:
    ratio = _even(rng, 1.3, 4.0)
    forward, backward = (size, size / ratio) if rng.random() < 0.5 else (size / ratio, size)
    share = rng.uniform(-0.5, 0.5) if rng.random() < 0.5 else 0.0
    return {"forward": forward, "backward": backward, "viscous_difference": share * size / b.speed}


def _load_dependent(rng: np.random.Generator, b: Basis, size: float) -> Values:
    return {"coefficient": size / b.level}


def _presliding(rng: np.random.Generator, b: Basis, size: float) -> Values | None:
    travel = _even(rng, max(0.003 * b.span, 4.0 * b.noise, 0.3 * b.speed * b.sample_time), 0.08 * b.span)
    return {"torque": size, "stiffness": size / travel} if travel < 0.1 * b.span else None


def _drag(rng: np.random.Generator, b: Basis, size: float) -> Values:
    return {"drag": size / rms(b.velocity**2)}


def _offset(rng: np.random.Generator, b: Basis, size: float) -> Values:
    return {"torque": size * rng.choice([-1.0, 1.0])}


def _gravity_offset(rng: np.random.Generator, b: Basis, size: float) -> Values | None:
    return {"beta": size / rms(np.sin(b.angle)) * rng.choice([-1.0, 1.0])} if b.span > 0.5 else None


def _cable(rng: np.random.Generator, b: Basis, size: float) -> Values | None:
    if b.span > 12.0:
        return None
    rest, cubic = rng.uniform(b.low, b.high), (_even(rng, 0.1, 2.0) if rng.random() < 0.5 else 0.0)
    deflection = b.angle - rest
    cubic /= (0.5 * b.span) ** 2
    k = size / rms(deflection + cubic * deflection**3)
    return {"stiffness": k, "cubic": k * cubic, "rest_angle": rest}


def _cogging(rng: np.random.Generator, b: Basis, size: float) -> Values | None:
    top = float(np.quantile(np.abs(b.velocity), 0.95))
    least, most = max(1.0, 3.0 * np.pi / b.span), min(150.0, 0.6 / (top * b.sample_time))
    if most < least + 1.0:
        return None
    order = float(np.ceil(_even(rng, least, most)))
    return {"amplitude": 1.414 * size, "order": order, "phase": rng.uniform(-np.pi, np.pi)}


def _periodic(rng: np.random.Generator, b: Basis, size: float) -> Values:
    duration = b.sample_time * b.time.size
    frequency = _even(rng, max(0.2 * b.fastest, 50.0 / duration), min(6.0 * b.fastest, 1.0 / b.sample_time))
    return {"amplitude": 1.414 * size, "frequency": frequency / (2.0 * np.pi), "phase": rng.uniform(-np.pi, np.pi)}


def _payload(rng: np.random.Generator, b: Basis, size: float) -> Values | None:
    time = rng.uniform(0.25, 0.75) * (b.time[-1] - b.time[0])
    share = rng.uniform(0.7, 1.4)  # of gravity, over that of the inertia
    after = b.time > time
    per_share = b.inertia * b.acceleration + share * b.gravity * np.cos(b.angle)
    part = min(size / rms(per_share * after), 2.0) * (1.0 if rng.random() < 0.6 else -0.3)
    if part < -0.6:
        return None
    return {"time": time, "inertia": part * b.inertia, "gravity": share * part * b.gravity}


def _drift(rng: np.random.Generator, b: Basis, size: float) -> Values:
    growth = b.time / b.time[-1]
    viscous = size / rms(growth * b.velocity) / b.time[-1]
    coulomb = size * 0.7 / b.time[-1] if rng.random() < 0.4 else 0.0
    return {"viscous_rate": viscous, "coulomb_rate": coulomb}


def _saturation(rng: np.random.Generator, b: Basis, size: float) -> Values | None:
    limits = np.quantile(np.abs(b.torque), np.linspace(0.3, 0.999, 40))
    cut = np.array([rms(b.torque - np.clip(b.torque, -limit, limit)) for limit in limits])
    return {"limit": float(limits[np.argmin(np.abs(cut - size))])} if cut.max() > size > cut.min() else None


def _rate(of: Array, sample_time: float, size: float) -> float | None:
    """Slope limit for a tracking error of `size`, rms, of a signal; None if no limit gives it."""
    slopes = np.ptp(of) / (sample_time * np.geomspace(2.0, 100.0, 15))
    for slope in slopes:
        followed, here = np.empty_like(of), float(of[0])
        for k, wanted in enumerate(of):
            here += min(max(wanted - here, -slope * sample_time), slope * sample_time)
            followed[k] = here
        if rms(followed - of) > size:
            return float(slope)
    return None


def _rate_limit(rng: np.random.Generator, b: Basis, size: float) -> Values | None:
    rate = None if b.servo else _rate(b.torque, b.sample_time, min(size, 0.15 * b.level))
    return None if rate is None else {"rate": rate}


def _setpoint_rate_limit(rng: np.random.Generator, b: Basis, size: float) -> Values | None:
    top = float(np.quantile(np.abs(b.velocity), 0.98))
    return {"rate": top * rng.uniform(0.4, 0.9)} if b.servo and top > 0.0 else None


def _delay(rng: np.random.Generator, b: Basis, size: float) -> Values:
    return {"time": min(_even(rng, 0.2, 6.0) * b.sample_time, 0.3 / b.fastest)}


def _lag(rng: np.random.Generator, b: Basis, size: float) -> Values:
    return {"time_constant": min(_even(rng, 0.3, 6.0) * b.sample_time, 0.3 / b.fastest)}


def _eccentricity(rng: np.random.Generator, b: Basis, size: float) -> Values | None:
    order = 1.0 if rng.random() < 0.75 else 2.0
    if b.span * order < 3.0:
        return None
    amplitude = min(_even(rng, 2.0, 50.0) * b.noise, 0.02, 0.05 * b.span)
    return {"amplitude": amplitude, "order": order, "phase": rng.uniform(-np.pi, np.pi)}


def _compliance(rng: np.random.Generator, b: Basis, size: float) -> Values | None:
    if 4.0 * b.fastest > 1.0 / b.sample_time:
        return None
    return {
        "frequency": _even(rng, 3.0 * b.fastest, 1.0 / b.sample_time),
        "damping": _even(rng, 0.01, 0.2),
        "motor_share": rng.uniform(0.15, 0.6),
    }


def _backlash(rng: np.random.Generator, b: Basis, size: float) -> Values:
    return {
        "gap": max(_even(rng, 0.002, 0.05) * min(b.span, 6.0), 3.0 * b.noise),
        "motor_share": rng.uniform(0.15, 0.6),
        "flank_frequency": 2.0 / b.sample_time,
        "flank_damping": 0.5,
    }


def _end_stop(rng: np.random.Generator, b: Basis, size: float) -> Values:
    upper = rng.random() < 0.5
    place = rng.uniform(0.02, 0.2)
    side = 1.0 if upper else -1.0
    swing = _even(rng, 3.0 * b.fastest, max(0.6 / b.sample_time, 4.0 * b.fastest))
    angle = b.high - place * b.span if upper else b.low + place * b.span
    return {"angle": angle, "stiffness": side * b.inertia * swing**2}


def _back_emf(rng: np.random.Generator, b: Basis, size: float) -> Values | None:
    return {"constant": size / b.speed} if b.dead_zone > 0.05 * b.level and size > 0.1 * b.level else None


DRAWS: dict[str, Draw] = {
    "coulomb_friction": _coulomb,
    "stribeck_friction": _stribeck,
    "asymmetric_friction": _asymmetric,
    "load_dependent_friction": _load_dependent,
    "presliding_hysteresis": _presliding,
    "quadratic_drag": _drag,
    "torque_offset": _offset,
    "gravity_offset": _gravity_offset,
    "cable_stiffness": _cable,
    "cogging": _cogging,
    "periodic_disturbance": _periodic,
    "payload_change": _payload,
    "friction_drift": _drift,
    "torque_saturation": _saturation,
    "rate_limit": _rate_limit,
    "setpoint_rate_limit": _setpoint_rate_limit,
    "input_delay": _delay,
    "actuator_lag": _lag,
    "sensor_lag": _lag,
    "encoder_eccentricity": _eccentricity,
    "compliance": _compliance,
    "backlash": _backlash,
    "end_stop": _end_stop,
    "back_emf": _back_emf,
}

ONE_OF = (
    {"coulomb_friction", "stribeck_friction", "asymmetric_friction", "presliding_hysteresis"},
    {"compliance", "backlash", "payload_change"},
    {"input_delay", "actuator_lag", "sensor_lag"},
    {"torque_offset", "asymmetric_friction"},
    {"torque_offset", "cable_stiffness"},
    {"rate_limit", "setpoint_rate_limit", "torque_saturation"},
)
"""Not together: one has the other as a special case, or two are equivalent to a third."""
BEHIND_THE_MEASUREMENT = {
    *("input_delay", "actuator_lag", "back_emf", "torque_saturation", "rate_limit", "setpoint_rate_limit"),
}
"""Part of a measured current."""
IN_THE_LOOP = {"encoder_eccentricity", "sensor_lag"}
"""Sensor errors that move a position servo itself; the log does not show its internal measurement."""
FRICTION = ("coulomb_friction", "stribeck_friction", "presliding_hysteresis", "asymmetric_friction")


def drawn_effects(
    rng: np.random.Generator, basis: Basis, *, slow: bool, measured: bool, count: int
) -> dict[str, Values]:
    """`count` effects, each with a torque of 1 to 50 % of that of the log, or with a typical time or stiffness."""
    found: dict[str, Values] = {}
    order = [str(name) for name in rng.permutation(list(DRAWS))]
    if slow and rng.random() < 0.5:
        order.insert(0, str(rng.choice(FRICTION)))
    for name in order:
        if len(found) == count:
            break
        barred = (measured and name in BEHIND_THE_MEASUREMENT) or (basis.servo and name in IN_THE_LOOP)
        if barred or name in found or any(name in group and group & set(found) for group in ONE_OF):
            continue
        values = DRAWS[name](rng, basis, basis.level * _even(rng, 0.01, 0.5))
        if values is not None:
            found[name] = {key: float(value) for key, value in values.items()}
    return found
