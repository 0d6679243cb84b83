"""`import antidrive as ad`: the names that people use, there at once, each from its package."""

from __future__ import annotations

import importlib
import inspect
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from front_door import PLAIN, antidrive, columns, write_csv, write_model

import antidrive as ad
from plant import ServoModel

ROOT = Path(__file__).parents[1]
HEAVY = {"casadi", "pandas", "scipy", "numpy", *("plant", "allocation", "identification", "diagnosis", "mpc")}


def python(code: str, folder: Path, **options: str) -> subprocess.CompletedProcess[str]:
    """Run a script of a user in a folder of theirs."""
    (folder / "script.py").write_text(code)
    words = [sys.executable, "script.py"]
    environment = {"PYTHONPATH": str(ROOT), "PATH": "/usr/bin:/bin", **options}
    return subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, timeout=60)


def test_every_name_is_that_of_its_package():
    for name in set(ad.__all__) - {"__version__"}:
        home = importlib.import_module(ad.HOMES[name])
        assert getattr(ad, name) is getattr(home, {"identify": "fit"}.get(name, name))
    assert set(ad.HOMES) | {"__version__"} == set(ad.__all__) == set(ad.__all__) & set(dir(ad))
    with pytest.raises(AttributeError, match="antidrive has no 'Servo'; it has Allocator, Controller"):
        _ = ad.Servo


def test_the_import_is_fast_and_brings_nothing_heavy(tmp_path):
    code = (
        "import sys, time; begin = time.process_time(); import antidrive as ad; took = time.process_time() - begin\n"
        f"heavy = {HEAVY!r} & set(sys.modules); print(took); sys.exit(str(heavy) if heavy else 0)"
    )
    runs = [python(code, tmp_path) for _ in range(3)]
    assert {run.returncode for run in runs} == {0}, runs[0].stderr
    assert min(float(run.stdout) for run in runs) < 0.1
    begun = time.process_time()
    assert ad.ServoModel.paper().inertia == 2.0
    assert time.process_time() - begun < 1.0


def test_the_example_of_the_docstring_runs(monkeypatch, capsys):
    requested = []

    def diagnose(log):
        requested.append(log)
        files = {"report": requested.append, "extended": SimpleNamespace(model=PLAIN, save=requested.append)}
        return SimpleNamespace(**files)

    monkeypatch.setitem(vars(ad), "diagnose", diagnose)
    lines = [line for line in inspect.cleandoc(ad.__doc__).splitlines() if line.startswith("    ")]
    exec("\n".join(lines).replace("\n    ", "\n").strip(), {})
    assert requested == ["log.csv", "report.html", "model.json"]
    assert float(capsys.readouterr().out.split()[-1]) > 0.0


@pytest.mark.parametrize("window", [None, 2.0])
def test_predict_reports_what_the_command_reports(window, tmp_path):
    table = columns(PLAIN, duration=5.0)
    log, model = write_csv(tmp_path / "log.csv", table), write_model(tmp_path / "model.json")
    found = ad.predict(PLAIN, table, window=window).to_frame()
    assert list(found.columns) == ["run", "time", "angle", "measured"]
    assert np.sqrt(np.mean((found["angle"] - table["angle"]) ** 2)) < 1e-3
    pd.testing.assert_frame_equal(ad.predict(model, log, window=window).to_frame(), found, atol=1e-9)
    more = [] if window is None else ["--window", window]
    assert antidrive("predict", model, log, *more, "--out", tmp_path / "p.csv").code == 0
    np.testing.assert_allclose(pd.read_csv(tmp_path / "p.csv").angle, found["angle"], atol=1e-9)


@pytest.mark.parametrize("axis", ["rotary", "linear"])
def test_a_prediction_of_a_speed_is_called_velocity(axis, tmp_path):
    servo = ServoModel(inertia=0.8, gravity=0.0, viscous_friction=0.5, axis=axis)
    table = columns(servo, duration=5.0)
    speed = {"time": table["time"], "velocity": np.gradient(table["angle"], table["time"])}
    speed["torque" if axis == "rotary" else "force"] = table["torque"]
    log, model = write_csv(tmp_path / "log.csv", speed), write_model(tmp_path / "model.json", servo)
    wanted = ["run", "time", "velocity", "measured"]
    found = ad.predict(model, log).to_frame()
    assert list(found.columns) == wanted
    assert np.std(found["velocity"] - found["measured"]) < 0.5 * np.std(found["measured"])
    assert antidrive("predict", model, log, "--measured", "--out", tmp_path / "p.csv").code == 0
    assert list(pd.read_csv(tmp_path / "p.csv").columns) == wanted


@pytest.mark.parametrize("name", ["plant", "mpc", "diagnosis"])
@pytest.mark.parametrize("line", ["import antidrive", "import {name}\nimport antidrive as ad"])
def test_a_file_of_the_same_name_is_reported_by_its_name(name, line, tmp_path):
    (tmp_path / f"{name}.py").write_text("")
    done = python(line.format(name=name), tmp_path)
    assert done.returncode == 1
    last_line = done.stderr.splitlines()[-1]
    assert last_line.startswith(
        f"ImportError: {tmp_path / name}.py stands in the way of antidrive's own package '{name}'"
    )
    assert f"my_{name}.py" in last_line


def test_a_folder_without_package_shadows_nothing(tmp_path):
    (tmp_path / "plant").mkdir()
    assert python("import antidrive", tmp_path).returncode == 0
    (tmp_path / "plant" / "__init__.py").write_text("")
    assert f"{tmp_path / 'plant' / '__init__.py'} stands in the way" in python("import antidrive", tmp_path).stderr
