"""One sample ahead: against closed forms, finite differences, and a machine that shares none of its code."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from machine import Machine, excitation, record

from plant import BadParameter, ServoModel, catalogue, sample_step, simulate
from plant.discrete import INPUTS, division, integration_steps, sample_reading, stretches
from plant.effects import CoulombFriction, Effect, InputDelay, StribeckFriction
from plant.simulation import beginning, held_commands

SAMPLE = 0.005
HIDDEN = {
    "input_delay": {"time": 0.0087},
    "actuator_lag": {"time_constant": 0.03},
    "dead_zone": {"half_width": 0.5},
    "torque_offset": {"torque": 0.2},
    "coulomb_friction": {"torque": 0.4},
    "asymmetric_friction": {"forward": 0.4, "backward": 0.25, "viscous_difference": 0.1},
    "stribeck_friction": {"coulomb": 0.3, "excess": 0.2, "velocity": 0.15},
    "quadratic_drag": {"drag": 0.05},
    "gravity_offset": {"beta": 0.2},
    "cogging": {"amplitude": 0.2, "order": 11.0, "phase": 0.7},
    "torque_saturation": {"limit": 3.0},
    "rate_limit": {"rate": 60.0},
    "setpoint_rate_limit": {"rate": 5.0},
    "back_emf": {"constant": 0.3},
    "compliance": {"frequency": 25.0, "damping": 0.05, "motor_share": 0.3},
    "backlash": {"gap": 0.1, "motor_share": 0.3},
    "load_dependent_friction": {"coefficient": 0.15},
    "presliding_hysteresis": {"torque": 0.4, "stiffness": 8.0},
    "cable_stiffness": {"stiffness": 0.3, "cubic": 0.02, "rest_angle": 0.4},
    "end_stop": {"angle": 0.8, "stiffness": 300.0},
    "payload_change": {"time": 3.1416, "inertia": 0.7, "gravity": 0.4},
    "periodic_disturbance": {"amplitude": 0.3, "frequency": 3.3, "phase": 0.4},
    "friction_drift": {"viscous_rate": 0.05, "coulomb_rate": 0.03},
    "encoder_eccentricity": {"amplitude": 0.02, "order": 1.0, "phase": 0.4},
    "sensor_lag": {"time_constant": 0.02},
    "torque_measurement_lag": {"time_constant": 0.02},
}
DRIVE = {"setpoint_rate_limit": {"servo_gain": 40.0}}  # what only a position servo can have
SLACK = {  # rad, where a step of the product is knowingly coarse
    "backlash": 5e-3,  # a twentieth of the gap: each knock sends the load on its own way
    "presliding_hysteresis": 5e-5,
    "rate_limit": 5e-5,
    "end_stop": 5e-5,
    "payload_change": 5e-4,
    "friction_drift": 5e-5,
    "torque_measurement_lag": 5e-4,  # between samples a torque that jumps is not known
}


def model_of(name: str) -> ServoModel:
    return ServoModel(effects=(catalogue[name](**HIDDEN[name]),))


@pytest.mark.parametrize("name", HIDDEN)
def test_every_effect_matches_the_independent_machine(name: str) -> None:
    command = excitation(7, duration=8.0)
    drive = DRIVE.get(name, {})
    machine = Machine(effects={name: HIDDEN[name]}, **drive)
    truth = record(machine, command, noise=0.0, bits=None, angle=0.3, velocity=-0.4)
    model, first = model_of(name), command[0]
    begin = beginning(model, angle=0.3, velocity=-0.4, torque=first, setpoint=first)
    command = drive.get("servo_gain", 1.0) * truth.command[:, 0]
    found = simulate(model, command=command, dt=SAMPLE, state=begin, **drive)[:-1]
    bare = simulate(ServoModel(), command=command, dt=SAMPLE, state=begin[:2], **drive)[:-1]
    seen = np.array(sample_reading(model).map(len(found))(found.T, model.values)).ravel()
    assert np.abs(seen - truth.measured[:, 0]).max() < SLACK.get(name, 2e-5)
    assert np.abs(bare[:, 0] - truth.measured[:, 0]).max() > 1e-2  # the effect is there at all


@pytest.mark.parametrize("time_constant", [1e-4, 0.0015, 0.03])
def test_a_lag_before_a_dead_zone_matches_the_machine(time_constant: float) -> None:
    """The torque crosses the edge of the dead zone inside a sample, where no fixed step can follow exactly."""
    command = excitation(7, duration=4.0)
    effects = {"actuator_lag": {"time_constant": time_constant}, "dead_zone": HIDDEN["dead_zone"]}
    truth = record(Machine(effects=effects), command, noise=0.0, bits=None, steps=8)
    model = ServoModel(effects=tuple(catalogue[name](**values) for name, values in effects.items()))
    begin = np.array([0.0, 0.0, command[0]])
    found = simulate(model, command=command, dt=SAMPLE, state=begin)[:-1, 0]
    assert np.abs(found - truth.angle[:, 0]).max() < 1e-5


@pytest.mark.parametrize(
    ("effect", "values"), [("rate_limit", {"rate": 3e6}), ("actuator_lag", {"time_constant": 1e-5})]
)
def test_an_actuator_that_follows_at_once_is_none(effect: str, values: dict[str, float]) -> None:
    """Also where the command jumps across a dead zone, which has no memory of the way."""
    command = excitation(7, duration=10.0)
    base = ServoModel.paper()
    fast = base.with_effect(catalogue[effect](**values))
    alone, behind = (simulate(model, command=command, dt=SAMPLE)[:, 0] for model in (base, fast))
    late = simulate(base.with_effect(catalogue["input_delay"](time=1e-4)), command=command, dt=SAMPLE)[:, 0]
    assert np.abs(behind - alone).max() < 0.2 * np.abs(late - alone).max()


@pytest.mark.parametrize("time_constant", [2e-4, 1e-3, 5e-3, 2e-2])
def test_a_lag_costs_its_time_constant_of_impulse(time_constant: float) -> None:
    """Also a lag much shorter than the step."""
    lag = catalogue["actuator_lag"](time_constant=time_constant)
    model = ServoModel(inertia=1.5, gravity=0.0, viscous_friction=0.0, effects=(lag,))
    command = np.where(np.arange(200) < 10, 0.0, 2.0)
    speed = simulate(model, command=command, dt=SAMPLE)[-1, 1]
    assert 190 * SAMPLE - speed * 1.5 / 2.0 == pytest.approx(time_constant, rel=0.01)


@pytest.mark.parametrize("name", HIDDEN)
@pytest.mark.parametrize("width", [0.0, 0.05])
def test_derivatives_of_the_step_are_those_of_finite_differences(name: str, width: float) -> None:
    import casadi as ca

    model = model_of(name)
    step = sample_step(model, substeps=integration_steps(model, 0.02))
    sizes = (len(model.states), len(INPUTS), len(model.names))
    symbols = [ca.SX.sym("z", n) for n in sizes]
    slopes = ca.Function("slopes", symbols, [ca.jacobian(step(*symbols), ca.vertcat(symbols[0], symbols[2]))])
    rng = np.random.default_rng(3)
    for _ in range(10):
        state = np.concatenate((rng.uniform(-3, 3, 1), rng.choice([-1, 1], 1) * rng.uniform(0.3, 3, 1)))
        state = np.append(state, rng.uniform(1, 5, sizes[0] - 2))
        drive = DRIVE.get(name, {}).get("servo_gain", 0.0)
        inputs = np.array([rng.uniform(2, 6), rng.uniform(2, 6), drive, np.inf, 1.0, 0.02, width, 0.0])
        values = model.values
        if name == "input_delay":
            values[-1] = 0.004
        point = np.concatenate((state, values))

        def at(z: np.ndarray, inputs: np.ndarray = inputs) -> np.ndarray:
            return np.array(step(z[: sizes[0]], inputs, z[sizes[0] :])).ravel()

        nudge = 1e-6
        numeric = np.column_stack(
            [(at(point + nudge * e) - at(point - nudge * e)) / (2 * nudge) for e in np.eye(len(point))]
        )
        assert np.array(slopes(state, inputs, values)) == pytest.approx(numeric, rel=1e-6, abs=1e-7)


def test_a_dead_zone_can_open_from_nothing() -> None:
    """At half width zero, where fits begin, the slope by the half width is that from the right."""
    import casadi as ca

    model = ServoModel(effects=(catalogue["dead_zone"](half_width=0.0),))
    step, z = sample_step(model), ca.SX.sym("z", 4)
    for torque in (3.0, -3.0):
        inputs = np.array([torque, torque, 0.0, np.inf, 1.0, 0.02, 0.0, 0.0])
        slope = ca.Function("slope", [z], [ca.jacobian(step(np.zeros(2), inputs, z), z[3])])(model.values)
        assert float(slope[1]) == pytest.approx(-np.sign(torque) * 0.02 / model.inertia, rel=0.01)


@pytest.mark.parametrize("hours", [3])
def test_stiction_holds_for_hours_without_creeping(hours: int) -> None:
    model = ServoModel(gravity=0.5, effects=(StribeckFriction(coulomb=0.6, excess=0.3, velocity=0.1),))
    count = hours * 3600 * 10
    rng = np.random.default_rng(0)
    command = rng.uniform(-0.3, 1.3, count)  # with gravity's 0.5, always below breakaway at 0.9
    path = simulate(model, command=command, dt=0.1, state=np.array([0.1, 0.0]))
    assert np.ptp(path[:, 0]) < 1e-12
    assert np.abs(path[:, 1]).max() == 0.0


def test_a_load_let_go_comes_to_rest_where_energy_says() -> None:
    model = ServoModel(inertia=1.5, gravity=0.0, viscous_friction=0.0, effects=(CoulombFriction(torque=0.3),))
    for speed in (1.0, -0.73):
        path = simulate(model, command=np.zeros(1200), dt=SAMPLE, state=np.array([0.0, speed]))
        assert path[-1] == pytest.approx([np.sign(speed) * 0.5 * 1.5 * speed**2 / 0.3, 0.0], abs=1e-12)


def test_breakaway_is_at_its_torque() -> None:
    model = ServoModel(gravity=0.0, effects=(StribeckFriction(coulomb=0.3, excess=0.2, velocity=0.05),))
    for torque, moves in ((0.499, False), (0.501, True), (-0.499, False), (-0.501, True)):
        path = simulate(model, command=np.full(200, torque), dt=SAMPLE)
        assert bool(path[-1, 0] != 0.0) is moves
        assert np.sign(path[-1, 0]) == (np.sign(torque) if moves else 0.0)


@settings(max_examples=30, deadline=None)
@given(st.floats(0.0, 0.0249), st.floats(0.5, 3.0))
def test_a_fraction_of_a_sample_of_delay_is_exact(delay: float, torque: float) -> None:
    """A double integrator behind a step: the angle is half the square of the time since the command has arrived."""
    model = ServoModel(inertia=1.5, gravity=0.0, viscous_friction=0.0, effects=(InputDelay(time=delay),))
    command = np.where(np.arange(40) < 10, 0.0, torque)
    path = simulate(model, command=command, dt=SAMPLE)
    since = np.maximum(np.arange(41) * SAMPLE - 10 * SAMPLE - delay, 0.0)
    assert path[:, 0] == pytest.approx(torque / 1.5 * since**2 / 2, abs=1e-13)
    assert path[:, 1] == pytest.approx(torque / 1.5 * since, abs=1e-12)


@settings(max_examples=200, deadline=None)
@given(st.floats(0.0, 0.008), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.sampled_from([0.0, 1e-6, 0.001, 0.005]))
def test_the_fewest_integration_steps_cover_the_sample(delay: float, goal: float, shown: float, dt: float) -> None:
    names = ("input_delay", "setpoint_rate_limit", "compliance")
    effects = tuple(
        catalogue[name](**{**HIDDEN[name], "time": delay} if name == "input_delay" else HIDDEN[name]) for name in names
    )
    model, gain, substeps = ServoModel(effects=effects), 40.0, 8
    state = beginning(model, angle=0.0, velocity=0.0, torque=0.0, setpoint=shown)
    row = np.array([gain * goal, gain * shown, gain, np.inf, 0.0, dt, 0.0, 0.0])
    sample = [(command, np.array(float(length))) for command, length in stretches(model, row)]
    assert sum(length for _, length in sample) == pytest.approx(dt, abs=1e-18)
    for command, length in sample:
        steps = np.array([float(h) for h in division(model, state, command, row, length, substeps)])
        ramp = min(abs(command / gain - shown) / HIDDEN["setpoint_rate_limit"]["rate"], float(length))
        first = max(3, int(np.ceil(substeps * ramp / max(dt, 1e-15) * (1.0 - 1e-6))))
        early, late = steps[:first], steps[first:]
        assert len(steps) == substeps + 3
        for part, whole, least in ((early, ramp, 3), (late, float(length) - ramp, 1)):
            needed = part[part > 0.0]
            assert needed.sum() == pytest.approx(whole, abs=1e-15)
            assert (needed == needed[:1]).all()
            assert (part[: len(needed)] > 0.0).all()
            assert (needed <= dt / substeps * (1.0 + 1e-5)).all()
            if whole > 1e-12:
                assert len(needed) == max(least, np.ceil(substeps * whole / dt * (1.0 - 1e-6)))


def test_the_command_before_the_log_is_its_first() -> None:
    model, command = ServoModel(effects=(InputDelay(time=0.0075),)), np.array([3.0, 4.0, 5.0])
    now, before, switch = held_commands(model, command, np.full(3, SAMPLE))
    assert now.tolist() == [3.0, 3.0, 4.0]
    assert before.tolist() == [3.0, 3.0, 3.0]
    assert switch == pytest.approx(0.0025)


@pytest.mark.parametrize(
    ("effect", "slack"),
    [
        pytest.param(catalogue["friction_drift"](viscous_rate=0.04, coulomb_rate=0.0), 1e-7, id="no dry friction"),
        pytest.param(CoulombFriction(torque=5.0), 2e-7, id="Coulomb friction"),
        pytest.param(
            catalogue["asymmetric_friction"](forward=5.0, backward=3.0, viscous_difference=0.0), 2e-7, id="asymmetric"
        ),
    ],
)
def test_a_reversal_is_as_accurate_as_the_way_to_it(effect: Effect, slack: float) -> None:
    """In an accurate log an error of the integration is unmodelled torque, and hides the friction itself."""
    model = ServoModel(inertia=0.1, gravity=1.0, viscous_friction=0.9, effects=(effect,))
    coarse, fine = (sample_step(model, substeps=substeps) for substeps in (1, 64))
    state, worst, reversals = np.array([0.1, 0.0]), 0.0, 0
    for command in np.repeat(np.random.default_rng(0).choice([-60.0, -20.0, -4.0, 4.0, 20.0, 60.0], 100), 7):
        inputs = [command, command, 0.0, np.inf, 1.0, 0.004, 0.0, 0.0]
        once, after = (np.array(step(state, inputs, model.values)).ravel() for step in (coarse, fine))
        worst, reversals = max(worst, abs(once[0] - after[0])), reversals + (state[1] * after[1] < 0.0)
        state = after
    assert reversals > 10
    assert worst < slack


def test_gravity_is_followed_through_turns_within_a_sample() -> None:
    model = ServoModel(inertia=0.02, gravity=3.0, viscous_friction=0.04)
    speed, sample = 300.0, 0.02
    steps = integration_steps(model, sample, speed=speed)
    inputs = [12.0, 12.0, 0.0, np.inf, 0.0, sample, 0.0, 0.0]
    once, fine = (
        np.array(sample_step(model, substeps=n)([0.3, speed], inputs, model.values)).ravel()
        for n in (steps, 20 * steps)
    )
    assert steps > integration_steps(model, sample)
    assert once[0] == pytest.approx(fine[0], abs=1e-5)


def test_a_steady_speed_is_that_of_the_equations() -> None:
    model = ServoModel(inertia=2.0, gravity=0.0, viscous_friction=0.8)
    path = simulate(model, command=np.full(1000, 4.0), dt=SAMPLE)
    time = np.arange(1001) * SAMPLE
    assert path[:, 1] == pytest.approx(4.0 / 0.8 * (1.0 - np.exp(-0.4 * time)), abs=1e-9)


def test_a_swing_keeps_its_energy() -> None:
    model = ServoModel(inertia=1.5, gravity=0.7, viscous_friction=0.0)
    path = simulate(model, command=np.zeros(4000), dt=SAMPLE, state=np.array([0.2, 1.0]))
    energy = 0.75 * path[:, 1] ** 2 + 0.7 * np.sin(path[:, 0])
    assert np.ptp(energy) < 1e-8


@settings(max_examples=25, deadline=None)
@given(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(0.0, 1.0), st.floats(0.0, 2.0))
def test_friction_never_gives_energy(angle: float, velocity: float, coulomb: float, viscous: float) -> None:
    friction = (CoulombFriction(torque=coulomb),)
    model = ServoModel(inertia=1.5, gravity=0.7, viscous_friction=viscous, effects=friction)
    path = simulate(model, command=np.zeros(300), dt=SAMPLE, state=np.array([angle, velocity]))
    energy = 0.75 * path[:, 1] ** 2 + 0.7 * np.sin(path[:, 0])
    assert np.diff(energy).max() < 1e-9


def test_a_position_servo_settles_at_its_goal() -> None:
    model = ServoModel(inertia=0.1, gravity=0.0, viscous_friction=1.0)
    path = simulate(model, command=np.full(2000, 5.0 * 0.7), dt=SAMPLE, servo_gain=5.0, command_limit=2.0)
    assert path[-1] == pytest.approx([0.7, 0.0], abs=1e-6)
    assert np.abs(np.diff(path[:, 1])).max() <= 2.0 / 0.1 * SAMPLE + 1e-12  # the drive's limit holds


# Equation (5) of the paper.


def by_hand(torque: np.ndarray, step: float) -> np.ndarray:
    """Eq. (5) solved sample by sample with a bracketing root finder."""
    from scipy.optimize import brentq

    x = [0.0, 0.0]  # at rest before the first sample
    for tau in torque:

        def balance(new: float, tau: float = tau) -> float:
            second = (new - 2 * x[-1] + x[-2]) / step**2
            return float(2.0 * second + 0.5 * np.cos(new) + 0.8 * (new - x[-1]) / step - tau)

        x.append(brentq(balance, x[-1] - 1.0, x[-1] + 1.0, xtol=1e-15))
    return np.array(x[1:])


def test_the_backward_difference_is_equation_5() -> None:
    torque = 3.0 * np.sin(np.arange(200) * 0.1)
    model = ServoModel(inertia=2.0, gravity=0.5, viscous_friction=0.8)
    path = simulate(model, command=torque, dt=0.02, method="backward_difference")
    assert path[:, 0] == pytest.approx(by_hand(torque, 0.02), abs=1e-10)


def test_equation_5_becomes_equation_4_as_the_step_shrinks() -> None:
    """First order: half the step, half the error."""
    model = ServoModel.paper()
    errors = []
    for step in (0.02, 0.01, 0.005, 0.0025):
        count = round(4.0 / step)
        torque = np.full(count, 5.0)
        exact = simulate(model, command=torque, dt=step, substeps=4)
        implicit = simulate(model, command=torque, dt=step, method="backward_difference")
        errors.append(abs(implicit[-1, 0] - exact[-1, 0]))
    assert np.array(errors[:-1]) / errors[1:] == pytest.approx(2.0, rel=0.02)


def test_what_a_step_cannot_do_is_refused() -> None:
    with pytest.raises(BadParameter, match="substeps"):
        sample_step(ServoModel(), substeps=0)
    with pytest.raises(BadParameter, match="euler"):
        sample_step(ServoModel(), method="euler")  # type: ignore[arg-type]
    with pytest.raises(BadParameter, match="Equation \\(5\\)"):
        sample_step(model_of("coulomb_friction"), method="backward_difference")
    with pytest.raises(BadParameter, match="Equation \\(5\\)"):
        sample_step(model_of("actuator_lag"), method="backward_difference")


def test_equal_structures_share_one_compiled_step() -> None:
    assert sample_step(ServoModel(inertia=1.0)) is sample_step(ServoModel(inertia=5.0))
    assert sample_step(ServoModel()) is not sample_step(ServoModel.paper())


def test_no_effect_of_the_catalogue_goes_without_its_comparison() -> None:
    assert set(HIDDEN) == set(catalogue)
