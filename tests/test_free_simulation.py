"""Free simulation: pieces, restarts and what happens where there is nothing to restart from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.log import Log
from identification.simulation import free_simulation
from plant import BadParameter, ServoModel, simulate
from plant.effects import Compliance

DT = 0.01
TIME = np.arange(1000) * DT
TORQUE = 2.0 * np.sin(2 * np.pi * 0.3 * TIME)
TRUTH = ServoModel(inertia=2.0, gravity=0.5, viscous_friction=0.8)
ANGLE = simulate(TRUTH, command=TORQUE, dt=DT)[:-1, 0]
LOG = Log.from_arrays(time=TIME, torque=TORQUE, angle=ANGLE)
WRONG = replace(TRUTH, inertia=2.4)


def masked(start: int, stop: int) -> Log:
    (run,) = LOG.runs
    valid = run.valid.copy()
    valid[start:stop] = False
    return replace(LOG, runs=(replace(run, valid=valid, output=np.where(valid, run.output, 77.0)),))


def test_each_window_begins_at_the_measurement() -> None:
    (free,), (windowed,) = free_simulation(LOG, WRONG), free_simulation(LOG, WRONG, window=2.0)
    np.testing.assert_allclose(windowed[::200], ANGLE[::200], atol=2e-3)
    np.testing.assert_allclose(windowed[:200], free[:200])
    assert np.max(np.abs(free[::200] - ANGLE[::200])) > 0.05
    assert windowed.shape == (1000,)


def test_a_last_piece_of_a_few_samples_goes_with_the_one_before() -> None:
    (one,) = free_simulation(LOG, WRONG, window=9.97)  # would leave three samples
    (whole,) = free_simulation(LOG, WRONG)
    np.testing.assert_array_equal(one, whole)
    (cut,) = free_simulation(LOG, WRONG, window=9.9)
    assert np.max(np.abs(cut[990:] - whole[990:])) > 1e-3


def test_a_piece_without_measured_start_continues_the_previous() -> None:
    (through,) = free_simulation(masked(400, 600), TRUTH, window=4.0)
    np.testing.assert_allclose(through, ANGLE, atol=1e-3)
    (unmeasured,) = free_simulation(masked(0, 30), TRUTH)
    assert np.all(np.isfinite(unmeasured))
    assert unmeasured[0] == 0.0


def test_masked_samples_do_not_find_the_start() -> None:
    (found,) = free_simulation(masked(3, 12), TRUTH)
    np.testing.assert_allclose(found, ANGLE, atol=1e-3)


SHAFT = ServoModel(
    inertia=2.0,
    gravity=0.5,
    viscous_friction=0.8,
    effects=(Compliance(frequency=12.0, damping=0.01, motor_share=0.4),),
)


def ringing(start: int) -> Log:
    """A shaft that torque steps have set ringing, from a sample on; white noise of 0.01 mrad."""
    torque = 2.0 * np.sign(np.sin(2 * np.pi * 0.3 * TIME))
    angle = simulate(SHAFT, command=torque, dt=DT)[:-1, 0] + 1e-5 * np.random.default_rng(0).normal(size=TIME.size)
    return Log.from_arrays(time=TIME[start:] - TIME[start], torque=torque[start:], angle=angle[start:])


@pytest.mark.parametrize("window", [2.0, None])
def test_a_restart_goes_on_with_the_twist_of_a_shaft(window: float | None) -> None:
    """From rest it would ring once more, and validation data would speak against the true model."""
    log = ringing(300)
    (simulated,) = free_simulation(log, SHAFT, window=window)
    assert np.max(np.abs(simulated - log.runs[0].output)) < 2e-3


@pytest.mark.parametrize("seed", range(1, 5))
def test_noise_winds_no_shaft_up(seed: int) -> None:
    """The start shows no twist: it is settled. Fitted to the noise, it is ten times as wrong with most seeds."""
    (run,) = ringing(0).runs
    noise = 1e-3 * np.random.default_rng(seed).normal(size=TIME.size)
    noisy = Log.from_arrays(time=run.time, torque=run.command, angle=run.output + noise)
    (simulated,) = free_simulation(noisy, SHAFT)
    assert np.sqrt(np.mean((simulated - run.output) ** 2)) < 0.02


def test_what_cannot_be_simulated_is_refused() -> None:
    with pytest.raises(BadParameter, match=r"longer than the 0\.2 s"):
        free_simulation(LOG, TRUTH, window=0.2)
    with pytest.raises(BadParameter, match="rotary axis, the model of a linear"):
        free_simulation(LOG, ServoModel(inertia=2.0, gravity=0.0, axis="linear"))
