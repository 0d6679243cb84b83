"""The rig obeys mechanics: teeth push and never pull, friction holds, energy never appears, finer steps agree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from plant.errors import BadParameter
from plant.flank import contact_torque
from plant.rig import Rig, RigState

Array = NDArray[np.float64]

FRICTIONLESS = {"viscous_friction": 0.0, "motor_viscous": 0.0, "motor_coulomb": 0.0, "gravity": 0.0}
IDEAL_ENCODER = {"encoder_counts": 0, "encoder_noise": 0.0}
SAMPLE_TIME = 0.005


def sine_torques(rig: Rig, amplitude: float, preload: float, count: int = 200) -> Array:
    """(count, 2) pinion torques: a sine of 2 Hz on the output gear and a constant preload per pinion [N m]."""
    output_torque = amplitude * np.sin(2 * np.pi * 2.0 * np.arange(count) * SAMPLE_TIME)
    return rig.gears.pinion_torques(output_torque, preload / rig.gears.pinion_teeth[0])


@given(
    gap=st.floats(-2e-3, 2e-3),
    rate=st.floats(-50, 50),
    half_backlash=st.floats(0, 1e-3),
    damping=st.floats(0, 100),
)
def test_a_flank_pushes_and_never_pulls(gap: float, rate: float, half_backlash: float, damping: float) -> None:
    torque = float(contact_torque(gap, rate, half_backlash=half_backlash, stiffness=2e4, damping=damping))
    if abs(gap) <= half_backlash:
        assert torque == 0.0
    else:
        assert torque * gap >= 0.0


def test_a_pressed_flank_is_a_spring() -> None:
    assert float(contact_torque(1.5e-3, 0.0, half_backlash=1e-3, stiffness=2e4, damping=6.0)) == pytest.approx(10.0)
    assert float(contact_torque(-1.5e-3, 0.0, half_backlash=1e-3, stiffness=2e4, damping=6.0)) == pytest.approx(-10.0)


def test_under_preload_it_moves_like_one_rigid_body() -> None:
    rig = Rig.paper_like(**{**FRICTIONLESS, **IDEAL_ENCODER})
    torques = np.tile(rig.gears.pinion_torques(1.0, 0.1 / 20), (100, 1))
    record = rig.run(torques, SAMPLE_TIME, seed=0, start=rig.rest(torques=torques[0]))
    assert np.all(record.minimum_contact_torques > 0.0)
    expected = 0.5 * 1.0 / rig.total_inertia * record.time**2
    assert record.true_angle == pytest.approx(expected, abs=2e-5)


def test_the_contact_torques_are_those_of_the_formula() -> None:
    # T_i = n_i (xi_i - f_i) - n_i^2 J_i a, in the required sense of each drive, once vibration has died out
    rig = Rig.paper_like(**FRICTIONLESS)
    torque, preload = 1.0, 0.1 / 20
    xi = rig.gears.pinion_torques(torque, preload)
    record = rig.run(np.tile(xi, (200, 1)), SAMPLE_TIME, seed=0)
    acceleration = torque / rig.total_inertia
    reflected = rig.rotor_inertia * rig.gears.ratio**2
    expected = np.array([-1, 1]) * (rig.gears.torque_map * xi - reflected * acceleration)
    assert record.contact_torques[-1] == pytest.approx(expected, rel=1e-4)


def test_without_preload_contact_is_lost_and_the_load_dwells() -> None:
    rig = Rig.paper_like(**IDEAL_ENCODER)
    loose = rig.run(sine_torques(rig, 2.0, preload=0.0), SAMPLE_TIME, seed=0)
    tight = rig.run(sine_torques(rig, 2.0, preload=0.2), SAMPLE_TIME, seed=0)
    assert np.any(loose.minimum_contact_torques[10:] <= 0.0)
    assert np.all(tight.minimum_contact_torques[10:] > 0.0)


def test_the_minimum_contact_torque_sees_inside_the_sample() -> None:
    rig = Rig.paper_like()
    record = rig.run(sine_torques(rig, 2.0, preload=0.2), SAMPLE_TIME, seed=0)
    at_samples = np.minimum(record.contact_torques[:-1], record.contact_torques[1:])
    assert np.all(record.minimum_contact_torques[:-1] <= at_samples + 1e-3)
    assert np.any(record.minimum_contact_torques[:-1] < at_samples - 0.05)


def test_contact_torques_of_a_state_are_those_of_the_fine_step() -> None:
    rig = Rig.paper_like()
    state = RigState(
        angle=0.1,
        velocity=0.2,
        rotor_angles=0.1 + np.array([-7e-4, 9e-4]),
        rotor_velocities=np.array([0.1, 0.5]),
        minimum_contact_torques=np.zeros(2),
    )
    expected = [
        sense
        * float(
            contact_torque(
                state.rotor_angles[i] - 0.1,
                state.rotor_velocities[i] - 0.2,
                half_backlash=rig.backlash / 2,
                stiffness=rig.flank_stiffness,
                damping=rig.flank_damping,
            )
        )
        for i, sense in enumerate((-1, 1))
    ]
    assert rig.contact_torques(state) == pytest.approx(expected, rel=1e-12)


@settings(max_examples=25, deadline=None)
@given(
    rates=st.tuples(st.floats(-3, 3), st.floats(-3, 3)),
    velocity=st.floats(-3, 3),
    damping=st.floats(0, 20),
    rubbing=st.floats(0, 0.3),
)
def test_no_energy_is_gained_in_impacts(
    rates: tuple[float, float], velocity: float, damping: float, rubbing: float
) -> None:
    rig = Rig.paper_like(**{**FRICTIONLESS, "flank_damping": damping, "mesh_friction": rubbing, "fine_step": 5e-6})
    state = replace(rig.rest(), velocity=velocity, rotor_velocities=np.array(rates))
    first = highest = rig.energy(state)
    for _ in range(40):
        state = rig.advance(state, (0.0, 0.0), 0.5e-3)
        highest = max(highest, rig.energy(state))
    assert highest <= first * (1 + 2e-3) + 1e-12


def through_an_impact(rig: Rig, rate: float, place: float) -> tuple[RigState, RigState]:
    """Before and after the one rotor of a rig, at `place` of its half play, has hit the load and left it again."""
    before = replace(rig.rest(), rotor_angles=np.array([place * rig.backlash / 2]), rotor_velocities=np.array([rate]))
    state, touched = before, False
    for _ in range(2000):
        state = rig.advance(state, (0.0,), 1e-4)
        inside = abs(state.rotor_angles[0] - state.angle) < rig.backlash / 2
        if touched and inside:
            return before, state
        touched = touched or not inside
    raise AssertionError("the rotor never came back")


@pytest.mark.parametrize("place", [-0.7, -0.1, 0.13, 0.5])
@pytest.mark.parametrize("damping", [0.0, 1e-3, 0.5, 6.0, 20.0])
def test_an_impact_gains_no_energy_and_returns_what_theory_says(damping: float, place: float) -> None:
    """At the default fine step; the restitution is that of Schwager and Pöschel, Granular Matter 9 (2007) 465."""
    rig = Rig.paper_like(**FRICTIONLESS, drives=(2,), flank_damping=damping)
    rotor = rig.rotor_inertia * rig.gears.ratio**2
    mass = 1 / (1 / rotor + 1 / rig.inertia)
    for rate in (0.1, 0.7, 2.3):
        before, after = through_an_impact(rig, rate, place)
        if damping == 0.0:
            assert rig.energy(after) == pytest.approx(rig.energy(before), rel=1e-4)
        else:
            assert rig.energy(after) < rig.energy(before)
        decay = damping / (2 * mass)
        swing = np.sqrt(rig.flank_stiffness / mass - decay**2)
        angle = np.pi - np.arctan2(2 * decay * swing, swing**2 - decay**2)
        returned = float(after.velocity - after.rotor_velocities[0]) / rate
        assert returned == pytest.approx(np.exp(-decay / swing * angle), rel=5e-3)


def test_impacts_with_damping_lose_energy() -> None:
    rig = Rig.paper_like(**FRICTIONLESS)
    state = replace(rig.rest(), rotor_velocities=np.array([2.0, 2.0]))
    assert rig.energy(rig.advance(state, (0.0, 0.0), 0.1)) < 0.9 * rig.energy(state)


def test_dry_friction_really_holds() -> None:
    rig = Rig.paper_like(gravity=0.0, coulomb_friction=0.5, breakaway_excess=0.2)
    torques = np.tile(rig.gears.pinion_torques(0.69, 0.1 / 20), (200, 1))
    pressed = rig.rest(torques=torques[0])
    held = rig.run(torques, SAMPLE_TIME, seed=0, start=pressed)
    assert np.all(held.true_angle == 0.0)
    assert np.all(held.velocity == 0.0)
    broken_loose = rig.run(
        np.tile(rig.gears.pinion_torques(1.0, 0.1 / 20), (200, 1)), SAMPLE_TIME, seed=0, start=pressed
    )
    assert broken_loose.velocity[-1] > 0.1


def test_motor_friction_holds_the_rotor() -> None:
    rig = Rig.paper_like(gravity=0.0)
    below = 0.99 * rig.motor_coulomb * rig.gears.pre_reduction
    state = rig.advance(rig.rest(), (below, -below), 0.05)
    assert state.rotor_angles == pytest.approx(rig.rest().rotor_angles, abs=0.0)


def test_it_comes_to_rest_exactly() -> None:
    rig = Rig.paper_like(gravity=0.0, coulomb_friction=0.3)
    state = replace(rig.rest(), velocity=0.2, rotor_velocities=np.array([0.2, 0.2]))
    state = rig.advance(state, (0.0, 0.0), 2.0)
    assert state.velocity == 0.0
    assert np.all(state.rotor_velocities == 0.0)


def errors_of_fine_steps(rig: Rig, preload: float, *steps: float) -> list[float]:
    """Greatest error of the load angle at each fine step [rad], against a step of 1 us."""
    torques = sine_torques(rig, 2.0, preload)
    exact = replace(rig, fine_step=1e-6).run(torques, SAMPLE_TIME, seed=0).true_angle
    return [
        float(np.max(np.abs(replace(rig, fine_step=h).run(torques, SAMPLE_TIME, seed=0).true_angle - exact)))
        for h in steps
    ]


@pytest.mark.parametrize("preload", [0.0, 0.2])
def test_the_default_fine_step_is_fine_enough(preload: float) -> None:
    rig = Rig.paper_like(coulomb_friction=0.2, cogging_amplitude=0.1, cogging_order=20.0, **IDEAL_ENCODER)
    one_count = 2 * np.pi / Rig.paper_like().encoder_counts
    used, halved = errors_of_fine_steps(rig, preload, rig.fine_step, rig.fine_step / 2)
    assert used < 0.1 * one_count
    assert halved < used


def test_halving_the_fine_step_halves_the_error() -> None:
    rig = Rig.paper_like(motor_coulomb=0.0, cogging_amplitude=0.1, cogging_order=20.0, **IDEAL_ENCODER)
    used, halved = errors_of_fine_steps(rig, 0.2, 20e-6, 10e-6)
    assert used / halved == pytest.approx(2.1, abs=0.4)


@pytest.mark.parametrize("torque", [3.0, -3.0])
def test_the_moving_load_follows_an_independent_integrator(torque: float) -> None:
    from scipy.integrate import solve_ivp

    rig = Rig.paper_like(
        gravity_offset=0.3,
        coulomb_friction=0.2,
        breakaway_excess=0.6,
        stribeck_velocity=0.4,
        quadratic_drag=0.4,
        cogging_amplitude=0.2,
        cogging_order=6.0,
        cogging_phase=0.7,
        torque_offset=0.1,
        motor_coulomb=0.0,
        motor_viscous=1e-5,
    )
    pushes = np.where(np.arange(200) < 100, 0.4, -0.6)
    commands = np.tile(rig.gears.pinion_torques(torque, 0.3 / 20), (200, 1))
    record = rig.run(commands, SAMPLE_TIME, seed=0, start=rig.rest(torques=commands[0]), disturbance=pushes)
    viscous = 0.8 + 2 * 1e-5 * (161 / 20 * 46 / 18 * 41 / 17 * 42 / 21) ** 2

    def slope(t: float, z: Array) -> list[float]:
        x, v = z
        load = torque + 0.1 - 0.5 * np.cos(x) - 0.3 * np.sin(x) - viscous * v - 0.4 * v * abs(v)
        load += (0.4 if t < 0.5 else -0.6) - np.sign(torque) * (0.2 + 0.6 * np.exp(-((v / 0.4) ** 2)))
        return [v, (load + 0.2 * np.sin(6.0 * x + 0.7)) / rig.total_inertia]

    rigid = solve_ivp(slope, (0, 1), [0.0, 0.0], t_eval=record.time, rtol=1e-9, atol=1e-12, max_step=SAMPLE_TIME)
    assert np.all(record.velocity[1:] * torque > 0.0)
    assert record.true_angle == pytest.approx(rigid.y[0], abs=2e-4)


def test_the_encoder_counts() -> None:
    rig = Rig.paper_like(encoder_counts=1000, encoder_noise=0.0)
    seen = rig.measure(rig.rest(0.4321), np.random.default_rng(0))
    counts = seen / (2 * np.pi / 1000)
    assert counts == pytest.approx(round(counts), abs=1e-9)
    assert abs(seen - 0.4321) <= np.pi / 1000
    noisy = Rig.paper_like(encoder_counts=0, encoder_noise=1e-3)
    rng = np.random.default_rng(0)
    reads = [noisy.measure(noisy.rest(), rng) for _ in range(2000)]
    assert np.std(reads) == pytest.approx(1e-3, rel=0.1)
    coarse = Rig.paper_like(encoder_counts=1000, encoder_noise=1e-2)
    in_counts = np.array([coarse.measure(coarse.rest(), rng) for _ in range(50)]) / (2 * np.pi / 1000)
    assert in_counts == pytest.approx(np.round(in_counts), abs=1e-9)
    assert np.ptp(in_counts) > 1


def test_motors_turn_by_the_whole_ratio() -> None:
    rig = Rig.paper_like(backlash=0.0, motor_encoder_counts=0)
    assert rig.motor_angles(rig.rest(0.1)) == pytest.approx([-0.1 * 99.231, -0.1 * 99.231], rel=1e-5)
    step = 2 * np.pi / 100
    counted = replace(rig, motor_encoder_counts=100).motor_angles(rig.rest(0.1)) / step
    assert counted == pytest.approx(np.round(-0.1 * 99.231 / step) * np.ones(2), abs=1e-9)


def test_equal_seeds_give_equal_records() -> None:
    rig = Rig.paper_like()
    torques = sine_torques(rig, 1.0, 0.1, count=20)
    a, b, c = (rig.run(torques, SAMPLE_TIME, seed=s).angle for s in (1, 1, 2))
    assert np.array_equal(a, b)
    assert not np.array_equal(a, c)


@pytest.mark.parametrize(
    "bad",
    [
        {"inertia": 0.0},
        {"viscous_friction": -1.0},
        {"backlash": float("nan")},
        {"fine_step": 1e-3},
        {"rotor_inertia": 0},
    ],
)
def test_refuses_parameters_that_cannot_be(bad: dict[str, float]) -> None:
    with pytest.raises(BadParameter, match=next(iter(bad))):
        Rig.paper_like(**bad)


def test_refuses_torques_that_cannot_be() -> None:
    rig = Rig.paper_like()
    with pytest.raises(BadParameter):
        rig.advance(rig.rest(), (float("nan"), 0.0), SAMPLE_TIME)
    with pytest.raises(BadParameter):
        rig.advance(rig.rest(), (0.0, 0.0), 0.0)
    with pytest.raises(BadParameter):
        rig.run(np.zeros((5, 3)), SAMPLE_TIME, seed=0)
