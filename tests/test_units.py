"""A fit and a verdict are the same in every unit of torque, angle and time; more: `benchmarks/unit_invariance.py`."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hidden_effects import CASES
from machine import Machine, excitation, record
from rescaled import Units, differences, fit_differences
from rough_logs import rough_log

from diagnosis import Diagnosis, diagnose
from identification.fit import fit
from identification.log import Log

SEEDS = (0, 1, 2, 3, 5, 6, 7, 9, 11, 12, 13, 14, 17, 18, 19, 20, 23, 24, 25, 26)
ON_LINEAR = {"torque": (1e3, 1e-3), "angle": (1e-3, 1e3), "time": (1e-3, 1e3)}
"""Small and large factors by turns; of a rotary axis cos x fixes the unit of the angle."""
LATE = ("input_delay", "sensor_lag", "coulomb_friction")


def factors(seed: int, axis: str) -> Units:
    return Units(
        **{
            name: pair[(seed + place) % 2]
            for place, (name, pair) in enumerate(ON_LINEAR.items())
            if axis == "linear" or name != "angle"
        }
    )


@pytest.mark.parametrize("seed", [*SEEDS[::2], *(pytest.param(seed, marks=pytest.mark.long) for seed in SEEDS[1::2])])
def test_a_fit_is_the_same_in_other_units(seed: int) -> None:
    rough = rough_log(seed, longest=600)
    units, log = factors(seed, rough.axis), rough.log()
    here, there = fit(log), fit(units.log(log))
    assert here.failed is None
    assert max(apart for _, apart in fit_differences(here, there, units)) < 1e-6


@pytest.mark.parametrize("seed", [2, 5, 11])
def test_a_verdict_is_the_same_in_other_units(seed: int) -> None:
    rough = rough_log(seed, longest=400)
    units, log = factors(seed, rough.axis), rough.log()
    here, there = (diagnose(one, candidates=("coulomb_friction", "torque_offset")) for one in (log, units.log(log)))
    assert max(differences(here, there, units), key=lambda found: found[1])[1] < 1e-6


@pytest.fixture(scope="module")
def late() -> tuple[Log, Diagnosis]:
    """A linear axis whose command comes late: how much its dead time has paid decides between it and a slow sensor."""
    delay = next(case for case in CASES if case.effect == "input_delay")
    machine = replace(Machine(gravity=0.0), effects={"coulomb_friction": {"torque": 0.18}}).hiding(
        input_delay=delay.at(0.005)
    )
    log = replace(record(machine, excitation(5, duration=12.0), seed=5).log(), axis="linear")
    return log, diagnose(log, candidates=LATE)


@pytest.mark.parametrize("units", [Units(torque=1e3), Units(angle=1e-3), Units(time=1e-3), Units(time=1e3)], ids=str)
def test_posterior_odds_are_the_same_in_other_units(units: Units, late: tuple[Log, Diagnosis]) -> None:
    log, here = late
    there = diagnose(units.log(log), candidates=LATE)
    assert max(differences(here, there, units), key=lambda found: found[1])[1] < 1e-6
