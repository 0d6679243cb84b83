"""The equations of a model in print: what acts on the body stands in its equation, and each effect has its own."""

from __future__ import annotations

import re
from html import unescape

from antidrive.equations import model_equations
from plant import ServoModel
from plant.effects import ActuatorLag, Cogging, Compliance, CoulombFriction, DeadZone, EncoderEccentricity

BODY = {"inertia": 2.0, "gravity": 0.5, "viscous_friction": 0.8}


def plain(model: ServoModel) -> list[str]:
    """What is printed, marks taken out."""
    return [unescape(re.sub(r"<[^>]*>|\s", "", str(law))) for _, law, _ in model_equations(model)]


def body(*effects, **given) -> str:
    return plain(ServoModel(**(BODY | given), effects=effects))[0]


def test_what_acts_on_the_load_is_in_the_equation_of_the_body():
    alone, torn = body(), body(CoulombFriction(torque=0.1), Cogging(amplitude=0.1, order=2.0, phase=0.0))
    assert alone.endswith("=τ−αcosx−Kx˙")
    assert torn == alone + "+τf+τc"
    assert body(EncoderEccentricity(amplitude=0.1, order=1.0, phase=0.0)) == alone


def test_the_torque_arrives_through_the_actuator():
    assert "=h(τ)−" in body(DeadZone(half_width=0.1))
    assert "=τa−" in body(ActuatorLag(time_constant=0.1))
    assert "=h(τa)−" in body(DeadZone(half_width=0.1), ActuatorLag(time_constant=0.1))


def test_a_spring_parts_motor_and_load():
    parted = body(DeadZone(half_width=0.1), Compliance(frequency=50.0, damping=0.1, motor_share=0.4))
    assert re.fullmatch(r"\(1−s\)Jx¨=τl−αcosx−Kx˙,sJθ¨=h\(τ\)−τl", parted)


def test_a_linear_axis_has_no_gravity():
    model = ServoModel(inertia=5.0, gravity=0.0, viscous_friction=9.0, axis="linear")
    ((title, _, symbols),) = model_equations(model)
    assert (title, symbols) == ("Rigid body", "inertia J, viscous friction K")
    assert "cos" not in plain(model)[0]


def test_each_effect_has_its_title_equation_and_symbols():
    model = ServoModel(**BODY, effects=(DeadZone(half_width=0.1), CoulombFriction(torque=0.1)))
    assert [(title, symbols) for title, _, symbols in model_equations(model)] == [
        ("Rigid body", "inertia J, gravity torque α, viscous friction K"),
        ("Dead zone", "half width γ"),
        ("Coulomb friction", "friction torque F_c"),
    ]
