"""The servo model as a value: validated, immutable, a vector of named parameters."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from plant import BadParameter, ServoModel, catalogue
from plant.effects import (
    ActuatorLag,
    AsymmetricFriction,
    CoulombFriction,
    DeadZone,
    InputDelay,
    Moment,
    StribeckFriction,
    TorqueOffset,
)

STRIBECK = StribeckFriction(coulomb=0.2, excess=0.1, velocity=0.1)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("inertia", 0.0),
        ("inertia", -1.0),
        ("inertia", math.nan),
        ("inertia", "heavy"),
        ("gravity", math.inf),
        ("viscous_friction", -1e-9),
        ("axis", "round"),
    ],
)
def test_what_cannot_be_a_servo_is_refused_by_name(name: str, value: object) -> None:
    with pytest.raises(BadParameter, match=name):
        ServoModel(**{name: value})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        (DeadZone, {"half_width": -0.1}),
        (InputDelay, {"time": -1.0}),
        (ActuatorLag, {"time_constant": 0.0}),
        (CoulombFriction, {"torque": math.nan}),
        (StribeckFriction, {"coulomb": 0.1, "excess": 0.1, "velocity": 0.0}),
        (TorqueOffset, {"torque": math.inf}),
    ],
)
def test_an_effect_refuses_values_out_of_its_bounds(kind: type, values: dict[str, float]) -> None:
    with pytest.raises(BadParameter, match=kind.name):
        kind(**values)


def test_an_effect_acts_once() -> None:
    with pytest.raises(BadParameter, match="torque_offset"):
        ServoModel(effects=(TorqueOffset(torque=0.1), TorqueOffset(torque=0.2)))


def test_a_linear_axis_has_no_arm_gravity_and_its_own_units() -> None:
    with pytest.raises(BadParameter, match="gravity"):
        ServoModel(axis="linear")
    cart = ServoModel(inertia=100.0, gravity=0.0, viscous_friction=200.0, effects=(STRIBECK,), axis="linear")
    units = {spec.name: spec.unit for spec in cart.parameters}
    assert units["inertia"] == "kg"
    assert units["stribeck_friction.coulomb"] == "N"


def test_a_model_does_not_change_and_with_effect_makes_another() -> None:
    model = ServoModel.paper()
    more = model.with_effect(CoulombFriction(torque=0.2))
    assert model.effect("coulomb_friction") is None
    assert more.effect("coulomb_friction") == CoulombFriction(torque=0.2)
    with pytest.raises(dataclasses.FrozenInstanceError):
        model.inertia = 3.0  # type: ignore[misc]
    assert more.without_effect("coulomb_friction") == model


def test_an_effect_replaces_its_own_kind_and_special_cases() -> None:
    model = ServoModel(effects=(CoulombFriction(torque=0.2),))
    assert model.with_effect(CoulombFriction(torque=0.3)).effects == (CoulombFriction(torque=0.3),)
    for wider in (STRIBECK, AsymmetricFriction(forward=0.1, backward=0.2)):
        assert model.with_effect(wider).effects == (wider,)


def test_the_order_of_effects_is_the_way_of_the_command() -> None:
    parts = (TorqueOffset(torque=0.1), DeadZone(half_width=0.2), ActuatorLag(time_constant=0.1), InputDelay(time=0.01))
    names = [effect.name for effect in ServoModel(effects=parts).effects]
    assert names == ["input_delay", "actuator_lag", "dead_zone", "torque_offset"]
    assert ServoModel(effects=parts) == ServoModel(effects=parts[::-1])


def test_the_paper_servo() -> None:
    model = ServoModel.paper()
    assert model.names == ("inertia", "gravity", "viscous_friction", "dead_zone.half_width")
    assert model.values.tolist() == [2.0, 0.5, 0.8, 0.5]
    assert "inertia = 2 kg m^2" in str(model)


positive = st.floats(1e-3, 1e3)


@given(st.tuples(positive, st.floats(-1e3, 1e3), positive, positive))
def test_values_go_in_as_they_come_out(numbers: tuple[float, ...]) -> None:
    model = ServoModel.paper().with_values(numbers)
    assert model.values.tolist() == list(numbers)
    assert model.structure == ServoModel.paper().structure


def test_values_must_fit() -> None:
    with pytest.raises(BadParameter, match="4 parameters"):
        ServoModel.paper().with_values([1.0, 2.0])
    with pytest.raises(BadParameter, match="half_width"):
        ServoModel.paper().with_values([2.0, 0.5, 0.8, -0.5])


def test_states_are_those_of_the_load_and_of_its_effects() -> None:
    assert ServoModel.paper().states == ("angle", "velocity")
    assert ServoModel(effects=(ActuatorLag(time_constant=0.1),)).states == ("angle", "velocity", "actuator_lag")


def test_the_catalogue_names_what_it_holds() -> None:
    assert len(catalogue) >= 10
    for name, kind in catalogue.items():
        assert kind.name == name
        assert kind.parameters()
        assert kind.equation
        assert all(spec.meaning for spec in kind.parameters())


def test_dry_friction_adds_up() -> None:
    model = ServoModel(effects=(STRIBECK, AsymmetricFriction(forward=0.1, backward=0.3)))
    forward, backward = model.dry_friction(Moment())  # type: ignore[misc]
    assert (float(forward), float(backward)) == pytest.approx((0.4, 0.6))
    assert ServoModel.paper().dry_friction(Moment()) is None
    assert not ServoModel.paper().slides


def test_equation_4_with_numbers() -> None:
    model = ServoModel(inertia=2.0, gravity=0.5, viscous_friction=0.8)
    angle, velocity, torque = 0.7, -1.3, 3.0
    expected = (-0.5 * np.cos(angle) - 0.8 * velocity + torque) / 2.0
    at = Moment(angle=angle, velocity=velocity, torque=torque)
    assert float(model.smooth_acceleration(at)) == pytest.approx(expected, rel=1e-14)
