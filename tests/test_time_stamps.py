"""Times as loggers write them: of the day, with a date, since 1970 in any unit, in two columns."""

from __future__ import annotations

from datetime import datetime, timedelta

import numpy as np
import pandas as pd
import pytest
from sample_logs import motion

from identification.errors import MalformedLog
from identification.log import Log

SOUND = {name: values for name, values in motion(samples=300, dt=0.01).items() if name != "velocity"}
BEGIN = datetime(2021, 5, 25, 23, 59, 58, 500000)  # midnight is 1.5 s later
STAMPS = [BEGIN + timedelta(milliseconds=10 * k) for k in range(300)]


def csv(folder, times, heading="time", separator=","):
    """The sound motion with these times, as a file."""
    path = folder / "log.csv"
    rows = [
        f"{t}{separator}{u!r}{separator}{y!r}"
        for t, u, y in zip(times, SOUND["torque"].tolist(), SOUND["angle"].tolist(), strict=True)
    ]
    path.write_text("\n".join([separator.join((heading, "torque", "angle")), *rows]) + "\n")
    return path


def even(log):
    """The log's only run, whose times are those of the sound motion, from a start of their own."""
    (run,) = log.runs
    np.testing.assert_allclose(run.time - run.time[0], SOUND["time"], atol=1e-6)
    np.testing.assert_allclose(run.output, SOUND["angle"], atol=1e-9)
    return run


def german(stamp):
    return f"{stamp:%d.%m.%Y %H:%M:%S}.{stamp.microsecond // 1000:03d}"


def american(stamp):
    return f"{stamp:%m/%d/%Y %I:%M:%S}.{stamp.microsecond // 1000:03d} {stamp:%p}"


WAYS = {
    "iso": lambda s: s.isoformat(),
    "iso, a space and a zone": lambda s: f"{s:%Y-%m-%d %H:%M:%S.%f}+02:00",
    "german": german,
    "german, decimal comma": lambda s: german(s)[::-1].replace(".", ",", 1)[::-1],
    "american": american,
    "british": lambda s: f"{s:%d/%m/%Y %H:%M:%S.%f}",
    "matlab": lambda s: f"{s:%d-%b-%Y %H:%M:%S.%f}",
    "compact": lambda s: f"{s:%Y%m%d_%H:%M:%S.%f}",
    "time of day": lambda s: f"{s:%H:%M:%S.%f}",
    "time of day, decimal comma": lambda s: f"{s:%H:%M:%S},{s.microsecond // 1000:03d}",
    "time of day, colon": lambda s: f"{s:%H:%M:%S}:{s.microsecond // 1000:03d}",
    "time of day, none where it is whole": lambda s: f"{s.time()}",
    "twelve hours": lambda s: f"{s:%I:%M:%S}.{s.microsecond // 1000:03d} {s:%p}",
}


@pytest.mark.parametrize("way", WAYS)
def test_stamps_over_midnight(tmp_path, way):
    log = Log.read(csv(tmp_path, map(WAYS[way], STAMPS), separator=";"))
    even(log)
    assert any("passes midnight" in warning for warning in log.warnings) == ("day" in way or "hours" in way)


def test_a_time_of_day_counts_from_midnight(tmp_path):
    log = Log.read(csv(tmp_path, [f"{s - timedelta(hours=3):%H:%M:%S.%f}" for s in STAMPS]))
    run = even(log)
    assert run.zero + run.time[0] == pytest.approx(20 * 3600 + 59 * 60 + 58.5)
    assert log.warnings == ()


def test_minutes_as_a_spreadsheet_leaves_them(tmp_path):
    even(
        Log.read(
            csv(
                tmp_path,
                [f"{s:%M:%S.%f}"[:-3] for s in STAMPS[:1]]
                + [
                    f"{59 + (k + 50) // 6000:02d}:{(58.5 + 0.01 * k) % 60:06.3f}"
                    if k < 150
                    else f"60:{0.01 * (k - 150):06.3f}"
                    for k in range(1, 300)
                ],
            )
        )
    )


@pytest.mark.parametrize("written", ["0 days 00:00:{:09.6f}", "00:00:{:06.3f}", "0:0:{:.2f}"])
def test_elapsed_times(tmp_path, written):
    even(Log.read(csv(tmp_path, [written.format(t) for t in SOUND["time"]])))


def test_dates_and_durations_of_a_frame():
    for times in (
        pd.Series(STAMPS),
        pd.Series(STAMPS).dt.tz_localize("Europe/Berlin"),
        pd.to_timedelta(SOUND["time"], unit="s"),
        pd.Series([s.time() for s in STAMPS]),
    ):
        even(Log.from_dataframe(pd.DataFrame({**SOUND, "time": times})))


def test_a_stamp_that_is_none_is_named(tmp_path):
    times = [german(stamp) for stamp in STAMPS]
    times[100] = "noon"
    with pytest.raises(MalformedLog, match=r"row 101 \(line 102\), column 'time': 'noon' is no time like those"):
        Log.read(csv(tmp_path, times))


@pytest.mark.parametrize(("unit", "per_second"), [("ms", 10**3), ("us", 10**6), ("ns", 10**9)])
def test_epochs_in_finer_units(tmp_path, unit, per_second):
    epoch = 1742233511
    times = [epoch * per_second + k * per_second // 100 for k in range(300)]
    log = Log.read(csv(tmp_path, times))
    run = even(log)
    assert run.zero == epoch
    assert f"'time' counts {unit} since 1970" in log.warnings[0]
    even(Log.read(csv(tmp_path, times), units={"time": unit}))


def test_an_epoch_in_seconds_needs_no_word(tmp_path):
    log = Log.read(csv(tmp_path, [f"{1742233511 + t:.2f}" for t in SOUND["time"]]))
    even(log)
    assert log.warnings == ()


@pytest.mark.parametrize(
    ("whole", "part", "per_second"),
    [
        ("header.stamp.sec", "header.stamp.nanosec", 10**9),
        ("/joint_states/header/stamp/secs", "/joint_states/header/stamp/nsecs", 10**9),
        ("sec", "nanosec", 10**9),
        ("tv_sec", "tv_usec", 10**6),
        ("stamp_sec", "stamp_nsec", 10**9),
    ],
)
def test_seconds_and_their_parts_in_two_columns(whole, part, per_second):
    ticks = 1742233511 * per_second + np.arange(300) * per_second // 100 + per_second // 2
    columns = {whole: ticks // per_second, part: ticks % per_second, "torque": SOUND["torque"], "angle": SOUND["angle"]}
    log = Log.from_dataframe(pd.DataFrame(columns))
    run = even(log)
    assert run.zero == 1742233511.5
    assert any(f"'{whole}' and '{part}' are one time" in warning for warning in log.warnings)
    even(Log.from_dataframe(pd.DataFrame(columns), mapping={"time": whole}))


def test_hours_and_minutes_in_columns_pass_midnight():
    ticks = (23 * 3600 + 59 * 60 + 58) * 100 + np.arange(300)
    seconds = ticks // 100
    clock = {
        "hour": seconds // 3600 % 24,
        "minute": seconds // 60 % 60,
        "second": seconds % 60,
        "msec": ticks % 100 * 10,
    }
    log = Log.from_dataframe(pd.DataFrame({**clock, "torque": SOUND["torque"], "angle": SOUND["angle"]}))
    even(log)
    assert "'hour', 'minute', 'second' and 'msec' are one time" in log.warnings[0]


@pytest.mark.parametrize(("heading", "bits", "tick"), [("micros", 32, 1e-6), ("time_ms", 16, 1e-3)])
def test_a_counter_that_passes_its_end_goes_on(tmp_path, heading, bits, tick):
    ticks = np.round(SOUND["time"] / tick).astype(np.int64) + 2**bits - round(1.0 / tick)
    log = Log.read(csv(tmp_path, ticks % 2**bits, heading))
    even(log)
    assert any(f"passes the end of its {bits} bits" in reported for reported in log.warnings)


def test_a_time_that_begins_anew_is_no_counter_at_its_end(tmp_path):
    ticks = np.tile(np.arange(150) * 10, 2)
    log = Log.read(csv(tmp_path, ticks, "time_ms"))
    assert len(log.runs) == 2
