"""Standard errors from one record: those of white noise are known, and errors that last make them larger."""

from __future__ import annotations

import numpy as np
import pytest
from front_door import PLAIN, columns
from scipy import signal

from diagnosis.holdout import cut
from diagnosis.jackknife import jackknife
from diagnosis.residual_torque import residual_torque
from identification import Log, fit
from identification.problem import Problem
from identification.standard_errors import bandwidth_std
from plant.effects import CoulombFriction


def test_of_white_noise_the_standard_errors_are_known() -> None:
    records = 0.3 * np.random.default_rng(0).standard_normal((200, 2000))
    of_mean = [jackknife(float, record) ** 2 for record in records]
    of_rms = [jackknife(np.sqrt, record**2) ** 2 for record in records]
    assert np.sqrt(np.mean(of_mean)) == pytest.approx(0.3 / np.sqrt(2000), rel=0.1)
    assert np.sqrt(np.mean(of_rms)) == pytest.approx(0.3 / np.sqrt(2 * 2000), rel=0.1)


def test_errors_that_last_count_for_fewer() -> None:
    white = np.random.default_rng(1).standard_normal((200, 4000))
    lasting = signal.lfilter([1.0], [1.0, -0.9], white)
    # of the mean of a first-order autoregression: (1 + a) / (1 - a) times the variance of independent samples
    expected = np.std(lasting) / np.sqrt(4000) * np.sqrt(1.9 / 0.1)
    assert np.sqrt(np.mean([jackknife(float, record) ** 2 for record in lasting])) == pytest.approx(expected, rel=0.15)


def test_a_cut_is_surer_than_what_is_cut() -> None:
    record = np.random.default_rng(2).standard_normal(4000) ** 2
    assert cut(record, 0.25 * record) == pytest.approx((0.5, 0.0), abs=1e-12)
    share, std = cut(record, np.random.default_rng(3).standard_normal(4000) ** 2)
    assert share == pytest.approx(0.0, abs=5 * std)
    assert std == pytest.approx(1.0 / np.sqrt(4000), rel=0.4)  # of a ratio of two independent root mean squares


def test_one_sample_gives_no_estimate() -> None:
    assert jackknife(float, np.ones(1)) == 0.0


@pytest.fixture(scope="module")
def lacking():
    """A fit that lacks friction."""
    truth = PLAIN.with_effect(CoulombFriction(torque=0.3))
    return fit(Log.from_arrays(**columns(truth, duration=12.0)), PLAIN)


def test_the_bandwidth_error_is_that_of_the_likelihood(lacking) -> None:
    std = bandwidth_std(lacking)
    assert lacking.bandwidth > 0.0
    problem = Problem.of(lacking.log, lacking.model)
    point = problem.pack(lacking.model.values, lacking.initial)
    costs = [problem.cost(point, lacking.bandwidth + step * std, 0.0) for step in (-1.0, 0.0, 1.0)]
    losses = [0.5 * lacking.samples * np.log(cost / costs[1]) for cost in costs]
    # one standard error to either side costs half a unit of log-likelihood, in the mean of both
    assert 0.5 * (losses[0] + losses[2]) == pytest.approx(0.5, rel=0.2)


def test_a_free_simulation_has_no_bandwidth_to_be_sure_of() -> None:
    assert bandwidth_std(fit(Log.from_arrays(**columns(PLAIN, duration=6.0)), PLAIN)) is None


def test_the_missing_torque_has_a_standard_error(lacking) -> None:
    missing = residual_torque(lacking)
    assert 0.01 < missing.rms_std / missing.rms < 0.3
    velocity = next(curve for curve in missing.curves if curve.variable == "velocity")
    assert 0.001 < velocity.share_std < 0.2
