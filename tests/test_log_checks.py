"""Faults that are planted are found, said and masked; motion, steps, stick-slip and noise are left alone."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from machine import Follower, Machine, chirp_and_steps, excitation, record, wandering_reference
from sample_logs import motion

from identification.errors import MalformedLog
from identification.log import Log
from plant.errors import AntidriveError

ENCODERS = {"fine": 2**20, "usual": 2**14, "coarse": 2**12}


def read(columns, **options):
    return Log.from_arrays(**columns, **options)


def only_repair(log, text):
    (repair,) = log.repairs
    assert re.search(text, repair), repair
    return log.runs[0]


# Spikes


@settings(max_examples=60, deadline=None)
@given(
    places=st.lists(st.integers(0, 19), min_size=1, max_size=6, unique=True),
    size=st.floats(0.3, 4.0),
    sign=st.sampled_from([-1.0, 1.0]),
    width=st.integers(1, 3),
    noise=st.sampled_from([0.0, 1e-4, 1e-3]),
    counts=st.sampled_from(list(ENCODERS.values())),
)
def test_spikes_are_masked_and_nothing_else(places, size, sign, width, noise, counts):
    columns = motion(counts=counts, noise=noise)
    spoilt = np.zeros(600, dtype=bool)
    for place in places:
        spoilt[20 + 28 * place : 20 + 28 * place + width] = True
    columns["angle"] = np.where(spoilt, columns["angle"] + sign * size, columns["angle"])
    run = only_repair(read(columns), rf"{len(places)} spikes? of 'angle'.* {width * len(places)} samples? masked")
    np.testing.assert_array_equal(run.valid, ~spoilt)
    truth = motion(counts=counts, noise=noise)["angle"]
    np.testing.assert_allclose(run.output[spoilt], truth[spoilt], atol=0.05)


@pytest.mark.parametrize("place", [1, 2, 3, 596, 597, 598])
def test_spikes_near_the_ends(place):
    columns = motion(counts=4096)
    columns["angle"][place] -= 3.14
    run = only_repair(read(columns), "1 spike of 'angle'")
    np.testing.assert_array_equal(np.flatnonzero(~run.valid), [place])


def test_a_step_of_the_readings_that_stays_is_no_spike():
    columns = motion(counts=4096)
    del columns["velocity"]
    columns["angle"][300:] += 0.7
    assert read(columns).runs[0].valid.all()


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**16),
    frequency=st.floats(0.2, 80.0),
    noise=st.sampled_from([0.0, 1e-5, 1e-3, 3e-2]),
    counts=st.sampled_from([None, *ENCODERS.values()]),
)
def test_chirps_and_noise_up_to_high_frequencies_pass(seed, frequency, noise, counts):
    rng = np.random.default_rng(seed)
    time = 0.005 * np.arange(1500)
    angle = np.sin(2 * np.pi * frequency * time**2 / (2 * time[-1])) + noise * rng.standard_normal(1500)
    if counts:
        angle = np.round(angle * counts / 6.283185307) * 6.283185307 / counts
    log = read({"time": time, "torque": np.cos(time), "angle": angle})
    assert log.repairs == ()
    assert log.runs[0].valid.all()


@pytest.fixture(scope="module")
def true_motions():
    """(torque, angle) of heavy and light loads without friction, with Coulomb friction and with stick-slip."""
    friction = {"coulomb": np.tile([0.0, 1.5, 1.0], 2), "excess": np.tile([0.0, 0.0, 1.0], 2), "velocity": 0.05}
    machine = Machine(
        inertia=np.repeat([2.0, 0.02], 3),
        viscous_friction=np.repeat([0.8, 0.05], 3),
        effects={"stribeck_friction": friction},
    )
    plan = {"duration": 12.0, "sample_time": 0.005}
    heavy = Machine(
        effects={
            "stribeck_friction": {name: value if name == "velocity" else value[:3] for name, value in friction.items()}
        }
    )
    records = [
        record(machine, excitation(0, **plan), noise=0.0, bits=None, steps=2),
        record(machine, chirp_and_steps(0, **plan), noise=0.0, bits=None, steps=2),
        record(heavy, Follower(reference=wandering_reference(0, **plan)), noise=0.0, bits=None, steps=2),
    ]
    return [(r.command[:, k], r.angle[:, k]) for r in records for k in range(r.angle.shape[1])]


@pytest.mark.parametrize(
    ("noise", "bits"),
    [
        *((0.0, None), (0.0, 12), (1e-4, 17), (1e-3, None), (1e-3, 12)),
        *(pytest.param(*each, marks=pytest.mark.long) for each in ((0.0, 17), (1e-4, None), (1e-4, 12), (1e-3, 17))),
    ],
)
def test_real_motion_raises_no_false_alarm(true_motions, bits, noise):
    """Excitations and closed loops, with and without stick-slip: not one of 36,000 samples may be masked."""
    rng = np.random.default_rng(5)
    time = 0.005 * np.arange(2400)
    samples = 0
    for torque, true in true_motions:
        angle = true + noise * rng.standard_normal(len(true))
        if bits:
            angle = np.round(angle * 2**bits / (2 * np.pi)) * (2 * np.pi / 2**bits)
        log = read({"time": time, "torque": torque, "angle": angle})
        assert log.repairs == ()
        assert all(run.valid.all() for run in log.runs)
        samples += sum(map(len, log.runs))
    assert samples == 36_000


# Counter wraps


@settings(max_examples=40, deadline=None)
@given(
    speed=st.floats(2.0, 60.0),
    start=st.floats(-3.0, 3.0),
    counts=st.sampled_from([None, 4096, 2**17]),
    noise=st.sampled_from([0.0, 1e-4]),
    turns=st.sampled_from([1, 4]),
)
def test_a_wrapped_angle_is_continued(speed, start, counts, noise, turns):
    time = 0.005 * np.arange(800)
    true = start + speed * time + 0.3 * np.sin(5 * time) + noise * np.random.default_rng(1).standard_normal(800)
    if counts:
        true = np.round(true * counts / (2 * np.pi)) * 2 * np.pi / counts
    period = 2 * np.pi * turns
    turn = np.floor(true / period)
    assume(len(np.unique(turn[10:-10])) > 1)
    assume(turn[10] == turn[0] and turn[-10] == turn[-1])  # a wrap within the first few samples may pass for a spike
    log = read({"time": time, "torque": np.cos(time), "angle": np.mod(true, period)})
    run = log.runs[0]
    shift = run.output - true
    np.testing.assert_allclose(shift[run.valid], np.median(shift), atol=1e-6)
    assert run.valid.mean() > 0.97
    assert any("wraps around" in repair for repair in log.repairs)


def test_a_wrapped_linear_counter_is_continued():
    time = 0.001 * np.arange(2000)
    true = np.round(60_000 + 9000 * time + 500 * np.sin(20 * time))
    log = Log.from_arrays(time=time, force=np.cos(time), position=1e-6 * np.mod(true, 2**16))
    np.testing.assert_allclose(log.runs[0].output - 1e-6 * true, 0.0, atol=1e-9)


def test_many_turns_without_a_wrap_are_left_alone():
    time = 0.001 * np.arange(3000)
    log = read({"time": time, "torque": np.cos(time), "angle": 300 * time + np.sin(time)})
    assert log.repairs == ()


# Clipping, freezing


def test_a_clipped_output_is_masked():
    columns = motion(counts=65536)
    clipped = np.abs(columns["angle"]) > 0.5
    columns["angle"] = np.clip(columns["angle"], -0.5, 0.5)
    run = only_repair(read(columns), "'angle' is clipped")
    np.testing.assert_array_equal(~run.valid, clipped)


def test_a_clipped_command_is_only_warned_of():
    columns = motion()
    columns["torque"] = np.clip(columns["torque"], -15.0, 15.0)
    log = read(columns)
    assert log.repairs == ()
    assert "'torque' is clipped" in log.warnings[0]


def test_steps_of_the_command_are_no_clipping():
    columns = motion()
    columns["torque"] = np.sign(np.sin(3 * columns["time"]))
    assert read(columns).warnings == ()


def test_a_reading_that_freezes_in_motion_is_masked():
    columns = motion(counts=65536)
    fast = 20 + int(np.argmax(np.abs(columns["velocity"][20:500])))
    columns["angle"][fast : fast + 12] = columns["angle"][fast]
    run = only_repair(read(columns), "'angle' freezes in motion")
    np.testing.assert_array_equal(np.flatnonzero(~run.valid), np.arange(fast + 1, fast + 12))


# Time


def test_small_gaps_are_masked_and_reported():
    columns = {name: np.delete(values, np.arange(200, 220)) for name, values in motion().items()}
    log = read(columns)
    run = only_repair(log, r"1 gap in time of up to 105 ms")
    assert not run.valid[200]
    assert run.valid[199]
    assert 15 <= (~run.valid).sum() <= 25


def test_a_long_gap_splits_the_run():
    columns = motion(samples=1200)
    columns["time"][600:] += 5.0
    log = read(columns)
    assert [len(run) for run in log.runs] == [600, 600]
    assert "split into 2 parts" in log.repairs[0]
    assert [run.label for run in log.runs] == ["arrays part 1", "arrays part 2"]


def test_jitter_keeps_the_true_times():
    columns = motion()
    columns["time"] = columns["time"] + np.random.default_rng(0).uniform(-0.001, 0.001, 600)
    log = read(columns)
    np.testing.assert_array_equal(log.runs[0].time, columns["time"])
    assert "true times are used" in log.warnings[0]


def test_a_few_repeated_times_are_left_out():
    columns = motion()
    columns["time"][[100, 300]] = columns["time"][[99, 299]]
    run = only_repair(read(columns), "2 samples with a repeated time")
    assert len(run) == 598


def test_rows_that_stand_twice_are_left_out():
    """Samples are missing too, so that an even clock would put the copies where none was measured."""
    columns = motion(noise=1e-3)
    rows = np.sort(np.concatenate([np.delete(np.arange(600), [50, 180, 181, 420]), [30, 31, 200, 330, 331, 332, 500]]))
    run = only_repair(
        read({name: values[rows] for name, values in columns.items()}), "7 rows that repeat the row before"
    )
    np.testing.assert_array_equal(run.time, np.delete(columns["time"], [50, 180, 181, 420]))
    assert run.valid.all()


def test_a_short_run_among_others_is_left_out_and_reported():
    columns = motion(samples=630)
    columns["run"] = np.repeat([0, 1], [600, 30])
    log = read(columns)
    assert len(log.runs) == 1
    assert "run 1: left out" in log.repairs[0]


# Missing samples


def test_missing_outputs_are_masked():
    columns = motion()
    columns["angle"][[50, 51, 400]] = [np.nan, np.inf, -np.inf]
    run = only_repair(read(columns), r"row 51, .*3 missing samples of 'angle' masked")
    np.testing.assert_array_equal(np.flatnonzero(~run.valid), [50, 51, 400])


def test_missing_commands_are_held_and_their_effect_masked():
    columns = motion()
    columns["torque"][100] = np.nan
    run = only_repair(read(columns), "1 missing sample of 'torque' held")
    assert run.command[100] == columns["torque"][99]
    assert not run.valid[100:110].any()
    assert run.valid[:100].all()


def test_holes_in_a_channel_that_is_not_needed():
    columns = motion()
    columns["velocity"][100] = np.nan
    columns["reference"] = np.full(600, np.nan)
    log = read(columns)
    assert log.runs[0].reference is None
    assert np.isfinite(log.runs[0].velocity).all()
    assert len(log.repairs) == 2


# Units


@pytest.mark.parametrize(
    ("column", "factor", "option"),
    [
        ("angle", 180 / np.pi, "--unit angle=deg"),
        ("velocity", 180 / np.pi, "--unit velocity=deg/s"),
        ("velocity", 30 / np.pi, "--unit velocity=rpm"),
        ("angle", 1 / (2 * np.pi), "--unit angle=turn"),
    ],
)
def test_a_velocity_betrays_a_wrong_unit(column, factor, option):
    columns = motion()
    columns[column] = columns[column] * factor
    with pytest.raises(MalformedLog, match=option):
        read(columns)
    assert read(columns, units={column: option.split("=")[1]}).repairs == ()


def test_a_velocity_of_another_shaft_is_dropped_and_reported():
    columns = motion()
    columns["velocity"] = -99.231 * columns["velocity"]
    log = read(columns)
    assert log.runs[0].velocity is None
    assert "--scale velocity" in log.repairs[0]


@pytest.mark.parametrize(("factor", "option"), [(1e3, "time=ms"), (1e6, "time=us")])
def test_time_in_milliseconds_is_refused_with_the_right_option(factor, option):
    columns = motion()
    columns["time"] = factor * columns["time"]
    with pytest.raises(MalformedLog, match=f"--unit {option}"):
        read(columns)
    assert read(columns, units={"time": option[5:]}).runs[0].sample_time == pytest.approx(0.005)


def test_encoder_steps_of_degrees_make_a_log_unusable():
    columns = motion()
    del columns["velocity"]
    columns["angle"] = np.round(np.rad2deg(columns["angle"]) * 4096 / 360) * 360 / 4096
    (fault,) = read(columns).faults
    assert fault.endswith("has steps of 360/4096, as an encoder of 4096 steps a turn has in degrees: --unit angle=deg")


def test_a_load_that_never_turns_is_reported():
    columns = motion()
    del columns["velocity"]
    columns["angle"][:] = 0.3
    assert any("never turns" in fault for fault in read(columns).faults)


def test_many_findings_of_one_kind_are_reported_once():
    columns = {name: np.tile(values, 10) for name, values in motion().items()}
    columns["run"] = np.repeat(np.arange(10), 600)
    columns["angle"][300::600] += 3.0
    (repair,) = read(columns).repairs
    assert repair.endswith("9 further runs")


@settings(max_examples=100, deadline=None)
@given(
    values=st.lists(st.floats(), min_size=1, max_size=80),
    column=st.sampled_from(["time", "torque", "angle", "velocity", "goal", "run"]),
    start=st.integers(0, 520),
)
def test_any_numbers_in_a_channel_are_read_or_refused(values, column, start):
    columns = motion() | {"goal": np.cos(np.arange(600)), "run": np.zeros(600)}
    columns[column][start : start + len(values)] = values
    try:
        log = read(columns)
    except AntidriveError as error:
        refusal = str(error)
    else:
        assert all(np.isfinite(run.output).all() and np.isfinite(run.command).all() for run in log.runs)
        return
    assert refusal.endswith(".")
    assert "\n" not in refusal
