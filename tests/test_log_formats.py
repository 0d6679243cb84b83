"""Logs in every format, with other names, units, separators and runs, come out as the same SI channels."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import h5py
import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sample_logs import motion, text, write
from scipy.io import savemat

from identification.errors import MalformedLog
from identification.log import Log, Run
from plant.errors import BadParameter

SOUND = motion(counts=65536)


def same(log, columns=SOUND, atol=1e-8):
    (run,) = log.runs
    np.testing.assert_allclose(run.time, columns["time"], atol=atol)
    np.testing.assert_allclose(run.command, columns["torque"], rtol=1e-7, atol=atol)
    np.testing.assert_allclose(run.output, columns["angle"], atol=atol)
    np.testing.assert_allclose(run.velocity, columns["velocity"], rtol=1e-7, atol=atol)
    assert run.valid.all()
    assert log.repairs == ()


@pytest.mark.parametrize("separator", [",", ";", "\t", "|", " "])
def test_csv_separators(tmp_path, separator):
    path = write(tmp_path / "log.csv", SOUND, separator=separator)
    log = Log.read(path)
    same(log)
    assert log.warnings == ()
    assert log.sources[0].file == "log.csv"
    assert log.sources[0].sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.parametrize("separator", [";", "\t", "|"])
def test_decimal_comma(tmp_path, separator):
    same(Log.read(write(tmp_path / "log.csv", SOUND, separator=separator, decimal=",")))


def test_quoted_decimal_comma_in_a_comma_table(tmp_path):
    rows = [",".join(f'"{value:.9f}"'.replace(".", ",") for value in row) for row in zip(*SOUND.values(), strict=True)]
    (tmp_path / "log.csv").write_text("\n".join([",".join(SOUND), *rows]))
    same(Log.read(tmp_path / "log.csv"))


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_encodings_and_line_ends(tmp_path, encoding, newline):
    content = text(SOUND | {"température": SOUND["time"]}).replace("\n", newline)
    (tmp_path / "log.csv").write_bytes(content.encode(encoding))
    same(Log.read(tmp_path / "log.csv"))


def test_preamble_comments_and_units_line(tmp_path):
    names, rest = text(SOUND, separator=";").split("\n", 1)
    preamble = "# a recorder\nStation;7\n\n"
    (tmp_path / "log.csv").write_text(f"{preamble}{names}\ns;N m;rad;rad/s\n{rest}")
    log = Log.read(tmp_path / "log.csv")
    same(log)
    assert "units from the file: 'time' in s, 'torque' in N m" in log.warnings[0]


def test_cut_off_last_line_is_left_out_and_reported(tmp_path):
    (tmp_path / "log.csv").write_text(text(SOUND) + "3.0,0.1")
    log = Log.read(tmp_path / "log.csv")
    same(log)
    assert "cut off" in log.warnings[0]


def test_scope_export_with_a_time_for_each_channel(tmp_path):
    """Tab separated, decimal commas, milliseconds, channels sampled at instants of their own."""
    time, late = 1e3 * SOUND["time"], 1e3 * SOUND["time"] + 1.0
    shifted = np.interp(late, time, SOUND["torque"])
    head = "Name\tscope\nFile\tx.tcscopex\n\nName\tangle\tName\ttorque\nSampleTime[ms]\t5\tSampleTime[ms]\t5\n"
    rows = [
        "\t".join(f"{value:.9f}".replace(".", ",") for value in row)
        for row in zip(time, SOUND["angle"], late, shifted, strict=True)
    ]
    (tmp_path / "scope.csv").write_text(head + "\n".join(rows) + "\n")
    log = Log.read(tmp_path / "scope.csv", units={"time": "ms"})
    (run,) = log.runs
    np.testing.assert_allclose(run.time, SOUND["time"][1:], atol=1e-9)  # the torque begins a millisecond late
    np.testing.assert_allclose(run.output, SOUND["angle"][1:], atol=1e-8)
    np.testing.assert_allclose(run.command[5:-5], SOUND["torque"][6:-5], atol=0.2)
    assert any("own time" in warning for warning in log.warnings)


def test_time_as_dates(tmp_path):
    frame = pd.DataFrame(SOUND)
    frame["time"] = (pd.Timestamp("2025-11-12T09:53:06Z") + pd.to_timedelta(SOUND["time"], unit="s")).astype(str)
    frame.to_csv(tmp_path / "log.csv", index=False)
    same(Log.read(tmp_path / "log.csv"))


def test_time_as_time_spans():
    same(Log.from_dataframe(pd.DataFrame(SOUND | {"time": pd.to_timedelta(SOUND["time"], unit="s")})))


def test_of_columns_with_one_name_the_first_counts(tmp_path):
    twice = text(SOUND | {"again": -SOUND["angle"]}).replace("again", "angle")
    (tmp_path / "log.csv").write_text(twice)
    same(Log.read(tmp_path / "log.csv"))


def test_parquet(tmp_path):
    pd.DataFrame(SOUND).to_parquet(tmp_path / "log.parquet")
    same(Log.read(tmp_path / "log.parquet"))


def test_npz_also_with_a_matrix(tmp_path):
    np.savez(tmp_path / "log.npz", **SOUND)
    same(Log.read(tmp_path / "log.npz"))
    np.savez(tmp_path / "matrix.npz", data=np.column_stack(list(SOUND.values())), rate=200.0)
    names = {name: f"data:{k + 1}" for k, name in enumerate(SOUND)}
    same(Log.read(tmp_path / "matrix.npz", mapping=names))
    np.savez(tmp_path / "wide.npz", data=np.stack(list(SOUND.values())))
    same(Log.read((tmp_path / "wide.npz").rename(tmp_path / "WIDE.NPZ"), mapping=names))


class Intruder:
    """An object that leaves a file behind where it is unpickled."""

    def __init__(self, target):
        self.target = str(target)

    def __reduce__(self):
        return open, (self.target, "w")


def test_a_pickled_object_is_never_loaded(tmp_path):
    np.savez(tmp_path / "log.npz", note=np.array([Intruder(tmp_path / "trace")] * 600), **SOUND)
    same(Log.read(tmp_path / "log.npz"))
    assert not (tmp_path / "trace").exists()


@pytest.mark.parametrize("nested", [False, True])
def test_mat_version_5(tmp_path, nested):
    savemat(tmp_path / "log.mat", {"record": SOUND} if nested else SOUND | {"gain": 3.0}, oned_as="column")
    same(Log.read(tmp_path / "log.mat"))


def test_mat_version_7_3(tmp_path):
    with h5py.File(tmp_path / "log.mat", "w") as file:
        for name, values in SOUND.items():
            file.create_dataset(name, data=values[None, :])  # MATLAB's column vectors arrive as rows
    same(Log.read(tmp_path / "log.mat"))


def test_dataframe_and_arrays():
    same(Log.from_dataframe(pd.DataFrame(SOUND)))
    same(Log.from_arrays(**SOUND))


def test_reading_leaves_the_callers_data_alone():
    given_columns = {name: values.copy() for name, values in SOUND.items()}
    given_columns["angle"][100] += 3.0
    before = given_columns["angle"].copy()
    Log.from_arrays(**given_columns)
    np.testing.assert_array_equal(given_columns["angle"], before)


UNITS = {
    "time": [("ms", 1e-3), ("us", 1e-6), ("s", 1.0)],
    "torque": [("mN m", 1e-3), ("Nm", 1.0), ("Ncm", 1e-2), ("kgf*cm", 0.0980665), ("lbf*inch", 0.1129848290276167)],
    "angle": [("deg", np.pi / 180), ("turn", 2 * np.pi), ("mrad", 1e-3), ("arcmin", np.pi / 10800)],
    "velocity": [("deg/s", np.pi / 180), ("rpm", np.pi / 30)],
}


@settings(max_examples=25, deadline=None)
@given(st.fixed_dictionaries({name: st.sampled_from(options) for name, options in UNITS.items()}))
def test_units(choice):
    inside = {name: values / choice[name][1] for name, values in SOUND.items()}
    same(Log.from_arrays(**inside, units={name: unit for name, (unit, _) in choice.items()}), atol=1e-7)


def test_mapping_and_scale():
    frame = pd.DataFrame({"t": SOUND["time"], "vir": SOUND["torque"] / 35.15, "q": np.rad2deg(SOUND["angle"])})
    log = Log.from_dataframe(
        frame, mapping={"time": "t", "torque": "vir", "angle": "q"}, units={"angle": "deg"}, scales={"torque": 35.15}
    )
    np.testing.assert_allclose(log.runs[0].command, SOUND["torque"])
    np.testing.assert_allclose(log.runs[0].output, SOUND["angle"])


def test_a_scale_comes_before_the_unit():
    """Counts: 0.1 degrees each."""
    counts = np.rad2deg(SOUND["angle"]) / 0.1
    log = Log.from_arrays(**SOUND | {"angle": counts}, scales={"angle": 0.1}, units={"angle": "deg"})
    np.testing.assert_allclose(log.runs[0].output, SOUND["angle"], atol=1e-12)


def test_column_names_in_other_case(tmp_path):
    same(Log.read(write(tmp_path / "log.csv", {name.title(): values for name, values in SOUND.items()})))


@pytest.mark.parametrize(
    "options",
    [
        {"units": {"angle": "kg"}},
        {"units": {"angle": "counts"}},
        {"units": {"angle": "furlongs?("}},
        {"units": {"torque": "permille"}},
        {"units": {"torque": "A"}},
        {"units": {"speed": "rad/s"}},
        {"units": {"goal": "deg"}},
        {"units": {"run": "s"}},
        {"scales": {"torque": 0.0}},
        {"scales": {"torque": float("nan")}},
        {"scales": {"current": 2.0}},
    ],
)
def test_options_that_do_not_fit(options):
    with pytest.raises(BadParameter) as caught:
        Log.from_arrays(**SOUND, **options)
    assert str(caught.value).endswith(".")
    assert "\n" not in str(caught.value)


@dataclass(frozen=True)
class Gears:
    torque_map: np.ndarray


def test_pinion_torques_become_the_followers():
    gears = Gears(np.array([-8.05, -8.05]))
    first, second = 0.1 + SOUND["torque"], -0.1 * np.cos(SOUND["time"])
    channels = {"time": SOUND["time"], "angle": SOUND["angle"], "torque_1": first, "torque_2": second}
    run = Log.from_arrays(**channels, gears=gears).runs[0]
    np.testing.assert_allclose(run.command, -8.05 * (first + second))
    np.testing.assert_array_equal(run.torques, np.column_stack([first, second]))
    added = Log.from_arrays(**channels)  # nobody has said a gear train: none is taken for granted
    np.testing.assert_allclose(added.runs[0].command, first + second)
    assert "no gear train is given" in added.notes[0]
    assert "--gears 20,20:161" in added.notes[0]


def test_linear_axis():
    log = Log.from_arrays(time=SOUND["time"], force=SOUND["torque"], position=0.1 * SOUND["angle"])
    assert (log.axis, log.command_unit) == ("linear", "N")
    np.testing.assert_allclose(log.runs[0].output, 0.1 * SOUND["angle"])
    in_millimetres = Log.from_arrays(
        time=SOUND["time"],
        force=SOUND["torque"],
        position=100 * SOUND["angle"],
        velocity=100 * SOUND["velocity"],
        units={"position": "mm", "velocity": "mm/s"},
    )
    np.testing.assert_allclose(in_millimetres.runs[0].output, 0.1 * SOUND["angle"])
    np.testing.assert_allclose(in_millimetres.runs[0].velocity, 0.1 * SOUND["velocity"])


def test_a_column_that_is_mapped_is_not_taken_twice(tmp_path):
    frame = pd.DataFrame(SOUND).rename(columns={"angle": "Position"})
    frame.to_csv(tmp_path / "log.csv", index=False)
    same(Log.read(tmp_path / "log.csv", mapping={"angle": "Position"}))


def test_goal_of_a_position_servo():
    log = Log.from_arrays(time=SOUND["time"], goal=SOUND["angle"] + 0.1, angle=SOUND["angle"])
    run = log.runs[0]
    assert (run.servo_gain == 1.0).all()
    np.testing.assert_array_equal(run.command, run.servo_gain * run.setpoint)
    assert "scale unknown" in log.notes[0]
    assert log.command_unit == "rad"
    torque = Log.from_arrays(**SOUND, goal=SOUND["angle"] + 0.1)
    assert torque.command_unit == "N m"
    np.testing.assert_array_equal(torque.runs[0].command, SOUND["torque"])
    assert (torque.runs[0].servo_gain == 0.0).all()
    with pytest.raises(MalformedLog, match="a command in rad"):
        Log.merge([torque, log])


def test_runs_have_states_and_times_of_their_own(tmp_path):
    two = {name: np.tile(values, 2) for name, values in SOUND.items()}
    two["run"] = np.repeat([7.0, 3.0], len(SOUND["time"]))
    log = Log.read(write(tmp_path / "log.csv", two))
    assert [(run.run, run.number) for run in log.runs] == [("7", 0), ("3", 1)]
    assert [run.label for run in log.runs] == ["log.csv run 7", "log.csv run 3"]
    for run in log.runs:
        np.testing.assert_allclose(run.output, SOUND["angle"], atol=1e-8)
    assert log.select([1]).runs[0].run == "3"
    assert len(log.head(1).runs) == 1
    with pytest.raises(BadParameter, match="place 2"):
        log.select([2])
    with pytest.raises(BadParameter, match="place -3"):
        log.select([-3])


def test_several_files_keep_run_numbers_apart(tmp_path):
    paths = [write(tmp_path / f"{name}.csv", SOUND) for name in "ab"]
    log = Log.read(paths)
    assert [run.number for run in log.runs] == [0, 1]
    assert [source.file for source in log.sources] == ["a.csv", "b.csv"]
    assert any("numbered anew" in note for note in log.notes)


def test_what_is_found_in_any_file_is_reported(tmp_path):
    spoilt = {name: values.copy() for name, values in SOUND.items()}
    spoilt["angle"][300] += 3.0
    paths = [write(tmp_path / "a.csv", SOUND), write(tmp_path / "b.csv", spoilt)]
    paths[1].write_text(paths[1].read_text() + "3.0,0.1")
    log = Log.read(paths)
    assert [text.split(" ")[0].rstrip(":,") for text in (*log.warnings, *log.repairs)] == ["b.csv", "b.csv"]
    assert "cut off" in log.warnings[0]


def test_the_parts_of_one_run_keep_one_number_among_files(tmp_path):
    long = motion(samples=2000)
    split = {name: np.concatenate((values[:500], values[1500:])) for name, values in long.items()}
    log = Log.read([write(tmp_path / "a.csv", split), write(tmp_path / "b.csv", SOUND)])
    assert [run.number for run in log.runs] == [0, 0, 1]


def test_one_run_at_rest_does_not_spoil_the_others():
    two = {name: np.concatenate((np.zeros(600), values)) for name, values in SOUND.items() if name != "velocity"}
    two |= {"time": np.tile(SOUND["time"], 2), "run": np.repeat([0.0, 1.0], 600)}
    assert [run.run for run in Log.from_arrays(**two).runs] == ["1"]


def test_logs_of_different_machines_do_not_merge():
    rotary = Log.from_arrays(**SOUND)
    linear = Log.from_arrays(time=SOUND["time"], force=SOUND["torque"], position=SOUND["angle"])
    with pytest.raises(MalformedLog, match="linear axis"):
        Log.merge([rotary, linear])


def test_repr_shows_size_rate_and_duration():
    assert repr(Log.from_arrays(**SOUND)) == "Log(1 run, 600 samples, 200 Hz, 3.00 s, rotary)"


def test_a_slice_of_a_run():
    run = Log.from_arrays(**SOUND).runs[0]
    part = run.slice(100, 300)
    assert len(part) == 200
    assert part.duration == pytest.approx(199 * 0.005)
    assert part.sample_time == pytest.approx(0.005)
    np.testing.assert_array_equal(part.velocity, run.velocity[100:300])


@pytest.mark.parametrize(
    "spoilt",
    [
        {"time": np.zeros(600)},
        {"output": np.full(600, np.nan)},
        {"command": np.zeros(5)},
        {"valid": np.ones(5, dtype=bool)},
        {"command_limit": 0.0},
        {"drive_angles": np.zeros((600, 3))},
    ],
)
def test_a_run_validates_itself(spoilt):
    sound = {
        "time": SOUND["time"],
        "command": SOUND["torque"],
        "output": SOUND["angle"],
        "valid": np.ones(600, dtype=bool),
        "servo_gain": np.zeros(600),
    }
    Run(label="sound", number=0, **sound)
    with pytest.raises(MalformedLog, match="spoilt"):
        Run(label="spoilt", number=0, **sound | spoilt)
