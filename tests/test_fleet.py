"""Many rigs at once: each gives the numbers that it gives alone, in machine code and in the virtual machine."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from numpy.typing import NDArray

import plant.fleet
from plant.errors import BadParameter
from plant.fleet import Fleet
from plant.motion import Motion, motion
from plant.rig import Rig
from plant.rig_record import FleetRecord, RigRecord

Array = NDArray[np.float64]

COUNT, LENGTH, DT = 40, 30, 0.004
FULL = {"supply_voltage": 36.0, "current_bandwidth": 300.0, "motor_encoder_noise": 1e-3, "encoder_delay": 0.0015}


def fleet() -> Fleet:
    rng = np.random.default_rng(7)
    return Fleet(
        [
            Rig.paper_like(
                **FULL,
                backlash=(float(rng.uniform(2e-4, 4e-3)), float(rng.uniform(2e-4, 4e-3))),
                coulomb_friction=float(rng.uniform(0.0, 0.4)),
                encoder_counts=int(rng.choice([0, 4096, 2**17])),
                encoder_noise=float(rng.uniform(0.0, 1e-4)),
            )
            for _ in range(COUNT)
        ]
    )


def torques() -> Array:
    """(T, B, 2) sines of another height for each machine, under little preload [N m]."""
    output_torque = np.sin(2 * np.pi * 4.0 * np.arange(LENGTH) * DT)[:, None] * np.linspace(1.0, 9.0, COUNT)
    return Rig.paper_like().gears.pinion_torques(output_torque, 0.002)


def pushes() -> Array:
    return np.linspace(-0.3, 0.3, LENGTH * COUNT).reshape(LENGTH, COUNT)


def played() -> FleetRecord:
    return fleet().run(torques(), DT, range(COUNT), disturbance=pushes())


def assert_same(one: RigRecord | FleetRecord, other: RigRecord | FleetRecord) -> None:
    for each in fields(one):
        if each.name != "end":
            np.testing.assert_array_equal(getattr(one, each.name), getattr(other, each.name), err_msg=each.name)


def test_every_machine_moves_as_if_it_were_alone() -> None:
    together = played()
    assert together.angle.shape == (LENGTH, COUNT)
    assert together.contact_torques.shape == (LENGTH, COUNT, 2)
    assert np.unique(together.true_angle[-1]).size == COUNT
    for b in (0, 17, COUNT - 1):
        alone = fleet().rigs[b].run(torques()[:, b], DT, seed=b, disturbance=pushes()[:, b])
        assert_same(together.machine(b), alone)
        assert together.end.machine(b).angle == alone.end.angle
        assert together.end.machine(b).trail[0][1].tolist() == alone.end.trail[0][1].tolist()


def test_machine_code_and_virtual_machine_give_the_same_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    if not motion(2).wait():
        pytest.skip("no compiler")
    compiled = played()
    with monkeypatch.context() as patch:
        patch.setattr("plant.machine_code.compiler", lambda: None)
        virtual = Motion(2)
    assert not virtual.wait()
    monkeypatch.setattr(plant.fleet, "motion", lambda drives: virtual)
    assert_same(compiled, played())


def test_a_run_goes_on_where_another_ended() -> None:
    whole = played()
    first = fleet().run(torques()[:11], DT, range(COUNT), disturbance=pushes()[:11])
    rest = fleet().run(torques()[11:], DT, range(COUNT), start=first.end, disturbance=pushes()[11:])
    np.testing.assert_array_equal(rest.true_angle, whole.true_angle[11:])
    np.testing.assert_array_equal(rest.minimum_contact_torques, whole.minimum_contact_torques[11:])


def test_the_loop_can_be_closed_around_a_fleet() -> None:
    machines = fleet()
    state = machines.rest(0.1, (0.05, -0.05))
    for _ in range(300):
        error = 0.2 - machines.measure(state)
        output_torque = 40.0 * error - 12.0 * state.rows[:, 1]
        state = machines.advance(state, machines.rigs[0].gears.pinion_torques(output_torque, 0.01), DT)
    assert machines.measure(state) == pytest.approx(np.full(COUNT, 0.2), abs=0.03)
    assert machines.motor_angles(state).shape == machines.contact_torques(state).shape == (COUNT, 2)


def test_refuses_what_is_no_fleet() -> None:
    with pytest.raises(BadParameter, match="at least one"):
        Fleet([])
    with pytest.raises(BadParameter, match="fine_step"):
        Fleet([Rig.paper_like(), Rig.paper_like(fine_step=1e-5)])
    with pytest.raises(BadParameter, match="drives"):
        Fleet([Rig.paper_like(), Rig.paper_like(drives=(2,))])
    machines = Fleet([Rig.paper_like(), Rig.paper_like()])
    with pytest.raises(BadParameter, match="shape"):
        machines.run(np.zeros((5, 3, 2)), DT, (0, 1))
    with pytest.raises(BadParameter, match="seed"):
        machines.run(np.zeros((5, 2, 2)), DT, (0,))
    with pytest.raises(BadParameter, match="torques"):
        machines.advance(machines.rest(), np.full((2, 2), np.nan), DT)
