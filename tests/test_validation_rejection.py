"""Validation data that refute an effect: it is not named, and the reason is given."""

from __future__ import annotations

import pytest
from machine import Machine, excitation, record

from diagnosis import Diagnosis, diagnose


def told(held_out: Machine) -> Diagnosis:
    """Of a log with dry friction and held-out data of some machine."""
    hidden = Machine().hiding(coulomb_friction={"torque": 0.3})
    log = record(hidden, excitation(2, duration=15.0), seed=2).log()
    unseen = record(held_out, excitation(3, duration=10.0), seed=3).log()
    return diagnose(log, None, unseen, candidates=["coulomb_friction"])


@pytest.mark.parametrize(("friction", "against"), [(0.0, True), (0.3, False)])
def test_an_effect_that_worsens_validation_is_not_named(friction: float, against: bool) -> None:
    found = told(Machine().hiding(coulomb_friction={"torque": friction}) if friction else Machine())
    assert [cause.effect for cause in found.causes] == ([] if against else ["coulomb_friction"])
    reasons = [each.reason for each in found.rejected]
    assert any(reason.startswith("the validation error is larger with it, by ") for reason in reasons) is against


def test_where_nothing_was_added_nothing_is_refuted() -> None:
    log, unseen = (record(Machine(), excitation(k, duration=10.0), seed=k).log() for k in (2, 3))
    found = diagnose(log, None, unseen, candidates=["coulomb_friction"])
    assert found.verdict == "nothing_missing"
    assert "validation" not in found.rejected[0].reason
