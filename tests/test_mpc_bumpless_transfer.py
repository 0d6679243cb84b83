"""A controller in a running loop: it is immutable, another takes over bumplessly, and it can be reset."""

from __future__ import annotations

import pickle
from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest
from target import PAPER, RIGID

from mpc import Controller, closed_loop
from plant import BadParameter, Ratios, Rig, ServoModel, simulate
from plant.effects import ActuatorLag, Compliance, DeadZone, InputDelay

HEAVY = replace(RIGID, gravity=1.95)  # with a payload that RIGID does not include


def held(controller: Controller, state: np.ndarray, samples: int = 400) -> tuple[np.ndarray, np.ndarray, list[float]]:
    """Hold the load at 0.3 rad: its last state, its path, and the torques on it."""
    path, torques = [], []
    for _ in range(samples):
        control = controller.step(state[0], 0.3)
        torques.append(float(PAPER.output_torque(control.torques)))
        state = simulate(HEAVY, command=np.array(torques[-1:]), dt=controller.sample_time, state=state)[-1]
        path.append(state[0])
    return state, np.array(path), torques


@pytest.fixture(scope="module")
def settled() -> tuple[bytes, np.ndarray, float]:
    controller = Controller(RIGID, PAPER)
    state, path, torques = held(controller, np.array([0.3, 0.0]))
    assert abs(path[-1] - 0.3) < 1e-6
    assert torques[-1] == pytest.approx(1.95 * np.cos(0.3), abs=1e-3)
    return pickle.dumps(controller), state, torques[-1]


@pytest.mark.parametrize(
    "changes",
    [
        {"max_torque": 0.29},
        {"min_torque": 0.05},
        {"bandwidth": 3.0},
        {"horizon": 12},
        {"horizon": 40},
        {"model": HEAVY},
        {"model": RIGID.with_effect(InputDelay(time=0.012))},
        {"model": RIGID.with_effect(ActuatorLag(time_constant=0.008))},
        {"model": RIGID.with_effect(Compliance(frequency=60.0, damping=0.1, motor_share=0.3))},
        {"motor_resolution": 1e-3},
        {"angle_limits": (-1.0, 1.0), "torque_rate": 50.0},
        {"sample_time": 0.004},
        {"gears": Ratios(ratios=(-8.05, -8.05))},
    ],
    ids=lambda changes: ", ".join(changes),
)
def test_a_change_goes_on_without_a_bump(settled: tuple[bytes, np.ndarray, float], changes: dict[str, object]) -> None:
    remembered, state, before = settled
    controller = pickle.loads(remembered).with_(**changes)
    _, path, torques = held(controller, state)
    moved = np.max(np.abs(path - 0.3))
    print(f"{changes}: torque {before:.4f} goes on as {torques[0]:.4f}; moved {moved:.1e} rad")
    assert torques[0] == pytest.approx(before, abs=2e-3)
    assert moved < 2e-5


def test_a_change_of_the_drive_is_no_change_of_the_torque(settled: tuple[bytes, np.ndarray, float]) -> None:
    """Before the change, the torque lost in the dead zone was compensated as part of the disturbance."""
    controller = pickle.loads(settled[0]).with_(model=RIGID.with_effect(DeadZone(half_width=0.2)))
    _, _, torques = held(controller, settled[1], 1)
    assert torques[0] == pytest.approx(settled[2], abs=2e-3)


def test_without_it_there_is_a_bump(settled: tuple[bytes, np.ndarray, float]) -> None:
    _, path, torques = held(replace(pickle.loads(settled[0]), max_torque=0.29), settled[1])
    assert abs(torques[0] - settled[2]) > 1.0
    assert np.max(np.abs(path - 0.3)) > 1e-3


def test_the_new_bounds_hold_at_once(settled: tuple[bytes, np.ndarray, float]) -> None:
    controller = pickle.loads(settled[0]).with_(max_torque=0.2, min_torque=0.06)
    for _ in range(20):
        torques = controller.step(0.3, 0.5).torques
        assert 0.06 <= torques[0] <= 0.2
        assert -0.2 <= torques[1] <= -0.06


def test_the_same_again_is_the_same_to_the_last_bit(settled: tuple[bytes, np.ndarray, float]) -> None:
    one = pickle.loads(settled[0])
    other = one.with_()
    for k in range(50):
        torques = [each.step(0.3 + 1e-4 * k, 0.3).torques for each in (one, other)]
        np.testing.assert_array_equal(*torques)


def test_an_attribute_is_not_set_and_a_typo_is_refused() -> None:
    controller = Controller(RIGID, PAPER, horizon=30)
    for name in ("max_torque", "horizon", "maxtorque", "model"):
        with pytest.raises(FrozenInstanceError, match=rf"with_\({name}="):
            setattr(controller, name, 3)
    with pytest.raises(BadParameter, match="no 'maxtorque'"):
        controller.with_(maxtorque=3)
    with pytest.raises(BadParameter, match="horizon"):
        controller.with_(horizon=1)
    assert (controller.max_torque, controller.horizon) == (0.3, 30)


def test_it_forgets() -> None:
    used, fresh = Controller(RIGID, PAPER), Controller(RIGID, PAPER)
    for k in range(30):
        used.step(0.01 * k, 0.5)
    used.reset()
    for k in range(30):
        one, other = (each.step(1.0 + 1e-3 * k, 1.2) for each in (used, fresh))
        np.testing.assert_array_equal(one.torques, other.torques)
        assert one.status == other.status


def test_a_controller_is_used_for_loop_after_loop() -> None:
    rig, used = Rig.paper_like(), Controller(RIGID, PAPER)
    loops = [closed_loop(used, rig, level, duration=0.3, seed=0) for level in (0.2, 1.2)]
    assert [loop.degraded for loop in loops] == [0, 0]
    fresh = closed_loop(Controller(RIGID, PAPER), rig, 1.2, duration=0.3, seed=0)
    np.testing.assert_array_equal(loops[1].torques, fresh.torques)


@pytest.mark.parametrize("numbers", [{"min_torque": 0.3}, {"min_torque": 0.25, "motor_friction": 0.06}])
def test_limits_that_leave_no_torque_are_refused(numbers: dict[str, float]) -> None:
    with pytest.raises(BadParameter, match="no torque is left"):
        Controller(RIGID, PAPER, max_torque=0.3, **numbers)


@pytest.mark.parametrize("least", [0.25, 0.299, 0.2999999])
def test_limits_that_leave_little_torque_work(least: float) -> None:
    controller = Controller(ServoModel(inertia=2.0, gravity=0.0), PAPER, min_torque=least, max_torque=0.3)
    assert {controller.step(0.1, 0.1).status for _ in range(30)} == {"optimal"}


@pytest.mark.parametrize("kind", [np.float32, np.float64, np.int64, np.uint8])
def test_numbers_of_numpy_are_numbers(kind: type) -> None:
    assert ServoModel(inertia=kind(2)).inertia == 2.0
    controller = Controller(RIGID, PAPER, horizon=np.int64(20), max_torque=kind(1), torque_rate=kind(200))
    assert controller.step(0.1, 0.1).status == "optimal"
