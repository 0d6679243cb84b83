"""A spring that is damped so much that it does not swing is no surer than the lag that it imitates."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from diagnosis import diagnose

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

from drawn_machines import drawn


@pytest.mark.long
def test_what_imitates_a_lag_pays_for_what_the_log_knows_of_it() -> None:
    """Its three parameters trade places, and bounds stop them: all were held, and the spring cost nothing."""
    lags = ["sensor_lag", "actuator_lag", "input_delay"]
    found = diagnose(drawn(100063).log, candidates=[*lags, "torque_offset", "compliance"])
    probabilities = {cause.effect: cause.probability for cause in found.causes}
    assert probabilities["torque_offset"] > 0.9
    assert probabilities.get("compliance", 0.0) < 0.5
    assert max(probabilities.get(lag, 0.0) for lag in lags) > 0.5
