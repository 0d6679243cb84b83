"""Confounded effects: which effects are equivalent on a log, and why.

A line of the table says that a set of effects may be equivalent to an effect; whether it is on a log is measured: the
effect must have less than a detectable lambda beyond the regressors of that set. Only pairs of the table are tested, so
that no effect is accepted because of a chance fit.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from drawn_machines.detectability import TELLING, Seen
from drawn_machines.motion import Array

TABLE: tuple[tuple[str, tuple[str, ...], str], ...] = (
    ("stribeck_friction", ("coulomb_friction",), "the excess is passed within a few samples"),
    ("stribeck_friction", ("presliding_hysteresis",), "at coarse sampling both only round off the reversal"),
    ("stribeck_friction", ("asymmetric_friction",), "Coulomb friction is one with equal sides"),
    ("presliding_hysteresis", ("coulomb_friction",), "the contact gives less than the encoder shows"),
    ("presliding_hysteresis", ("stribeck_friction",), "at coarse sampling both only round off the reversal"),
    ("asymmetric_friction", ("coulomb_friction",), "the sides differ by less than the log shows"),
    ("asymmetric_friction", ("coulomb_friction", "torque_offset"), "Coulomb plus offset is asymmetric"),
    ("asymmetric_friction", ("stribeck_friction", "torque_offset"), "the same with an excess of nothing"),
    ("asymmetric_friction", ("presliding_hysteresis", "torque_offset"), "the same with a contact that hardly gives"),
    ("load_dependent_friction", ("coulomb_friction",), "the load hardly varies"),
    ("friction_drift", ("coulomb_friction",), "the log is short against the drift"),
    ("coulomb_friction", ("stribeck_friction",), "holds Coulomb friction as a special case"),
    ("coulomb_friction", ("presliding_hysteresis",), "holds Coulomb friction as a special case"),
    ("coulomb_friction", ("asymmetric_friction",), "holds Coulomb friction as a special case"),
    ("torque_offset", ("cable_stiffness",), "a soft spring far away is an offset"),
    ("torque_offset", ("gravity_offset",), "over a small arc sin x is a constant"),
    ("gravity_offset", ("torque_offset",), "over a small arc sin x is a constant"),
    ("gravity_offset", ("cable_stiffness",), "over a small arc sin x is a spring"),
    ("gravity_offset", ("cogging",), "of order one it is sin x"),
    ("cable_stiffness", ("gravity_offset",), "over a small arc a spring is sin x"),
    ("cable_stiffness", ("torque_offset",), "a spring that hardly bends is an offset"),
    ("cable_stiffness", ("cogging",), "over less than a period a wave is a spring"),
    ("cable_stiffness", ("gravity_offset", "torque_offset"), "over an arc they are a spring to a rest angle"),
    ("cogging", ("gravity_offset",), "of order one it is sin x"),
    ("cogging", ("cable_stiffness",), "over less than a period a wave is a spring"),
    ("cogging", ("periodic_disturbance",), "at a steady speed a wave over the angle is one over time"),
    ("periodic_disturbance", ("cogging",), "at a steady speed a wave over time is one over the angle"),
    ("input_delay", ("actuator_lag",), "to first order both are a time"),
    ("input_delay", ("sensor_lag",), "to first order both are a time"),
    ("actuator_lag", ("input_delay",), "to first order both are a time"),
    ("actuator_lag", ("sensor_lag",), "both lags are linear and in series"),
    ("sensor_lag", ("input_delay",), "to first order both are a time"),
    ("sensor_lag", ("actuator_lag",), "both lags are linear and in series"),
    ("setpoint_rate_limit", ("rate_limit",), "is the same thing at one servo gain"),
    ("encoder_eccentricity", ("cogging",), "at a steady acceleration an error of the measurement is a torque"),
)

HOLD = {
    "coulomb_friction": (("stribeck_friction",), ("presliding_hysteresis",), ("asymmetric_friction",)),
    "torque_offset": (("cable_stiffness",),),
    "setpoint_rate_limit": (("rate_limit",),),
}
"""Effects with another one as a special case, on every log; whether they add more is tested in the scoring."""


def alike(name: str, effects: Mapping[str, object], seen: Seen) -> tuple[tuple[str, ...], ...]:
    """The sets of effects that are equivalent to an effect on a log."""
    found = []
    for true, reported, _ in TABLE:
        if true != name or any(one in effects for one in reported):
            continue
        if reported in HOLD.get(name, ()):
            found.append(reported)
            continue
        columns = [_columns(one, seen) for one in reported]
        if all(c is not None for c in columns) and seen.visible(name, np.column_stack(columns)) < TELLING:  # type: ignore[arg-type]
            found.append(reported)
    return tuple(found)


def left_out_with(name: str, alike_here: tuple[tuple[str, ...], ...]) -> tuple[str, ...]:
    """Effects to exclude, so that no candidate is equivalent to an effect."""
    return tuple(dict.fromkeys((name, *(reported[0] for reported in alike_here))))


def _columns(given: str, seen: Seen) -> Array | None:
    """(T, m) regressors of an effect along a log, for several values of its nonlinear parameters."""
    b = seen.moved
    sign, x = np.sign(b.velocity), b.angle
    deflection = (x - x.mean()) / max(b.span, 1e-300)
    if given in ("coulomb_friction", "load_dependent_friction"):
        return _dry(seen)[:, None]
    if given == "asymmetric_friction":
        return np.column_stack((_dry(seen), np.ones(x.size), np.abs(b.velocity)))
    if given == "stribeck_friction":
        humps = [sign * np.exp(-((b.velocity / (share * b.speed)) ** 2)) for share in (0.05, 0.1, 0.2)]
        return np.column_stack((_dry(seen), *humps))
    if given == "presliding_hysteresis":
        return np.column_stack([_contact(seen, share * b.span) for share in (0.003, 0.01, 0.03)])
    if given == "torque_offset":
        return np.ones((x.size, 1))
    if given == "gravity_offset":
        return np.sin(x)[:, None]
    if given == "cable_stiffness":
        return np.column_stack((np.ones(x.size), deflection, deflection**2, deflection**3))
    if given in ("cogging", "periodic_disturbance"):
        return _waves(given, seen)
    return _late(given, seen)


def _dry(seen: Seen) -> Array:
    """Dry friction of one level as it acted, or by the direction of motion."""
    asymmetric = seen.machine.effects.get("asymmetric_friction")
    if asymmetric:
        return seen.torques["asymmetric_friction"] + 0.5 * (asymmetric["forward"] - asymmetric["backward"])
    if "coulomb_friction" in seen.machine.effects:
        return seen.torques["coulomb_friction"]
    curve = seen.machine.effects.get("stribeck_friction")
    if curve:
        hump = np.exp(-((seen.moved.velocity / curve["velocity"]) ** 2))
        return np.clip(seen.torques["stribeck_friction"] / (curve["coulomb"] + curve["excess"] * hump), -1.0, 1.0)
    return np.asarray(-np.sign(seen.moved.velocity))


def _contact(seen: Seen, travel: float) -> Array:
    """Dahl's friction of level one that slides after a travel."""
    parts = []
    for angle in seen.by_run(seen.moved.angle):
        state, force = 0.0, np.empty(angle.size)
        steps = np.diff(angle, append=angle[-1])
        decay, directions = np.exp(-np.abs(steps) / travel), np.sign(steps)
        for k in range(angle.size):
            state = directions[k] + (state - directions[k]) * decay[k] if directions[k] else state
            force[k] = -state
        parts.append(force)
    return np.concatenate(parts)


def _waves(given: str, seen: Seen) -> Array | None:
    """The wave over the angle, or over time, that is nearest to the hidden effect."""
    b, effects = seen.moved, seen.machine.effects
    over = b.angle if given == "cogging" else b.time
    if given == "cogging" and ("gravity_offset" in effects or "cable_stiffness" in effects):
        orders = [1.0] if b.span > np.pi else [1.0, np.pi / b.span]
    elif given == "cogging" and "encoder_eccentricity" in effects:
        orders = [effects["encoder_eccentricity"]["order"]]
    elif b.speed > 0.0 and float(np.std(b.velocity)) < 0.1 * b.speed:
        mean = float(np.mean(b.velocity))
        other = effects["periodic_disturbance"]["frequency"] * 2.0 * np.pi if given == "cogging" else 0.0
        orders = [other / mean if given == "cogging" else effects["cogging"]["order"] * mean]
    else:
        return None
    return np.column_stack([f(order * over) for order in orders for f in (np.sin, np.cos)])


def _late(given: str, seen: Seen) -> Array | None:
    """Influence of a lag or a dead time on the torque, for several times."""
    effects, dt = seen.machine.effects, seen.moved.sample_time
    if given not in ("input_delay", "actuator_lag", "sensor_lag"):
        return None
    times = [0.1, 0.5, 1.0, 2.0, 4.0]
    own = [effects[name]["time_constant"] / dt for name in ("actuator_lag", "sensor_lag") if name in effects]
    if given == "input_delay":
        return np.column_stack([_delayed(seen, time) for time in times])
    return np.column_stack([seen.lagged(time) for time in (*times, *own)])


def _delayed(seen: Seen, samples: float) -> Array:
    """Torque that a dead time adds to the command [N m]."""
    parts = seen.by_run(seen.commanded)
    places = [np.arange(part.size) for part in parts]
    return np.concatenate([np.interp(k - samples, k, u) - u for k, u in zip(places, parts, strict=True)])
