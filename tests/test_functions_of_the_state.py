"""Where a sweep begins, the states are others than ever after: what depends on them is no payload that changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from machine import Machine, record

from diagnosis import diagnose
from identification.log import Log

CHANGES = {"payload_change": {"time": 9.3, "inertia": 0.15, "gravity": 0.1}}
PULLS = {"cable_stiffness": {"stiffness": 0.1, "cubic": 0.05, "rest_angle": 0.3}}
GIVES = {"presliding_hysteresis": {"torque": 0.5, "stiffness": 2.0}}


def sweep(hidden: dict[str, dict[str, float]]) -> Log:
    """Four seconds of small motion, and then one sweep over and over."""
    time = np.arange(0.0, 30.0, 0.005)
    command = np.where(time < 4.0, np.sin(1.2 * np.pi * time), 5.0 * np.sin(0.5 * np.pi * (time - 4.0)))
    return record(replace(Machine(), gravity=1.5).hiding(**hidden), command, seed=3).log()


def test_a_payload_that_changed_is_named() -> None:
    (cause,) = diagnose(sweep(CHANGES), None, sweep(CHANGES), candidates=["payload_change"]).causes
    assert cause.effect == "payload_change"
    assert cause.probability > 0.9
    assert cause.parameters["time"].value == pytest.approx(9.3, abs=0.05)


@pytest.mark.long
def test_an_apparent_payload_at_the_start_is_none() -> None:
    """Contacts that give leave an error that the small motion has and the sweep has not."""
    found = diagnose(sweep(GIVES), None, sweep(GIVES), candidates=["payload_change"])
    assert not any(cause.probability > 0.9 for cause in found.causes)
    assert found.verdict in ("unknown", "ambiguous")


@pytest.mark.long
def test_the_effect_that_explains_more_takes_its_place() -> None:
    found = diagnose(sweep(GIVES), None, sweep(GIVES), candidates=["payload_change", "presliding_hysteresis"])
    assert [cause.effect for cause in found.causes] == ["presliding_hysteresis"]


@pytest.mark.long
def test_a_true_name_stays_beside_what_the_catalogue_lacks() -> None:
    hidden = {**GIVES, **PULLS}
    found = diagnose(sweep(hidden), None, sweep(hidden), candidates=["payload_change", "cable_stiffness"])
    assert [cause.effect for cause in found.causes] == ["cable_stiffness"]
