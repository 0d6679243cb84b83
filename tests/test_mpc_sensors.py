"""Encoder faults with finite values: frozen encoders, encoders that contradict each other, and wrap-around."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from target import PAPER, RIGID

from allocation import least_effort
from mpc import Controller
from plant import BadParameter, Rig, ServoModel, simulate

Array = NDArray[np.float64]
RIG = Rig.paper_like()
STEP = 2 * np.pi / 2**17
FROZEN = 200


def sine(time: Array) -> Array:
    return np.asarray(0.15 * (1 - np.cos(2 * time)))


def slow(time: Array) -> Array:
    return np.asarray(0.02 * time)


def late_step(time: Array) -> Array:
    return np.where(np.asarray(time) < 1.4995, 0.3, 0.4)


def loop(
    reference: Callable[[Array], Array],
    *,
    load: bool = False,
    motors: bool = False,
    drift: float = 0.0,
    fitted: bool,
    samples: int = 600,
) -> tuple[Array, list[str], Array]:
    """Errors [rad], statuses and torques (T, 2); from sample 200 on load or motor encoders are frozen.

    Or the load encoder drifts by `drift` per sample [rad].
    """
    controller = Controller(RIGID, PAPER, motor_resolution=STEP if fitted else None)
    rng, dt, seen = np.random.default_rng(0), controller.sample_time, {}
    state = RIG.rest(float(reference(np.zeros(1))[0]), least_effort(controller.bounds, 0.0))
    errors, statuses, torques = [], [], []
    for k in range(samples):
        shown = {"load": RIG.measure(state, rng), "motors": RIG.motor_angles(state)}
        if k == FROZEN:
            seen = {name: value for name, value in shown.items() if (load, motors)[name == "motors"]}
        shown |= seen
        shown["load"] += drift * max(k - FROZEN, 0)
        wanted = reference(dt * (k + np.arange(controller.horizon + 1)))
        control = controller.step(float(shown["load"]), wanted, shown["motors"] if fitted else None)
        state = RIG.advance(state, control.torques, dt)
        errors.append(state.angle - wanted[1])
        statuses.append(control.status)
        torques.append(control.torques)
    return np.array(errors), statuses, np.array(torques)


def noticed(statuses: list[str]) -> int:
    """Number of samples from the fault to its detection."""
    return next((k for k, status in enumerate(statuses[FROZEN:]) if "contradicted" in status), len(statuses))


@pytest.mark.parametrize("reference", [sine, slow])
def test_motors_show_that_the_encoder_of_the_load_is_frozen(reference: Callable[[Array], Array]) -> None:
    errors, statuses, torques = loop(reference, load=True, fitted=True)
    print(f"noticed after {noticed(statuses)} samples, {np.max(np.abs(errors[FROZEN:])):.1e} rad")
    assert noticed(statuses) <= 10
    assert np.max(np.abs(errors[FROZEN:])) < 4e-4
    assert all("contradicted" in status for status in statuses[FROZEN + 10 :])
    assert np.all((torques * [1, -1] >= 0.02) & (torques * [1, -1] <= 0.3))


def test_a_frozen_encoder_is_detected_once_the_load_should_move() -> None:
    errors, statuses, _ = loop(late_step, load=True, fitted=True)
    assert noticed(statuses) <= 100 + 10  # the step comes 100 samples after the fault
    assert np.max(np.abs(errors[500:])) < 4e-4


@pytest.mark.parametrize("drift", [5e-4, -2e-4])
def test_an_encoder_that_contradicts_the_motors_is_detected(drift: float) -> None:
    errors, statuses, _ = loop(sine, drift=drift, fitted=True)
    print(f"noticed after {noticed(statuses)} samples, {np.max(np.abs(errors[FROZEN:])):.1e} rad")
    assert noticed(statuses) <= 10
    assert np.max(np.abs(errors[FROZEN:])) < 1.5e-3


def test_the_load_encoder_reveals_frozen_motor_encoders() -> None:
    errors, statuses, _ = loop(sine, motors=True, fitted=True)
    assert noticed(statuses) <= 10
    assert np.max(np.abs(errors[FROZEN:])) < 6e-4


def test_a_sudden_stop_without_motor_encoders_is_rejected() -> None:
    """The prediction is used, as for a missing measurement; without detection the load ran away by 3.8 rad."""
    errors, statuses, torques = loop(sine, load=True, fitted=False)
    print(f"noticed after {noticed(statuses)} samples, {np.max(np.abs(errors)):.2f} rad")
    assert noticed(statuses) <= 10
    assert np.max(np.abs(errors)) < 0.2
    assert np.all((torques * [1, -1] >= 0.02) & (torques * [1, -1] <= 0.3))


def test_a_frozen_reading_under_full_torque_is_rejected() -> None:
    _, statuses, torques = loop(late_step, load=True, fitted=False)
    full = np.max(np.abs(torques[:, 1])) > 0.99 * 0.3
    assert full
    began = int(np.argmax(np.abs(torques[:, 1]) > 0.9 * 0.3))
    assert noticed(statuses) <= began - FROZEN + 12


@pytest.mark.parametrize("fitted", [False, True])
def test_what_works_is_not_contradicted(fitted: bool) -> None:
    for reference in (sine, late_step):
        errors, statuses, _ = loop(reference, fitted=fitted)
        assert set(statuses) == {"optimal"}
        assert np.max(np.abs(errors[150:280])) < 4e-4


@pytest.mark.parametrize("friction", [0.3, 1.0])
def test_a_load_that_sticks_is_no_failure(friction: float) -> None:
    """A noise-free, coarse encoder is constant to the last bit for a long time while unmodelled friction holds."""
    rig = Rig.paper_like(coulomb_friction=friction, encoder_counts=2**13, encoder_noise=0.0)
    controller = Controller(RIGID, PAPER, encoder_resolution=2 * np.pi / 2**13)
    state, rng, statuses = rig.rest(0.0, least_effort(controller.bounds, 0.0)), np.random.default_rng(0), []
    for k in range(600):
        control = controller.step(rig.measure(state, rng), 0.05 * np.sin(0.01 * k))
        state = rig.advance(state, control.torques, controller.sample_time)
        statuses.append(control.status)
    assert not any("contradicted" in status for status in statuses)


def test_an_encoder_that_comes_back_is_believed_again() -> None:
    controller, state, statuses, frozen = Controller(RIGID, PAPER), np.zeros(2), [], 0.0
    for k in range(600):
        frozen = frozen if 300 < k < 330 else float(state[0])
        control = controller.step(frozen, 0.1 * np.sin(0.01 * k))
        state = simulate(RIGID, command=PAPER.output_torque(control.torques)[None], dt=0.005, state=state)[-1]
        statuses.append(control.status)
    assert all("contradicted" in status for status in statuses[305:330])
    assert not any(word in status for status in statuses[350:] for word in ("contradicted", "angle"))
    assert abs(state[0] - 0.1 * np.sin(6.0)) < 4e-3


def test_a_reading_that_wraps_is_put_on_its_turn() -> None:
    """Same result as with an encoder that counts over turns; without the range the load kept turning."""
    wrapping, going_on = Controller(RIGID, PAPER, encoder_range=2 * np.pi), Controller(RIGID, PAPER)
    state = np.array([3.0, 0.0])
    for k in range(1500):
        wanted = 3.0 + 0.3 * np.sin(0.005 * k) + (2.5 if k > 700 else 0.0)
        controls = [
            wrapping.step(float((state[0] + np.pi) % (2 * np.pi) - np.pi), wanted),
            going_on.step(float(state[0]), wanted),
        ]
        assert controls[0].status == controls[1].status
        assert "angle" not in controls[0].status
        np.testing.assert_allclose(controls[0].torques, controls[1].torques, atol=1e-5)
        torque = PAPER.output_torque(controls[0].torques)[None]
        state = simulate(RIGID, command=torque, dt=0.005, state=state)[-1]
    assert abs(state[0] - wanted) < 5e-3  # beyond one turn


def test_a_range_that_is_none_is_refused() -> None:
    for bad in (-1.0, np.nan, np.inf):
        with pytest.raises(BadParameter, match="encoder_range"):
            Controller(ServoModel(), PAPER, encoder_range=bad)
