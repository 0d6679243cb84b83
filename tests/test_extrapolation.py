"""Held-out data that go where the log has not been."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from machine import Machine, excitation, record

from diagnosis import diagnose
from diagnosis.extrapolation import extrapolation_warning
from identification.log import Log


def swinging(low: float, high: float, period: float = 5.0, axis: str = "rotary") -> Log:
    """Between two angles, ten seconds long."""
    log = record(Machine(), excitation(1, duration=10.0), seed=1, noise=0.0).log()
    (run,) = log.runs
    angle = 0.5 * (low + high) - 0.5 * (high - low) * np.cos(2.0 * np.pi * run.time / period)
    return replace(log, runs=(replace(run, output=angle),), axis=axis)


def test_angles_that_the_log_has_not_reached_are_reported() -> None:
    seen = swinging(0.0, 2.0)
    assert extrapolation_warning(seen, seen) is None
    assert extrapolation_warning(swinging(-0.09, 2.09), seen) is None  # hardly further
    warning = extrapolation_warning(swinging(-2.0, 2.0), seen)
    assert warning is not None
    assert warning.startswith(
        "48 % of the validation data have angles outside 0 to 2 rad"
    )  # beyond a twentieth of the range


def test_speeds_are_reported_where_the_angles_are_known() -> None:
    seen = swinging(0.0, 2.0, axis="linear")
    warning = extrapolation_warning(swinging(0.0, 2.0, period=2.5, axis="linear"), seen)
    assert warning is not None
    assert "speeds outside -1.26 to 1.26 m/s" in warning


def test_a_diagnosis_reports_that_its_validation_data_go_further() -> None:
    machine = Machine().hiding(coulomb_friction={"torque": 0.2})
    log, near, far = (
        record(machine, scale * excitation(seed, duration=10.0), seed=seed, noise=1e-3).log()
        for seed, scale in ((1, 1.0), (1, 0.9), (1, 3.0))
    )
    for validation, further in ((near, False), (far, True)):
        warnings = diagnose(log, None, validation, candidates=["coulomb_friction"]).warnings
        assert any("the range of the estimation log" in warning for warning in warnings) is further
