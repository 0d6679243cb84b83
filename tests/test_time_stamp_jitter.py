"""Stamps that scatter about an even clock: the model tells whether the samples did."""

from dataclasses import replace

import numpy as np
import pytest
from machine import Machine, excitation, record

from diagnosis import diagnose
from identification.fit import fit
from identification.log import Log
from identification.time_stamp_jitter import evenly_timed
from plant import ServoModel

DT, FINE, NOISE = 0.005, 5e-4, 1e-3
CHANNELS = ("time", "command", "output", "valid", "servo_gain")


def stamped_late(seed: int, by: float = 0.1, duration: float = 20.0) -> Log:
    """Sampled evenly, and written down late by up to a part of a sample."""
    log = record(Machine(), excitation(2 * seed, duration=duration), seed=seed, noise=NOISE).log()
    (run,) = log.runs
    late = by * DT * np.random.default_rng([seed, 9]).uniform(size=len(run))
    return replace(log, runs=(replace(run, time=run.time + late),))


def sampled_late(seed: int, duration: float = 8.0) -> Log:
    """Sampled up to a tenth of a sample beside an even clock, command and angle alike, and written down truly."""
    rng = np.random.default_rng([seed, 11])
    count = round(duration / DT)
    places = np.arange(1, count) * round(DT / FINE) + rng.integers(-1, 2, count - 1)
    played = np.zeros(round(duration / FINE))
    even = excitation(2 * seed, duration=duration)
    for value, first, last in zip(even, places, [*places[1:], played.size], strict=False):
        played[first:last] = value
    (run,) = record(Machine(), played, seed=seed, sample_time=FINE, noise=NOISE).log().runs
    return Log(runs=(replace(run, **{name: getattr(run, name)[places] for name in CHANNELS}),), axis="rotary")


@pytest.mark.parametrize("seed", [1, 2])
def test_jittered_time_stamps_are_evened_and_reported(seed):
    log = stamped_late(seed)
    found = fit(log)
    assert found.log.evenly_timed
    np.testing.assert_allclose(np.diff(found.log.runs[0].time), DT, rtol=1e-4)
    assert "even times are used" in found.log.repairs[-1]
    assert found.bandwidth == 0.0
    assert found["inertia"].value == pytest.approx(2.0, abs=4.0 * found["inertia"].std)


@pytest.mark.parametrize("seed", [1, 2])
def test_samples_that_were_taken_unevenly_keep_their_times(seed):
    log = sampled_late(seed)
    assert evenly_timed(log) is not log  # near enough to an even clock to be asked
    found = fit(log)
    assert not found.log.evenly_timed
    assert found.log.repairs == ()


def test_even_stamps_and_a_drifting_clock_are_left_alone():
    log = record(Machine(), excitation(2, duration=20.0), seed=1, noise=NOISE).log()
    assert evenly_timed(log) is log
    (run,) = log.runs
    steps = np.random.default_rng(0).uniform(0.9, 1.1, len(run) - 1) * DT
    wandering = replace(log, runs=(replace(run, time=np.concatenate(([0.0], np.cumsum(steps)))),))
    assert evenly_timed(wandering) is wandering


@pytest.mark.parametrize(("by", "estimated"), [(0.014, False), (0.021, True)])
def test_scatter_that_cannot_matter_is_let_be(by, estimated):
    """Half a hundredth of a sample is little: uniform over 0.0173 samples."""
    log = stamped_late(1, by=by, duration=10.0)
    assert (evenly_timed(log) is not log) == estimated


def test_two_stamps_at_one_place_of_the_clock_are_no_scatter():
    log = record(Machine(), excitation(2, duration=10.0), seed=1, noise=NOISE).log()
    (run,) = log.runs
    late = np.random.default_rng(9).uniform(0.0, 0.1, len(run))
    late[0], late[499:502] = 0.0, (0.1, 0.55, 0.1)
    stamped = replace(log, runs=(replace(run, time=run.time + late * DT),))
    assert evenly_timed(stamped) is stamped


def test_what_is_fixed_stays_so_on_the_even_clock():
    model = ServoModel.paper()
    found = fit(stamped_late(1, duration=10.0), model, fixed=["inertia"])
    assert found.log.evenly_timed
    assert found.fixed == ("inertia",)
    assert found.model.inertia == model.inertia


def test_a_gap_does_not_break_the_clock():
    log = stamped_late(1)
    (run,) = log.runs
    kept = np.r_[0:1000, 1203 : len(run)]
    gapped = replace(log, runs=(replace(run, **{name: getattr(run, name)[kept] for name in CHANNELS}),))
    (even,) = evenly_timed(gapped).runs
    steps = np.diff(even.time)
    assert steps[999] == pytest.approx(204 * DT, rel=1e-4)
    np.testing.assert_allclose(np.delete(steps, 999), DT, rtol=1e-4)


@pytest.mark.parametrize("seed", [2, 5])
def test_late_stamps_have_no_cause(seed):
    found = diagnose(stamped_late(seed, duration=30.0))
    assert found.verdict == "nothing_missing"
    assert any("even times" in warning for warning in found.warnings)
