"""The Modelica class, translated by pymoca: it moves as the model does."""

from __future__ import annotations

import numpy as np
import pytest
from simulators import in_modelica

from plant import BadParameter, ServoModel, simulate
from plant.effects import (
    ActuatorLag,
    Cogging,
    Compliance,
    DeadZone,
    FrictionDrift,
    InputDelay,
    PreslidingHysteresis,
    SensorLag,
    StribeckFriction,
    TorqueSaturation,
)
from plant.modelica_class import modelica_class

DT = 0.005
TIME = np.arange(150) * DT
COMMAND = 2.0 * np.sin(2.0 * np.pi * 1.3 * TIME) + 0.8 * np.sign(np.sin(2.0 * np.pi * 1.7 * TIME))


def model_with(*effects: object) -> ServoModel:
    return ServoModel(inertia=0.5, gravity=0.3, viscous_friction=0.2, effects=effects)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    ("effects", "close"),
    [
        (
            (DeadZone(half_width=0.2), Cogging(amplitude=0.2, order=5.0, phase=0.2), ActuatorLag(time_constant=0.02)),
            1e-4,
        ),
        ((PreslidingHysteresis(torque=0.3, stiffness=5.0), TorqueSaturation(limit=1.5)), 1e-4),
        ((Compliance(frequency=60.0, damping=0.05, motor_share=0.3),), 1e-4),
        ((StribeckFriction(coulomb=0.2, excess=0.2, velocity=0.3),), 1e-2),  # smooth at rest, where it should stick
    ],
    ids=lambda value: value[0].name if isinstance(value, tuple) else "",
)
def test_the_class_moves_as_the_model_does(effects, close):
    pytest.importorskip("pymoca.parser", reason="pymoca translates Modelica and is not installed")
    model = model_with(*effects)
    here, there = simulate(model, command=COMMAND, dt=DT)[:-1, 0], in_modelica(model, COMMAND, DT)
    assert np.ptp(here) > 0.1
    assert np.abs(there - here).max() < close * np.ptp(here)


def test_units_names_and_what_is_left_out_stand_in_the_class():
    effects = (InputDelay(time=0.01), StribeckFriction(coulomb=0.2, excess=0.2, velocity=0.3))
    more = (FrictionDrift(viscous_rate=0.1), SensorLag(time_constant=0.01))
    made = modelica_class(model_with(*effects, *more), name="Elbow")
    assert made.text.startswith('class Elbow "Servo: rigid body')
    assert 'parameter Real viscous_friction(unit="N.m.s/rad") = 0.2 "viscous friction K";' in made.text
    assert "entering = delay(torque, input_delay_time);" in made.text
    assert made.left_out == (
        "Not in it: sensor lag.",
        "Left out, because it holds for the log alone: friction drift.",
    )
    assert "force(unit" in modelica_class(ServoModel(gravity=0.0, axis="linear")).text
    with pytest.raises(BadParameter, match="beginning with a letter"):
        modelica_class(model_with(), name="2nd")
