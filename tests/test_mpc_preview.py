"""A previewed reference that the torques cannot follow, and a load that does not follow."""

from __future__ import annotations

from functools import partial
from typing import Any

import casadi as ca
import numpy as np
import pytest
from four_hertz import four_hertz
from numpy.typing import NDArray

from mpc import Controller
from plant import GearTrain, ServoModel, sample_step

Array = NDArray[np.float64]
PAPER, DT = GearTrain.paper(), 0.005
MODEL = ServoModel(inertia=2.0, gravity=0.0, viscous_friction=0.0)
STRONG = partial(four_hertz, MODEL, PAPER, max_torque=3.0 / 8.05 + 0.02)
STEP = sample_step(MODEL)


def wanted(samples: int) -> Array:
    """A sine, and a step of 0.25 rad at 1 s."""
    time = DT * np.arange(samples)
    return np.asarray(0.3 * np.sin(time) + 0.25 * (time > 1.0))


def advanced(state: Array, torque: float) -> Array:
    return np.asarray(STEP(state, np.array([torque, 0.0, 0.0, np.inf, 0.0, DT, 0.0, 0.0]), MODEL.values))[:, 0]


def run(controller: Controller, *, ahead: bool, stuck: bool = False) -> tuple[Array, list[str]]:
    """Errors and statuses of a load that equals the model, or is jammed."""
    N, reference = controller.horizon, wanted(700)
    state, errors, statuses = np.array([0.0, 0.3]), [], []
    noise = 1e-5 * np.random.default_rng(0).standard_normal(600)
    for k in range(600):
        shown = state[0] + noise[k] * stuck  # a value constant to the last bit would be an encoder fault
        control = controller.step(shown, reference[k : k + N + 1] if ahead else reference[k])
        errors.append(state[0] - reference[k])
        statuses.append(control.status)
        state = state if stuck else advanced(state, float(PAPER.output_torque(control.torques)))
    return np.array(errors), statuses


def plain(controller: Controller) -> Array:
    """Errors of the textbook program with the same weights and bounds, without a governor."""
    N, P, w = controller.horizon, controller._terminal_weight, controller._rate_weight
    A, B = np.array([[1.0, DT], [0.0, 1.0]]), np.array([DT**2 / 2, DT]) / MODEL.inertia
    answer, free = np.zeros((N + 1, 2, N)), np.zeros((N + 1, 2, 2))
    free[0] = np.eye(2)
    for k in range(N):
        free[k + 1], answer[k + 1] = A @ free[k], A @ answer[k]
        answer[k + 1][:, k] += B
    rates = np.eye(N) - np.eye(N, k=-1)
    H = sum(np.outer(answer[k, 0], answer[k, 0]) for k in range(N)) + w * rates.T @ rates
    H = H + answer[N].T @ P @ answer[N]
    solver: Any = ca.conic(
        "plain",
        "qrqp",
        {"h": ca.DM(H).sparsity(), "a": ca.Sparsity(0, N)},
        {"print_iter": False, "print_header": False},
    )
    low, high = controller.bounds.reachable()
    reference, state, last, errors = wanted(700), np.array([0.0, 0.3]), 0.0, []
    for k in range(600):
        errors.append(state[0] - reference[k])
        ahead = reference[k : k + N + 2]
        misses = free @ state
        g = sum((misses[i, 0] - ahead[i]) * answer[i, 0] for i in range(N)) - w * last * rates[0]
        g = g + answer[N].T @ P @ (misses[N] - [ahead[N], (ahead[N + 1] - ahead[N - 1]) / (2 * DT)])
        last = float(solver(h=H, g=g, lbx=low, ubx=high)["x"][0])
        state = advanced(state, last)
    return np.array(errors)


@pytest.mark.parametrize("horizon", [20, 50])
def test_what_cannot_be_followed_is_begun_before_it_is_there(horizon: int) -> None:
    known, _ = run(STRONG(horizon=horizon), ahead=True)
    assert np.sum(known**2) <= 1.05 * np.sum(plain(STRONG(horizon=horizon)) ** 2)
    assert np.max(known[205:]) < 3e-3  # no overshoot either


def test_a_set_point_that_comes_unannounced_is_governed() -> None:
    known, unknown = (run(STRONG(), ahead=ahead)[0] for ahead in (True, False))
    assert np.all(np.abs(unknown[170:200]) < 1e-3)  # the initial move has ended, and no move starts before the step
    assert np.sum(known**2) < 0.7 * np.sum(unknown**2)


@pytest.mark.parametrize("compiled", [True, False])
def test_a_load_that_does_not_follow_is_reported(compiled: bool) -> None:
    controller = STRONG()
    if not compiled:
        controller._step = controller._interpreted
    statuses = run(controller, ahead=True, stuck=True)[1]
    late = round(1.0 / controller.bandwidth / DT)
    begun = round(0.05 / DT)  # until then the governed reference, with limited jerk, is still near the load
    assert set(statuses[begun + 2 * late :]) == {"degraded: the load does not follow the reference"}
    assert set(run(STRONG(), ahead=True)[1][200:]) == {"optimal"}
