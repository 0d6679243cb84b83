"""Hide an effect in an independent machine, and the diagnosis must name it; hide none, and it must name none.

Rates and odds over many logs are printed by benchmarks/calibration.py.
"""

from __future__ import annotations

import numpy as np
import pytest
from hidden_effects import CASES, Hidden, logs_of, oracle
from machine import Machine, excitation, record

from diagnosis import diagnose
from identification.log import Log
from identification.simulation import free_simulation
from plant import ServoModel, catalogue

LATE = {"input_delay", "actuator_lag", "sensor_lag"}  # alike in an open loop when small, and then said to be


def held_out_error(model: ServoModel, held_out: Log) -> float:
    """RMS error of a free simulation [rad]."""
    return float(np.sqrt(np.mean((free_simulation(held_out, model)[0] - held_out.runs[0].output) ** 2)))


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.effect)
def test_the_hidden_effect_is_named_and_its_size_recovered(case: Hidden) -> None:
    size = case.sizes[2]
    log, held_out = logs_of(case.machine(size), seed=12, duration=case.duration)
    found = diagnose(log, case.base, held_out)
    if case.effect in LATE and found.verdict == "ambiguous":
        (cause,) = found.causes
        assert {cause.effect, *(name for name, _ in cause.alternatives)} <= LATE
        assert case.effect in {cause.effect, *(name for name, _ in cause.alternatives)}
        return
    assert [cause.effect for cause in found.causes] == [case.effect]
    assert found.verdict == "named"
    for name in case.judged:
        true, line = case.at(size)[name], found.causes[0].parameters[name]
        assert line.std is not None
        assert line.value == pytest.approx(true, abs=max(0.1 * abs(true), 4 * line.std)), name
    if catalogue[case.effect].chaotic:  # in a free simulation the truth itself goes astray
        return
    mine, best = (held_out_error(m, held_out) for m in (found.model, oracle(case, size, log).model))
    assert mine < max(1.2 * best, best + 5e-4)  # as good as if told


@pytest.mark.long
def test_backlash_is_named_alone_in_a_short_log_and_measured() -> None:
    """A light motor crosses a wide gap in the time in which a heavy one crosses a narrow one.

    What such a log measures is therefore their product. How it is split between them hangs on the shape of the knocks,
    behind which the likelihood is multimodal: another processor's rounding alone moves each by a quarter. The standard
    errors say so.
    """
    gap, share = 0.02, 0.3
    hidden = Machine().hiding(backlash={"gap": gap, "motor_share": share})
    found = diagnose(record(hidden, excitation(1, duration=20.0)).log())
    (cause,) = found.causes
    assert cause.effect == "backlash"
    found_gap, found_share = cause.parameters["gap"].value, cause.parameters["motor_share"].value
    std = cause.parameters["gap"].std
    assert std is not None
    assert abs(found_gap - gap) < 3.0 * std < 1.5 * gap
    assert found_gap * found_share == pytest.approx(gap * share, rel=0.05)
    assert found_gap == pytest.approx(gap, rel=0.3)


@pytest.mark.long
def test_backlash_between_soft_flanks_is_named_alone() -> None:
    """Between flanks that count as hard two logs of four got a payload change too, one at 1.000."""
    hidden = Machine(flank_frequency=150.0, flank_damping=0.3).hiding(backlash={"gap": 0.02, "motor_share": 0.3})
    few = ["backlash", "compliance", "payload_change", "input_delay"]
    found = diagnose(record(hidden, excitation(64, duration=15.0), seed=32).log(), candidates=few)
    (cause,) = found.causes
    assert cause.effect == "backlash"
    assert cause.parameters["gap"].value == pytest.approx(0.02, rel=0.3)
    flank = cause.parameters["flank_frequency"]
    assert flank.std is not None
    assert flank.value == pytest.approx(150.0, abs=2.0 * flank.std)


@pytest.mark.long
def test_an_instant_is_found_among_the_peaks_beside_it() -> None:
    """From the nearest instant of the screen the fit ends 1.2 s late, and what it leaves was an end stop at 0.99."""
    change = {"time": 23.1416, "inertia": 0.006, "gravity": 0.0018}
    log, held_out = logs_of(Machine().hiding(payload_change=change), seed=12, duration=40.0)
    found = diagnose(log, None, held_out, candidates=["payload_change", "end_stop"])
    (cause,) = found.causes
    assert cause.effect == "payload_change"
    assert cause.parameters["time"].value == pytest.approx(23.1416, abs=0.02)


@pytest.mark.parametrize("seed", [21, pytest.param(22, marks=pytest.mark.long)])
def test_nothing_is_named_when_nothing_is_hidden(seed: int) -> None:
    log, held_out = logs_of(Machine(), seed=seed)
    found = diagnose(log, None, held_out)
    assert found.verdict == "nothing_missing"
    assert found.causes == ()
    assert found.gain is not None
    assert found.gain.held_out_rms_after == found.gain.held_out_rms_before
