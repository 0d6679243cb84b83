"""A loop with jitter: the controller gets the time since its last step, in Python and in C."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from target import MODELS, PAPER, RIGID, Loaded

from allocation import least_effort
from mpc import Controller
from mpc.export import export
from plant import BadParameter, Rig

RIG = Rig.paper_like()


def wanted(time: np.ndarray) -> np.ndarray:
    return np.asarray(0.15 * (1 - np.cos(2 * np.pi * 0.32 * time)))


def loop(
    *, jitter: float = 0.0, missed: float = 0.0, elapsed_given: bool = True, number: bool = False, samples: int = 700
) -> tuple[float, int, float]:
    """Greatest error after the start [rad], number of degraded samples, minimum contact torque [N m]."""
    controller, rng = Controller(RIGID, PAPER), np.random.default_rng(0)
    dt, ahead = controller.sample_time, np.arange(controller.horizon + 1)
    state, time, elapsed = RIG.rest(0.0, least_effort(controller.bounds, 0.0)), 0.0, dt
    errors, flanks, degraded = [], [], 0
    for _ in range(samples):
        reference = float(wanted(np.array(time))) if number else wanted(time + dt * ahead)
        control = controller.step(RIG.measure(state, rng), reference, elapsed=elapsed if elapsed_given else None)
        elapsed = dt * (1 + jitter * (2 * rng.random() - 1)) * (2 if rng.random() < missed else 1)
        state, time = RIG.advance(state, control.torques, elapsed), time + elapsed
        errors.append(state.angle - float(wanted(np.array(time))))
        flanks.append(state.minimum_contact_torques.min())
        degraded += any(word in control.status for word in ("angle", "contradicted", "contact", "not solved"))
    return float(np.max(np.abs(errors[150:]))), degraded, float(np.min(flanks))


@pytest.mark.parametrize("faults", [{"jitter": 0.3}, {"missed": 0.05}, {"jitter": 0.3, "missed": 0.05}], ids=str)
def test_the_contact_is_kept_in_a_loop_that_jitters(faults: dict[str, float]) -> None:
    error, degraded, flank = loop(**faults)
    without = loop(**faults, elapsed_given=False)
    print(f"{faults}: {error:.1e} rad, {degraded} degraded, least flank {flank:.3f} N m; not told: {without}")
    assert degraded == 0
    assert flank > 0.05
    assert error < 1.5e-3
    assert without[1] > 20  # without the elapsed time, jitter looks like jumps of the sensor
    assert without[2] < 0.02


def test_a_reference_that_is_a_number_goes_on_at_its_speed() -> None:
    exact, jittering = loop(number=True), loop(number=True, jitter=0.3, missed=0.05)
    assert jittering[1] == 0
    assert jittering[2] > 0.05
    assert jittering[0] < 2.5 * exact[0]


def times(samples: int) -> np.ndarray:
    """Elapsed times of all kinds [s]: exact, with jitter, missed cycles, a pause, and invalid ones."""
    rng = np.random.default_rng(1)
    drawn = 0.005 * (1 + 0.3 * rng.uniform(-1, 1, samples)) * rng.choice([1, 1, 1, 2, 3], samples)
    drawn[40], drawn[60], drawn[80], drawn[90] = 0.08, 0.5, 1e-9, 0.005
    return drawn


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc here")
def test_all_forms_of_the_step_agree_to_the_last_bit(name: str, tmp_path: Path) -> None:
    options = {"angle_limits": (-0.1, 0.2)} if name == "late" else {}
    compiled, interpreted = (Controller(MODELS[name], PAPER, **options) for _ in range(2))  # type: ignore[arg-type]
    interpreted._step = interpreted._interpreted
    target = Loaded(export(compiled), tmp_path)
    rng, state, statuses = np.random.default_rng(0), RIG.rest(0.0, (0.02, -0.02)), set()
    for k, elapsed in enumerate(times(120)):
        shown, reference = RIG.measure(state, rng), 0.3 * np.sin(0.02 * k)
        target.elapsed(elapsed)
        controls = [each.step(shown, reference, elapsed=elapsed) for each in (compiled, interpreted)]
        np.testing.assert_array_equal(controls[0].torques, controls[1].torques)
        np.testing.assert_array_equal(target.step(shown, reference), controls[0].torques)
        assert controls[0].status == controls[1].status
        statuses.add(controls[0].status)
        state = RIG.advance(state, controls[0].torques, max(elapsed, 1e-4))
    assert "optimal" in statuses


def test_what_is_no_time_is_refused_in_python_and_left_out_in_c() -> None:
    controller = Controller(RIGID, PAPER)
    for bad in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(BadParameter, match="elapsed"):
            controller.step(0.0, 0.0, elapsed=bad)
    assert controller.step(0.0, 0.0, elapsed=0.005).status == "optimal"


def test_the_sample_time_itself_changes_nothing() -> None:
    one, other = Controller(RIGID, PAPER), Controller(RIGID, PAPER)
    for k in range(40):
        controls = one.step(1e-4 * k, 0.2), other.step(1e-4 * k, 0.2, elapsed=0.005)
        np.testing.assert_array_equal(controls[0].torques, controls[1].torques)
