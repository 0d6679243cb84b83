"""The error on validation data is that of the model, not of the state from which its simulation starts."""

from __future__ import annotations

import numpy as np
import pytest
from machine import Machine, excitation, record

from diagnosis.holdout import STARTS, restart_window, squared_errors
from identification.log import Log
from plant import ServoModel

NOISE = 1e-3  # [rad]
TRUTH = ServoModel.paper()


@pytest.fixture(scope="module")
def log() -> Log:
    return record(Machine(), excitation(7, duration=15.0), seed=7, noise=NOISE).log()


def error(log: Log, model: ServoModel, bandwidth: float) -> float:
    return float(np.sqrt(np.mean(squared_errors(log, model, None, bandwidth)[0])))


def test_the_true_model_has_the_error_of_the_noise(log):
    assert error(log, TRUTH, 0.0) < 1.1 * NOISE
    assert error(log, TRUTH, np.inf) > 2.0 * NOISE  # the initial velocity from a fifth of a second


def test_a_model_starts_where_it_follows_the_motion(log):
    """With a start from a fifth of the run a wrong model would begin beside the motion to come nearer to it later."""
    wrong = TRUTH.with_values([2.0 * value if name == "viscous_friction" else value
                               for name, value in zip(TRUTH.names, TRUTH.values, strict=True)])  # fmt: skip
    start = slice(0, round(STARTS * restart_window(log) / log.sample_time))
    for bandwidth, follows in ((0.0, False), (20.0, True)):
        _, (simulated,) = squared_errors(log, wrong, None, bandwidth)
        apart = float(np.sqrt(np.mean((simulated - log.runs[0].measured)[start] ** 2)))
        assert (apart < 1.2 * NOISE) == follows


def test_a_run_shorter_than_a_window_has_a_start_too(log):
    (run,) = log.runs
    short = run.slice(0, 100)
    squares, (simulated,) = squared_errors(Log(runs=(short,), axis="rotary"), TRUTH, None, 0.0)
    assert (len(squares), len(simulated)) == (100, 100)
    assert np.all(np.isfinite(squares))
