"""What is projected out of innovations, lines among noise, and work side by side."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from machine import Machine, excitation, record
from test_sums_over_runs import dense
from threadpoolctl import threadpool_info, threadpool_limits

from diagnosis import diagnose
from diagnosis.nuisance import Nuisance
from identification.checks.check import check
from identification.log import Log
from identification.predictor import Prediction
from identification.recording import Recording
from identification.threads import in_threads, without_blas_threads
from plant.effects.effect import Array
from plant.effects.spectral_lines import strongest_lines


def prediction(rng: np.random.Generator, samples: int, free: int) -> Prediction:
    return Prediction(
        errors=np.zeros(samples),
        innovations=rng.normal(size=samples),
        jacobian=rng.normal(size=(samples, free + 2)),
        states=np.zeros((2, samples)),
        output=np.zeros(samples),
    )


@pytest.mark.parametrize("free", [0, 3])
def test_each_run_has_its_own_initial_state(free: int) -> None:
    rng = np.random.default_rng(0)
    runs = [prediction(rng, samples, free) for samples in (40, 55, 30)]
    values = rng.normal(size=(125, 4))
    jacobian = dense(runs)
    expected = values - jacobian @ np.linalg.lstsq(jacobian, values, rcond=None)[0]
    nuisance = Nuisance.of(runs)
    assert nuisance.beyond(values) == pytest.approx(expected, abs=1e-12)
    assert nuisance.beyond(values[:, 0]) == pytest.approx(expected[:, 0], abs=1e-12)


@pytest.mark.parametrize("insensitive", [0, 1, 2])
def test_a_parameter_without_a_trace_takes_nothing_away(insensitive: int) -> None:
    """As the instant of a payload change does while the load rests; what comes behind it keeps its own."""
    rng = np.random.default_rng(1)
    run = prediction(rng, 50, 3)
    run.jacobian[:, insensitive] = 0.0
    nuisance = Nuisance.of([run])
    assert nuisance.shared.shape == (50, 2)
    assert nuisance.beyond(run.jacobian) == pytest.approx(np.zeros((50, 5)), abs=1e-12)


def test_work_side_by_side_keeps_its_order_and_its_errors() -> None:
    assert in_threads(lambda item: item**2, range(20)) == [item**2 for item in range(20)]
    with pytest.raises(ZeroDivisionError):
        in_threads(lambda item: 1 / item, [1, 0])


def test_blas_has_one_thread_while_a_log_is_read_and_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    def threads() -> set[int]:
        return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}

    def checked(recording: Recording) -> Any:
        seen.append(threads())
        return check(recording)

    seen: list[set[int]] = []
    monkeypatch.setattr("identification.checked_runs.check", checked)
    plan = record(Machine(), excitation(1, duration=2.0), noise=1e-3)
    with threadpool_limits(limits=2, user_api="blas"):
        assert threads() == {2}
        without_blas_threads(lambda: seen.append(threads()))()
        log = Log.from_arrays(time=plan.time, torque=plan.command[:, 0], angle=plan.measured[:, 0])
        assert len(seen) == 2
        diagnose(log, candidates=["coulomb_friction"], progress=lambda line: seen.append(threads()))
        assert threads() == {2}
    assert len(seen) > 3
    assert all(each == {1} for each in seen)


def test_a_spectral_line_is_measured_against_white_noise() -> None:
    """Twenty slow lines of chance are each higher than the one that is meant, where chance has next to nothing."""
    rng = np.random.default_rng(4)
    place = np.linspace(0.0, 50.0, 4000)
    slow = 0.5 + 0.3 * np.arange(20)

    def chance() -> Array:
        waves = [rng.normal() * np.sin(w * place) + rng.normal() * np.cos(w * place) for w in slow]
        return np.sum(waves, axis=0) + 0.01 * rng.normal(size=place.size)

    score = chance() + 0.05 * np.sin(29.0 * place)
    draws = np.column_stack([chance() for _ in range(16)])
    apart = 2.0 * np.pi / 50.0
    found, searched = strongest_lines(place, score[:, None], draws, 40.0)
    white, _ = strongest_lines(place, score[:, None], draws[:, :0], 40.0)
    assert searched > 1000
    assert min(abs(rate - 29.0) for rate in found) < 0.5 * apart
    assert min(abs(rate - 29.0) for rate in white) > apart
