"""Contact on the test bench: kept with a minimum contact torque, lost with a minimum motor torque, as predicted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from raised_load import BY_FLANK, BY_MOTOR, GEARS, LEAST, LIMITS, MESH, MODEL, MOST, MOTOR, RIG, ROTOR, swing

from allocation import capability_map
from mpc import ClosedLoopResult, Controller, closed_loop

PARTING = LEAST * MESH / ROTOR
"""Acceleration at which a rotor takes the whole minimum motor torque, n^2 J_m a = n eps [rad/s^2]."""


def run(controller: Controller, acceleration: float, duration: float = 2.0) -> ClosedLoopResult:
    return closed_loop(controller, RIG, swing(acceleration, duration), duration, seed=0)


@pytest.mark.parametrize("share", [0.7, 0.95, 1.05, 1.4])
def test_a_minimum_motor_torque_loses_contact_with_heavy_rotors(share: float) -> None:
    # at the top, gravity and not the motors turns the load back: the motors are near their minimum torque
    result = run(BY_MOTOR(), share * PARTING)
    assert np.min(np.abs(result.torques)) >= LEAST
    if share < 1:
        assert result.minimum_contact_torque == pytest.approx(LEAST * MESH * (1 - share), abs=0.15)
        assert result.minimum_contact_torque > 0
    else:
        assert result.minimum_contact_torque <= 0
        assert np.min(result.contact_torques[:, 1]) > 0.5 * LEAST * MESH  # the drive that moves the load keeps contact


@pytest.mark.parametrize("share", [0.7, 0.95, 1.05, 1.4])
def test_minimum_contact_torque_keeps_contact_all_the_same(share: float) -> None:
    result = run(BY_FLANK(), share * PARTING)
    assert result.minimum_contact_torque > 0.85 * LEAST * MESH
    assert result.tracking_rms == pytest.approx(
        run(BY_MOTOR(), share * PARTING).tracking_rms, rel=0.1
    )  # also where the other one loses contact


@pytest.mark.parametrize("share", [0.7, 0.95, 1.05, 1.4])
def test_heavy_rotors_keep_contact_with_the_loop_chosen_for_them(share: float) -> None:
    chosen = Controller(MODEL, GEARS, min_torque=LEAST, max_torque=MOST, rotor_inertia=MOTOR)
    result = run(chosen, share * PARTING)
    assert result.minimum_contact_torque > 0.2 * LEAST * MESH  # more gear oscillation than at 4 Hz
    assert result.tracking_rms < run(BY_FLANK(), share * PARTING).tracking_rms
    assert result.degraded == 0


@pytest.mark.parametrize("acceleration", [3.0, 8.0])
def test_minimum_contact_torque_covers_the_motors_friction(acceleration: float) -> None:
    # dry friction above the minimum motor torque: 0.25 N m and 0.2 N m at the pinion
    friction = 1.25 * LEAST / GEARS.pre_reduction
    rig = replace(RIG, motor_coulomb=friction)
    unknown, known = (
        closed_loop(BY_FLANK(motor_friction=motor_friction), rig, swing(acceleration, 2.0), 2.0, seed=0)
        for motor_friction in (0.0, friction)
    )
    assert np.mean(np.min(unknown.contact_torques, axis=1) <= 0.0) > 0.1
    assert known.minimum_contact_torque > 0.3 * LEAST * MESH


def test_the_flank_row_is_newtons_law_for_a_rotor_that_rubs() -> None:
    friction, still = 0.01, np.full(31, -np.pi / 2)
    pair = [BY_FLANK(motor_friction=f) for f in (0.0, friction)]
    controls = [controller.step(-np.pi / 2, still) for controller in pair]
    taken = friction * GEARS.pre_reduction  # the only loss at rest
    assert controls[1].torques == pytest.approx([LEAST + taken, -LEAST - taken], abs=1e-9)
    assert [control.margin for control in controls] == pytest.approx([0.0, 0.0], abs=1e-9)


def edge_of_the_map() -> float:
    found = capability_map(LIMITS, inertia=MODEL.inertia, acceleration=np.linspace(-40, 40, 801), load_torque=[0.0])
    return float(found.edge[0, 1])


@pytest.mark.parametrize("share", [0.5, 0.8, 1.0, 1.5, 3.0])
def test_at_the_torque_limit_contact_comes_before_acceleration(share: float) -> None:
    edge = edge_of_the_map()
    assert edge == pytest.approx(MESH * (MOST - LEAST) / MODEL.inertia, rel=1e-6)
    result = run(BY_FLANK(), share * edge, duration=2.5)
    assert result.minimum_contact_torque > 0.5 * LEAST * MESH
    assert result.degraded == 0
    load = MODEL.gravity * np.cos(result.angle) + MODEL.viscous_friction * result.velocity
    of_run = capability_map(
        LIMITS, inertia=MODEL.inertia, acceleration=np.linspace(-80, 80, 161), load_torque=np.unique(load)
    )
    low, high = of_run.edge[np.searchsorted(of_run.load_torque, load)].T
    acceleration = np.gradient(result.velocity, 0.005)
    used = np.max(np.maximum(acceleration / high, acceleration / low))
    assert used < 1.05  # only vibration of the gear contact exceeds it
    if share <= 0.8:
        assert result.tracking_rms < 3e-3
    if share >= 1.5:
        assert result.tracking_rms > 0.1
        assert used > 0.9
