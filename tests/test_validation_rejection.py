"""Validation data that refute an effect: it is not named, and the reason is given."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from machine import Machine, excitation, record

from diagnosis import Diagnosis, diagnose, falsification
from diagnosis.falsification import _is_determined_jointly


def diagnosed_with(held_out: Machine) -> Diagnosis:
    """Of a log with dry friction and held-out data of some machine."""
    hidden = Machine().hiding(coulomb_friction={"torque": 0.3})
    log = record(hidden, excitation(2, duration=15.0), seed=2).log()
    validation = record(held_out, excitation(3, duration=10.0), seed=3).log()
    return diagnose(log, None, validation, candidates=["coulomb_friction"])


@pytest.mark.parametrize(("friction", "against"), [(0.0, True), (0.3, False)])
def test_an_effect_that_worsens_validation_is_not_named(friction: float, against: bool) -> None:
    found = diagnosed_with(Machine().hiding(coulomb_friction={"torque": friction}) if friction else Machine())
    assert [cause.effect for cause in found.causes] == ([] if against else ["coulomb_friction"])
    reasons = [each.reason for each in found.rejected]
    assert any(reason.startswith("the validation error is larger with it, by ") for reason in reasons) is against


def test_where_nothing_was_added_nothing_is_refuted() -> None:
    log, validation = (record(Machine(), excitation(k, duration=10.0), seed=k).log() for k in (2, 3))
    found = diagnose(log, None, validation, candidates=["coulomb_friction"])
    assert found.verdict == "nothing_missing"
    assert "validation" not in found.rejected[0].reason


@pytest.mark.parametrize(("several", "worse"), [((0.0, 0.01), True), ((0.75, 0.01), False)])
def test_data_that_several_steps_support_rule_nothing_out(
    monkeypatch: pytest.MonkeyPatch, several: tuple[float, float], worse: bool
) -> None:
    """A true offset made steps of one sample worse by 40 %, and those of many better by 75 %: it stays."""
    less, fit = (SimpleNamespace(bandwidth=1.0) for _ in range(2))
    rng = np.random.default_rng(0)
    squares = {id(less): rng.uniform(0.9, 1.1, 4000), id(fit): rng.uniform(1.8, 2.2, 4000)}
    monkeypatch.setattr(falsification, "_squared_innovations", lambda log, each, bandwidth: squares[id(each)])
    rejection = falsification._rejection(less, fit, None, several)  # type: ignore[arg-type]
    assert (rejection.worse > 0.3) == worse
    assert (rejection.against.sum() < 0.0) == worse


@pytest.mark.parametrize(
    ("together", "with_inertia", "clear"), [(0.9999, 0.0, True), (0.0, 0.0, False), (0.0, 0.9999, False)]
)
def test_a_size_may_be_reported_with_its_own_shape_alone(together: float, with_inertia: float, clear: bool) -> None:
    """A stiffness of 30 ± 60 is told if it trades places with the stop's angle, not with the load's inertia."""
    correlations = np.array([[1.0, 0.0, with_inertia], [0.0, 1.0, together], [with_inertia, together, 1.0]])
    std = np.array([0.1, 0.02, 60.0])
    model = SimpleNamespace(
        names=("inertia", "end_stop.angle", "end_stop.stiffness"), values=np.array([2.0, 1.0, 30.0])
    )
    fit: Any = SimpleNamespace(model=model, free=(0, 1, 2), covariance=correlations * np.outer(std, std))
    assert _is_determined_jointly(fit, "end_stop.stiffness") is clear
