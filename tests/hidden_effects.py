"""What is hidden from the diagnosis: each effect of the catalogue at three sizes, and the oracle that knows which.

A size is chosen by how plainly the log shows the effect: lambda, twice the log-likelihood by which the model with the
true effect beats the nearest model without it, is about 100, 400 and 1600 on the minute-long log. The nearest model is
the base; for an effect with a special case, as the friction laws have in Coulomb friction, it is the base with that,
for else the larger part of lambda would speak for friction of whatever kind and not for the law.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from machine import Machine, excitation, record

from identification.fit import fit
from identification.fit_result import Fit
from identification.log import Log
from identification.problem import Problem
from plant import ServoModel, catalogue

Values = Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class Hidden:
    """One effect to hide: its parameters at a size, the sizes, and the parameters by which its size is judged.

    The host is what it is hidden in: a machine of (4) and (6), the paper's by default. What moves fast shows often and
    takes many steps of integration in a sample: its log is shorter.
    """

    effect: str
    at: Callable[[float], dict[str, float]]
    sizes: tuple[float, float, float]
    judged: tuple[str, ...]
    host: Machine = field(default_factory=Machine)
    duration: float = 12.5  # of the log that the tests diagnose [s]

    @property
    def base(self) -> ServoModel | None:
        """Where the diagnosis starts: the default; for the dead zone, which that has, eq. (4) alone."""
        return ServoModel(inertia=1.0, gravity=0.0, viscous_friction=0.1) if self.effect == "dead_zone" else None

    def machine(self, size: float) -> Machine:
        return self.host.hiding(**{self.effect: self.at(size)})

    @property
    def start(self) -> ServoModel:
        """The host's model, which for the dead zone has none."""
        host = self.host
        rigid = [float(np.asarray(value)) for value in (host.inertia, host.gravity, host.viscous_friction)]
        had = {name: values for name, values in host.effects.items() if name != self.effect}
        effects = tuple(catalogue[name](**{p: float(np.asarray(v)) for p, v in had[name].items()}) for name in had)
        return ServoModel(inertia=rigid[0], gravity=rigid[1], viscous_friction=rigid[2], effects=effects)

    def truth(self, size: float) -> ServoModel:
        """The true model."""
        return self.start.with_effect(catalogue[self.effect](**self.at(size)))


CASES = (
    Hidden(effect="input_delay", at=lambda s: {"time": s}, sizes=(0.00015, 0.0007, 0.005), judged=("time",)),
    Hidden(
        effect="actuator_lag",
        at=lambda s: {"time_constant": s},
        sizes=(0.0005, 0.0012, 0.0055),
        judged=("time_constant",),
        duration=20.0,
    ),
    Hidden(effect="dead_zone", at=lambda s: {"half_width": s}, sizes=(0.001, 0.011, 0.2), judged=("half_width",)),
    Hidden(effect="torque_offset", at=lambda s: {"torque": s}, sizes=(0.0003, 0.004, 0.15), judged=("torque",)),
    Hidden(
        effect="coulomb_friction",
        at=lambda s: {"torque": s},
        sizes=(0.0005, 0.008, 0.18),
        judged=("torque",),
        duration=20.0,
    ),
    Hidden(
        effect="asymmetric_friction",
        at=lambda s: {"forward": s, "backward": 0.5 * s, "viscous_difference": 0.1 * s},
        sizes=(0.0008, 0.014, 0.35),
        judged=("forward", "backward"),
    ),
    Hidden(
        effect="stribeck_friction",
        at=lambda s: {"coulomb": s, "excess": s, "velocity": 0.3},
        sizes=(0.002, 0.025, 0.4),
        judged=("coulomb", "excess"),
    ),
    Hidden(effect="quadratic_drag", at=lambda s: {"drag": s}, sizes=(0.0005, 0.006, 0.15), judged=("drag",)),
    Hidden(effect="gravity_offset", at=lambda s: {"beta": s}, sizes=(0.0003, 0.006, 0.17), judged=("beta",)),
    Hidden(
        effect="cogging",
        at=lambda s: {"amplitude": s, "order": 11.0, "phase": 0.7},
        sizes=(0.002, 0.008, 0.18),
        judged=("amplitude",),
    ),
    Hidden(effect="rate_limit", at=lambda s: {"rate": 50.0 / s}, sizes=(0.01, 0.018, 0.22), judged=("rate",)),
    Hidden(effect="torque_saturation", at=lambda s: {"limit": 8.0 - s}, sizes=(1.75, 2.0, 2.9), judged=("limit",)),
    Hidden(effect="back_emf", at=lambda s: {"constant": s}, sizes=(0.0073, 0.061, 0.5), judged=("constant",)),
    Hidden(
        effect="compliance",
        at=lambda s: {"frequency": 30.0 / s, "damping": 0.05, "motor_share": 0.3},
        sizes=(0.24, 0.34, 0.52),
        judged=("frequency",),
        duration=10.0,
    ),
    Hidden(
        effect="backlash",
        at=lambda s: {"gap": s, "motor_share": 0.3},
        sizes=(0.002, 0.005, 0.02),
        judged=("gap",),
        duration=10.0,
    ),
    Hidden(
        effect="load_dependent_friction",
        at=lambda s: {"coefficient": s},
        sizes=(0.0005, 0.006, 0.1),
        judged=("coefficient",),
    ),
    Hidden(
        effect="presliding_hysteresis",
        at=lambda s: {"torque": s, "stiffness": 27.0 * s},
        sizes=(0.002, 0.02, 0.3),
        judged=("torque", "stiffness"),
        duration=20.0,
    ),
    Hidden(
        effect="cable_stiffness",
        at=lambda s: {"stiffness": s, "cubic": 0.02 * s, "rest_angle": 0.4},
        sizes=(0.0003, 0.004, 0.1),
        judged=("stiffness",),
    ),
    Hidden(
        effect="end_stop",
        at=lambda s: {"angle": 3.0, "stiffness": 300.0 * s},
        sizes=(0.001, 0.01, 0.3),
        judged=("angle",),
    ),
    Hidden(
        effect="payload_change",
        at=lambda s: {"time": 23.1416, "inertia": s, "gravity": 0.3 * s},
        sizes=(0.0005, 0.006, 0.2),
        judged=("inertia", "gravity"),
        duration=40.0,
    ),
    Hidden(
        effect="periodic_disturbance",
        at=lambda s: {"amplitude": s, "frequency": 3.3, "phase": 0.4},
        sizes=(0.15, 0.3, 0.6),
        judged=("amplitude", "frequency"),
    ),
    Hidden(
        effect="friction_drift",
        at=lambda s: {"viscous_rate": s, "coulomb_rate": 0.5 * s},
        sizes=(0.00003, 0.0003, 0.004),
        judged=("viscous_rate",),
    ),
    Hidden(
        effect="encoder_eccentricity",
        at=lambda s: {"amplitude": s, "order": 1.0, "phase": 0.4},
        sizes=(0.0005, 0.002, 0.01),
        judged=("amplitude",),
    ),
    Hidden(
        effect="sensor_lag",
        at=lambda s: {"time_constant": s},
        sizes=(0.00015, 0.0007, 0.005),
        judged=("time_constant",),
    ),
)


def logs_of(machine: Machine, seed: int, duration: float = 60.0) -> tuple[Log, Log]:
    """A log to diagnose and one to hold out, from the same machine under different inputs."""
    commands = np.column_stack([excitation(2 * seed + k, duration=duration) for k in (0, 1)])
    out = record(machine, commands, seed=seed)
    return out.log(0), out.log(1)


def oracle(case: Hidden, size: float, log: Log) -> Fit:
    """The fit that is told which effect is there and where the truth is, and refines it."""
    truth = case.truth(size)
    at_truth = fit(log, truth, fixed=[name for name in truth.names if name != "inertia"])
    return Problem.of(log, truth).descend(at_truth)


def alternative_model(case: Hidden, size: float) -> ServoModel:
    """The nearest kind of model without the effect: the base, with the effect's special case where it has one."""
    start = case.start
    for special in catalogue[case.effect](**case.at(size)).reduced():
        start = start.with_effect(special)
    if case.effect == "asymmetric_friction":  # its difference of levels is an offset, whoever asks
        start = start.with_effect(catalogue["torque_offset"](torque=0.0))
    return start


def alternative_fit(case: Hidden, size: float, log: Log) -> Fit:
    """The nearest model without the effect, fitted."""
    return fit(log, alternative_model(case, size))


def evidence(case: Hidden, size: float, log: Log) -> float:
    """lambda: twice the rise in log-likelihood from the rival to the oracle."""
    return 2.0 * (oracle(case, size, log).log_likelihood - alternative_fit(case, size, log).log_likelihood)
