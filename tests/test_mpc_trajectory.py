"""Moves in minimum time and with least copper loss, beside closed forms, finer simulations and the test bench."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq

from allocation import Bounds, Limits, Structure
from mpc import Controller, Trajectory, closed_loop, minimum_copper_loss, time_optimal
from plant import BadParameter, GearTrain, Rig, ServoModel, simulate
from plant.effects import ActuatorLag, Backlash, CoulombFriction, SensorLag, TorqueSaturation

Array = NDArray[np.float64]

PAPER = GearTrain.paper()
N, LEAST, MOST = 161 / 20, 0.02, 0.3
BOUNDS = Bounds(gears=PAPER, min_torque=LEAST, max_torque=MOST)
HEAVY = Bounds(gears=PAPER, min_torque=LEAST, max_torque=MOST, rotor_inertia=1e-4)
J = 2.0
PURE = ServoModel(inertia=J, gravity=0.0, viscous_friction=0.0)


def sound(move: Trajectory, goal: float, bounds: Limits = BOUNDS, miss: float = 1e-6) -> bool:
    """Inside its bounds to the last bit, at the goal, with contact kept, and with consistent torques."""
    drives = bounds.structure.signs * move.torques
    return (
        move.status == "optimal"
        and bool(np.all(drives >= bounds.least) and np.all(drives <= bounds.greatest))
        and move.margin > -1e-6 * float(np.max(bounds.greatest))
        and bool(np.all(np.abs(move.miss) < miss))
        and bool(np.allclose(PAPER.output_torque(move.torques), move.output_torque))
        and abs(move.angle[-1] - goal) < 1e-9
        and abs(move.speed[-1]) < 1e-9
    )


@pytest.mark.parametrize(("start", "goal"), [(0.0, 1.0), (0.3, -0.4)])
@pytest.mark.parametrize("scale", [0.01, 1.0, 1e4])
def test_least_time_of_a_double_integrator_is_bang_bang(start: float, goal: float, scale: float) -> None:
    bounds = Bounds(gears=PAPER, min_torque=scale * LEAST, max_torque=scale * MOST)
    move = time_optimal(
        ServoModel(inertia=scale * J, gravity=0.0, viscous_friction=0.0), bounds, start, goal, intervals=40
    )
    full = N * (MOST - LEAST)
    assert sound(move, goal, bounds)
    assert move.duration == pytest.approx(2 * np.sqrt(J * abs(goal - start) / full), rel=1e-6)
    wanted = np.sign(goal - start) * scale * full * np.repeat([1, -1], 20)
    assert move.output_torque == pytest.approx(wanted, rel=1e-4)


@pytest.mark.parametrize("limit", [0.2, 0.5, 1.0])
def test_least_time_under_a_speed_limit_is_a_trapezoid(limit: float) -> None:
    move = time_optimal(PURE, BOUNDS, 0.3, -0.4, speed_limit=limit)
    greatest = N * (MOST - LEAST) / J
    peak = min(limit, np.sqrt(0.7 * greatest))  # the last limit is not reached
    expected = 0.7 / peak + peak / greatest
    assert sound(move, -0.4)
    assert np.max(np.abs(move.speed)) <= limit * (1 + 1e-6)
    assert move.duration >= expected * (1 - 1e-6)
    assert move.duration == pytest.approx(expected, rel=2e-3)


def test_least_copper_loss_keeps_a_speed_limit_and_pays_for_it() -> None:
    free, held = (minimum_copper_loss(ServoModel(), BOUNDS, 0.0, 0.6, 3.0, speed_limit=v) for v in (np.inf, 0.25))
    assert np.max(free.speed) > 0.28
    assert np.max(held.speed) == pytest.approx(0.25, rel=1e-4)
    assert sound(held, 0.6)
    assert held.copper_loss > free.copper_loss * 1.002
    assert minimum_copper_loss(ServoModel(), BOUNDS, 0.0, 0.6, 3.0, speed_limit=0.19).status.startswith("failed")


def test_with_friction_acceleration_takes_longer_than_braking() -> None:
    rub, full = 0.6, N * (MOST - LEAST)
    move = time_optimal(PURE.with_effect(CoulombFriction(torque=rub)), BOUNDS, 0.0, 1.0)
    up, down = (full - rub) / J, (full + rub) / J
    assert sound(move, 1.0)
    assert move.duration == pytest.approx(np.sqrt(2 * (1 / up + 1 / down)), rel=2e-4)
    assert move.duration >= np.sqrt(2 * (1 / up + 1 / down)) * (1 - 1e-6)


def test_least_copper_loss_of_a_double_integrator_is_known() -> None:
    # With u the torque of the driving pinion minus that of the holding one, seen from the pinion, the copper loss is
    # m^2 + (m + |u|)^2. The costate p is a line through zero half-way, and u = sign(p) max(|p| - m, 0).
    T, goal = 3.0, 1.0
    t = (np.arange(200_000) + 0.5) / 200_000 * T

    def torque(steepness: float) -> Array:
        p = steepness * (1 - 2 * t / T)
        return np.asarray(np.sign(p) * np.maximum(np.abs(p) - LEAST, 0))

    def way(steepness: float) -> float:
        return float(np.mean(torque(steepness) * (T - t)) * T * N / J)

    u = torque(brentq(lambda s: way(s) - goal, LEAST, 10.0))
    loss = float(np.mean(LEAST**2 + (LEAST + np.abs(u)) ** 2) * T)
    move = minimum_copper_loss(PURE, BOUNDS, 0.0, goal, T)
    assert sound(move, goal)
    assert move.copper_loss == pytest.approx(loss, rel=1e-4)
    assert move.copper_loss == pytest.approx(float(np.sum(move.torques**2) * T / 100))
    assert PAPER.output_torque(move.torques) == pytest.approx(N * u.reshape(100, -1).mean(axis=1), abs=0.01)


def test_least_loss_move_in_least_time_is_bang_bang() -> None:
    quick = time_optimal(ServoModel(), BOUNDS, 0.0, 0.5)
    losses = [
        minimum_copper_loss(ServoModel(), BOUNDS, 0.0, 0.5, share * quick.duration).copper_loss
        for share in (1 + 1e-6, 1.2, 1.5)
    ]
    assert losses[0] == pytest.approx(quick.copper_loss, rel=0.005)
    assert losses[0] > losses[1] > losses[2]


def test_contact_torque_is_a_bound_of_its_own() -> None:
    # gravity accelerates the load, both drives are near their minimum torque, and heavy rotors take more than that
    load = ServoModel(inertia=4.0, gravity=1.5)
    held, careless = minimum_copper_loss(load, HEAVY, 0.0, -1.0, 3.0), minimum_copper_loss(load, BOUNDS, 0.0, -1.0, 3.0)
    assert sound(held, -1.0, HEAVY)
    assert held.margin < 1e-6
    h = careless.duration / 100
    acceleration = np.diff(careless.speed) / h
    assert float(np.min(HEAVY.margin(careless.torques, acceleration))) < -0.01
    assert held.copper_loss > careless.copper_loss * 1.005


@pytest.mark.parametrize(
    ("model", "start", "goal", "miss"),
    [
        (ServoModel(), -0.5, 0.8, 1e-6),
        (ServoModel.paper(), 0.0, 1.0, 4e-3),  # the jump of its dead zone is planned as a steep slope
        (ServoModel(inertia=4.0).with_effect(CoulombFriction(torque=0.3)), 1.0, 0.2, 1e-6),
    ],
)
def test_a_finer_simulation_comes_to_the_goal(model: ServoModel, start: float, goal: float, miss: float) -> None:
    for move in (time_optimal(model, HEAVY, start, goal), minimum_copper_loss(model, HEAVY, start, goal, 4.0)):
        assert sound(move, goal, HEAVY, miss)
        states = simulate(
            model,
            command=np.repeat(move.output_torque, 50),
            dt=move.duration / 5000,
            state=np.array([start, 0.0]),
        )
        assert states[-1] == pytest.approx([goal, 0.0], abs=max(miss, 1e-5))
        assert states[::50, 0] == pytest.approx(move.angle, abs=max(miss, 1e-5))


def test_a_move_is_never_quicker_for_having_less_torque() -> None:
    least = [
        time_optimal(ServoModel(), Bounds(gears=PAPER, min_torque=LEAST, max_torque=most), 0.0, 1.0).duration
        for most in (0.2, 0.25, 0.3)
    ]
    assert least[0] > least[1] > least[2]
    limited = time_optimal(ServoModel().with_effect(TorqueSaturation(limit=N * (0.25 - LEAST))), BOUNDS, 0.0, 1.0)
    assert limited.duration == pytest.approx(least[1], rel=1e-5)


def test_feed_forward_leaves_lags_and_sensor_errors_out() -> None:
    plain = time_optimal(ServoModel(), BOUNDS, 0.0, 1.0, intervals=20)
    for effect in (ActuatorLag(time_constant=0.02), SensorLag(time_constant=0.02), Backlash(gap=0.01, motor_share=0.2)):
        other = time_optimal(ServoModel().with_effect(effect), BOUNDS, 0.0, 1.0, intervals=20)
        assert other.duration == pytest.approx(plain.duration, rel=1e-9)


def test_too_short_a_time_is_reported() -> None:
    move = minimum_copper_loss(PURE, BOUNDS, 0.0, 1.0, 1.0, intervals=20)
    assert move.status.startswith("failed: Infeasible")
    assert abs(move.miss[0]) > 0.1
    assert np.all(BOUNDS.structure.signs * move.torques >= LEAST)


def test_the_rig_follows_a_move_without_loss_of_contact() -> None:
    rig = Rig.paper_like()
    model = ServoModel(inertia=rig.total_inertia, gravity=0.5, viscous_friction=0.8)
    spare = Bounds(gears=PAPER, min_torque=LEAST, max_torque=0.25, rotor_inertia=rig.rotor_inertia)
    move = time_optimal(model, spare, 0.0, 0.6)
    controller = Controller(model, PAPER, rotor_inertia=rig.rotor_inertia)
    start = 0.5
    loop = closed_loop(controller, rig, lambda t: move.reference(t - start), start + move.duration + 0.3, seed=0)
    moving = loop.time > 0.8 * start
    assert np.max(np.abs(loop.angle - loop.reference)[moving]) < 2e-3
    assert abs(loop.angle[-1] - 0.6) < 2e-4
    assert loop.minimum_contact_torque > 0
    assert move.reference(np.array([-1.0, 99.0])) == pytest.approx([0.0, 0.6])


@pytest.mark.parametrize(
    "wrong",
    [
        {"goal": 0.0},
        {"goal": float("nan")},
        {"intervals": 1},
        {"intervals": True},
        {"speed_limit": 0.0},
        {"speed_limit": float("nan")},
        {"duration": 0.0},
        {"duration": float("inf")},
        {"model": ServoModel(axis="linear", gravity=0.0)},
        {"bounds": Bounds(gears=PAPER, min_torque=0.3, max_torque=0.3)},
        {"bounds": Limits(gears=Structure(A=((1.0, -1.0, 0.5),)), min_torque=0.1, max_torque=1.0)},
    ],
)
def test_refuses_what_is_no_move(wrong: dict[str, object]) -> None:
    right = {"model": ServoModel(), "bounds": BOUNDS, "start": 0.0, "goal": 1.0, "duration": 3.0}
    with pytest.raises(BadParameter):
        minimum_copper_loss(**{**right, **wrong})  # type: ignore[arg-type]
