"""The commands of the how-to pages, run on a file of that kind as its own tool writes it."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from front_door import antidrive
from measurement_logs import scope
from sample_logs import motion
from test_codesys import trace

from identification import Log, MalformedLog
from identification.reading.files import read_table

PAGES = Path(__file__).parents[1] / "docs" / "howto"
SAMPLES = motion()
TIME, TORQUE, ANGLE, VELOCITY = (SAMPLES[name] for name in ("time", "torque", "angle", "velocity"))
TURN = 2.0 * np.pi
HEADER = "builtin_interfaces/Time stamp\nstring frame_id\n"
JOINTS = (
    "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
    f"{'=' * 80}\nMSG: std_msgs/Header\n{HEADER}{'=' * 80}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
)


def csv(path: Path, columns: dict[str, np.ndarray]) -> None:
    pd.DataFrame(columns).to_csv(path, index=False)


def bag(path: Path) -> None:
    """`ros2 bag record -s mcap /joint_states`, of a driver that publishes no velocity."""
    writer = pytest.importorskip("mcap_ros2.writer")
    with path.open("wb") as stream:
        file = writer.Writer(stream)
        schema = file.register_msgdef("sensor_msgs/msg/JointState", JOINTS)
        for time, torque, angle in zip(TIME, TORQUE, ANGLE, strict=True):
            stamp = 1_700_000_000_000_000_000 + round(1e9 * time)
            header = {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": ""}
            pair = {"position": [0.1, angle], "velocity": [], "effort": [0.0, torque]}
            message = {"header": header, "name": ["shoulder", "elbow"], **pair}
            file.write_message("/joint_states", schema, message, log_time=stamp + 10**5, publish_time=stamp)
        file.finish()


def twincat(path: Path) -> None:
    names = {"time": TIME, "Axis 1.TorqueCommand": TORQUE, "Axis 1.ActPos": np.degrees(ANGLE)}
    path.write_text(scope([names]))


def codesys(path: Path) -> None:
    times = np.round(TIME, 3)
    path.write_text(trace({"Axis.fSetTorque": (times, TORQUE), "Axis.fActPosition": (times, np.degrees(ANGLE))}))


def matlab(path: Path) -> None:
    """Columns, as MATLAB keeps them, and a simulation output in a struct."""
    from scipy.io import savemat

    if path.name == "out.mat":
        savemat(path, {"out": {"tout": TIME[:, None], "yout": np.column_stack((TORQUE, ANGLE))}})
    else:
        savemat(path, {"t": TIME[:, None], "tau": TORQUE[:, None], "q": ANGLE[:, None]})


def drive(path: Path) -> None:
    counts = np.round(ANGLE / TURN * 131072)
    csv(path, {"time": TIME, "6071h Target torque": np.round(TORQUE / 2.4e-3), "6064h Position actual value": counts})


def oscilloscope(path: Path) -> None:
    rows = "".join(f"{t:.6e},{u / 0.5:.6g},{a / 0.3:.6g}\n" for t, u, a in zip(TIME - 1.5, TORQUE, ANGLE, strict=True))
    path.write_text(f"Model,MSO44\nVertical Units,V,V\nSample Interval,0.005\n\nTIME,CH1,CH2\n{rows}")


WRITERS = {
    ("ros", "recording.mcap"): bag,
    ("twincat", "scope.csv"): twincat,
    ("twincat", "motion.trace"): codesys,
    ("matlab", "log.mat"): matlab,
    ("matlab", "out.mat"): matlab,
    ("cia402", "drive.csv"): drive,
    ("oscilloscope", "scope.csv"): oscilloscope,
}


def commands(page: str) -> list[list[str]]:
    """The words of `antidrive inspect` lines that read a file which is there."""
    lines = re.findall(r"^antidrive (inspect .*)$", (PAGES / f"{page}.md").read_text("utf-8"), re.MULTILINE)
    return [shlex.split(line) for line in lines]


def read(folder: Path, words: list[str]) -> Log:
    result = antidrive(*words, "--out", folder / "out")
    assert result.code == 0, result.err
    again = antidrive("identify", folder / "out" / "log.toml", "--out", folder / "fit", "--quiet")
    assert again.code == 0, again.err
    return result


@pytest.mark.parametrize(("page", "file"), WRITERS)
def test_the_page_reads_a_file_of_its_kind(page, file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    WRITERS[page, file](tmp_path / file)
    (words,) = [words for words in commands(page) if words[1] == file]
    result = read(tmp_path, words)
    assert "used as" in result.out
    assert "Log(1 run, 600 samples, 200 Hz, 3.00 s, rotary), command in N m" in result.out


SERVOS = {
    "ODrive": {"pos_estimate": ANGLE / TURN, "Iq_setpoint": TORQUE / 0.08, "Iq_measured": TORQUE / 0.08 + 0.01},
    "moteus": {"position": ANGLE / TURN, "torque": TORQUE},
    "Dynamixel, current mode": {
        "present_position": np.round(ANGLE / TURN * 4096),
        "goal_current": np.round(TORQUE / 0.08 / 2.69e-3),
    },
    "Dynamixel, position mode": {
        "present_position": np.round(ANGLE / TURN * 4096),
        "goal_position": np.round((ANGLE + 0.05 * TORQUE) / TURN * 4096),
    },
}


@pytest.mark.parametrize("servo", SERVOS)
def test_the_options_of_a_small_servo_read_its_log(servo, tmp_path):
    rows = re.findall(r"^\| ([^|]+) \| [^|]+ \| `([^|]+)` \|$", (PAGES / "small_servos.md").read_text("utf-8"), re.M)
    options = dict(rows)[servo].replace("KT", "0.08").split()
    csv(tmp_path / "log.csv", {"time": TIME, **SERVOS[servo]})
    result = read(tmp_path, ["inspect", str(tmp_path / "log.csv"), *options])
    assert "recognised as" not in result.err
    assert "600 samples" in result.out


def test_a_velocity_in_turns_is_identified_by_its_factor(tmp_path):
    csv(tmp_path / "log.csv", {"time": TIME, "angle": ANGLE, "torque": TORQUE, "velocity": VELOCITY / TURN})
    assert "--unit velocity=turn/s" in antidrive("inspect", tmp_path / "log.csv", "--out", tmp_path / "out").out


def test_turns_and_revolutions_per_minute_are_told_from_degrees(tmp_path):
    """1/60 is near pi/180: with degrees per second alone, the angle would be wrong by 2 pi."""
    csv(tmp_path / "log.csv", {"time": TIME, "angle": ANGLE / TURN, "torque": TORQUE, "velocity": VELOCITY * 60 / TURN})
    result = antidrive("inspect", tmp_path / "log.csv", "--out", tmp_path / "out")
    assert result.code == 2
    assert "try --unit angle=turn --unit velocity=rpm, or" in result.err


def test_a_unit_in_a_heading_is_not_doubted_for_its_factor(tmp_path):
    csv(tmp_path / "log.csv", {"time": TIME, "angle_rad": ANGLE, "torque": TORQUE, "velocity_rad_s": VELOCITY * TURN})
    result = antidrive("inspect", tmp_path / "log.csv", "--out", tmp_path / "out")
    assert (result.code, "--unit angle=" in result.out) == (0, False)
    assert "moves 0.1592 times as fast as 'velocity_rad_s' says, so the velocity is not used" in result.out


def test_the_velocity_shows_the_sampling_rate(tmp_path):
    csv(tmp_path / "log.csv", {"angle": ANGLE, "torque": TORQUE, "velocity": VELOCITY})
    true = 1.0 / (TIME[1] - TIME[0])
    told = [
        antidrive("inspect", tmp_path / "log.csv", "--rate", k * true, "--out", tmp_path / "out") for k in (1, 1.18)
    ]
    assert ["they agree" in result.out for result in told] == [False, True]
    (rate,) = re.findall(r"with --rate (\S+) they agree", told[1].out)
    assert float(rate) == pytest.approx(true, rel=0.01)


def test_the_set_point_of_a_speed_is_refused(tmp_path):
    csv(tmp_path / "log.csv", {"time": TIME, "angle": ANGLE, "commanded_deg_s": VELOCITY})
    result = antidrive("inspect", tmp_path / "log.csv", "--map", "setpoint=commanded_deg_s", "--out", tmp_path / "out")
    assert result.code == 2
    assert "'commanded_deg_s' is the set-point of a speed" in result.err


def test_a_torque_with_fractions_is_no_per_mille_of_a_drive(tmp_path):
    csv(tmp_path / "log.csv", {"time": TIME, "angle": ANGLE, "Target Torque": TORQUE})
    result = antidrive("inspect", tmp_path / "log.csv", "--out", tmp_path / "out")
    assert result.code == 2
    assert "'Target Torque' is called like an object of CiA 402 (6071h), but has no whole numbers" in result.err
    current = antidrive("inspect", tmp_path / "log.csv", "--map", "current=Target Torque", "--out", tmp_path / "out")
    assert current.code == 0


def test_joints_with_short_names_are_counted(tmp_path):
    joints = {f"{name}{k}": v + k for name, v in (("pos", ANGLE), ("cur", TORQUE)) for k in (1, 2, 3)}
    csv(tmp_path / "log.csv", {"time": TIME, **joints})
    assert "the log has 3 joints" in antidrive("inspect", tmp_path / "log.csv", "--out", tmp_path / "out").err
    result = antidrive("inspect", tmp_path / "log.csv", "--joint", "2", "--out", tmp_path / "out")
    assert (result.code, "command in A" in result.out) == (0, True)


def test_rigol_and_tektronix_write_tables_of_their_own(tmp_path):
    """Rigol counts the samples; Tektronix writes its settings beside the numbers, a file for each channel."""
    place = tmp_path / "rigol.csv"
    lines = [f"{k},{u:.6e},{a:.6e}," for k, (u, a) in enumerate(zip(TORQUE, ANGLE, strict=True))]
    place.write_text("\n".join(["X,CH1,CH2,Start,Increment,", "Sequence,Volt,Volt,-1.5e+00,5.0e-03", *lines]) + "\n")
    table = read_table(place)
    np.testing.assert_allclose(table.columns["Time"], TIME - 1.5, atol=1e-9)
    np.testing.assert_allclose(table.columns["CH2"], ANGLE, rtol=1e-6, atol=1e-12)
    assert table.units == {"Time": "s", "CH1": "Volt", "CH2": "Volt"}
    for name, values in (("CH1", TORQUE), ("CH2", ANGLE)):
        keys = [("Record Length", "6.0e+02"), ("Source", name), ("Vertical Units", "V"), ("Probe Atten", "1")]
        keys += [("", "")] * (len(TIME) - len(keys))
        rows = zip(keys, TIME - 1.5, values, strict=True)
        text = "".join(f"{key},{value},,{t:.9f},  {number:.9f},\n" for (key, value), t, number in rows)
        (tmp_path / f"{name}.csv").write_text(text)
    log = Log.read(
        [tmp_path / "CH1.csv", tmp_path / "CH2.csv"],
        mapping={"torque": "CH1", "angle": "CH2"},
        scales={"torque": 1.0, "angle": 1.0},
    )
    np.testing.assert_allclose(log.runs[0].output, ANGLE, atol=1e-6)
    np.testing.assert_allclose(log.runs[0].time, TIME, atol=1e-6)


def test_a_rigol_without_a_time_column_is_read(tmp_path):
    place, rows = tmp_path / "rigol.csv", list(zip(TORQUE, ANGLE, strict=True))
    old = ["CH1,CH2,Start,Increment,", "Volt,Volt,-1.5e+00,5.0e-03,", *(f"{u:.6e},{a:.6e}," for u, a in rows)]
    new = ["CH1V,CH2V,t0 =-1.5s, tInc = 0.005s,", *(f"{u:.6e},{a:.6e},," for u, a in rows)]
    for lines in (old, new):
        place.write_text("\n".join(lines) + "\n")
        table = read_table(place)
        np.testing.assert_allclose(table.columns["Time"], TIME - 1.5, atol=1e-9)
        np.testing.assert_allclose(table.columns["CH2"], ANGLE, rtol=1e-6, atol=1e-12)
        assert table.units["CH1"] in ("Volt", "V")


YOKOGAWA = {
    "Header Size": "15",
    "Model Name": "DLM2024",
    "Comment": "axis 2, slow",
    "BlockNumber": "1",
    "TraceName": "CH1,CH2",
    "BlockSize": "SIZE,SIZE",
    "VUnit": "V,V",
    "SampleRate": "2.0E+02,2.0E+02",
    "HResolution": "5.0E+00,5.0E+00",
    "HOffset": "-1.5E+03,-1.5E+03",
    "HUnit": "ms,ms",
    "DisplayBlockSize": "SIZE,SIZE",
    "DisplayPointNo.": "1,1",
    "Date": "2024/05/15",
    "Time": "19:12:02.5",
}


def yokogawa(size: int, rows: list[str], quoted: bool = False, **changes: str) -> str:
    """As the manuals of the DL9000, DL6000 and DLM3000 describe the header."""
    head = {key: value.replace("SIZE", str(size)) for key, value in (YOKOGAWA | changes).items()}
    lines = [f'"{key}",{value}' if quoted else f"{key},{value}" for key, value in head.items()]
    return "\n".join([*lines, "", *rows, ""])


@pytest.mark.parametrize("quoted", [False, True])
def test_a_yokogawa_is_read_by_resolution_and_offset(quoted, tmp_path):
    place, rows = tmp_path / "dl.csv", [f",{u:.6e},{a:.6e}" for u, a in zip(TORQUE, ANGLE, strict=True)]
    options = {"mapping": {"torque": "CH1", "angle": "CH2"}, "scales": {"torque": 1.0, "angle": 1.0}}
    place.write_text(yokogawa(len(rows), rows, quoted))
    log = Log.read(place, **options)
    np.testing.assert_allclose(log.runs[0].time, TIME - 1.5, atol=1e-9)
    np.testing.assert_allclose(log.runs[0].output, ANGLE, rtol=1e-6, atol=1e-12)
    half = len(rows) // 2
    place.write_text(yokogawa(half, [*rows[:half], "", *rows[half : 2 * half]], BlockNumber="2"))
    parts = Log.read(place, **options)
    assert [len(run) for run in parts.runs] == [half, half]
    np.testing.assert_allclose(parts.runs[1].output, ANGLE[half : 2 * half], rtol=1e-6, atol=1e-12)
    place.write_text(yokogawa(len(rows), rows, HResolution="5.0,10.0"))
    with pytest.raises(MalformedLog, match="the traces differ in HResolution"):
        Log.read(place, **options)


def test_a_tachometer_in_volts_is_refused_with_what_to_give(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    oscilloscope(tmp_path / "scope.csv")
    words = ("inspect", "scope.csv", "--map", "torque=CH1", "--scale", "torque=0.5", "--map", "velocity=CH2")
    result = antidrive(*words, "--out", "out")
    assert result.code == 2
    assert "give the size of one V with --scale velocity=" in result.err
    assert antidrive(*words, "--scale", "velocity=10", "--out", "out").code == 0
