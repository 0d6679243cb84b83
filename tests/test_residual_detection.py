"""An effect that the log hardly shows is told with its doubt, or not at all."""

from __future__ import annotations

from functools import lru_cache

import pytest
from machine import Machine, excitation, record

from diagnosis import Diagnosis, diagnose
from diagnosis.explanation.summary import headline


@lru_cache
def found(offset: float, friction: float = 0.0) -> Diagnosis:
    """A torque offset [N m] that the log hardly shows, alone or beside dry friction [N m] that it shows plainly."""
    hidden = {"torque_offset": {"torque": offset}} | ({"coulomb_friction": {"torque": friction}} if friction else {})
    log = record(Machine().hiding(**hidden), excitation(1, duration=30.0), seed=0).log()
    return diagnose(log, candidates=("torque_offset", *(["coulomb_friction"] if friction else [])))


def test_an_uncertain_effect_is_reported_with_its_probability() -> None:
    diagnosis = found(2.2e-5)
    assert diagnosis.verdict == "ambiguous"
    (cause,) = diagnosis.causes
    assert cause.effect == "torque_offset"
    assert cause.probability < 0.9
    assert headline(diagnosis) == "The model probably lacks torque offset; the unexplained torque is about as large."
    assert "The unexplained torque is about as large as torque offset" in str(diagnosis.explain())


def test_what_chance_explains_too_is_not_reported() -> None:
    diagnosis = found(2e-6)
    assert (diagnosis.verdict, diagnosis.causes) == ("nothing_missing", ())


@pytest.mark.parametrize("offset", [pytest.param(1e-5, marks=pytest.mark.long), 8e-5])
def test_a_companion_in_doubt_is_not_named_for_sure(offset: float) -> None:
    diagnosis = found(offset, friction=0.1)
    sure = [cause.effect for cause in diagnosis.causes if cause.probability > 0.9]
    assert sure == ["coulomb_friction"]
