"""A controller as an FMU, for Simulink and Modelica tools: the C99 code of `mpc.export` with an FMI 2.0 interface."""

from __future__ import annotations

from importlib.resources import files
from string import Template

from mpc.controller import Controller
from mpc.export import export
from mpc.target_report import what
from plant.fmu import Fmu, Variable
from plant.units import axis_quantities


def controller_fmu(controller: Controller, *, name: str = "antidrive") -> Fmu:
    """The controller as an FMU; it gives the torques of `Controller.step` to the last bit.

    It reads angle and reference at the start of a sample and holds the torques until the next one; before the first
    sample they are zero. The reference is a scalar, without preview.

    Args:
        controller: the controller to export, without its present state.
        name: of the library, followed by "_controller"; several FMUs in one model need different names.

    Raises:
        BadParameter: a name that is not valid in C.
    """
    made = export(controller, name=name)
    motors = controller.motor_resolution is not None
    drives = range(1, controller.gears.drives + 1)
    angle, length, torque, newton = axis_quantities(controller.model.axis)
    variables = [
        Variable(name=angle, unit=length, meaning=f"measured {angle} of the load; NaN if none", causality="input"),
        Variable(name="reference", unit=length, meaning=f"wanted {angle} of the load; NaN holds it", causality="input"),
        *(
            Variable(name=f"motor_angle_{i}", unit="rad", meaning=f"measured angle of motor {i}", causality="input")
            for i in (drives if motors else ())
        ),
        *(Variable(name=f"torque_{i}", unit="N m", meaning=f"for drive {i}", causality="output") for i in drives),
        Variable(name="margin", unit="N m", meaning="smallest predicted margin of contact, at the pinion",
                 causality="output"),
        Variable(name="disturbance", unit=newton, meaning=f"{torque} on the load that the model does not know",
                 causality="output"),
        Variable(name="status", unit="", meaning="0 if optimal, else the sum of the reasons why not",
                 causality="output", whole=True),
    ]  # fmt: skip
    before, after = made.files[f"{name}_controller.c"].split(f'#include "{name}_controller.h"\n')
    around = Template((files("mpc") / "target" / "fmu.c").read_text(encoding="utf-8"))
    header, machine = made.files[f"{name}_controller.h"], around.substitute(name=name, NAME=name.upper())
    return Fmu(
        name=f"{name}_controller",
        description=f"Predictive controller of {what(controller)}",
        sample_time=controller.sample_time,
        variables=tuple(variables),
        machine=f"{before}{header}{after}\n{machine}",
    )
