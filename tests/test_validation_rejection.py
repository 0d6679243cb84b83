"""Held-out data that refute what was added: it is said, beside how far the log goes there."""

from __future__ import annotations

import pytest
from machine import Machine, excitation, record

from diagnosis import Diagnosis, diagnose

AGAINST = "The validation data contradict the extension: with it the one-step error rises there"


def told(held_out: Machine) -> Diagnosis:
    """Of a log with dry friction and held-out data of some machine."""
    hidden = Machine().hiding(coulomb_friction={"torque": 0.3})
    log = record(hidden, excitation(2, duration=15.0), seed=2).log()
    unseen = record(held_out, excitation(3, duration=10.0), seed=3).log()
    return diagnose(log, None, unseen, candidates=["coulomb_friction"])


@pytest.mark.parametrize(("friction", "against"), [(0.0, True), (0.3, False)])
def test_an_effect_that_fails_validation_is_reported_as_rejected(friction: float, against: bool) -> None:
    found = told(Machine().hiding(coulomb_friction={"torque": friction}) if friction else Machine())
    (cause,) = found.causes
    assert cause.effect == "coulomb_friction"
    assert (found.gain.cut < 0.0) is against
    assert any(warning.startswith(AGAINST) for warning in found.warnings) is against


def test_where_nothing_was_added_nothing_is_refuted() -> None:
    log, unseen = (record(Machine(), excitation(k, duration=10.0), seed=k).log() for k in (2, 3))
    found = diagnose(log, None, unseen, candidates=["coulomb_friction"])
    assert found.verdict == "nothing_missing"
    assert not any(warning.startswith(AGAINST) for warning in found.warnings)
