"""Logs of other people end in the numbers that an engineer finds in them by hand; their folder is not part of this."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from diagnosis import diagnose
from identification.fit import fit
from identification.fit_result import Fit
from identification.log import Log
from plant import ServoModel, simulate
from plant.effects import CoulombFriction

LOGS = Path(__file__).parents[1].parent / "shared" / "cases" / "logs"
DEGREES = {"angle": "deg"}


def fitted(path: str, units: dict[str, str]) -> Fit:
    file = LOGS / path
    if not file.exists():
        pytest.skip(f"{file} is not there")
    found = fit(Log.read(file, units=units))
    assert found.failed is None
    return found


def value_of(found: Fit, name: str) -> float:
    value = found[name].value
    assert value is not None
    return value


@pytest.mark.parametrize("file", ["log.csv", "log_first_4.35s.csv"])
def test_a_laboratory_motor_is_identified_in_whole_and_in_part(file: str) -> None:
    """The part had ended at 1 kg m^2: its torque has one level, with which a dead zone trades places."""
    found = fitted(f"14-prbs-lab-kit/{file}", DEGREES)
    assert 1.1e-4 < value_of(found, "inertia") < 1.9e-4
    assert value_of(found, "viscous_friction") == pytest.approx(2.9e-3, rel=0.05)


def test_steady_levels_of_speed_give_the_friction() -> None:
    """Seen from a fast observer, 1 kg m^2 had explained as much as the motor."""
    found = fitted("05-staircase-idle-tail/log.csv", {})
    assert value_of(found, "viscous_friction") == pytest.approx(7.6e-4, rel=0.25)
    assert value_of(found, "dead_zone.half_width") == pytest.approx(0.052, rel=0.25)
    assert value_of(found, "inertia") < 1e-3


def test_a_random_current_with_clock_jitter_gives_the_motor() -> None:
    found = fitted("02-eigenvalues-crash/log.csv", {})
    assert value_of(found, "inertia") == pytest.approx(2.0e-4, rel=0.25)
    assert value_of(found, "viscous_friction") == pytest.approx(1.9e-3, rel=0.25)


def test_a_spindle_at_26000_rpm_is_a_motor_like_others() -> None:
    found = fitted("06-fast-motor-refused/log_spindle_synthetic.csv", {})
    assert value_of(found, "inertia") == pytest.approx(2e-6, rel=0.1)


def test_a_motor_beyond_1000_radians_a_second_is_diagnosed() -> None:
    """No bound of a candidate ends it."""
    time = 0.005 * np.arange(400)
    torque = 1e-3 * np.where(np.sin(2 * np.pi * 1.7 * time) > 0, 1.0, -1.0) + 5e-4 * np.sin(2 * np.pi * 1.9 * time)
    spindle = ServoModel(inertia=2e-7, gravity=0.0, viscous_friction=4e-7).with_effect(CoulombFriction(torque=2e-4))
    states = simulate(spindle, command=torque, dt=0.005)[:-1]
    angle = states[:, 0] + 1e-3 * np.random.default_rng(1).standard_normal(time.size)
    assert np.abs(states[:, 1]).max() > 1100.0
    log = Log.from_arrays(time=time, torque=torque, angle=angle)
    found = diagnose(log, candidates=("coulomb_friction", "stribeck_friction"))
    assert {cause.effect for cause in found.causes} <= {"coulomb_friction"}
    if not found.causes:  # in a free simulation of 400 samples the search may miss it, and then says that it lacks it
        assert (found.verdict, found.unknown.depends_on) == ("unknown", ("velocity",))


@pytest.mark.long
@pytest.mark.parametrize(
    ("file", "units", "candidates", "named"),
    [
        (
            "14-prbs-lab-kit/log.csv",
            DEGREES,
            ("input_delay", "asymmetric_friction", "presliding_hysteresis", "stribeck_friction", "torque_offset"),
            {"input_delay", "asymmetric_friction"},
        ),
        (
            "06-fast-motor-refused/log_spindle_synthetic.csv",
            {},
            ("coulomb_friction", "stribeck_friction"),
            {"coulomb_friction"},
        ),
        ("02-eigenvalues-crash/log.csv", {}, ("coulomb_friction", "torque_offset"), None),
        ("05-staircase-idle-tail/log.csv", {}, ("coulomb_friction", "quadratic_drag"), None),
    ],
)
def test_other_peoples_logs_end_in_a_verdict_without_a_nan(file, units, candidates, named) -> None:
    """Once they ended in a traceback, a refusal, `nan %`, and four sure wrong names."""
    path = LOGS / file
    if not path.exists():
        pytest.skip(f"{path} is not there")
    found = diagnose(Log.read(path, units=units), candidates=candidates)
    if named is not None:
        assert {cause.effect for cause in found.causes} == named
    assert "nan" not in f"{found.explain()} {found.to_dict()}".replace("'", " ").split()
    assert np.isfinite([found.gain.held_out_rms_before, found.gain.held_out_rms_after]).all()
