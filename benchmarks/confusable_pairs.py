"""Pairs of confounded effects, as small as a short log still shows them: the hidden effect and the competing one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

Values = Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class Pair:
    """The hidden effect, its competing effect (with starting values of its fit), and the chirp of the log."""

    hidden: str
    values: Values
    alternative: str
    start: Values
    amplitude: float
    duration: float = 12.0

    def __str__(self) -> str:
        return f"{self.hidden:24}{self.alternative:24}"


PAIRS = (
    Pair(
        hidden="stribeck_friction",
        values={"coulomb": 0.1, "excess": 0.02, "velocity": 0.3},
        alternative="coulomb_friction",
        start={"torque": 0.1},
        amplitude=1.5,
    ),
    Pair(
        hidden="presliding_hysteresis",
        values={"torque": 0.005, "stiffness": 5.0},
        alternative="coulomb_friction",
        start={"torque": 0.005},
        amplitude=1.5,
    ),
    Pair(
        hidden="load_dependent_friction",
        values={"coefficient": 0.0012},
        alternative="coulomb_friction",
        start={"torque": 0.005},
        amplitude=1.0,
        duration=20.0,
    ),
    Pair(
        hidden="asymmetric_friction",
        values={"forward": 0.101, "backward": 0.099, "viscous_difference": 0.0},
        alternative="coulomb_friction",
        start={"torque": 0.1},
        amplitude=3.0,
    ),
    Pair(
        hidden="actuator_lag",
        values={"time_constant": 0.00125},
        alternative="input_delay",
        start={"time": 0.001},
        amplitude=1.5,
    ),
    Pair(
        hidden="encoder_eccentricity",
        values={"amplitude": 0.002, "order": 1.0, "phase": 0.3},
        alternative="gravity_offset",
        start={"beta": 0.01},
        amplitude=1.5,
    ),
    Pair(
        hidden="cable_stiffness",
        values={"stiffness": 0.0006, "cubic": 0.0, "rest_angle": 0.0},
        alternative="asymmetric_friction",
        start={"forward": 0.006, "backward": 0.003, "viscous_difference": 0.0},
        amplitude=1.5,
    ),
    Pair(
        hidden="cable_stiffness",
        values={"stiffness": 0.0009, "cubic": 0.0, "rest_angle": 1.0},
        alternative="torque_offset",
        start={"torque": 0.003},
        amplitude=1.5,
        duration=30.0,
    ),
    Pair(
        hidden="gravity_offset",
        values={"beta": 0.0003},
        alternative="torque_offset",
        start={"torque": 0.003},
        amplitude=1.5,
    ),
    Pair(
        hidden="cable_stiffness",
        values={"stiffness": 0.0021, "cubic": 0.0, "rest_angle": 0.0},
        alternative="gravity_offset",
        start={"beta": 0.003},
        amplitude=1.5,
    ),
    Pair(
        hidden="asymmetric_friction",
        values={"forward": 0.0027, "backward": 0.0, "viscous_difference": 0.0},
        alternative="torque_offset",
        start={"torque": 0.003},
        amplitude=2.0,
    ),
    Pair(
        hidden="compliance",
        values={"frequency": 75.0, "damping": 0.05, "motor_share": 0.3},
        alternative="input_delay",
        start={"time": 0.003},
        amplitude=1.5,
    ),
    Pair(
        hidden="backlash",
        values={"gap": 0.0012, "motor_share": 0.3},
        alternative="compliance",
        start={"frequency": 70.0, "damping": 0.1, "motor_share": 0.3},
        amplitude=1.5,
    ),
    Pair(
        hidden="sensor_lag",
        values={"time_constant": 0.00125},
        alternative="input_delay",
        start={"time": 0.001},
        amplitude=1.5,
    ),
)
