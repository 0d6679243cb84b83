"""A servo model as an FMU: what a fit or a diagnosis found, for Simulink and Modelica tools."""

from __future__ import annotations

from importlib.resources import files
from typing import Any

import casadi as ca
import numpy as np

from plant.discrete import integration_steps, sample_reading, sample_step
from plant.drive_train import DriveTrain
from plant.effects import State
from plant.errors import BadParameter
from plant.fmu import Fmu, Variable
from plant.gears import GearTrain
from plant.servo import ServoModel
from plant.simulation import whole_samples

_LONGEST_DELAY = 1.0  # [s] that the memory of an FMU has room for


def servo_fmu(
    model: ServoModel, *, sample_time: float, gears: DriveTrain | None = None, name: str = "antidrive"
) -> Fmu:
    """The model as an FMU: each sample is that of `plant.simulate`, to the last bit.

    A command holds for a sample. The outputs are the sensor's reading, without noise and before any encoder rounds it,
    and the true motion of the load; parameters, first angle and first velocity may be set before the start. Effects
    that only a position servo shows (`goal_rate_limit`) rest, since the command is a torque.

    Args:
        model: of a servo.
        sample_time: [s].
        gears: with them the commands are the torques of the drives, `torque_1`, `torque_2` [N m]; without, it is the
            torque [N m] (on a linear axis the force [N]) on the load.
        name: of the library, with "_plant" behind it.

    Raises:
        BadParameter: a sample time that is not positive, or a gear train on a linear axis.
    """
    if not (np.isfinite(sample_time) and sample_time > 0.0):
        raise BadParameter(f"sample_time must be finite and above zero, not {sample_time:g}.")
    model = model.commanded()
    if isinstance(gears, GearTrain) and model.axis == "linear":
        raise BadParameter("A linear axis has no gear train; give its Ratios in N/(N m), or leave gears out.")
    angle, torque = ("angle", "torque") if model.axis == "rotary" else ("position", "force")
    length, strength = ("rad", "N m") if model.axis == "rotary" else ("m", "N")
    commands = {torque: strength} if gears is None else {f"torque_{i + 1}": "N m" for i in range(gears.drives)}
    variables = [
        *(Variable(name=each, unit=unit, meaning="command", causality="input") for each, unit in commands.items()),
        Variable(name=angle, unit=length, meaning="what the sensor shows", causality="output"),
        Variable(name=f"load_{angle}", unit=length, meaning="where the load is", causality="output"),
        Variable(name="velocity", unit=f"{length}/s", meaning="of the load", causality="output"),
        Variable(name=f"first_{angle}", unit=length, meaning="at the start", causality="parameter"),
        Variable(name="first_velocity", unit=f"{length}/s", meaning="at the start", causality="parameter"),
    ]
    for spec, value in zip(model.parameters, model.values, strict=True):
        own = Variable(
            name=spec.name,
            unit=spec.unit.removesuffix("-"),
            meaning=spec.meaning,
            causality="parameter",
            start=float(value),
            lower=spec.lower,
            upper=spec.upper,
        )
        variables.append(own)
    return Fmu(
        name=f"{name}_plant",
        description=f"Servo: inertia, gravity, viscous friction{''.join(f', {e.title}' for e in model.effects)}",
        sample_time=float(sample_time),
        variables=tuple(variables),
        machine=_machine(model, sample_time, (1.0,) if gears is None else tuple(gears.torque_map.tolist())),
    )


def _machine(model: ServoModel, sample_time: float, torque_map: tuple[float, ...]) -> str:
    """C code: the steps that CasADi writes, what they need, and the machine around them."""
    step, reading = sample_step(model, substeps=integration_steps(model, sample_time)), sample_reading(model)
    generator = ca.CodeGenerator("steps.c")
    generator.add(step)
    generator.add(reading)
    delay = "input_delay.time"
    late = delay in model.names
    numbers = {
        "STATES": len(model.states),
        "PARAMETERS": len(model.names),
        "COMMANDS": len(torque_map),
        "DELAY": model.names.index(delay) if late else -1,
        "PAST": 2 + (whole_samples(_LONGEST_DELAY, sample_time)[0] if late else 0),
        **_work("STEP", step),
        **_work("READING", reading),
    }
    begins = {State.ANGLE: 1, State.VELOCITY: 2}  # place behind the outputs; everything else begins at zero
    tables = (
        f"enum {{ {', '.join(f'{name} = {value}' for name, value in numbers.items())} }};\n"
        f"static const double torque_map[] = {{{', '.join(map(repr, torque_map))}}};\n"
        f"static const int begins[] = {{{', '.join(str(begins.get(kind, 0)) for kind in model.kinds)}}};\n"
    )
    around = (files("plant") / "servo_fmu.c").read_text(encoding="utf-8")
    return f"#define CASADI_SYMBOL_EXPORT static\n{generator.dump()}\n{tables}\n{around}"


def _work(name: str, function: Any) -> dict[str, int]:
    """What a function of CasADi needs to work."""
    sizes = {"ARG": function.sz_arg(), "RES": function.sz_res(), "IW": function.sz_iw(), "W": function.sz_w()}
    return {f"{name}_{kind}": int(size) for kind, size in sizes.items()}
