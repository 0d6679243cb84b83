"""A position servo that limits the speed of its goal: the model moves as an independent one, and the limit is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from machine import Array, Machine, record
from machine_inputs import random_steps

from diagnosis import diagnose
from identification import fit
from identification.inverse import filtered_motion, needed_torque
from identification.log import Log, Run
from identification.simulation import free_simulation
from mpc import Controller
from plant import GearTrain, ServoModel, simulate
from plant.effects import DeadZone, InputDelay, Motion, RateLimit, SetpointRateLimit
from plant.effects.setpoint_rate_limit import setpoints
from plant.simulation import beginning

SAMPLE, RATE, GAINS, LIMIT = 0.005, 2.5, np.array([40.0, 120.0]), 30.0
TRUTH = ServoModel(inertia=2.0, gravity=0.5, viscous_friction=12.0, effects=(DeadZone(half_width=0.5),))
GEARS = GearTrain(pinion_teeth=(20, 20), output_teeth=160)
LIMITED = TRUTH.with_effect(SetpointRateLimit(rate=RATE))


def servo(**effects: dict[str, float]) -> Machine:
    """One machine at two gains."""
    hidden = {"dead_zone": {"half_width": 0.5}, **effects}
    return Machine(viscous_friction=12.0, effects=hidden, servo_gain=GAINS, command_limit=LIMIT)


def steps_of(seed: int, duration: float) -> Array:
    """(T, 2) setpoints that jump, others for each gain [rad]."""
    rng = np.random.default_rng([seed, 7])
    return np.column_stack([random_steps(rng, 0.2, 1.0, duration, SAMPLE) for _ in GAINS])


def log_of(machine: Machine, seed: int, duration: float = 8.0, **options: float | None) -> Log:
    """A log of two runs, one at each gain."""
    out = record(machine, steps_of(seed, duration), seed=seed, **options)
    runs = [
        replace(
            out.run(place, number=place),
            command=gain * out.command[:, place],
            setpoint=out.command[:, place],
            servo_gain=np.full(out.time.size, gain),
            command_limit=LIMIT,
        )
        for place, gain in enumerate(GAINS)
    ]
    return Log(runs=tuple(runs), axis="rotary")


def held_out_error(model: ServoModel, log: Log) -> float:
    """RMS error of a free simulation [rad]."""
    pairs = zip(free_simulation(log, model), log.runs, strict=True)
    return float(np.sqrt(np.mean([(simulated - run.output) ** 2 for simulated, run in pairs])))


@pytest.mark.parametrize("delay", [0.0, 0.0123])
def test_position_servo_matches_the_independent_machine(delay: float) -> None:
    """Also where a delay brings the goal late, by whole samples and a part of one."""
    effects = {"setpoint_rate_limit": {"rate": RATE}} | ({"input_delay": {"time": delay}} if delay else {})
    log = log_of(servo(**effects), 3, duration=8.0, noise=0.0, bits=None)
    model = LIMITED.with_effect(InputDelay(time=delay)) if delay else LIMITED
    for run, gain in zip(log.runs, GAINS, strict=True):
        drive = {"servo_gain": gain, "command_limit": LIMIT}
        path = simulate(model, command=run.command, dt=SAMPLE, state=begins(model, run), **drive)
        assert np.abs(path[:-1, 0] - run.output).max() < 1e-4
        free = simulate(model.without_effect("setpoint_rate_limit"), command=run.command, dt=SAMPLE, **drive)
        assert np.abs(free[:-1, 0] - run.output).max() > 0.05


def begins(model: ServoModel, run: Run) -> Array:
    return beginning(model, setpoint=float(setpoints(run.command, run.servo_gain)[0]))


def test_the_limit_is_named_with_its_rate_and_its_gain_is_had() -> None:
    machine = servo(setpoint_rate_limit={"rate": RATE})
    log, held_out = log_of(machine, 1), log_of(machine, 2)
    found = diagnose(log, None, held_out)
    assert found.verdict == "named"
    assert [cause.effect for cause in found.causes] == ["setpoint_rate_limit"]
    assert found.causes[0].parameters["rate"].value == pytest.approx(RATE, rel=0.05)
    assert found.causes[0].parameters["rate"].unit == "rad/s"
    mine, best = (held_out_error(m, held_out) for m in (found.model, fit(log, LIMITED).model))
    assert mine < 1.2 * best < 0.2 * held_out_error(found.base.model, held_out)


def test_a_servo_that_follows_its_goal_at_once_names_nothing() -> None:
    found = diagnose(log_of(servo(), 1), None, log_of(servo(), 2))
    assert found.verdict == "nothing_missing"
    assert found.causes == ()


@pytest.mark.long
def test_a_set_point_rate_limit_holds_at_several_gains() -> None:
    log = log_of(servo(setpoint_rate_limit={"rate": RATE}), 1)
    limits = (SetpointRateLimit(rate=4.0), RateLimit(rate=60.0 * RATE))
    goal, command = (fit(log, TRUTH.with_effect(effect)) for effect in limits)
    assert goal.model.effect("setpoint_rate_limit").rate == pytest.approx(RATE, rel=0.01)
    assert goal.log_likelihood > command.log_likelihood + 500.0


def test_without_a_goal_the_command_passes() -> None:
    command = 5.0 * np.sin(np.arange(300) * 0.05)
    path, plain = (simulate(model, command=command, dt=SAMPLE) for model in (LIMITED, TRUTH))
    np.testing.assert_array_equal(path[:, :2], plain)
    controllers = [Controller(model, GEARS, min_torque=0.02, max_torque=5.0) for model in (LIMITED, TRUTH)]
    for angle in (0.0, 0.01, 0.03):
        limited, same = (controller.step(angle, 0.5) for controller in controllers)
        assert limited.status == same.status
        assert limited.torques == pytest.approx(same.torques, abs=1e-6)


def test_while_the_drive_is_off_the_internal_goal_waits() -> None:
    gain = np.where((np.arange(400) >= 100) & (np.arange(400) < 200), 0.0, 60.0)
    command = gain * np.where(np.arange(400) < 50, 0.1, 0.9)
    path = simulate(LIMITED, command=command, dt=SAMPLE, servo_gain=gain)
    internal = path[:, LIMITED.states.index("setpoint_rate_limit")]
    elapsed = np.clip(np.arange(401) - 50, 0, 50) + np.maximum(np.arange(401) - 200, 0)
    assert internal == pytest.approx(np.minimum(0.1 + RATE * SAMPLE * elapsed, 0.9), abs=1e-9)


def test_the_first_setpoint_of_a_drive_that_starts_late_is_found() -> None:
    gain = np.array([0.0, 0.0, 2.0, 2.0, 0.0, 2.0])
    assert setpoints(np.array([9.0, 9.0, 1.0, 3.0, 9.0, 5.0]), gain).tolist() == [0.5, 0.5, 0.5, 1.5, 1.5, 2.5]
    assert setpoints(np.ones(3), np.zeros(3)).tolist() == [0.0, 0.0, 0.0]


def test_the_missing_torque_sees_the_limited_goal() -> None:
    """Behind the law and the limit, what the motion needs is what arrives."""
    log = log_of(servo(setpoint_rate_limit={"rate": RATE}), 4, noise=0.0, bits=None)
    for run in log.runs:
        lacking = []
        for model in (LIMITED, TRUTH):
            motion = filtered_motion(run, 8.0, model)
            lacking.append(np.std((needed_torque(model, motion) - motion.torque)[100:-100]))
        assert lacking[0] < 0.1 * lacking[1]


def motion_of(servo_gain: float, goal: Array | None = None) -> Motion:
    """A still load with two runs: in the first the goal jumps from 0.2 to 1, in the second it stays."""
    goal = np.repeat([0.2, 1.0, -0.5], [50, 100, 150]) if goal is None else goal
    count, still = goal.size, np.zeros(goal.size)
    command = servo_gain * goal if servo_gain else goal

    def law(command: Array) -> Array:
        return np.clip(command, -LIMIT, LIMIT)

    return Motion(
        time=np.arange(count) * SAMPLE,
        angle=still,
        velocity=still,
        acceleration=still,
        command=command,
        servo_gain=np.full(count, servo_gain),
        torque=law(command),
        score=still[:, None],
        reading_score=still[:, None],
        run=np.repeat([0, 1], count // 2),
        inertia=2.0,
        velocity_resolution=1e-3,
        law=law,
    )


def test_the_trace_is_what_the_law_makes_of_the_limited_goal() -> None:
    """The drive gives its limit from a goal of 0.5 on, so none is missing behind that, nor in a run without jumps."""
    for regressors in SetpointRateLimit.regressors(motion_of(60.0)):
        rate = regressors.start(np.ones(1)).values[0]
        edges = np.clip(0.2 + rate * SAMPLE * (np.arange(301) - 50), 0.2, 0.5)
        expected = np.where(np.arange(300) < 150, 60.0 * (edges[:-1] + edges[1:]) / 2, 0.0)
        expected[:150] -= np.where(np.arange(150) < 50, 12.0, 30.0)
        reaches = 50 + int(0.3 / (rate * SAMPLE))  # a sample within which the limit is reached is known by its mean
        same = np.delete(np.arange(300), reaches)
        assert regressors.columns[same, 0] == pytest.approx(expected[same], abs=1e-9)


def test_either_limit_is_drawn_where_it_acts() -> None:
    """A torque has no goal, and of a position servo it is the goal that is limited."""
    for kind, drawn in ((RateLimit, [6, 0]), (SetpointRateLimit, [0, 6])):
        assert [len(list(kind.regressors(motion_of(gain)))) for gain in (0.0, 60.0)] == drawn


def test_of_a_slow_set_point_the_limits_tried_are_slower() -> None:
    """It takes 800 samples from end to end; limits that cross that in 150 samples would all be out of its reach."""
    slow = np.tile(0.1 * np.sin(np.linspace(0.0, 2.0 * np.pi, 1600)), 2)
    for regressors in SetpointRateLimit.regressors(motion_of(60.0, slow)):
        assert regressors.start(np.ones(1)).values[0] < np.abs(np.diff(slow)).max() / SAMPLE
        assert np.abs(regressors.columns).max() > 0.1
