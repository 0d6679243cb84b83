"""A row for each sample of each channel, as databases and historians export: channels with clocks of their own."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from sample_logs import motion

from identification import Log
from identification.reading.files import read_table

SOUND = motion(samples=300)
TIME, TORQUE, ANGLE = (SOUND[name] for name in ("time", "torque", "angle"))
LATE = TIME + 0.001


def long(name="name", value="value", time="time", stamp=lambda t: f"{t:.6f}", separator=","):
    rows = sorted(
        [(t, "torque", x) for t, x in zip(TIME, TORQUE, strict=True)]
        + [(t, "angle", x) for t, x in zip(LATE, ANGLE, strict=True)]
    )
    lines = [separator.join((stamp(t), label, f"{x:.9f}")) for t, label, x in rows]
    return "\n".join([separator.join((time, name, value)), *lines]) + "\n"


def dated(seconds):
    return f"2026-03-12T10:12:{3 + seconds:09.6f}Z"


@pytest.mark.parametrize(
    "content",
    [
        long(),
        long("_field", "_value", "_time", dated),
        long("VarName", "VarValue", "TimeString", dated, ";"),
        long("Signal", "Wert", "Zeit [ms]", lambda t: f"{1e3 * t:.4f}", "\t"),
    ],
    ids=["plain", "Influx", "WinCC", "German"],
)
def test_a_row_for_each_sample_of_each_channel(tmp_path, content):
    (tmp_path / "log.csv").write_text(content, encoding="utf-8")
    log = Log.read(tmp_path / "log.csv")
    (run,) = log.runs
    np.testing.assert_allclose(run.output, ANGLE[: len(run)], atol=1e-8)
    assert run.sample_time == pytest.approx(0.005, rel=1e-4)
    np.testing.assert_allclose(run.command[5:-5], np.interp(LATE, TIME, TORQUE)[5 : len(run) - 5], atol=1e-6)
    assert any("a row is a sample of one channel" in text for text in log.warnings)


def test_a_table_with_a_label_beside_its_values_is_none(tmp_path):
    """Of each label a single time, as of settings; or a column of values that is one of several."""
    frame = pd.DataFrame({"time": TIME, "name": ["a", "b", "c"] * 100, "torque": TORQUE, "angle": ANGLE})
    frame.to_csv(tmp_path / "log.csv", index=False)
    assert list(read_table(tmp_path / "log.csv").columns) == ["time", "name", "torque", "angle"]
    settings = "".join(f"{t},setting {k},{t}\n" for k, t in enumerate(TIME))
    (tmp_path / "few.csv").write_text(f"time,name,value\n{settings}")
    assert list(read_table(tmp_path / "few.csv").columns) == ["time", "name", "value"]
