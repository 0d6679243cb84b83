"""Channels of different rates in one table, held samples, and stamps with too few digits."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from machine import Machine, excitation, record

from identification.errors import MalformedLog
from identification.fit import fit
from identification.log import Log

MACHINE = Machine()
FAST, SLOW = 0.001, 10  # sample time [s] of the torque, and how many of them lie in one of the angle


@pytest.fixture(scope="module")
def fast():
    """Columns at 1 kHz of a machine that is driven at 1 kHz, and read with a coarse encoder."""
    torque = excitation(5, duration=20.0, sample_time=FAST)
    (run,) = record(MACHINE, torque, seed=5, sample_time=FAST, noise=1e-4).log().runs
    return {"time": run.time, "torque": run.command, "angle": run.output}


def between(values):
    return np.where(np.arange(len(values)) % SLOW, np.nan, values)


def parameters(log):
    model = fit(log).model
    return np.array([model.inertia, model.gravity, model.viscous_friction])


def test_a_log_of_two_rates_gives_the_same_as_one_of_one_rate(fast):
    one = parameters(Log.from_arrays(**fast))
    empty = Log.from_arrays(**fast | {"angle": between(fast["angle"])})
    held = Log.from_arrays(**fast | {"angle": np.repeat(fast["angle"][::SLOW], SLOW)})
    for log in (empty, held):
        assert len(log.runs[0]) == len(fast["time"]) // SLOW
        np.testing.assert_array_equal(log.runs[0].output, fast["angle"][::SLOW])
        np.testing.assert_allclose(parameters(log), one, rtol=5e-3)
    assert "'angle' has a sample in every 10th row only; its own samples are used" in empty.repairs[0]
    assert "'angle' repeats each sample until every 10th row" in held.repairs[0]


def test_the_impulse_of_the_command_between_two_samples_is_kept(fast):
    (run,) = Log.from_arrays(**fast | {"angle": between(fast["angle"])}).runs
    np.testing.assert_allclose(run.command, fast["torque"].reshape(-1, SLOW).mean(axis=1), atol=1e-12)


def test_a_slower_command_is_held_until_its_next_sample(fast):
    (run,) = (log := Log.from_arrays(**fast | {"torque": between(fast["torque"])})).runs
    assert len(run) == len(fast["time"])
    np.testing.assert_array_equal(run.command, np.repeat(fast["torque"][::SLOW], SLOW))
    assert log.repairs == ("arrays: 'torque' has a sample in every 10th row only, held in between",)


def test_channels_in_rows_of_their_own_are_joined(fast):
    command = pd.DataFrame({"time": fast["time"], "torque": fast["torque"]})
    angle = pd.DataFrame({"time": fast["time"][::SLOW] + 0.3 * FAST, "angle": fast["angle"][::SLOW]})
    (run,) = Log.from_dataframe(pd.concat([command, angle]).sort_values("time", ignore_index=True)).runs
    np.testing.assert_array_equal(run.output, fast["angle"][::SLOW])
    together = pd.concat([command, angle.assign(time=fast["time"][::SLOW])]).sort_values("time", ignore_index=True)
    (run,) = Log.from_dataframe(together).runs
    np.testing.assert_allclose(run.command, fast["torque"].reshape(-1, SLOW).mean(axis=1), atol=1e-12)


def test_a_faster_command_of_another_group_keeps_its_impulse(fast, tmp_path):
    path = tmp_path / "log.csv"
    slow = {name: fast[name][::SLOW] for name in ("time", "angle")}
    rows = [
        (repr(t), repr(u), *((repr(slow["time"][k]), repr(slow["angle"][k])) if k < len(slow["time"]) else ("", "")))
        for k, (t, u) in enumerate(zip(fast["time"].tolist(), fast["torque"].tolist(), strict=True))
    ]
    cells = [[cell.removeprefix("np.float64(").removesuffix(")") for cell in row] for row in rows]
    path.write_text("\n".join(["time,torque,time,angle", *map(",".join, cells)]) + "\n")
    (run,) = Log.read(path).runs
    np.testing.assert_array_equal(run.output, fast["angle"][::SLOW])
    np.testing.assert_allclose(run.command, fast["torque"].reshape(-1, SLOW).mean(axis=1), atol=1e-9)


def test_a_slower_speed_is_interpolated(fast):
    speed = np.gradient(fast["angle"], fast["time"])
    (run,) = (log := Log.from_arrays(**fast, velocity=between(speed))).runs
    assert "'velocity' has a sample in every 10th row only, interpolated" in log.repairs[0]
    np.testing.assert_array_equal(run.velocity[::SLOW], speed[: len(run)][::SLOW])


def test_rates_in_no_whole_proportion_are_seen_too(fast):
    taken = np.floor(np.floor(np.arange(len(fast["time"])) / 3.4) * 3.4).astype(int)
    (run,) = (log := Log.from_arrays(**fast | {"angle": fast["angle"][taken]})).runs
    assert len(run) == pytest.approx(len(fast["time"]) / 3.4, rel=2e-3)
    assert "repeats each sample" in log.repairs[0]


@pytest.mark.parametrize("counts", [200, 2000, 20000, None])
def test_a_coarse_encoder_is_no_slow_one(fast, counts):
    angle = fast["angle"] if counts is None else np.round(fast["angle"] * counts) / counts
    log = Log.from_arrays(**fast | {"angle": angle})
    assert len(log.runs[0]) == len(fast["time"])
    assert not any("repeats" in repair for repair in log.repairs)


def test_missing_samples_are_no_slower_rate(fast):
    angle = np.where(np.random.default_rng(1).random(len(fast["time"])) < 0.2, np.nan, fast["angle"])
    log = Log.from_arrays(**fast | {"angle": angle})
    assert len(log.runs[0]) >= len(angle) - 2
    assert "masked" in log.repairs[-1]


@pytest.mark.parametrize("step", [0.01, 0.0043])
def test_stamps_with_too_few_digits_are_spread(fast, step):
    time = np.floor(fast["time"] / step) * step
    (run,) = (log := Log.from_arrays(**fast | {"time": time})).runs
    assert len(run) == len(time)
    off = run.time - fast["time"]
    assert np.ptp(off) < 0.02 * step
    assert f"in steps of {1e3 * step:g} ms; the samples are spread evenly between them" in log.repairs[0]


def test_a_clock_that_drifts_is_followed(fast):
    true = fast["time"] * (1.0 + 2e-4 * fast["time"])
    (run,) = Log.from_arrays(**fast | {"time": np.floor(true / 0.01) * 0.01}).runs
    assert np.abs(run.time - true + np.mean(true - run.time)).max() < 0.006


def test_stamps_that_repeat_at_random_are_refused(fast):
    random = np.random.default_rng(0)
    counts = random.geometric(0.1, 4000)
    time = np.repeat(0.01 * np.arange(4000), counts)[: len(fast["time"])]
    with pytest.raises(MalformedLog, match="repeat the time of the one before, export the time with more digits"):
        Log.from_arrays(**{name: values[: len(time)] for name, values in fast.items()} | {"time": time})
