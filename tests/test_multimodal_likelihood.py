"""The standard error of a gap knows of the peaks that its fit has not climbed."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from machine import Machine, excitation, record

from diagnosis import multimodal_likelihood
from diagnosis.multimodal_likelihood import scatter_over_parts, with_scatter
from diagnosis.refit import problem_near
from identification.errors import Unidentifiable
from identification.fit import fit
from identification.fit_result import Fit
from identification.least_squares import Minimum
from identification.observer_steps import FADING
from identification.predictor import Prediction, Predictor
from identification.problem import Problem
from identification.standard_errors import fit_with_errors
from plant import ServoModel
from plant.effects import Backlash, Effect

TRUE = Backlash(gap=0.02, motor_share=0.6)


@pytest.fixture(scope="module")
def found() -> Fit:
    hidden = Machine().hiding(backlash={"gap": TRUE.gap, "motor_share": TRUE.motor_share})
    base = fit(record(hidden, excitation(1, duration=6.0)).log(), ServoModel.paper())
    return problem_near(base, base.model.with_effect(TRUE)).descend(base)


def fitted(fit: Fit) -> Effect:
    effect = fit.model.effect("backlash")
    assert effect is not None
    return effect


def in_turn(monkeypatch: pytest.MonkeyPatch, *results: np.ndarray | None) -> None:
    waiting = iter(results)
    monkeypatch.setattr(multimodal_likelihood, "_alone", lambda rest, effect, part: next(waiting))


@pytest.mark.long
def test_backlash_scatter_over_parts_exceeds_the_peak_width(found: Fit) -> None:
    honest = with_scatter(found)
    for name in ("backlash.gap", "backlash.motor_share"):
        before, now = found[name], honest[name]
        assert before.value is not None
        assert before.std is not None
        assert now.std is not None
        assert now.value == before.value
        assert now.std > 1.5 * before.std
        assert abs(before.value - getattr(TRUE, name.split(".")[1])) < 3.0 * now.std
    assert [line for line in honest.parameters if "backlash" not in line.name] == [
        line for line in found.parameters if "backlash" not in line.name
    ]


@pytest.mark.long
def test_parts_of_the_log_use_the_flanks_of_the_whole(found: Fit, monkeypatch: pytest.MonkeyPatch) -> None:
    """A part that settled for other flanks told another gap by chance, and the gap of the whole was sure to nothing."""
    requested: list[Backlash] = []
    monkeypatch.setattr(Backlash, "freer", lambda self: requested.append(self) or ())
    assert scatter_over_parts(found, fitted(found))
    assert requested == []


def test_backlash_error_is_scatter_over_parts_or_peak_width(found: Fit, monkeypatch: pytest.MonkeyPatch) -> None:
    parts = [np.array([0.02, 0.6]), np.array([0.03, 0.6]), None, np.array([0.01, 0.6]), np.array([0.02, 0.6])]
    in_turn(monkeypatch, *parts)
    scatter = scatter_over_parts(found, fitted(found))
    assert scatter["backlash.gap"] == pytest.approx(np.std([0.02, 0.03, 0.01, 0.02], ddof=1))
    assert scatter["backlash.motor_share"] == pytest.approx(0.0, abs=1e-12)
    in_turn(monkeypatch, *parts)
    honest = with_scatter(found)
    assert honest["backlash.gap"].std == pytest.approx(scatter["backlash.gap"])
    assert honest["backlash.motor_share"].std == found["backlash.motor_share"].std


def test_two_parts_give_no_estimate(found: Fit, monkeypatch: pytest.MonkeyPatch) -> None:
    in_turn(monkeypatch, None, None, None, np.array([0.01, 0.5]), np.array([0.03, 0.7]))
    assert scatter_over_parts(found, fitted(found)) == {}


def test_a_log_too_short_to_cut_leaves_the_fit_as_it_is(found: Fit) -> None:
    short = replace(found.log, runs=tuple(run.slice(0, 499) for run in found.log.runs))
    assert scatter_over_parts(replace(found, log=short), fitted(found)) == {}


def test_a_part_that_does_not_determine_it_is_left_out(found: Fit, monkeypatch: pytest.MonkeyPatch) -> None:
    def cannot(*_: object, **__: object) -> None:
        raise Unidentifiable("nothing moves")

    monkeypatch.setattr(multimodal_likelihood, "problem_near", cannot)
    assert scatter_over_parts(found, fitted(found)) == {}


def test_a_model_that_is_not_chaotic_is_not_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = fit(record(Machine(), excitation(1, duration=6.0)).log(), ServoModel.paper())
    in_turn(monkeypatch)  # which would raise
    assert with_scatter(plain).parameters == plain.parameters


def test_without_smoothing_the_peak_gives_the_standard_error(found: Fit, monkeypatch: pytest.MonkeyPatch) -> None:
    """Impacts in quick succession: behind a fast observer too the slopes overflowed, and with them the diagnosis."""
    predict = Predictor.predict

    def overflowing(self: Predictor, *args: Any, bandwidth: float, **others: Any) -> list[Prediction]:
        predictions = predict(self, *args, bandwidth=bandwidth, **others)
        return (
            [replace(one, jacobian=one.jacobian * 1e200) for one in predictions]
            if bandwidth == pytest.approx(FADING / 0.005)
            else predictions
        )

    problem = Problem.of(found.log, found.model)
    point = problem.pack(found.model.values, found.initial)
    here = Minimum(point=point, equations=problem.linearise(point, 0.0, 0.0), converged=True, evaluations=1)
    smooth = fit_with_errors(problem, 0.0, here, 0)
    monkeypatch.setattr(Predictor, "predict", overflowing)
    alone = fit_with_errors(problem, 0.0, here, 0)
    assert alone.log_likelihood == smooth.log_likelihood
    assert 0.1 < alone["backlash.gap"].std / smooth["backlash.gap"].std < 10.0
