"""Logs in JSON of the shapes that pandas, scripts and web services write, and JSON lines."""

from __future__ import annotations

import gzip
import json

import numpy as np
import pandas as pd
import pytest
from sample_logs import motion
from test_malformed_logs import check_sentence

from identification.errors import MalformedLog
from identification.reading.files import read_table
from plant.errors import AntidriveError

SOUND = motion(samples=80)
FRAME = pd.DataFrame(SOUND)
COLUMNS = {name: values.tolist() for name, values in SOUND.items()}
RECORDS = FRAME.to_dict(orient="records")
ROWS = FRAME.to_numpy().tolist()


def nested(record):
    return {"time": record["time"], "drive": {"torque": record["torque"]}, "load": [record["angle"], 1.0]}


SHAPES = {
    "records": RECORDS,
    "columns": COLUMNS,
    **{f"pandas, {orient}": json.loads(FRAME.to_json(orient=orient, double_precision=15)) for orient in
       ("records", "columns", "split", "index", "table")},
    "records in a wrapper": {"data": RECORDS, "station": 7},
    "columns in a wrapper": {"log": {"samples": COLUMNS}, "version": "1"},
    "rows beside their names": {"header": list(SOUND), "rows": ROWS},
    "rows with names in the first": [list(SOUND), *ROWS],
    "an object a name": {name: {"values": values} for name, values in COLUMNS.items()},
    "series with a name each": [{"name": name, "data": values} for name, values in COLUMNS.items()],
    "columns of two groups": {"time": COLUMNS["time"], "drive": {"torque": COLUMNS["torque"]},
                              "load": {"angle": COLUMNS["angle"], "velocity": COLUMNS["velocity"]}},
}  # fmt: skip


def read(folder, content, name="log.json"):
    path = folder / name
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return read_table(path)


def same(table, names=tuple(SOUND)):
    for name, column in zip(names, SOUND, strict=True):
        np.testing.assert_allclose(table.columns[name], SOUND[column], rtol=1e-12)


@pytest.mark.parametrize("indent", [None, 2])
@pytest.mark.parametrize("shape", SHAPES)
def test_shapes(tmp_path, shape, indent):
    table = read(tmp_path, json.dumps(SHAPES[shape], indent=indent))
    same(table)
    assert table.clocks == {}
    assert table.notes == ()


def test_records_in_records_and_lists(tmp_path):
    table = read(tmp_path, [nested(record) for record in RECORDS])
    assert list(table.columns) == ["time", "drive.torque", "load:1", "load:2"]
    np.testing.assert_allclose(table.columns["load:1"], SOUND["angle"])


def test_numbers_beside_the_table_count_for_all_rows(tmp_path):
    table = read(tmp_path, {"kp": 20, "motor": "x", "entries": RECORDS})
    same(table)
    np.testing.assert_array_equal(table.columns["kp"], np.full(80, 20.0))
    assert "motor" not in table.columns


def test_time_series_with_clocks_of_their_own(tmp_path):
    late = SOUND["time"][:50] + 0.001
    table = read(tmp_path, {
        "angle": {"time_ms": [1e3 * t for t in SOUND["time"]], "value": COLUMNS["angle"]},
        "torque": {"time_ms": (1e3 * late).tolist(), "value": COLUMNS["torque"][:50]},
    })  # fmt: skip
    assert list(table.columns) == ["angle", "torque"]
    assert table.units == {"time": "ms"}
    np.testing.assert_allclose(table.clocks["torque"], 1e3 * late)


def test_rows_without_names(tmp_path):
    table = read(tmp_path, ROWS)
    same(table, ("1", "2", "3", "4"))
    same(read(tmp_path, {"data": ROWS}), ("data:1", "data:2", "data:3", "data:4"))


@pytest.mark.parametrize("name", ["log.jsonl", "log.ndjson", "log"])
def test_lines(tmp_path, name):
    text = "\n".join(map(json.dumps, RECORDS))
    same(read(tmp_path, text, name))
    table = read(tmp_path, text + '\n{"time": 0.4, "tor', name)
    same(table)
    assert table.notes == (f"{name}: the last line (81) is cut off and left out",)
    same(read(tmp_path, "\n".join(json.dumps(row) for row in [list(SOUND), *ROWS]), name))


def test_dates_labels_and_missing_values(tmp_path):
    records = [{**record, "time": f"2026-03-01T10:00:{k:02d}", "run": "slow"} for k, record in enumerate(RECORDS[:60])]
    records[3]["angle"] = None
    del records[4]["angle"]
    table = read(tmp_path, records)
    assert table.columns["time"][7] == "2026-03-01T10:00:07"
    assert table.columns["run"][0] == "slow"
    assert np.flatnonzero(np.isnan(table.columns["angle"])).tolist() == [3, 4]


def test_joints_by_the_names_in_the_messages(tmp_path):
    messages = [{"stamp": r["time"], "name": ["hip", "knee"], "position": [r["angle"], 0.5]} for r in RECORDS]
    table = read(tmp_path, messages)
    assert table.joints == ("hip", "knee")
    np.testing.assert_allclose(table.columns["position:hip"], SOUND["angle"])
    matrix = [[angle, 0.5] for angle in COLUMNS["angle"]]
    table = read(tmp_path, {"time": COLUMNS["time"], "joint_names": ["hip", "knee"], "position": matrix})
    assert table.joints == ("hip", "knee")
    np.testing.assert_allclose(table.columns["position:hip"], SOUND["angle"])


def test_compressed(tmp_path):
    (tmp_path / "log.json.gz").write_bytes(gzip.compress(json.dumps(RECORDS).encode()))
    same(read_table(tmp_path / "log.json.gz"))


REFUSED = {
    "cut off": (json.dumps(RECORDS)[:-500], "this is no JSON \\(line 1, column"),
    "a bad line": (
        "\n".join(map(json.dumps, RECORDS)).replace("}", "", 1),
        "line 1: this line is no JSON|this is no JSON",
    ),
    "a bad line below": ("\n".join(map(json.dumps, RECORDS[:9])) + "\noops\n{}", "line 10: this line is no JSON"),
    "no table": ('{"station": 7, "names": ["a", "b"]}', "no records or lists of numbers"),
    "a number": ("7", "no records or lists of numbers"),
    "nested beyond reason": ("[" * 5000, "this is no JSON"),
    "text": ("time,torque\n0,1\n", "this is no JSON"),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_refused_in_one_sentence(tmp_path, kind):
    content, message = REFUSED[kind]
    with pytest.raises(MalformedLog, match=message) as caught:
        read(tmp_path, content)
    check_sentence(str(caught.value))


def test_damaged_json_is_read_as_far_as_intact_or_refused(tmp_path):
    rng = np.random.default_rng(0)
    for shape in SHAPES.values():
        sound = json.dumps(shape)
        for _ in range(6):
            damaged = list(sound)
            for place in rng.integers(len(damaged) if rng.random() < 0.5 else 300, size=3):
                damaged[place] = '{}[],:"0eN'[rng.integers(10)]
            try:
                assert read(tmp_path, "".join(damaged)).columns
            except AntidriveError as error:
                check_sentence(str(error))


def test_matrices_of_different_lengths_are_runs(tmp_path):
    runs = {"slow-forward": ROWS[:50], "fast-forward": ROWS[50:]}
    table = read(tmp_path, {**runs, "sysid": True, "units": "Radians"})
    same(table, names=("1", "2", "3", "4")[: len(SOUND)])
    assert table.columns["run"].tolist() == ["slow-forward"] * 50 + ["fast-forward"] * 30
    named = {key: [list(SOUND), *rows] for key, rows in runs.items()}
    same(read(tmp_path, named))


def test_matrices_of_one_length_are_channels(tmp_path):
    table = read(tmp_path, {"left": ROWS, "right": ROWS})
    assert "run" not in table.columns
    np.testing.assert_allclose(table.columns["right:2"], SOUND["torque"], rtol=1e-12)
