"""`antidrive inspect` says what is understood of a log, and the log.toml that it writes needs no option again."""

from __future__ import annotations

import json
import tomllib

import numpy as np
import pytest
from front_door import antidrive
from sample_logs import motion, text

SOUND = motion(samples=600)


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    columns = {"Time (ms)": 1e3 * SOUND["time"], "M": -1e3 * SOUND["torque"], "Angle (deg)": np.degrees(SOUND["angle"])}
    (tmp_path / "log.csv").write_text(text(columns), encoding="utf-8")
    return tmp_path


OPTIONS = ("--map", "torque=M", "--scale", "torque=-1", "--unit", "torque=mN*m")


def test_it_shows_columns_units_and_runs(place):
    result = antidrive("inspect", "log.csv", *OPTIONS, "--out", "seen")
    assert result.code == 0, result.err
    rows = {line.split("  ")[1].strip(): line for line in result.out.splitlines() if line.startswith("  ")}
    assert "torque (as given)" in rows["M"]
    assert "mN*m" in rows["M"]
    assert "angle (named so)" in rows["Angle (deg)"]
    assert "600" in result.out
    assert sorted(file.name for file in (place / "seen").iterdir()) == ["log.toml", "report.html"]


def test_its_log_toml_needs_no_option_typed_again(place):
    antidrive("inspect", "log.csv", *OPTIONS, "--out", "seen")
    content = tomllib.loads((place / "seen" / "log.toml").read_text(encoding="utf-8"))
    assert content["files"] == ["../log.csv"]
    assert content["columns"] == {"time": "Time (ms)", "torque": "M", "angle": "Angle (deg)"}
    assert content["units"] == {"time": "ms", "angle": "deg", "torque": "mN*m"}
    assert content["scale"] == {"torque": -1.0}
    typed = antidrive("identify", "log.csv", *OPTIONS, "--json", "--out", "a")
    described = antidrive("identify", "seen/log.toml", "--json", "--out", "b")
    assert typed.code == described.code == 0, described.err
    assert json.loads(typed.out)["parameters"] == json.loads(described.out)["parameters"]


def test_what_is_typed_comes_before_the_file(place):
    antidrive("inspect", "log.csv", *OPTIONS, "--out", "seen")
    turned = antidrive("inspect", "seen/log.toml", "--scale", "torque=1", "--json", "--out", "again")
    assert turned.code == 0, turned.err
    content = tomllib.loads((place / "again" / "log.toml").read_text(encoding="utf-8"))
    assert content["scale"] == {"torque": 1.0}


def test_what_the_file_holds_for_a_fit_is_used(place):
    antidrive("inspect", "log.csv", *OPTIONS, "--out", ".")
    with (place / "log.toml").open("a", encoding="utf-8") as file:
        file.write("\n[fit]\nfixed = ['gravity=0.0']\n")
    found = antidrive("identify", "log.toml", "--json", "--out", "fitted")
    assert found.code == 0, found.err
    assert json.loads(found.out)["parameters"]["gravity"]["fixed"]


def test_what_is_missing_ends_in_a_command_to_type(place):
    result = antidrive("inspect", "log.csv", "--out", "seen")
    assert result.code == 2
    assert result.err.splitlines()[-1].endswith("antidrive inspect log.csv --out seen --map torque=NAME")
    assert not (place / "seen").exists()


def test_what_cannot_be_used_is_shown_beside_the_reason(place):
    columns = {"time": SOUND["time"], "torque": SOUND["torque"], "Position (counts)": np.round(1e3 * SOUND["angle"])}
    (place / "log.csv").write_text(text(columns), encoding="utf-8")
    result = antidrive("inspect", "log.csv", "--out", "seen")
    first, *table = result.err.splitlines()
    assert result.code == 2
    assert first.startswith("antidrive: log.csv: the unit 'count' of column 'angle' has no fixed size")
    assert any(line.split()[:3] == ["Position", "(counts)", "count"] for line in table)


@pytest.mark.parametrize(
    ("content", "word"),
    [
        ("files = []", "files is empty"),
        ("files = 3", "list of paths"),
        ("fils = ['log.csv']", "'fils'"),
        ("files = ['log.csv']\nrate = 'fast'", "rate"),
        ("files = ['log.csv']\nunits = 'deg'", "[units]"),
        ("files = ['log.csv'", "no TOML"),
        ("files = ['log.csv']\n[fit]\nfixt = ['a']", "'fixt'"),
        ("files = ['absent.csv']", "absent.csv"),
    ],
)
def test_a_bad_log_toml_is_reported_in_a_sentence(place, content, word):
    (place / "log.toml").write_text(content, encoding="utf-8")
    result = antidrive("inspect", "log.toml", "--out", "seen")
    assert result.code == 2
    assert word in result.err
    assert result.err.count("\n") == 1
    assert not (place / "seen").exists()
