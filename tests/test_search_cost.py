"""Lines in time that explain barely more than chance does."""

from __future__ import annotations

import numpy as np
import pytest
from machine import Machine, excitation, record

from diagnosis import diagnose
from diagnosis.evidence.marginal import families_along, marginal_likelihood
from identification.fit import fit
from plant import ServoModel
from plant.effects import (
    Cogging,
)

WAVE = {"amplitude": 0.2, "frequency": 3.3, "phase": 0.4}


def test_a_line_is_tried_under_a_slow_observer_despite_drift() -> None:
    """Six lines of the spectrum are higher than the one that is hidden, and none of them explains more."""
    hidden = {"amplitude": 0.002279, "order": 11.0, "phase": 0.7}
    machine = Machine().hiding(cogging=hidden)
    base = fit(record(machine, excitation(18006, duration=30.0), seed=9003, noise=1e-3).log(), ServoModel.paper())
    explanation = marginal_likelihood(base, {"dead_zone"}, families_along(base), catalogue=1, observer=base.bandwidth)
    assert explanation is not None
    orders = [regressors.start(np.ones(2)) for regressors in Cogging.regressors(explanation.screen.motion)]
    assert any(abs(effect.order - 11.0) < 0.25 for effect in orders if isinstance(effect, Cogging))


@pytest.mark.parametrize("seed", [9000, pytest.param(9005, marks=pytest.mark.long)])
def test_a_disturbance_of_barely_more_than_chance_is_named(seed: int) -> None:
    """About 24 in log-likelihood, of which some 9 are the price of 6,000 frequencies."""
    hidden = WAVE | {"amplitude": 0.0966}
    log = record(
        Machine().hiding(periodic_disturbance=hidden), excitation(2 * seed, duration=30.0), seed=seed, noise=1e-3
    ).log()
    found = diagnose(log)
    assert [cause.effect for cause in found.causes] == ["periodic_disturbance"]
    assert found.causes[0].parameters["frequency"].value == pytest.approx(3.3, abs=0.02)
