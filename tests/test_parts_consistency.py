"""Names beside what the catalogue lacks, or beside a load that fluctuates."""

from __future__ import annotations

import pytest
from machine import Machine, excitation, load_fluctuation, record

from diagnosis import diagnose


@pytest.mark.long
def test_an_unknown_cause_is_not_reported_as_sensor_lag() -> None:
    """A slew limit, left out: with a lag behind an observer the log is 37 likelier, all of it from a few fast steps."""
    limited = Machine().hiding(rate_limit={"rate": 50.0 / 0.22})
    log, validation = (
        record(limited, excitation(120000 + k, duration=30.0 - 15.0 * k), seed=60000 + k, noise=1e-3).log()
        for k in (0, 1)
    )
    found = diagnose(log, holdout=validation, exclude=["rate_limit"])
    assert (found.verdict, found.causes) == ("unknown", ())


@pytest.mark.long
def test_a_cause_beside_a_load_that_fluctuates_stays() -> None:
    load = load_fluctuation(3, 0.05, (6000, 1))
    rubbing = Machine().hiding(coulomb_friction={"torque": 0.1})
    found = diagnose(record(rubbing, excitation(6, duration=30.0), seed=3, load_torque=load).log())
    assert found.extended.bandwidth > 0.0
    assert [cause.effect for cause in found.causes] == ["coulomb_friction"]
    assert found.verdict == "named"
