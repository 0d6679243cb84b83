"""The linearised servo: closed forms, small signals of the simulation, and the plant of the loop's analysis."""

from __future__ import annotations

import control
import numpy as np
import pytest
from target import MODELS, PAPER

from mpc import Controller, analyse_loop
from plant import BadParameter, ServoModel, linearise, simulate
from plant.discrete import sample_reading
from plant.effects import (
    ActuatorLag,
    Cogging,
    CoulombFriction,
    DeadZone,
    Effect,
    InputDelay,
    QuadraticDrag,
    SensorLag,
    StribeckFriction,
    TorqueSaturation,
)
from plant.linear import operating_point

DT = 0.005
RIGID = MODELS["rigid"]


@pytest.mark.parametrize("angle", [0.0, 0.3, 2.0])
def test_the_rigid_servo_is_its_closed_form(angle: float) -> None:
    found = linearise(RIGID, sample_time=DT, angle=angle)
    J, alpha, K = RIGID.inertia, RIGID.gravity, RIGID.viscous_friction
    continuous = control.ss([[0, 1], [alpha * np.sin(angle) / J, -K / J]], [[0], [1 / J]], [[1, 0]], 0)
    exact = control.c2d(continuous, DT)
    for name in "ABCD":
        np.testing.assert_allclose(getattr(found, name), getattr(exact, name), atol=1e-12)
    assert (found.dt, found.state_labels, found.input_labels) == (DT, ["angle", "velocity"], ["torque"])
    assert operating_point(RIGID, sample_time=DT, angle=angle)[0] == pytest.approx(alpha * np.cos(angle))


MOVING = {
    "late": RIGID.with_effect(InputDelay(time=0.0132)).with_effect(SensorLag(time_constant=0.02)),
    "whole": RIGID.with_effect(InputDelay(time=2 * DT)),
    "dead zone": RIGID.with_effect(DeadZone(half_width=0.3)).with_effect(QuadraticDrag(drag=0.2)),
    "sliding": RIGID.with_effect(StribeckFriction(coulomb=0.3, excess=0.2, velocity=0.4)),
    "elastic": MODELS["compliance"].with_effect(ActuatorLag(time_constant=0.02)),
}


@pytest.mark.parametrize("name", MOVING)
def test_small_signals_of_the_simulation_follow_it(name: str) -> None:
    """Gravity apart, a servo that turns stays at its operating point, and what is added is small."""
    model = ServoModel(
        inertia=RIGID.inertia, gravity=0.0, viscous_friction=RIGID.viscous_friction, effects=MOVING[name].effects
    )
    system = linearise(model, sample_time=DT, angle=0.1, velocity=0.8)
    torque, state = operating_point(model, sample_time=DT, angle=0.1, velocity=0.8)
    change = 1e-3 * np.sin(np.arange(200) ** 1.5 / 20)
    change[0] = 0.0  # so that the command before the first was that of the operating point
    steady, moved = (simulate(model, command=torque + u, dt=DT, state=state) for u in (0 * change, change))
    sensor = sample_reading(model).map(len(steady))
    seen = np.array(sensor(moved.T, model.values) - sensor(steady.T, model.values)).ravel()
    expected = control.forced_response(system, inputs=change).outputs.ravel()
    assert np.max(np.abs(expected)) > 1e-6
    np.testing.assert_allclose(seen[:-1], expected, atol=2e-4 * np.max(np.abs(expected)))
    assert np.ptp(np.diff(steady[:, 1])) < 1e-10  # it is steady


@pytest.mark.parametrize("name", ["rigid", "lag", "late", "compliance"])
def test_it_is_the_plant_of_the_loop(name: str) -> None:
    model = MODELS[name].without_effect("coulomb_friction")
    expected = analyse_loop(Controller(model, PAPER, sample_time=DT), angle=0.3).plant
    found, z = linearise(model, sample_time=DT, angle=0.3), np.exp(1j * np.geomspace(0.5, 600.0, 40) * DT)
    # The controller follows a lag in one step of integration where the simulation takes several.
    np.testing.assert_allclose(found(z), expected(z), rtol=5e-3 if name == "lag" else 1e-5)


@pytest.mark.parametrize("slow", [InputDelay(time=0.0125), ActuatorLag(time_constant=0.02)], ids=lambda e: e.name)
@pytest.mark.parametrize("others", [(), (DeadZone(half_width=0.5), Cogging(amplitude=0.2, order=12.0, phase=0.3))])
@pytest.mark.parametrize("angle", [-1.0, 0.0, 0.3, 0.9])
def test_a_load_with_friction_behind_a_slow_drive_rests(slow: Effect, others: tuple[Effect, ...], angle: float) -> None:
    friction = StribeckFriction(coulomb=0.25, excess=0.1, velocity=0.2)
    model = ServoModel(inertia=2.0, gravity=0.5, viscous_friction=0.8, effects=(slow, *others, friction))
    torque, _ = operating_point(model, sample_time=0.005, angle=angle)
    quick, _ = operating_point(model.without_effect(slow.name), sample_time=0.005, angle=angle)
    assert torque == pytest.approx(quick, abs=1e-3)
    assert others or torque == pytest.approx(0.5 * np.cos(angle), abs=1e-3)
    assert np.isfinite(linearise(model, sample_time=0.005, angle=angle, width=0.1).A).all()


def test_friction_sticks_at_rest_and_a_dead_zone_passes_nothing() -> None:
    model = RIGID.with_effect(CoulombFriction(torque=0.6))
    stuck = linearise(model, sample_time=DT)
    assert not np.any(stuck.B)
    assert operating_point(model, sample_time=DT)[0] == pytest.approx(model.gravity)
    creeping = linearise(model, sample_time=DT, width=0.05)
    assert creeping.B[1, 0] > 0.0
    assert not np.any(linearise(RIGID.with_effect(DeadZone(half_width=0.3)), sample_time=DT, angle=np.pi / 2).B)
    assert abs(creeping.A[1, 1]) < linearise(RIGID, sample_time=DT).A[1, 1]


@pytest.mark.parametrize(
    ("model", "options", "reason"),
    [
        (RIGID, {"sample_time": 0.0}, "sample_time"),
        (RIGID.with_effect(TorqueSaturation(limit=0.2)), {"sample_time": DT}, "keeps the load"),
        (RIGID, {"sample_time": DT, "angle": np.nan}, "keeps the load"),
    ],
)
def test_a_missing_operating_point_is_reported(model: ServoModel, options: dict[str, float], reason: str) -> None:
    with pytest.raises(BadParameter, match=reason):
        linearise(model, **options)
