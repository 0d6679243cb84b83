"""Friction in the model of the controller degrades no loop, and its scale is learnt while the load slides."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mpc import ClosedLoopResult, Controller, closed_loop
from plant import GearTrain, Rig, ServoModel
from plant.effects import CoulombFriction, Effect, PreslidingHysteresis, StribeckFriction
from plant.errors import BadParameter

Array = NDArray[np.float64]
GEARS = GearTrain(pinion_teeth=(20, 20), output_teeth=161)
TEETH: dict[str, Any] = {"flank_stiffness": 5e3, "flank_damping": 1.0, "fine_step": 25e-6}
LIGHT = Rig(gears=GEARS, inertia=0.02, gravity=0.1, viscous_friction=0.02, coulomb_friction=0.25, **TEETH)
STICKY = Rig(
    gears=GEARS, inertia=0.02, gravity=0.1, viscous_friction=0.02, coulomb_friction=0.25, breakaway_excess=0.2, **TEETH
)
FRICTION = {LIGHT: CoulombFriction(torque=0.25), STICKY: StribeckFriction(coulomb=0.25, excess=0.2, velocity=0.05)}


def controller(*effects: Effect, **options: Any) -> Controller:
    model = ServoModel(inertia=LIGHT.total_inertia, gravity=0.1, viscous_friction=0.02, effects=effects)
    known = {"rotor_inertia": 4e-6, "motor_friction": 5e-4, "encoder_noise": 2e-6, "sample_time": 0.002}
    return Controller(model, GEARS, **{**known, **options})


def swing(time: Array) -> Array:
    return np.asarray(0.04 * (1 - np.cos(np.pi * time)))


def error(loop: ClosedLoopResult) -> float:
    return float(np.sqrt(np.mean((loop.angle - loop.reference)[100:] ** 2)))


@pytest.mark.parametrize("rig", FRICTION, ids=["Coulomb", "Stribeck"])
@pytest.mark.parametrize("factor", [1.0, pytest.param(0.7, marks=pytest.mark.long), 1.3])
def test_known_friction_improves_tracking_on_a_light_axis(rig: Rig, factor: float) -> None:
    friction = FRICTION[rig]
    values = [getattr(friction, spec.name) for spec in friction.parameters()]
    modelled = friction.bound([factor * value for value in values[:2]] + values[2:])
    known, unknown = (
        [closed_loop(controller(*effects), rig, swing, 3.0, seed=seed) for seed in range(5)]
        for effects in ((modelled,), ())
    )
    errors = np.array([[error(loop) for loop in loops] for loops in (known, unknown)])  # a stuck load is an outlier
    assert np.median(errors[0]) < 0.55 * np.median(errors[1])
    assert errors[0].max() < 1.5 * np.median(errors[1])
    assert min(loop.minimum_contact_torque for loop in known) > 0


def test_known_friction_prevents_stick_slip_at_low_speed() -> None:
    known, unknown = (
        closed_loop(c, STICKY, lambda t: 0.01 * t, 1.5, seed=0)
        for c in (controller(FRICTION[STICKY], bandwidth=8.0), controller(bandwidth=8.0))
    )
    assert error(known) < 1.05 * error(unknown)


@pytest.mark.parametrize("modelled", [0.18, 0.33])
def test_friction_scale_is_learned_only_while_sliding(modelled: float) -> None:
    c = controller(CoulombFriction(torque=modelled), friction_std=0.3)
    closed_loop(c, LIGHT, lambda t: swing(np.minimum(t, 4.0)), 4.0, seed=0)
    learnt = c._arrays["learnt"].copy()
    assert learnt[2] * modelled == pytest.approx(
        0.25, abs=0.03
    )  # the friction of the load; that of the motors is extra
    for _ in range(200):
        c.step(0.0, 0.0)
    assert c._arrays["learnt"][1:3] == pytest.approx(learnt[1:3], abs=1e-3)


def test_what_is_not_sure_is_not_compensated() -> None:
    def pushed(**options: float) -> float:
        c = controller(CoulombFriction(torque=0.25), **options)
        for k in range(30):
            c.step(0.0, 0.05 * np.maximum(0.0, 0.002 * (k + np.arange(c.horizon + 1) - 5)))
        return float(c._arrays["rub"][0])

    assert pushed(friction_std=0.0) == pytest.approx(0.25)
    assert pushed(friction_std=0.4) == pytest.approx(0.15)
    assert pushed(friction_std=2.0) == 0.0
    with pytest.raises(BadParameter, match="friction_std"):
        controller(friction_std=-0.1)


def test_at_rest_friction_does_nothing() -> None:
    # with friction too high by half, the load stays within 1.5 encoder counts and does not jump
    for seed in range(4):
        loop = closed_loop(
            controller(CoulombFriction(torque=0.38)), LIGHT, lambda t: 0.05 * np.minimum(t, 0.5), 2.0, seed=seed
        )
        assert np.max(np.abs(loop.angle[-500:] - loop.reference[-500:])) < 1.5 * 2 * np.pi / 2**17


def test_friction_changes_no_faster_than_the_contact_bears() -> None:
    c = controller(CoulombFriction(torque=0.8))
    rubs = []
    for k in range(300):
        c.step(float(swing(np.array(0.002 * k))), swing(0.002 * (k + np.arange(c.horizon + 1))))
        rubs.append(c._arrays["rub"][0])
    assert max(rubs) > 0.5
    assert np.max(np.abs(np.diff(rubs))) <= 0.02 * 161 / 20 + 1e-12


def test_presliding_contact_is_exported_as_sliding() -> None:
    spring = PreslidingHysteresis(torque=0.25, stiffness=2e3)
    loop, same = (
        closed_loop(controller(effect), LIGHT, swing, 1.0, seed=0) for effect in (spring, CoulombFriction(torque=0.25))
    )
    assert np.array_equal(loop.angle, same.angle)
