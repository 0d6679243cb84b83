"""A controller as an FMU, for Simulink and Modelica tools: the C99 of `mpc.export` behind the functions of FMI 2.0."""

from __future__ import annotations

from importlib.resources import files

from mpc.controller import Controller
from mpc.export import export
from plant.fmu import Fmu, Variable


def controller_fmu(controller: Controller) -> Fmu:
    """The controller as an FMU, which hands out the torques of `Controller.step` to the last bit.

    It reads angle and reference when a sample begins, and holds the torques until the next; before the first they are
    zero. The reference is a number, so that nothing of its future is known.

    Args:
        controller: what it is; what it remembers does not count.
    """
    made = export(controller)
    motors = controller.motor_resolution is not None
    variables = [
        Variable(name="angle", unit="rad", meaning="measured angle of the load; NaN if none", causality="input"),
        Variable(name="reference", unit="rad", meaning="wanted angle of the load; NaN holds it", causality="input"),
        *(
            Variable(name=f"motor_angle_{i}", unit="rad", meaning=f"measured angle of motor {i}", causality="input")
            for i in ((1, 2) if motors else ())
        ),
        Variable(name="torque_1", unit="N m", meaning="for pinion 1", causality="output"),
        Variable(name="torque_2", unit="N m", meaning="for pinion 2", causality="output"),
        Variable(name="margin", unit="N m", meaning="least predicted flank torque above the minimum, at the pinion",
                 causality="output"),
        Variable(name="disturbance", unit="N m", meaning="torque on the load that the model does not know",
                 causality="output"),
        Variable(name="status", unit="", meaning="0 if optimal, else the sum of the reasons why not",
                 causality="output", whole=True),
    ]  # fmt: skip
    code = made.files["antidrive_controller.c"]
    include = '#include "antidrive_controller.h"\n'
    before, after = code.split(include)
    around = (files("mpc") / "target" / "fmu.c").read_text(encoding="utf-8")
    return Fmu(
        name="antidrive_controller",
        description="Predictive controller that keeps the teeth of a preloaded pair of drives together",
        sample_time=controller.sample_time,
        variables=tuple(variables),
        machine=f"{before}{made.files['antidrive_controller.h']}{after}\n{around}",
    )
