"""A name about which the parts of a log disagree, where an observer is still at work, is not told."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from machine import Machine, excitation, load_fluctuation, record

from diagnosis import diagnose, parts_consistency
from diagnosis.overdispersion import Overdispersion
from diagnosis.parts_consistency import consistent_additions, inconsistent_effects


@pytest.mark.long
def test_an_unknown_cause_is_not_reported_as_sensor_lag() -> None:
    """A slew limit, left out: with a lag behind an observer the log is 37 likelier, all of it from a few fast steps."""
    limited = Machine().hiding(rate_limit={"rate": 50.0 / 0.22})
    log, unseen = (
        record(limited, excitation(120000 + k, duration=30.0 - 15.0 * k), seed=60000 + k, noise=1e-3).log()
        for k in (0, 1)
    )
    found = diagnose(log, holdout=unseen, exclude=["rate_limit"])
    first = next(c for c in found.candidates if c.effect == "sensor_lag")
    assert first.probability > 0.9
    assert (found.verdict, found.causes) == ("unknown", ())
    assert any("Sensor lag is rejected: parts of the log contradict" in warning for warning in found.warnings)


@pytest.mark.long
def test_a_cause_beside_a_load_that_fluctuates_stays() -> None:
    load = load_fluctuation(3, 0.05, (6000, 1))
    rubbing = Machine().hiding(coulomb_friction={"torque": 0.1})
    found = diagnose(record(rubbing, excitation(6, duration=30.0), seed=3, load_torque=load).log())
    assert found.extended.bandwidth > 0.0
    assert [cause.effect for cause in found.causes] == ["coulomb_friction"]
    assert found.verdict == "named"


def fit(bandwidth: float) -> Any:
    return SimpleNamespace(bandwidth=bandwidth)


def test_only_where_an_observer_is_left_with_work(monkeypatch: pytest.MonkeyPatch) -> None:
    additions: Any = [SimpleNamespace(effect=name, fit=fit(5.0)) for name in ("first", "second")]
    monkeypatch.setattr(parts_consistency, "still_needed", lambda added, at, surely: (added[:1], "less"))
    monkeypatch.setattr(parts_consistency, "refitted_path", lambda base, kept, at: (kept, at))
    assert consistent_additions(fit(9.0), additions) == (additions[:1], "less")
    assert consistent_additions(fit(9.0), []) == []
    additions[-1].fit.bandwidth = 0.0
    assert consistent_additions(fit(9.0), additions) is additions


def test_chance_is_no_disagreement(monkeypatch: pytest.MonkeyPatch) -> None:
    least = {"chance": 1.0, "none": 1.2}
    monkeypatch.setattr(parts_consistency, "overdispersion", lambda fit, name: Overdispersion(2.0, least[name]))
    assert inconsistent_effects([SimpleNamespace(fit=None)], tuple(least)) == ("none",)  # type: ignore[list-item]
