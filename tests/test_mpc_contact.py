"""Teeth on the rig: together where flank torque is planned, apart where motor torque is, as the formulas foretell."""

from __future__ import annotations

import numpy as np
import pytest
from swung_load import BY_FLANK, BY_MOTOR, LEAST, LIMITS, MESH, MODEL, MOST, RIG, ROTOR, swing

from allocation import capability_map
from mpc import ClosedLoopResult, Controller, closed_loop

PARTING = LEAST * MESH / ROTOR
"""Acceleration at which a rotor takes all of the least motor torque, n^2 J_m a = n eps [rad/s^2]."""


def run(controller: Controller, acceleration: float, duration: float = 2.0) -> ClosedLoopResult:
    return closed_loop(controller, RIG, swing(acceleration, duration), duration, seed=0)


@pytest.mark.parametrize("share", [0.7, 0.95, 1.05, 1.4])
def test_least_motor_torque_loses_contact_where_its_rotor_takes_it(share: float) -> None:
    # at the top gravity and not the motors turn the load back: they are near their least torque
    result = run(BY_MOTOR(), share * PARTING)
    assert np.min(np.abs(result.torques)) >= LEAST
    if share < 1:
        assert result.least_flank_torque == pytest.approx(LEAST * MESH * (1 - share), abs=0.15)
        assert result.least_flank_torque > 0
    else:
        assert result.least_flank_torque <= 0
        assert np.min(result.flank_torques[:, 1]) > 0.5 * LEAST * MESH  # the drive that carries the load keeps it


@pytest.mark.parametrize("share", [0.7, 0.95, 1.05, 1.4])
def test_least_flank_torque_keeps_contact_all_the_same(share: float) -> None:
    result = run(BY_FLANK(), share * PARTING)
    assert result.least_flank_torque > 0.85 * LEAST * MESH
    assert result.tracking_rms == pytest.approx(run(BY_MOTOR(), share * PARTING).tracking_rms, rel=0.05)


def edge_of_the_map() -> float:
    found = capability_map(LIMITS, inertia=MODEL.inertia, acceleration=np.linspace(-40, 40, 801), load_torque=[0.0])
    return float(found.edge[0, 1])


@pytest.mark.parametrize("share", [0.5, 0.8, 1.0, 1.5, 3.0])
def test_at_the_edge_of_the_map_it_gives_up_acceleration_and_not_contact(share: float) -> None:
    edge = edge_of_the_map()
    assert edge == pytest.approx(MESH * (MOST - LEAST) / MODEL.inertia, rel=1e-6)
    result = run(BY_FLANK(), share * edge, duration=2.5)
    assert result.least_flank_torque > 0.5 * LEAST * MESH
    assert result.degraded == 0
    load = MODEL.gravity * np.cos(result.angle) + MODEL.viscous_friction * result.velocity
    of_run = capability_map(
        LIMITS, inertia=MODEL.inertia, acceleration=np.linspace(-80, 80, 161), load_torque=np.unique(load)
    )
    low, high = of_run.edge[np.searchsorted(of_run.load_torque, load)].T
    acceleration = np.gradient(result.velocity, 0.005)
    used = np.max(np.maximum(acceleration / high, acceleration / low))
    assert used < 1.05  # beyond it only what the teeth vibrate
    if share <= 0.8:
        assert result.tracking_rms < 3e-3
    if share >= 1.5:
        assert result.tracking_rms > 0.1
        assert used > 0.9
