"""Oddities of real exports that must neither cost the user a log nor slip through: padding, ends, awkward wraps."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from sample_logs import motion, text

from identification.log import Log

SOUND = motion(counts=65536)
LINES = text(SOUND, separator=";").splitlines()


def read(folder, lines):
    path = folder / "log.csv"
    path.write_text("\n".join(lines) + "\n")
    return Log.read(path)


def same(log):
    (run,) = log.runs
    np.testing.assert_allclose(run.output, SOUND["angle"], atol=1e-8)
    np.testing.assert_allclose(run.velocity, SOUND["velocity"], rtol=1e-7, atol=1e-8)
    assert run.valid.all()
    assert log.repairs == ()


@pytest.mark.parametrize("names_too", [False, True])
def test_a_separator_at_the_end_of_each_row(tmp_path, names_too):
    log = read(tmp_path, [LINES[0] + ";" * names_too, *(line + ";" for line in LINES[1:])])
    same(log)
    assert log.warnings == ()


def test_a_preamble_padded_to_the_width_of_the_table(tmp_path):
    same(read(tmp_path, ["Date;2026-01-01;;", "Drive;x;;", *LINES]))


def test_quoted_decimal_commas_in_a_comma_table(tmp_path):
    rows = [",".join(f'"{cell}"'.replace(".", ",") for cell in line.split(";")) for line in LINES[1:]]
    same(read(tmp_path, [LINES[0].replace(";", ","), *rows]))


def test_line_numbers_survive_blank_and_preamble_lines(tmp_path):
    lines = ["# station 7", "", *LINES]
    lines[202] = "0.995;nan;nan;nan"
    lines.insert(100, "")
    log = read(tmp_path, lines)
    assert any("(line 204)" in repair for repair in log.repairs)
    assert len(log.runs[0]) == 600


def test_first_rows_without_values_are_no_header(tmp_path):
    log = read(tmp_path, [LINES[0], "-0.010;nan;nan;nan", "-0.005;NaN;;", *LINES[1:]])
    assert log.warnings == ()
    assert len(log.runs[0]) == 600
    assert "2 samples at the start" in log.repairs[0]


def test_a_time_that_pandas_keeps_as_the_index(tmp_path):
    frame = pd.DataFrame(SOUND).set_index("time")
    same(Log.from_dataframe(frame))
    frame.to_parquet(tmp_path / "log.parquet")
    same(Log.read(tmp_path / "log.parquet"))


def test_ends_where_a_channel_is_missing_are_cut_and_reported():
    columns = motion()
    columns["torque"][:3] = np.nan
    columns["angle"][-7:] = np.nan
    log = Log.from_arrays(**columns)
    (repair,) = log.repairs
    assert "row 1, t = 0 s: 3 samples at the start and 7 at the end are left out" in repair
    assert "'torque'" in repair
    np.testing.assert_array_equal(log.runs[0].time, columns["time"][3:-7])
    assert log.runs[0].valid.all()


# Wraps in bad places. The motion covers several turns; wrapped, it jumps by 2 pi between the samples J and J + 1.

SWING = motion(samples=2000, counts=4096)
TURNING = 9 * SWING["angle"] + 3.0
WRAPPED = np.mod(TURNING, 2 * np.pi)
J = int(np.flatnonzero(np.abs(np.diff(WRAPPED)) > 3)[5])


def continued(angle, truth=TURNING):
    log = Log.from_arrays(time=SWING["time"], torque=SWING["torque"], angle=angle)
    run = log.runs[0]
    shift = run.output - truth
    np.testing.assert_allclose(shift[run.valid], np.median(shift), atol=1e-9)
    np.testing.assert_allclose(shift, np.median(shift), atol=0.1)
    assert any("wraps around by 6.28319 rad" in repair for repair in log.repairs)
    return np.flatnonzero(~run.valid)


@pytest.mark.parametrize("gone", [[0], [1], [-1, 0, 1, 2]])
def test_a_wrap_behind_missing_samples(gone):
    angle = WRAPPED.copy()
    angle[J + np.array(gone)] = np.nan
    np.testing.assert_array_equal(continued(angle), J + np.array(gone))


@pytest.mark.parametrize("place", [-4, 1, 3])
def test_a_spike_beside_a_wrap(place):
    angle = WRAPPED.copy()
    angle[J + place] += 1.5
    np.testing.assert_array_equal(continued(angle), [J + place])


def test_a_wrap_among_the_last_samples():
    truth = 2 * np.pi + 0.3 * (SWING["time"] - SWING["time"][-5])
    wrapped = np.mod(truth + 1e-9, 2 * np.pi)
    assert np.flatnonzero(np.abs(np.diff(wrapped)) > 3)[0] > 1500
    continued(wrapped, truth)


@pytest.mark.parametrize("counts", [None, 4096])
def test_a_load_at_rest_on_the_wrap(counts):
    noise = 1e-3 * np.random.default_rng(0).standard_normal(2000)
    truth = 2 * np.pi + np.where(np.arange(2000) < 1000, 0.0, TURNING - TURNING[1000]) + noise
    if counts:
        truth = np.round(truth * counts / (2 * np.pi)) * 2 * np.pi / counts
    assert np.sum(np.abs(np.diff(np.mod(truth, 2 * np.pi))) > 3) > 300
    assert len(continued(np.mod(truth, 2 * np.pi), truth)) == 0


def test_a_scope_export_is_not_interpolated_across_a_wrap(tmp_path):
    time = SWING["time"]
    rows = zip(time, SWING["torque"], time + 0.002, WRAPPED, strict=True)
    lines = ["Name\ttorque\tName\tangle", *("\t".join(f"{v:.9f}".replace(".", ",") for v in row) for row in rows)]
    run = read(tmp_path, lines).runs[0]
    truth = np.interp(run.time, time + 0.002, TURNING)
    shift = run.output - truth
    np.testing.assert_allclose(shift, np.median(shift), atol=0.1)


def test_speed_of_a_large_log():
    """All checks are vector operations: a quarter of an hour at 200 Hz takes well under a few seconds."""
    columns = motion(samples=180_000, counts=4096, noise=1e-4)
    assert Log.from_arrays(**columns).repairs == ()


def test_a_slowly_sampled_stop_is_not_taken_for_clipping():
    """Moves between set points at 10 Hz, each at one speed, held for a second or two."""
    holds = np.cumsum(np.tile([0.6, 0.9, -1.4, 0.5, -0.6], 8))
    angle = np.concatenate([np.r_[np.linspace(a, b, 8), np.full(15, b)] for a, b in pairwise(holds)])
    time = 0.1 * np.arange(len(angle))
    log = Log.from_arrays(time=time, torque=np.cos(time), angle=np.round(angle * 4096 / 6.28) * 6.28 / 4096)
    assert log.repairs == ()
