"""What is missing in two places at once has two curves, though a load that wanders says as much as either alone."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from machine import Machine, excitation, record

from diagnosis import nonparametric_residual
from diagnosis.holdout import squared_errors
from diagnosis.nonparametric_residual import residual_model
from identification.fit import fit
from plant import ServoModel

SEED = 64000


def test_drifting_friction_and_damping_are_kept_together() -> None:
    drifting = Machine().hiding(friction_drift={"coulomb_rate": 2e-3, "viscous_rate": 4e-3})
    log, unseen = (
        record(drifting, excitation(2 * SEED + k, duration=30.0 - 15.0 * k), seed=SEED + k, noise=1e-3).log()
        for k in (0, 1)
    )
    base = fit(log, ServoModel.paper())
    *_, last = residual_model(base).path
    assert {effect.name for effect in last.model.effects} >= {"damping_over_time", "friction_over_time"}
    assert not last.bandwidth
    before, after = (np.sqrt(np.mean(squared_errors(unseen, model, None)[0])) for model in (base.model, last.model))
    assert after < 0.05 * before


def named(name: str, bandwidth: float) -> Any:
    return SimpleNamespace(name=name, bandwidth=bandwidth)


@pytest.mark.parametrize(
    ("bandwidth", "worth", "stands", "taken"),
    [(0.0, 64.0, True, True), (0.0, 63.0, True, False), (1.0, 90.0, True, False), (0.0, 64.0, False, False)],
)
def test_two_curves_must_each_beat_a_random_walk_load(
    monkeypatch: pytest.MonkeyPatch, bandwidth: float, worth: float, stands: bool, taken: bool
) -> None:
    """The load's evidence is 50, and 2 log 1000 = 13.8."""
    base, first, second, load = named("base", 9.0), named("first", 5.0), named("second", bandwidth), named("load", 5.0)
    monkeypatch.setattr(nonparametric_residual, "_closest", lambda at, tries: [first] if at is base else [second])
    monkeypatch.setattr(nonparametric_residual, "is_clearly_likelier", lambda one, other, than, times: not other)
    monkeypatch.setattr(nonparametric_residual, "charged_evidence", lambda path, than: worth)
    monkeypatch.setattr(nonparametric_residual, "evidence_of", lambda at, than: 50.0)
    monkeypatch.setattr(nonparametric_residual, "with_random_walk", lambda at: load)
    monkeypatch.setattr(nonparametric_residual, "passes_validation", lambda before, after, must_show: stands)
    assert nonparametric_residual._two_together(base) == ((first, second) if taken else ())


@pytest.mark.parametrize(
    ("found", "wanders", "asked"), [(True, True, False), (False, False, False), (False, True, True)]
)
def test_pairs_of_curves_are_tried_if_none_pays_alone(
    monkeypatch: pytest.MonkeyPatch, found: bool, wanders: bool, asked: bool
) -> None:
    first, second = named("first", 5.0), named("second", 0.0)
    first.log = second.log = SimpleNamespace(colour=())
    pair = (first, second)
    monkeypatch.setattr(nonparametric_residual, "unnamed_dependence", lambda at, *kinds, **bar: ())
    monkeypatch.setattr(nonparametric_residual, "_path", lambda *_: (first,) if found else ())
    monkeypatch.setattr(nonparametric_residual, "may_be_random_walk", lambda at: wanders)
    monkeypatch.setattr(nonparametric_residual, "_two_together", lambda at: pair)
    monkeypatch.setattr(nonparametric_residual, "follows_anything", lambda at: False)
    monkeypatch.setattr(
        nonparametric_residual, "is_clearly_likelier", lambda one, other, than, times: len(one) > len(other)
    )
    assert (residual_model(first).path == pair) is asked
