"""Two files of one experiment, joined on their clocks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from sample_logs import motion, write
from scipy.io import savemat
from test_malformed_logs import check_sentence

from antidrive.log_options import LogOptions
from identification import Log
from identification.errors import MalformedLog
from identification.reading.clocks import on_one_clock
from identification.reading.files import read_table
from identification.reading.join import join_tables
from identification.reading.table import Table
from plant.errors import BadParameter

SOUND = motion(samples=400)
SOUND["torque"] = np.sin(3 * SOUND["time"])
LATE = SOUND["time"][:-1] + 0.0013
DRIVE = {"time": LATE, "torque": np.sin(3 * LATE), "position": 0 * LATE}
ENCODER = {"time": SOUND["time"], "angle": SOUND["angle"], "position": 2 * SOUND["angle"]}
FOUND = {"angle": "angle", "torque": "torque"}


def tables(folder, drive=DRIVE, encoder=ENCODER):
    return [read_table(write(folder / "drive.csv", drive)), read_table(write(folder / "encoder.csv", encoder))]


def check(joined, found=FOUND):
    """On the clock of the encoder the angle is as it was measured, the torque interpolated."""
    table, found = on_one_clock(joined, found)
    np.testing.assert_allclose(table.columns[found["angle"]], SOUND["angle"], atol=1e-8)
    torque = np.asarray(table.columns[found["torque"]])
    known = np.isfinite(torque)
    assert known.sum() > 390
    np.testing.assert_allclose(torque[known], SOUND["torque"][known], atol=1e-4)
    assert any("joined on their clocks, which have 1.99" in note for note in table.notes)


@pytest.mark.parametrize("order", [1, -1])
def test_two_files_become_channels_with_clocks(tmp_path, order):
    joined = join_tables(tables(tmp_path)[::order])
    check(joined)
    assert set(joined.columns) == {"torque", "angle", "drive/position", "encoder/position"}
    assert joined.clocks["angle"] is joined.clocks["encoder/position"]
    assert joined.units["time"] == "s"


def test_clocks_in_other_units_and_since_1970(tmp_path):
    epoch = 1_760_000_000.0
    drive = {"Time (ms)": 1e3 * (DRIVE["time"] + epoch), "torque": DRIVE["torque"]}
    stamps = pd.to_datetime(SOUND["time"] + epoch, unit="s").strftime("%Y-%m-%dT%H:%M:%S.%f")
    pd.DataFrame(drive).to_csv(tmp_path / "drive.csv", index=False)
    pd.DataFrame({"stamp": stamps, "angle": SOUND["angle"]}).to_csv(tmp_path / "encoder.csv", index=False)
    joined = join_tables([read_table(tmp_path / "drive.csv"), read_table(tmp_path / "encoder.csv")])
    check(joined)
    assert joined.clocks["angle"][0] == 0.0


def test_a_file_that_has_clocks_already(tmp_path):
    channels = Table(
        name="drive.mf4",
        columns={"torque": DRIVE["torque"]},
        sha256="0",
        clocks={"torque": 1e3 * DRIVE["time"]},
        units={"time": "ms", "torque": "N m"},
        notes=("drive.mf4: a word",),
    )
    joined = join_tables([channels, tables(tmp_path)[1]])
    check(joined)
    assert joined.units["torque"] == "N m"
    assert joined.notes[0] == "drive.mf4: a word"
    assert joined.name == "drive.mf4 + encoder.csv"


def test_a_time_of_another_name_is_given(tmp_path):
    renamed = {"moment" if name == "time" else name: values for name, values in ENCODER.items()}
    with pytest.raises(MalformedLog, match=r"encoder\.csv: no column is called as a time is") as caught:
        join_tables(tables(tmp_path, encoder=renamed))
    check_sentence(str(caught.value))
    check(join_tables(tables(tmp_path, encoder=renamed), time="moment"))


def test_clocks_that_do_not_overlap(tmp_path):
    later = ENCODER | {"time": ENCODER["time"] + 1763.0}
    with pytest.raises(
        MalformedLog, match=r"not overlap: drive\.csv runs from 0\.0013 s to 1\.9913 s and enc"
    ) as caught:
        join_tables(tables(tmp_path, encoder=later))
    check_sentence(str(caught.value))
    assert "1763 s to 1764.995 s" in str(caught.value)


def test_times_that_are_text_or_alone(tmp_path):
    (tmp_path / "words.csv").write_text("time,angle\n2,2\n3,3\nstart,1\n4,4\n")
    with pytest.raises(MalformedLog, match="'start' is not a number"):
        join_tables([*tables(tmp_path)[:1], read_table(tmp_path / "words.csv")])
    (tmp_path / "alone.npz").write_bytes(b"")
    np.savez(tmp_path / "alone.npz", time=SOUND["time"])
    with pytest.raises(MalformedLog, match="nothing beside the time"):
        join_tables([*tables(tmp_path)[:1], read_table(tmp_path / "alone.npz")])


def test_times_of_the_day(tmp_path):
    for name, columns in (("drive", DRIVE), ("encoder", ENCODER)):
        stamps = [f"09:41:{13 + t:09.6f}".replace(".", ",") for t in columns["time"]]
        frame = pd.DataFrame({**columns, "time": stamps}).drop(columns="position")
        frame.to_csv(tmp_path / f"{name}.csv", index=False, sep=";")
    check(join_tables([read_table(tmp_path / "drive.csv"), read_table(tmp_path / "encoder.csv")]))


def test_samples_without_a_time_are_left_out(tmp_path):
    times = ENCODER["time"].copy()
    times[7] = np.nan
    joined = join_tables(tables(tmp_path, encoder=ENCODER | {"time": times}))
    assert len(joined.columns["angle"]) == len(joined.clocks["angle"]) == 399


def test_times_of_two_matrices_are_in_the_same_place(tmp_path: Path) -> None:
    """As Simulink writes them: a first row, or column, of times in each file."""
    time = np.arange(0.0, 4.0, 0.01)
    savemat(tmp_path / "drive.mat", {"u": np.column_stack((time, np.cos(time)))})
    savemat(tmp_path / "load.mat", {"y": np.column_stack((time, np.sin(time)))})
    log = Log.read(
        [tmp_path / "drive.mat", tmp_path / "load.mat"], mapping={"time": "u:1", "torque": "u:2", "angle": "y:2"}
    )
    assert log.runs[0].output == pytest.approx(np.sin(time))
    assert log.runs[0].command == pytest.approx(np.cos(time))


def test_a_rate_beside_times_is_refused(tmp_path: Path) -> None:
    time = np.arange(0.0, 4.0, 0.01)
    (tmp_path / "log.csv").write_text("\n".join(["time,torque,angle", *(f"{t},{np.cos(t)},{np.sin(t)}" for t in time)]))
    with pytest.raises(BadParameter, match="has times \\(column 'time'\\); leave the rate out"):
        Log.read(tmp_path / "log.csv", rate=100.0)


def write_matrices(folder, *, angle, torque):
    """The angles and the torques of two joints in two files without names and times."""
    np.savetxt(folder / "angles.txt", np.column_stack((0 * angle, angle)))
    np.savetxt(folder / "torques.txt", np.column_stack((0 * torque, torque)))
    return [folder / "angles.txt", folder / "torques.txt"]


QUALIFIED = {"torque": "torques/2", "angle": "angles/2"}


def test_two_matrices_without_a_time_are_joined_by_row(tmp_path):
    files = write_matrices(tmp_path, angle=SOUND["angle"], torque=SOUND["torque"])
    log = Log.read(files, rate=200, mapping=QUALIFIED)
    np.testing.assert_allclose(log.runs[0].output, SOUND["angle"])
    np.testing.assert_allclose(log.runs[0].command, SOUND["torque"])
    assert log.runs[0].time[-1] == pytest.approx((len(SOUND["time"]) - 1) / 200)
    assert any("angles.txt and torques.txt: joined row by row" in warning for warning in log.warnings)


def test_one_number_for_two_files_says_how_to_name_them(tmp_path):
    files = write_matrices(tmp_path, angle=SOUND["angle"], torque=SOUND["torque"])
    with pytest.raises(MalformedLog, match="put the name of the file before each") as caught:
        Log.read(files, rate=200, mapping={"torque": "2", "angle": "2"})
    check_sentence(str(caught.value))
    assert "--map torque=angles/2 --map angle=torques/2" in str(caught.value)


def test_rows_that_do_not_match_are_refused(tmp_path):
    files = write_matrices(tmp_path, angle=SOUND["angle"][:-1], torque=SOUND["torque"])
    with pytest.raises(MalformedLog, match="399 and 400 rows, so they cannot be joined") as caught:
        Log.read(files, rate=200, mapping=QUALIFIED)
    check_sentence(str(caught.value))


def test_one_file_per_quantity_with_the_time_in_its_own(tmp_path):
    for name, column in (("t", "time"), ("tau", "torque"), ("q", "angle")):
        np.savetxt(tmp_path / f"{name}.txt", SOUND[column])
    files = [tmp_path / f"{name}.txt" for name in ("t", "tau", "q")]
    log = Log.read(files, mapping={"time": "t/1", "torque": "tau/1", "angle": "q/1"})
    np.testing.assert_allclose(log.runs[0].time, SOUND["time"], atol=1e-12)
    np.testing.assert_allclose(log.runs[0].command, SOUND["torque"])


def test_named_columns_without_a_time_are_joined_by_row(tmp_path):
    files = [write(tmp_path / f"{name}.csv", {name: SOUND[name], "beside": SOUND["time"]}) for name in FOUND]
    np.testing.assert_allclose(Log.read(files, rate=200).runs[0].command, SOUND["torque"])
    with pytest.raises(MalformedLog, match="no column is called as a time is"):
        Log.read(files)


def test_a_qualified_name_is_joined_on_the_clocks(tmp_path):
    both = {**SOUND, "torque": 0 * SOUND["torque"]}
    files = [write(tmp_path / "drive.csv", DRIVE), write(tmp_path / "encoder.csv", both)]
    log = Log.read(files, mapping={"torque": "drive/torque", "angle": "encoder/angle"})
    assert any("joined on their clocks" in warning for warning in log.warnings)
    assert np.abs(log.runs[0].command).max() > 0.9


def test_files_of_one_name_cannot_be_told_apart(tmp_path):
    (tmp_path / "other").mkdir()
    drive = {name: DRIVE[name] for name in ("time", "torque")}
    files = [write(tmp_path / "log.csv", drive), write(tmp_path / "other" / "log.csv", ENCODER)]
    with pytest.raises(MalformedLog, match="two are called 'log'") as caught:
        join_tables([read_table(file) for file in files])
    check_sentence(str(caught.value))


@pytest.mark.parametrize(("head", "name"), [("", "1"), ("torque\n", "torque"), ("# torque\n", "torque")])
def test_a_text_of_a_single_column(tmp_path, head, name):
    (tmp_path / "tau.txt").write_text(head + "0.25\n-1e-3\n.5\n4\n")
    table = read_table(tmp_path / "tau.txt")
    np.testing.assert_allclose(table.columns[name], [0.25, -1e-3, 0.5, 4.0])


def test_prose_with_numbers_is_no_single_column(tmp_path):
    (tmp_path / "notes.txt").write_text("Measured on Monday\nin the laboratory\n12\n13\n14\n")
    with pytest.raises(MalformedLog, match="no table of numbers is found"):
        read_table(tmp_path / "notes.txt")


def test_validation_files_stand_in_the_place_of_the_files(tmp_path):
    paths = [tmp_path / f"{name}_{k}.txt" for k in (1, 2) for name in ("tau", "q")]
    for k, path in enumerate(paths):
        np.savetxt(path, (1 + k // 2) * SOUND["torque" if k % 2 == 0 else "angle"])
    mapping = {"torque": "tau_1/1", "angle": "q_1/1"}
    options = LogOptions(files=tuple(paths[:2]), holdout=tuple(paths[2:]), mapping=mapping, rate=200.0)
    measured = options.read()
    np.testing.assert_allclose(measured.log.runs[0].command, SOUND["torque"])
    np.testing.assert_allclose(measured.holdout.runs[0].command, 2 * SOUND["torque"])
    with pytest.raises(MalformedLog, match="no column 'tau_1/1'"):
        LogOptions(files=tuple(paths[:2]), holdout=(paths[2],), mapping=mapping, rate=200.0).read()


def test_clocks_without_a_date_are_taken_to_begin_together():
    def noted(offset):
        moved = [{**columns, "time": columns["time"] + offset} for columns in (DRIVE, ENCODER)]
        named = zip(("drive.csv", "encoder.csv"), moved, strict=True)
        return join_tables([Table(name=name, columns=columns, sha256="") for name, columns in named]).notes

    assert any("their zeros are taken to be the same instant" in note for note in noted(0.0))
    assert not any("zeros" in note for note in noted(1.7e9))
