"""The Modelica class, translated by pymoca: it moves as the model does."""

from __future__ import annotations

import logging

import casadi as ca
import numpy as np
import pytest

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

DT, SUBSTEPS = 0.005, 8
TIME = np.arange(150) * DT
COMMAND = 2.0 * np.sin(2.0 * np.pi * 1.3 * TIME) + 0.8 * np.sign(np.sin(2.0 * np.pi * 1.7 * TIME))


def model_with(*effects: object) -> ServoModel:
    return ServoModel(inertia=0.5, gravity=0.3, viscous_friction=0.2, effects=effects)


def moved(text: str) -> np.ndarray:
    """(T,) angle at each sample, the class translated by pymoca and integrated by Runge and Kutta's method."""
    parser = pytest.importorskip("pymoca.parser", reason="pymoca translates Modelica and is not installed")
    from pymoca.backends.casadi.generator import generate

    made = generate(parser.parse(text), "Antidrive")
    states, others = len(made.states), len(made.alg_states)
    x, rates, inner, torque = (ca.MX.sym(n, c) for n, c in (("x", states), ("r", states), ("i", others), ("u", 1)))
    values = ca.DM([float(p.value) for p in made.parameters])
    off = made.dae_residual_function(0, x, rates, inner, torque, ca.DM(0, 1), values)
    parts = {"x": ca.vertcat(rates, inner), "p": ca.vertcat(x, torque), "g": off}
    solve, guess = ca.rootfinder("solve", "newton", parts), np.ones(states + others)
    h, z, place = DT / SUBSTEPS, np.zeros(states), [s.symbol.name() for s in made.states].index("angle")

    def rate(at: np.ndarray, command: float) -> np.ndarray:
        return np.array(solve(guess, np.append(at, command))).ravel()[:states]

    found = []
    for command in COMMAND:
        found.append(z[place])
        for _ in range(SUBSTEPS):
            first = rate(z, command)
            second = rate(z + h / 2 * first, command)
            third = rate(z + h / 2 * second, command)
            z = z + h / 6 * (first + 2 * second + 2 * third + rate(z + h * third, command))
    return np.array(found)


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
def test_the_class_moves_as_the_model_does(effects, close, monkeypatch):
    monkeypatch.setattr(ca.MX, "__div__", ca.MX.__truediv__, raising=False)  # as pymoca calls it
    logging.getLogger("pymoca").setLevel(logging.ERROR)
    model = model_with(*effects)
    here, there = simulate(model, command=COMMAND, dt=DT)[:-1, 0], moved(modelica_class(model).text)
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
