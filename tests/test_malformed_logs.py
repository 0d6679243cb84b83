"""Logs that cannot be used: one sentence that says where and what to do, exit code 2, no traceback, nothing written."""

from __future__ import annotations

import io
import pickle
import re
import warnings

import numpy as np
import pandas as pd
import pytest
from front_door import antidrive, listing
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from sample_logs import motion, text
from scipy.io import savemat

from identification.errors import MalformedLog
from identification.log import Log
from plant.errors import AntidriveError

SOUND = motion(counts=65536)
N = len(SOUND["time"])
TABLE = text(SOUND)
LINES = TABLE.splitlines()


def spoilt(**changes):
    """The sound log with some columns replaced, left out (None), or changed at an index ({index: value})."""
    columns = {name: values.copy() for name, values in SOUND.items() if name != "velocity"}
    for name, change in changes.items():
        if change is None:
            del columns[name]
        elif isinstance(change, dict):
            for index, value in change.items():
                columns[name][index] = value
        else:
            columns[name] = np.asarray(change)
    return columns


def lines(**changes):
    """The sound CSV file with some lines (counted from 1, as `line12=...`) replaced."""
    new = list(LINES)
    for name, line in changes.items():
        new[int(name[4:]) - 1] = line
    return "\n".join(new) + "\n"


def mat(columns):
    file = io.BytesIO()
    savemat(file, columns)
    return file.getvalue()


def npz(columns):
    file = io.BytesIO()
    np.savez(file, **columns)
    return file.getvalue()


def parquet(columns):
    file = io.BytesIO()
    pd.DataFrame(columns).to_parquet(file)
    return file.getvalue()


TIME = SOUND["time"]
GONE = np.random.default_rng(0).random(N)  # cells that are empty here and there are no slower rate
HALF_GONE = np.where(GONE < 0.45, np.nan, SOUND["torque"])
RUNS = np.repeat([1.0, 2.0], N // 2)

# name -> (suffix, content: columns for a CSV file, text or bytes, what the sentence must say)
BAD = {
    # files
    "empty": (".csv", b"", ["empty"]),
    "of-another-kind": (".jpg", b"\xff\xd8\xff\xe0\0\x10JFIF\0", ["not a text table", "JSON", "Parquet"]),
    "cut-excel": (".xlsx", b"PK\x03\x04", ["not a readable .xlsx"]),
    "old-excel": (".xls", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600), [".xlsx or .csv"]),
    "ros-1-bag": (".bag", b"#ROSBAG V2.0\n" + bytes(600), ["rostopic echo"]),
    "ros-2-bag-in-sqlite": (".db3", b"SQLite format 3\0" + bytes(600), ["ros2 bag convert"]),
    "pickle": (".pkl", pickle.dumps({"time": [0.0, 1.0]}), ["never loaded", ".parquet"]),
    "blank": (".csv", "\n\n  \n", ["no table of numbers"]),
    "prose": (".csv", "Dear colleague,\nthe log is attached.\n", ["no table of numbers"]),
    "html": (".csv", "<!DOCTYPE html>\n<html><body><p>404, Not Found</p></body></html>\n", ["no table of numbers"]),
    "binary-csv": (".csv", bytes(range(256)) * 20, ["not a text table"]),
    "cut-parquet": (".parquet", parquet(SOUND)[:2000], ["not a readable .parquet"]),
    "cut-mat": (".mat", mat(SOUND)[:2000], ["not a readable .mat"]),
    "cut-npz": (".npz", npz(SOUND)[:2000], ["not a readable .npz"]),
    "hdf5-head-only": (".mat", b"MATLAB 7.3 MAT-file".ljust(512) + b"\x89HDF\r\n\x1a\n", ["not a readable .mat"]),
    "mat-of-scalars": (".mat", mat({"gain": 3.0}), ["no numeric columns"]),
    "npz-of-objects": (".npz", npz({"time": np.array([{}, {}], dtype=object)}), ["no numeric columns"]),
    # tables
    "header-only": (".csv", "time,torque,angle\n", ["no table of numbers"]),
    "no-header": (".csv", "\n".join(LINES[1:]), ["'angle'", "\n  4 "]),
    "header-too-short": (".csv", lines(line1="time,torque,angle"), ["line 2", "4 columns", "names above has 3"]),
    "row-too-long": (".csv", lines(line301="1,2,3,4,5"), ["line 301", "5 cells", "give 4"]),
    "rows-too-short": (
        ".csv",
        lines(**{f"line{k}": LINES[k - 1].split(",")[0] for k in range(301, 320)}),
        ["row 300 (line 301), t = 1.495 s", "'torque' is not a number in 19 of 600"],
    ),
    "open-quote": (".csv", lines(line301='1.495,"0.2,0.1,0.1'), ["line 301", "quotation mark"]),
    "word-in-a-cell": (".csv", lines(line301="1.495,oops,0.1,0.1"), ["row 300 (line 301)", "'torque'", "'oops'"]),
    "decimal-comma-in-one-cell": (".csv", lines(line301='1.495,"0,5",0.1,0.1'), ["'torque'", "is not a number"]),
    "scope-time-goes-back": (
        ".csv",
        "Name\tangle\tName\ttorque\n" + "\n".join(f"{k}\t0.1\t{k % 70}\t0.1" for k in range(100)),
        ["time of channel 'torque' does not increase"],
    ),
    "scope-text": (
        ".csv",
        "Name\tangle\tName\ttorque\n" + "\n".join(f"{k}\t0.1\t{k}\t{'EOF' if k == 9 else 1}" for k in range(100)),
        ["holds text"],
    ),
    # columns
    "no-time": (".csv", spoilt(time=None), ["recognised as 'time'", "--rate HZ"]),
    "no-output": (".csv", spoilt(angle=None), ["'angle'", "'position'", "--map angle="]),
    "no-command": (".csv", spoilt(torque=None), ["'torque'", "'setpoint'", "--map torque="]),
    "foreign-names": (".csv", {"t": TIME, "vir": SOUND["torque"], "qm": SOUND["angle"]}, ["qm", "--map angle="]),
    "force-on-a-rotary-axis": (
        ".csv",
        spoilt(torque=None, force=SOUND["torque"]),
        ["'force' does not go with 'angle'"],
    ),
    "lengths-differ": (".npz", npz(SOUND | {"torque": SOUND["torque"][:-7]}), ["'torque' has 593", "time has 600"]),
    "column-of-words": (".parquet", parquet({**SOUND, "angle": ["far"] * N}), ["'angle'", "'far' is not a number"]),
    "angle-as-dates": (
        ".parquet",
        parquet({**SOUND, "angle": pd.Timestamp("2026-01-01") + pd.to_timedelta(TIME, unit="s")}),
        ["'angle'", "plain numbers"],
    ),
    "complex-torque": (".npz", npz(SOUND | {"torque": SOUND["torque"] * 1j}), ["'torque'"]),
    # time
    "time-at-random": (
        ".csv",
        spoilt(time=np.random.default_rng(0).permutation(TIME)),
        ["row 2 (line 3)", "goes back from 0 s", "of 600 rows", "'run'"],
    ),
    "run-in-each-row": (".csv", spoilt(run=TIME), ["'run'", "600 labels in 600 rows"]),
    "time-repeats-at-random": (
        ".csv",
        spoilt(time=np.repeat(0.01 * np.arange(N), np.random.default_rng(0).geometric(0.1, N))[:N]),
        ["repeat the time", "more digits"],
    ),
    "time-stands-still": (".csv", spoilt(time=0 * TIME), ["repeat the time"]),
    "time-missing-in-a-row": (".csv", spoilt(time={7: np.nan}), ["row 8 (line 9)", "time is not a number"]),
    "time-infinite": (".npz", npz(spoilt(time={-1: np.inf})), ["row 600", "time is not a number"]),
    "milliseconds": (".csv", spoilt(time=1e3 * TIME), ["sample time of 5 s", "--unit time=ms"]),
    "microseconds": (".csv", spoilt(time=1e6 * TIME), ["sample time of 5e+03 s", "--unit time=us"]),
    "picosecond-clock": (".csv", spoilt(time=1.7e21 + 5e9 * np.arange(N)), ["1e+12 s", "--unit time="]),
    "mega-sampling": (".csv", spoilt(time=1e-6 * TIME), ["faster than any servo log", "with --unit time=UNIT"]),
    "seconds-called-microseconds": (".csv", spoilt(time=None, time_us=TIME), ["for example --unit time=s"]),
    "ends-too-soon": (".csv", {name: v[:30] for name, v in SOUND.items()}, ["30 samples", "too short", "at least 50"]),
    "a-tenth-of-a-second": (".csv", spoilt(time=2e-2 * TIME), ["0.0599 s", "too short"]),
    "all-runs-too-short": (".csv", spoilt(run=np.arange(N) // 20), ["run 0", "20 samples", "too short"]),
    # values
    "torque-half-missing": (".csv", spoilt(torque=HALF_GONE), ["'torque' is not a number in 244 of 599", "repair"]),
    "torque-all-missing": (".npz", npz(spoilt(torque=np.full(N, np.nan))), ["'torque' is not a number in 600 of 600"]),
    "angle-mostly-missing": (
        ".csv",
        spoilt(angle=np.where(np.arange(N) % 50 < 20, SOUND["angle"], np.nan)),
        ["'angle'", "export the channel again"],
    ),
    "rows-of-nothing": (".csv", "time,torque,angle\n0,0,0\n0.01,0,0\n" + ",,\n" * 100, ["2 samples", "too short"]),
    "impossible-torque": (".csv", spoilt(torque={50: 1e30}), ["row 51 (line 52)", "1e+30", "no drive"]),
    "impossible-angle": (".csv", spoilt(angle={50: -1e30}), ["row 51 (line 52)", "-1e+30"]),
    "nothing-happens": (".csv", spoilt(torque=0 * TIME, angle=0 * TIME), ["'torque' nor 'angle' ever changes"]),
    "held-still": (".csv", spoilt(torque=0 * TIME + 2.0, angle=0 * TIME + 1.0), ["ever changes", "moves the load"]),
    "one-pinion": (".csv", spoilt(torque=None, torque_1=SOUND["torque"]), ["'torque_1' and 'torque_2'"]),
    "a-negative-gain": (".csv", spoilt(torque=None, setpoint=SOUND["angle"], kp=0 * TIME - 2.0), ["negative gain"]),
    "a-gain-of-nothing": (".csv", spoilt(torque=None, setpoint=SOUND["angle"], kp=0 * TIME), ["zero throughout"]),
    # units
    "degrees-beside-rad/s": (".csv", SOUND | {"angle": np.rad2deg(SOUND["angle"])}, ["57.3", "--unit angle=deg"]),
    "deg/s-beside-radians": (".csv", SOUND | {"velocity": np.rad2deg(SOUND["velocity"])}, ["--unit velocity=deg/s"]),
    "rpm-beside-radians": (".csv", SOUND | {"velocity": SOUND["velocity"] * 30 / np.pi}, ["--unit velocity=rpm"]),
    "turns-beside-rad/s": (".csv", SOUND | {"angle": SOUND["angle"] / (2 * np.pi)}, ["--unit angle=turn"]),
    "fast-milliseconds": (".csv", SOUND | {"time": 40 * TIME, "velocity": 25 * SOUND["velocity"]}, ["--unit time=ms"]),
    "millimetres": (
        ".csv",
        {"time": TIME, "force": SOUND["torque"], "position": 1e3 * SOUND["angle"], "velocity": SOUND["velocity"]},
        ["--unit position=mm"],
    ),
}


def spoil(folder, name):
    suffix, content, _ = BAD[name]
    path = folder / f"{name.replace('/', '-')}{suffix}"
    if isinstance(content, dict):
        content = text(content)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def check_sentence(message):
    """One sentence, with something in it that a reader can act upon; the columns of the file may be listed below."""
    assert message == message.strip()
    message, *lines = message.splitlines()
    assert all(line.startswith(("  ", "Name them")) for line in lines)
    assert message.endswith(".")
    assert len(message) < 400
    assert not re.search(r"[a-z]\. [A-Z]", message), "one sentence"
    assert "Traceback" not in message
    assert "Error" not in re.sub(r"\(\w+Error\)", "", message)


def test_there_are_many():
    assert len(BAD) >= 60


@pytest.mark.parametrize("name", BAD)
def test_refused_in_one_sentence(tmp_path, name):
    path = spoil(tmp_path, name)
    with pytest.raises(MalformedLog) as caught:
        Log.read(path)
    message = str(caught.value)
    check_sentence(message)
    assert message.startswith(path.name)
    for part in BAD[name][2]:
        assert part in message


@pytest.mark.parametrize(
    ("channels", "message"),
    [
        ({"time": [0.0, 1.0, [2.0, 3.0]]}, "'time' is ragged"),
        ({"time": 0.0}, "has shape ()"),
        ({"time": TIME[:, None]}, "has shape (600, 1)"),
        ({"angle": SOUND["angle"][:-1]}, "has 599 samples"),
        ({"torque": np.full(N, None)}, "is not a number in 600 of 600"),
        ({"torque": np.zeros(N, dtype=[("a", float)])}, "plain numbers"),
        ({"time": [], "torque": [], "angle": [], "velocity": []}, "no rows"),
        ({"angel": SOUND["angle"]}, "no channel 'angel'"),
    ],
)
def test_arrays_are_refused_alike(channels, message):
    with pytest.raises(AntidriveError) as caught:
        Log.from_arrays(**SOUND | channels)
    check_sentence(str(caught.value))
    assert message in str(caught.value)


def test_missing_files_and_folders(tmp_path):
    (tmp_path / "folder.csv").mkdir()
    for path, message in ((tmp_path / "gone.csv", "no such file"), (tmp_path / "folder.csv", "cannot be opened")):
        with pytest.raises(MalformedLog, match=message) as caught:
            Log.read(path)
        check_sentence(str(caught.value))
    with pytest.raises(AntidriveError, match="at least one file"):
        Log.read([])


def test_one_bad_file_among_good_ones_is_named(tmp_path):
    good = tmp_path / "good.csv"
    good.write_text(TABLE)
    with pytest.raises(MalformedLog, match=r"^word-in-a-cell\.csv, row 300"):
        Log.read([good, spoil(tmp_path, "word-in-a-cell")])


@pytest.mark.parametrize("command", ["identify", "diagnose"])
@pytest.mark.parametrize(
    "name", ["prose", "cut-mat", "row-too-long", "word-in-a-cell", "no-output", "milliseconds", "degrees-beside-rad/s"]
)
def test_the_command_line_reports_it_and_writes_nothing(tmp_path, command, name):
    path = spoil(tmp_path, name)
    before = listing(tmp_path)
    result = antidrive(command, path, "--out", tmp_path / "out")
    assert result.code == 2
    assert result.out == ""
    assert result.err.startswith("antidrive: ")
    check_sentence(result.err.removeprefix("antidrive: ").strip())
    assert "Traceback" not in result.err
    assert all(part in result.err for part in BAD[name][2])
    assert listing(tmp_path) == before


def judged(content: bytes, folder) -> None:
    """Whatever the file holds, it gives a log whose channels are numbers, or one sentence; never a warning."""
    path = folder / "fuzz.csv"
    path.write_bytes(content)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            log = Log.read(path)
        except AntidriveError as error:
            check_sentence(str(error))
        else:
            for run in log.runs:
                assert np.isfinite(run.output).all()
                assert np.all(np.diff(run.time) > 0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("fuzz")


CELLS = st.one_of(
    st.sampled_from(["", "0", "-1", "nan", "inf", "-inf", "1e999", "1e-320", "0,5", "1.234,5", '"', "'", "#", "oops",
                     "True", "2026-01-01T00:00:00", "12:30:01", "0x1F", "1_000", "99999999999999999999999"]),
    st.floats().map(repr),
    st.text(max_size=4),
)  # fmt: skip


@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    rows=st.lists(st.tuples(st.integers(0, 120), st.integers(0, 4), CELLS), max_size=5),
    separator=st.sampled_from([",", ";", "\t", "|", " "]),
    preamble=st.lists(st.text(max_size=20), max_size=3),
    cut=st.integers(0, 60),
)
def test_fuzzed_cells(folder, rows, separator, preamble, cut):
    """A sound table in which some cells, header included, hold anything."""
    table = [line.split(",") for line in LINES[:120]]
    for row, column, cell in rows:
        line = table[row % 120]
        line[column % len(line)] = cell
        if column == 4:
            line.append(cell)
    content = "\n".join([*preamble, *(separator.join(line) for line in table)])
    judged(content[: len(content) - cut].encode("utf-8", "replace"), folder)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.one_of(st.binary(max_size=300), st.text(alphabet='0123456789.,;\t \n"eE+-#|naifmtgeloqru\r', max_size=300)))
@example("time,torque,angle\n0,1,")
@example("time,torque,angle\r0,1,2")
@example('"time","torque"\n"0","1"\n')
@example("time;torque;angle\n0;0;0\n\x1c1;1;1\n")
def test_fuzzed_text(folder, content):
    judged(content if isinstance(content, bytes) else content.encode(), folder)


@settings(max_examples=40, derandomize=True, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.sampled_from([(".mat", mat(SOUND)), (".npz", npz(SOUND)), (".parquet", parquet(SOUND))]),
    st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 255)), min_size=1, max_size=4),
)
def test_flipped_bytes(folder, file, flips):
    """A damaged binary file is read as what it still says, or refused.

    The same damage each time: on some files the process ends in SciPy's own reader of MATLAB files.
    """
    suffix, content = file
    damaged = bytearray(content)
    for place, value in flips:
        damaged[int(place * len(damaged))] = value
    path = folder / f"damaged{suffix}"
    path.write_bytes(bytes(damaged))
    try:
        Log.read(path)
    except AntidriveError as error:
        check_sentence(str(error))
