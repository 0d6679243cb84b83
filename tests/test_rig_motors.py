"""Motors of the rig: current loop, supply, any number of them, a gap each; and encoders that lag."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from plant.errors import BadParameter
from plant.gears import GearTrain
from plant.rig import Rig

Array = NDArray[np.float64]

IDEAL = {"encoder_counts": 0, "encoder_noise": 0.0, "motor_encoder_counts": 0}
PURE = {"viscous_friction": 0.0, "motor_viscous": 0.0, "motor_coulomb": 0.0, "gravity": 0.0, **IDEAL}
NO_LOAD = 2000 * 2 * np.pi / 60  # [rad/s]


@pytest.mark.parametrize("preload", [0.0, 0.2])
def test_halving_the_fine_step_changes_next_to_nothing(preload: float) -> None:
    """With everything at work the error is of first order: below a bound that halves with the step.

    Step by step it need not halve where teeth hit: when within a step they do is chance.
    """
    rig = Rig.paper_like(
        **IDEAL, supply_voltage=36.0, current_bandwidth=200.0, encoder_delay=0.0013, coulomb_friction=0.2
    )
    output_torque = 2.0 * np.sin(2 * np.pi * 2.0 * np.arange(200) * 0.005)
    xi = rig.gears.pinion_torques(output_torque, preload / 20)
    steps = np.array([1.0, 0.5, 0.25, 0.125]) * rig.fine_step
    exact, *found = (replace(rig, fine_step=step).run(xi, 0.005, seed=0).angle for step in (5e-7, *steps))
    errors = np.array([np.max(np.abs(angle - exact)) for angle in found])
    assert errors[0] < 0.1 * 2 * np.pi / Rig.paper_like().encoder_counts  # a tenth of a count
    assert np.all(errors < 0.25 * steps)


def test_the_current_loop_follows_with_its_time_constant() -> None:
    rig = Rig.paper_like(**PURE, current_bandwidth=50.0)
    record = rig.run(np.tile([0.1, -0.2], (20, 1)), 0.001, seed=0)
    follow = 1.0 - np.exp(-2 * np.pi * 50.0 * (record.time + 0.001))
    assert record.given_torques == pytest.approx(follow[:, None] * [0.1, -0.2], rel=1e-9)
    at_once = Rig.paper_like(**PURE).run(np.tile([0.1, -0.2], (20, 1)), 0.001, seed=0)
    assert np.all(at_once.given_torques == [0.1, -0.2])


def test_the_supply_bounds_the_speed() -> None:
    rig = Rig.paper_like(**PURE, supply_voltage=36.0)
    record = rig.run(np.tile([-2.5, -2.5], (400, 1)), 0.005, seed=0)
    motor = -record.velocity * rig.gears.ratio
    assert abs(motor[-1]) == pytest.approx(NO_LOAD, rel=1e-3)
    assert np.rad2deg(record.velocity[-1]) == pytest.approx(120.9, abs=0.15)
    free = replace(rig, supply_voltage=0.0).run(np.tile([-2.5, -2.5], (400, 1)), 0.005, seed=0)
    assert free.velocity[-1] > 10 * record.velocity[-1]


@pytest.mark.parametrize("share", [0.0, 0.4, 0.8])
def test_torque_and_speed_of_a_motor_lie_on_its_line(share: float) -> None:
    """U = R i + k w: at a given share of the no-load speed the rest of the stall torque is left."""
    rig = Rig.paper_like(**PURE, supply_voltage=36.0, winding_resistance=30.0)
    stall = rig.torque_constant * 36.0 / 30.0 * rig.gears.pre_reduction  # at the pinion
    state = rig.rest()
    speed = share * NO_LOAD / rig.gears.ratio
    state = replace(state, velocity=speed, rotor_velocities=np.full(2, speed))
    state = rig.advance(state, (-9.0, -9.0), 1e-6)
    given = state.drive_torques / rig.gears.torque_map
    assert given == pytest.approx(-stall * (1.0 - share) * np.ones(2), rel=2e-3)


def test_a_motor_that_is_turned_too_fast_brakes() -> None:
    rig = Rig.paper_like(**PURE, supply_voltage=36.0)
    fast = 1.5 * NO_LOAD / rig.gears.ratio
    state = replace(rig.rest(), velocity=fast, rotor_velocities=np.full(2, fast))
    slower = rig.advance(state, (-0.1, -0.1), 0.5)
    assert slower.velocity < 0.9 * fast
    assert rig.energy(slower) < rig.energy(state)


@pytest.mark.parametrize("drives", [(1,), (2,), (1, 2), (1, 1, 2, 2)])
def test_any_number_of_motors_moves_the_load(drives: tuple[int, ...]) -> None:
    rig = Rig.paper_like(**PURE, drives=drives)
    m = len(drives)
    assert rig.total_inertia == pytest.approx(2.0 + m * 4e-6 * rig.gears.ratio**2)
    forward = 2 in drives
    torques = np.array([-0.1 if (d == 2) == forward else 0.0 for d in drives]) * (1 if forward else -1)
    record = rig.run(np.tile(torques, (200, 1)), 0.005, seed=0, start=rig.rest(torques=torques))
    assert record.torques.shape == record.contact_torques.shape == record.motor_angles.shape == (200, m)
    push = float(np.sum(torques * -8.05))
    total_inertia = (
        2.0 + np.sum(torques != 0.0) * 4e-6 * rig.gears.ratio**2
    )  # idle rotors are dragged by the other flank
    expected = 0.5 * push / rig.total_inertia * record.time[-1] ** 2
    assert abs(record.true_angle[-1]) == pytest.approx(
        abs(expected), rel=0.05 if total_inertia < rig.total_inertia else 1e-3
    )
    assert np.sign(record.true_angle[-1]) == np.sign(push)


def test_four_motors_share_what_two_have_to_give() -> None:
    two, four = (
        Rig.paper_like(),
        Rig.paper_like(drives=(1, 1, 2, 2), rotor_inertia=2e-6, motor_coulomb=2.5e-4, motor_viscous=5e-8),
    )
    output_torque = 2.0 * np.sin(2 * np.pi * 2.0 * np.arange(200) * 0.005)
    xi = two.gears.pinion_torques(output_torque, 0.2 / 20)
    pair = two.run(xi, 0.005, seed=0, start=two.rest(torques=xi[0]))
    half = np.repeat(xi / 2, 2, axis=1)
    quartet = four.run(half, 0.005, seed=0, start=four.rest(torques=half[0]))
    assert quartet.true_angle == pytest.approx(pair.true_angle, abs=3e-5)
    assert quartet.contact_torques.sum(axis=1) == pytest.approx(pair.contact_torques.sum(axis=1), abs=0.6)


def test_each_drive_has_its_own_backlash() -> None:
    rig = Rig.paper_like(**PURE, backlash=(1e-3, 4e-3))
    assert rig.rest().rotor_angles == pytest.approx([-0.5e-3, 2e-3])
    state = rig.rest()
    free = (1.0, -1.0)  # each rotor leaves its flank, and meets the other one after the play
    times = []
    for drive in range(2):
        at, k = state, 0
        while (
            abs(at.rotor_angles[drive] - state.rotor_angles[drive] - (at.angle - state.angle))
            < rig.half_backlash[drive] * 2
        ):
            at, k = rig.advance(at, (-free[0], -free[1]), 1e-4), k + 1
        times.append(k * 1e-4)
    accelerated = 8.05 / (4e-6 * rig.gears.ratio**2)
    assert times == pytest.approx(np.sqrt(2 * np.array([1e-3, 4e-3]) / accelerated), abs=2e-4)


def test_unequal_pinions_keep_their_own_ratio() -> None:
    gears = GearTrain(pinion_teeth=(20, 31), output_teeth=161)
    rig = Rig(gears=gears, inertia=2.0, rotor_inertia=1e-3, drives=(2, 1, 2))
    assert rig.motor_ratios == pytest.approx([161 / 31, 161 / 20, 161 / 31])
    assert rig.torque_map == pytest.approx([-161 / 31, -161 / 20, -161 / 31])
    assert rig.directions.tolist() == [1.0, -1.0, 1.0]


@pytest.mark.parametrize("delay", [0.0013, 0.005, 0.0117])
def test_encoders_show_where_the_shafts_were(delay: float) -> None:
    rig = Rig.paper_like(**IDEAL, fine_step=1e-5)
    torques = rig.gears.pinion_torques(3.0 * np.sin(2 * np.pi * 3.0 * np.arange(60) * 0.005), 0.01)
    fine = np.repeat(torques, 50, axis=0)  # the true motion every 0.1 ms
    true = rig.run(fine, 1e-4, seed=0)
    late = replace(rig, encoder_delay=delay).run(torques, 0.005, seed=0)
    then = np.maximum(np.arange(60) * 50 - round(delay / 1e-4), 0)
    assert late.angle == pytest.approx(true.true_angle[then], abs=1e-9)
    assert late.motor_angles == pytest.approx(true.motor_angles[then], abs=1e-6)
    assert late.true_angle == pytest.approx(true.true_angle[::50], abs=1e-9)
    assert np.ptp(true.true_angle) > 0.01


def test_readings_after_unequal_steps_lie_on_a_line() -> None:
    rig = Rig.paper_like(**PURE, encoder_delay=0.02)
    state = replace(rig.rest(), velocity=0.5, rotor_velocities=np.full(2, 0.5))
    for duration in (0.007, 0.011, 0.003, 0.013, 0.002):
        state = rig.advance(state, (0.0, 0.0), duration)
    assert rig.measure(state, np.random.default_rng(0)) == pytest.approx(state.angle - 0.01, abs=1e-9)


def test_motor_encoders_are_noisy_by_themselves() -> None:
    quiet, noisy = Rig.paper_like(), Rig.paper_like(motor_encoder_counts=0, motor_encoder_noise=0.01)
    at_rest = np.zeros((2000, 2))
    seen = noisy.run(at_rest, 0.0002, seed=5)
    still = replace(noisy, motor_encoder_noise=0.0).run(at_rest, 0.0002, seed=5)
    shake = seen.motor_angles - still.motor_angles
    assert np.std(shake, axis=0) == pytest.approx([0.01, 0.01], rel=0.06)
    assert abs(np.corrcoef(shake.T)[0, 1]) < 0.1
    np.testing.assert_array_equal(seen.angle, quiet.run(at_rest, 0.0002, seed=5).angle)  # the load's encoder as ever
    rng, rest = np.random.default_rng(0), noisy.rest()
    one_by_one = np.array([noisy.motor_angles(rest, rng) for _ in range(500)])
    assert np.std(one_by_one, axis=0) == pytest.approx([0.01, 0.01], rel=0.1)
    np.testing.assert_array_equal(noisy.motor_angles(rest), still.motor_angles[0])


@pytest.mark.parametrize(
    "bad",
    [
        {"drives": ()},
        {"drives": (1, 3)},
        {"backlash": (1e-3, 1e-3, 1e-3)},
        {"backlash": (1e-3, -1e-3)},
        {"supply_voltage": -36.0},
        {"winding_resistance": 0.0},
        {"encoder_delay": float("inf")},
    ],
)
def test_refuses_motors_that_cannot_be(bad: dict[str, object]) -> None:
    with pytest.raises(BadParameter, match=next(iter(bad))):
        Rig.paper_like(**bad)


def test_a_motor_too_quick_for_the_fine_step_is_refused() -> None:
    with pytest.raises(BadParameter, match="fine_step"):
        Rig.paper_like(supply_voltage=36.0, winding_resistance=0.1)


def test_a_gear_rubs_the_more_the_more_it_passes() -> None:
    # against a brake: D - f - mu T = T while the torque grows, D + f + mu T = T while it falls
    mu = 0.1
    rig = Rig.paper_like(drives=(2,), coulomb_friction=50.0, mesh_friction=mu, motor_viscous=0.0)
    ramp = 8.0 * np.concatenate((np.linspace(0, 1, 200), np.linspace(1, 0.25, 150)))
    played = rig.run(ramp[:, None] / rig.torque_map, 0.005, seed=0)
    friction, passed = rig.motor_coulomb * rig.gears.ratio, played.contact_torques[:, 0]
    for k, (commanded, sign) in {150: (ramp[149], 1.0), 340: (ramp[339], -1.0)}.items():
        assert passed[k] == pytest.approx(
            (commanded - sign * friction) / (1.0 + sign * mu), abs=0.04
        )  # a step of the ramp
