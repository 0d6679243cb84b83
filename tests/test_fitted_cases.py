"""Logs of other people end in the numbers that an engineer finds in them by hand; their folder is not part of this."""

from __future__ import annotations

from pathlib import Path

import pytest

from identification.fit import fit
from identification.fit_result import Fit
from identification.log import Log

LOGS = Path(__file__).parents[1].parent / "shared" / "cases" / "logs"
DEGREES = {"angle": "deg"}


def fitted(path: str, units: dict[str, str]) -> Fit:
    file = LOGS / path
    if not file.exists():
        pytest.skip(f"{file} is not there")
    found = fit(Log.read(file, units=units))
    assert found.failed is None
    return found


def told(found: Fit, name: str) -> float:
    value = found[name].value
    assert value is not None
    return value


@pytest.mark.parametrize("file", ["log.csv", "log_first_4.35s.csv"])
def test_a_laboratory_motor_is_identified_in_whole_and_in_part(file: str) -> None:
    """The part had ended at 1 kg m^2: its torque has one level, with which a dead zone trades places."""
    found = fitted(f"14-prbs-lab-kit/{file}", DEGREES)
    assert 1.1e-4 < told(found, "inertia") < 1.9e-4
    assert told(found, "viscous_friction") == pytest.approx(2.9e-3, rel=0.05)


def test_steady_levels_of_speed_give_the_friction() -> None:
    """Seen from a fast observer, 1 kg m^2 had explained as much as the motor."""
    found = fitted("05-staircase-idle-tail/log.csv", {})
    assert told(found, "viscous_friction") == pytest.approx(7.6e-4, rel=0.25)
    assert told(found, "dead_zone.half_width") == pytest.approx(0.052, rel=0.25)
    assert told(found, "inertia") < 1e-3


def test_a_random_current_with_clock_jitter_gives_the_motor() -> None:
    found = fitted("02-eigenvalues-crash/log.csv", {})
    assert told(found, "inertia") == pytest.approx(2.0e-4, rel=0.25)
    assert told(found, "viscous_friction") == pytest.approx(1.9e-3, rel=0.25)


def test_a_spindle_at_26000_rpm_is_a_motor_like_others() -> None:
    found = fitted("06-fast-motor-refused/log_spindle_synthetic.csv", {})
    assert told(found, "inertia") == pytest.approx(2e-6, rel=0.1)
