"""Which rows are one experiment: labels of any kind, times that begin anew, rows out of order."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from front_door import antidrive, write_model
from sample_logs import motion, text, write

from identification.errors import MalformedLog
from identification.log import Log
from plant import ServoModel

CASES = Path(__file__).parents[1].parent / "shared" / "cases" / "logs"
SOUND = {name: values for name, values in motion(samples=300).items() if name != "velocity"}


def labelled(*labels):
    """The sound motion once for each label, one below the other, each with a time of its own."""
    table = {name: np.tile(values, len(labels)) for name, values in SOUND.items()}
    table["time"] = table["time"] + np.repeat(10.0 * np.arange(len(labels)), 300)
    return table | {"run": np.repeat(np.array(labels, dtype=object), 300)}


def same(run):
    np.testing.assert_allclose(run.output, SOUND["angle"], atol=1e-8)


@pytest.mark.parametrize(
    ("labels", "written"),
    [
        (["2.5A", "-2.5A", "10.0A"], ["2.5A", "-2.5A", "10.0A"]),
        ([7, 3, 5], ["7", "3", "5"]),
        ([0.5, 0.25, 2.0], ["0.5", "0.25", "2"]),
        ([True, False], ["True", "False"]),
        (["2026-01-02", "2026-01-01"], ["2026-01-02", "2026-01-01"]),
        ([pd.Timestamp("2026-01-02"), "warm"], ["2026-01-02 00:00:00", "warm"]),
    ],
)
def test_labels_of_any_kind_group_the_rows(labels, written):
    log = Log.from_dataframe(pd.DataFrame(labelled(*labels)))
    assert [run.run for run in log.runs] == written
    assert [run.number for run in log.runs] == list(range(len(labels)))
    assert [run.label for run in log.runs] == [f"DataFrame run {label}" for label in written]
    for run in log.runs:
        same(run)


def test_a_log_without_labels_has_one_run_that_is_called_0():
    (run,) = Log.from_arrays(**SOUND).runs
    assert (run.run, run.number, run.label) == ("0", 0, "arrays")


def test_a_label_that_returns_continues_its_experiment():
    log = Log.from_dataframe(pd.DataFrame(labelled("cold", "warm", "cold")))
    assert [(run.run, run.number) for run in log.runs] == [("cold", 0), ("cold", 0), ("warm", 1)]
    assert "1 gap of up to 18.5 s" in log.repairs[0]


def test_rows_without_a_label_are_left_out():
    columns = labelled("a", "b")
    columns["run"][[0, 1, 300]] = None
    log = Log.from_dataframe(pd.DataFrame(columns))
    assert [len(run) for run in log.runs] == [298, 299]
    assert "3 rows without a label in 'run' left out" in log.warnings[0]


def test_a_label_at_the_first_row_of_each_experiment_is_enough():
    columns = labelled("a", "b")
    columns["run"][[k for k in range(600) if k % 300]] = None
    assert [(run.run, len(run)) for run in Log.from_dataframe(pd.DataFrame(columns)).runs] == [("a", 300), ("b", 300)]


def test_a_column_that_is_different_in_each_row_numbers_no_runs():
    with pytest.raises(MalformedLog, match="300 labels in 300 rows"):
        Log.from_arrays(**SOUND, run=SOUND["time"])


def test_predictions_and_files_together_keep_the_labels(tmp_path):
    one, two = labelled("2.5A", "5A"), labelled("10A")
    paths = [tmp_path / "one.csv", tmp_path / "two.csv"]
    for path, columns in zip(paths, (one, two), strict=True):
        pd.DataFrame(columns).to_csv(path, index=False)
    model = write_model(tmp_path / "model.json", ServoModel.paper())
    out = tmp_path / "predicted.csv"
    assert antidrive("predict", model, *paths, "--out", out, "--quiet").code == 0
    assert list(dict.fromkeys(pd.read_csv(out)["run"])) == ["2.5A", "5A", "10A"]
    again = Log.read([paths[0], paths[0]])
    assert [run.run for run in again.runs] == ["0", "1", "2", "3"]


def test_where_the_time_begins_anew_a_run_begins(tmp_path):
    two = {name: np.tile(values, 2) for name, values in SOUND.items()}
    log = Log.read(write(tmp_path / "log.csv", two))
    assert [(run.run, run.label) for run in log.runs] == [("0", "log.csv run 0"), ("1", "log.csv run 1")]
    for run in log.runs:
        same(run)
    (warning,) = log.warnings
    assert "log.csv, row 301 (line 302), t = 0 s: the time goes back by 1.495 s, so a new run begins there" in warning


def test_the_time_in_a_message_counts_from_the_earliest_run():
    two = labelled("late", "early")
    two["time"] = np.concatenate([130.0 + SOUND["time"], 100.0 + SOUND["time"]])
    two["angle"] = two["angle"].copy()
    two["angle"][400] += 1.0
    (repair,) = Log.from_dataframe(pd.DataFrame(two)).repairs
    assert "run early, row 401, t = 0.5 s after the start: 1 spike" in repair


def test_experiments_out_of_order_are_runs_within_their_label():
    two = labelled("a", "b", "a")
    two["time"] = two["time"] - np.repeat([0.0, 0.0, 40.0], 300)
    log = Log.from_dataframe(pd.DataFrame(two))
    assert [run.run for run in log.runs] == ["a", "a (2)", "b"]


def test_a_restart_after_a_few_samples_is_no_shuffled_row():
    few = {name: np.concatenate((values[:5], values)) for name, values in SOUND.items()}
    log = Log.from_arrays(**few)
    same(log.runs[0])
    assert "5 samples" in log.repairs[0]


@pytest.mark.parametrize("order", [[101, 100], [103, 100, 101, 102], [101, 102, 103, 100], [110, 100]])
def test_a_few_shuffled_rows_are_sorted(order):
    rows = np.arange(300)
    rows[sorted(order)] = order
    log = Log.from_arrays(**{name: values[rows] for name, values in SOUND.items()})
    same(log.runs[0])
    assert "out of order, sorted" in log.warnings[0]


def test_pairs_in_the_wrong_order_throughout_are_sorted():
    rows = np.arange(300).reshape(-1, 2)[:, ::-1].ravel()
    log = Log.from_arrays(**{name: values[rows] for name, values in SOUND.items()})
    same(log.runs[0])


@pytest.mark.parametrize("wrong", [-3.0, 0.2, 99.0])
def test_a_row_with_a_time_from_elsewhere_is_left_out(wrong):
    columns = {name: values.copy() for name, values in SOUND.items()}
    columns["time"][200] = wrong
    (run,) = (log := Log.from_arrays(**columns)).runs
    np.testing.assert_array_equal(run.output, np.delete(SOUND["angle"], 200))
    assert "row 201" in log.warnings[0] or "row 202" in log.warnings[0]
    assert "1 row with a time out of its place, left out" in log.warnings[0]


def test_a_table_with_the_newest_row_on_top_is_turned():
    log = Log.from_arrays(**{name: values[::-1] for name, values in SOUND.items()})
    same(log.runs[0])
    assert "backwards in time" in log.warnings[0]


def test_times_in_messages_count_from_the_start(tmp_path):
    columns = {name: values.copy() for name, values in SOUND.items()}
    columns["time"] = columns["time"] + 1.6e9
    columns["angle"][200] += 3.0
    lines = text(columns).splitlines()
    for k in range(300):
        lines[k + 1] = f"{columns['time'][k]:.4f}," + lines[k + 1].split(",", 1)[1]
    (tmp_path / "log.csv").write_text("\n".join(lines))
    log = Log.read(tmp_path / "log.csv")
    assert "row 201 (line 202), t = 1 s after the start: 1 spike" in log.repairs[0]


@pytest.mark.skipif(not CASES.exists(), reason="the folder of other people's logs is not here")
def test_a_text_column_of_another_log_numbers_its_experiments():
    names = {"time": "OSL:timestamp", "angle": "knee[DephyActpack]:output_position"}
    path = CASES / "10-text-run-labels" / "log.csv"
    log = Log.read(path, mapping=names | {"run": "peak_value"})
    assert [run.run for run in log.runs[:3]] == ["2.5A", "-2.5A", "5A"]
    assert len(log.runs) == 16
    for finding in log.warnings + log.repairs + Log.read(path, mapping=names).repairs:
        assert "e+09" not in finding
