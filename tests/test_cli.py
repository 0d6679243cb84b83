"""The commands from end to end, on small synthetic logs."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
import time
from importlib import import_module
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from front_door import DT, PLAIN, TRUTH, antidrive, columns, listing, write_csv, write_model

import antidrive.cli as cli
from antidrive.log_options import Measured
from antidrive.output import whole_folder
from identification.log import Log
from plant import BadParameter, read_model


def strict_json(text: str):
    """Parse JSON and refuse the NaN and Infinity that Python would let through."""

    def refuse(constant: str):
        raise AssertionError(f"{constant} is not JSON")

    return json.loads(text, parse_constant=refuse)


@pytest.fixture(scope="module")
def log(tmp_path_factory) -> Path:
    return write_csv(tmp_path_factory.mktemp("logs") / "log.csv", columns())


@pytest.fixture(scope="module")
def held(tmp_path_factory) -> Path:
    return write_csv(tmp_path_factory.mktemp("logs") / "held.csv", columns(seed=1, duration=9.0))


@pytest.fixture(scope="module")
def fitted(log, tmp_path_factory):
    out = tmp_path_factory.mktemp("fit") / "out"
    base = write_model(out.parent / "base.json", TRUTH)
    return antidrive("identify", log, "--base", base, "--out", out), out


def test_identify_recovers_the_truth_and_writes_three_files(fitted):
    result, out = fitted
    assert result.code == 0, result.err
    assert sorted(listing(out)) == ["fit.json", "model.json", "report.html"]
    found = read_model(out / "model.json")
    assert found.model.values == pytest.approx(TRUTH.values, rel=0.02, abs=0.01)
    assert found.sample_time == pytest.approx(DT)
    assert found.source[0]["file"].endswith("log.csv")
    assert len(found.source[0]["sha256"]) == 64
    content = strict_json((out / "fit.json").read_text())
    line = content["parameters"]["inertia"]
    assert abs(line["value"] - TRUTH.inertia) < 5 * line["std"]
    assert "inertia" in result.out
    table, _, _ = result.out.partition("Written")
    assert max(map(len, table.splitlines())) <= 80


def test_identify_reports_what_the_log_cannot_show_and_a_remedy(tmp_path):
    time_ = np.arange(800) * DT
    angle = 0.02 * (np.sin(2 * np.pi * 0.6 * time_) + np.sin(2 * np.pi * 1.5 * time_))
    velocity = np.gradient(angle, DT)
    torque = 0.8 * np.gradient(velocity, DT) + 0.5 * velocity + 0.6 * np.cos(angle)
    noise = 1e-4 * np.random.default_rng(0).standard_normal(time_.size)
    log = write_csv(tmp_path / "log.csv", {"time": time_, "torque": torque, "angle": angle + noise})
    result = antidrive("identify", log, "--out", tmp_path / "out")
    advice = "the load turns by 4.5 degrees only; let it turn by more than 90 degrees."
    assert result.code == 0, result.err
    assert advice in result.out
    assert advice in (tmp_path / "out" / "report.html").read_text()
    assert any(advice in text for text in strict_json((tmp_path / "out" / "fit.json").read_text())["data"]["warnings"])


def test_mapping_units_and_scales_give_the_same_fit(fitted, log, tmp_path):
    _, out = fitted
    table = pd.read_csv(log)
    odd = pd.DataFrame({"t": table.time, "i": table.torque / 2.5, "qm": np.rad2deg(table.angle)})
    odd.to_csv(tmp_path / "odd.csv", index=False, sep=";", decimal=",")
    base = write_model(tmp_path / "base.json", TRUTH)
    names = ["--map", "time=t", "--map", "torque=i", "--map", "angle=qm"]
    words = [*names, "--unit", "angle=deg", "--scale", "torque=5/2"]
    result = antidrive("identify", tmp_path / "odd.csv", *words, "--base", base, "--out", tmp_path / "out", "--json")
    assert result.code == 0, result.err
    values = read_model(tmp_path / "out" / "model.json").model.values
    np.testing.assert_allclose(values, read_model(out / "model.json").model.values, rtol=1e-4, atol=1e-6)
    assert strict_json(result.out)["parameters"]["inertia"]["unit"] == "kg m^2"
    assert result.err == ""


def test_quiet_prints_nothing_and_a_seed_repeats_the_files(fitted, log, tmp_path):
    _, out = fitted
    base = write_model(tmp_path / "base.json", TRUTH)
    result = antidrive("identify", log, "--base", base, "--out", tmp_path / "again", "--quiet")
    assert (result.code, result.out, result.err) == (0, "", "")
    assert (tmp_path / "again" / "fit.json").read_bytes() == (out / "fit.json").read_bytes()


@pytest.fixture(scope="module")
def diagnosed(log, held, tmp_path_factory):
    out = tmp_path_factory.mktemp("diagnosis") / "out"
    return antidrive("diagnose", log, "--holdout", held, "--out", out, "--json"), out


def test_diagnose_names_what_is_hidden_in_the_contracted_form(diagnosed, log, held):
    result, out = diagnosed
    assert result.code == 0, result.err
    assert sorted(listing(out)) == ["diagnosis.json", "model.json", "report.html"]
    content = strict_json((out / "diagnosis.json").read_text())
    assert strict_json(result.out) == content
    assert content["schema"] == 2
    assert content["verdict"] == "named"
    assert [cause["effect"] for cause in content["causes"]] == ["coulomb_friction"]
    cause = content["causes"][0]
    assert set(cause) == {"effect", "probability", "alternatives", "parameters", "share", "rms", "gain"}
    assert cause["parameters"]["torque"]["value"] == pytest.approx(0.4, abs=0.02)
    assert cause["parameters"]["torque"]["unit"] == "N m"
    gain = content["gain"]
    assert set(gain) == {"held_out_rms_before", "held_out_rms_after", "noise_floor", "unit", "window", "runs"}
    assert gain["held_out_rms_after"] < 0.2 * gain["held_out_rms_before"]
    assert set(content["unexplained"]) == {"share", "depends_on"}
    assert set(content["unknown"]) == {"probability", "depends_on", "share"}
    assert all(set(each) == {"effects", "unknown", "probability"} for each in content["sets"])
    assert content["sets"][0]["effects"] == ["coulomb_friction"]
    assert content["minor"] == []
    assert set(content["data"]) == {"warnings", "read_as"}
    page = (out / "report.html").read_text()
    assert all(hashlib.sha256(file.read_bytes()).hexdigest() in page for file in (log, held))


def test_the_extended_model_predicts_better_than_the_base(diagnosed, held, tmp_path):
    _, out = diagnosed
    errors = []
    for name, model in (("extended", out / "model.json"), ("plain", write_model(tmp_path / "plain.json"))):
        target = tmp_path / f"{name}.csv"
        result = antidrive("predict", model, held, "--out", target, "--json")
        assert result.code == 0, result.err
        reported = strict_json(result.out)["runs"][0]["rms"]
        predicted, measured = pd.read_csv(target), pd.read_csv(held)
        assert list(predicted.columns) == ["run", "time", "angle"]
        assert reported == pytest.approx(np.sqrt(np.mean((predicted.angle - measured.angle) ** 2)), rel=1e-6)
        errors.append(reported)
    assert errors[0] < 0.1 * errors[1]


@pytest.mark.parametrize("window", [None, 2.0])
def test_a_prediction_sees_the_output_only_while_it_settles(window, tmp_path):
    table = columns()
    model = write_model(tmp_path / "model.json", TRUTH)
    options = [] if window is None else ["--window", window]
    period = window or 12.0
    late = np.clip((table["time"] % period - 0.2 - DT) / (period - 0.2 - DT), 0.0, 1.0)
    changed = table | {"angle": table["angle"] + 0.3 * np.sin(np.pi * late) ** 2}
    curves = []
    for name, content in (("true", table), ("changed", changed)):
        log, out = write_csv(tmp_path / f"{name}.csv", content), tmp_path / f"{name}-out.csv"
        assert antidrive("predict", model, log, *options, "--out", out).code == 0
        curves.append(pd.read_csv(out).angle.to_numpy())
    np.testing.assert_array_equal(curves[0], curves[1])
    assert np.sqrt(np.mean((curves[0] - table["angle"]) ** 2)) < 0.02


def test_masked_samples_do_not_count_as_errors_of_the_model(tmp_path):
    table = columns()
    truth = table["angle"].copy()
    table["angle"][300:340] = np.nan
    model, log = write_model(tmp_path / "model.json", TRUTH), write_csv(tmp_path / "log.csv", table)
    result = antidrive("predict", model, log, "--out", tmp_path / "out.csv", "--json")
    error = pd.read_csv(tmp_path / "out.csv").angle - truth
    reported = strict_json(result.out)
    assert reported["runs"][0]["rms"] == pytest.approx(
        np.sqrt(np.mean(np.delete(error, range(300, 340)) ** 2)), rel=1e-6
    )
    assert reported["unit"] == "rad"


def test_a_model_that_runs_away_predicts_nothing(monkeypatch, log, tmp_path):
    monkeypatch.setattr(
        "antidrive.prediction.free_simulation",
        lambda log, *_, **__: [np.full(len(run), np.inf) for run in log.runs],
    )
    model = write_model(tmp_path / "model.json")
    result = antidrive("predict", model, log, "--out", tmp_path / "out.csv")
    assert result.code == 2
    assert "the model diverges" in result.err
    assert list(tmp_path.iterdir()) == [model]


def test_the_words_of_a_diagnosis_reach_it(monkeypatch, log, held, tmp_path):
    heard = {}

    def listen(log, start, holdout, *, fixed, **_):
        heard.update(log=log, start=start, holdout=holdout, fixed=fixed)
        raise BadParameter("heard.")

    monkeypatch.setattr(import_module("diagnosis.diagnose"), "diagnose", listen)
    base = write_model(tmp_path / "base.json", TRUTH)
    result = antidrive("diagnose", log, "--holdout", held, "--base", base, "--out", tmp_path / "out")
    assert (result.code, result.err) == (2, "antidrive: heard.\n")
    assert [heard[part].sources[0].file for part in ("log", "holdout")] == ["log.csv", "held.csv"]
    np.testing.assert_array_equal(heard["start"].values, TRUTH.values)
    assert heard["fixed"] == {}


@pytest.mark.parametrize("own", [False, True])
@pytest.mark.parametrize("command", ["identify", "diagnose"])
def test_what_a_known_machine_does_not_have_is_not_fitted(command, own, monkeypatch, log, tmp_path):
    heard = {}

    def listen(log, start, *_, fixed, **__):
        heard.update(start=start, fixed=fixed)
        raise BadParameter("heard.")

    known = Measured(log=Log.read(log), base=PLAIN, fixed=("gravity",))
    monkeypatch.setattr("antidrive.log_options.LogOptions.read", lambda self, tell: known)
    monkeypatch.setattr(import_module("diagnosis.diagnose"), "diagnose", listen)
    monkeypatch.setattr(import_module("identification.fit"), "fit", listen)
    base = ["--base", write_model(tmp_path / "base.json", TRUTH)] if own else []
    assert antidrive(command, log, *base, "--out", tmp_path / "out").code == 2
    # a model that the user gives comes before what is known of the machine
    assert heard["fixed"] == ({} if own else {"gravity": None})
    np.testing.assert_array_equal(heard["start"].values, (TRUTH if own else PLAIN).values)


def test_a_linear_axis_is_predicted_as_a_position_for_each_run(tmp_path):
    count = 300
    time_ = np.tile(np.arange(count) * DT, 2)
    force = np.tile(2.0 * np.sin(np.arange(count) * DT * 4), 2)
    table = {"time": time_, "force": force, "position": np.cumsum(force) * 1e-4, "run": np.repeat([3, 7], count)}
    log = write_csv(tmp_path / "axis.csv", table)
    content = json.dumps(
        {"schema": 1, "axis": "linear", "parameters": {"inertia": 5, "gravity": 0, "viscous_friction": 9}}
    )
    (tmp_path / "model.json").write_text(content)
    result = antidrive("predict", tmp_path / "model.json", log, "--out", tmp_path / "p.csv", "--json")
    assert result.code == 0, result.err
    assert strict_json(result.out)["unit"] == "m"
    predicted = pd.read_csv(tmp_path / "p.csv")
    assert list(predicted.columns) == ["run", "time", "position"]
    assert predicted.run.value_counts().to_dict() == {3: count, 7: count}


def test_allocate_shares_the_torque_and_keeps_every_bound():
    result = antidrive("allocate", "-1", "0", "2.0", "9", "--json")
    assert result.code == 0, result.err
    allocations = strict_json(result.out)["allocations"]
    for found, wanted in zip(allocations, (-1.0, 0.0, 2.0, 9.0), strict=True):
        first, second = found["torques"]
        assert 0.02 <= first <= 0.3
        assert -0.3 <= second <= -0.02
        assert -161 / 20 * (first + second) + found["missing_torque"] == pytest.approx(wanted, abs=1e-9)
    assert [each["status"] == "optimal" for each in allocations] == [True, True, True, False]
    assert allocations[3]["missing_torque"] == pytest.approx(9 - 161 / 20 * 0.28)
    assert "degraded" in antidrive("allocate", "9").out


def test_simulate_keeps_the_contact_while_it_tracks(tmp_path):
    text = """
    title = "short"
    duration = 1.5
    sample_time = 0.005
    reference = { kind = "sine", amplitude = 0.1, frequency = 0.3 }
    """
    (tmp_path / "short.toml").write_text(text)
    result = antidrive("simulate", tmp_path / "short.toml", "--out", tmp_path / "out", "--json")
    assert result.code == 0, result.err
    assert sorted(listing(tmp_path / "out")) == ["report.html", "summary.json", "trajectory.csv"]
    summary = strict_json((tmp_path / "out" / "summary.json").read_text())
    assert strict_json(result.out) == summary
    path = pd.read_csv(tmp_path / "out" / "trajectory.csv")
    assert len(path) == 300
    assert (path.torque_1 >= 0.02).all()
    assert (path.torque_2 <= -0.02).all()
    assert summary["least_preload_margin"] == pytest.approx(path[["contact_torque_1", "contact_torque_2"]].min().min())
    assert summary["least_preload_margin"] > 0
    assert summary["tracking_rms"] == pytest.approx(np.sqrt(np.mean((path.angle - path.reference) ** 2)), rel=1e-6)
    assert summary["tracking_rms"] < 2e-3


def test_the_seed_and_the_model_of_a_simulation_count(tmp_path):
    text = 'duration = 0.2\nsample_time = 0.005\nreference = { kind = "constant", level = 0.1 }\n'
    (tmp_path / "still.toml").write_text(text)
    paths = []
    for name, words in {
        "first": (),
        "again": ("--seed", 0),
        "seeded": ("--seed", 1),
        "modelled": ("--model", write_model(tmp_path / "model.json", PLAIN)),
    }.items():
        assert antidrive("simulate", tmp_path / "still.toml", *words, "--out", tmp_path / name, "--quiet").code == 0
        paths.append((tmp_path / name / "trajectory.csv").read_bytes())
    assert paths[0] == paths[1]
    assert len(set(paths)) == 3


def test_motion_outlives_a_drive_but_preload_does_not(tmp_path):
    text = """
    duration = 1.6
    sample_time = 0.005
    [reference]
    kind = "sine"
    amplitude = 0.1
    frequency = 0.4
    [drive_loss]
    drive = 1
    time = 0.8
    """
    (tmp_path / "loss.toml").write_text(text)
    result = antidrive("simulate", tmp_path / "loss.toml", "--out", tmp_path / "out", "--json")
    assert result.code == 0, result.err
    path, summary = pd.read_csv(tmp_path / "out" / "trajectory.csv"), strict_json(result.out)
    after = path.time >= 0.8
    assert (path.torque_1[after] == 0).all()
    assert path.status[after].str.startswith("degraded: drive 1 is lost").all()
    assert (path.contact_torque_1[after] <= 0).any()
    assert summary["tracking_rms_after_loss"] < 5e-3
    assert summary["least_preload_margin"] > 0


def write(out: Path, *names: str, fails: bool = False) -> None:
    """Write files into a whole folder, and fail before its end if asked to."""
    with whole_folder(out) as draft:
        for name in names:
            (draft / name).write_text("new")
        if fails:
            raise ZeroDivisionError


def test_results_are_whole_or_absent(tmp_path):
    out = tmp_path / "out"
    with pytest.raises(ZeroDivisionError):
        write(out, "a.txt", fails=True)
    assert list(tmp_path.iterdir()) == []
    write(out, "a.txt")
    (out / "a.txt").write_text("old")
    (out / "b.txt").write_text("mine")
    with pytest.raises(ZeroDivisionError):
        write(out, "a.txt", "b.txt", fails=True)
    assert listing(tmp_path) == {"out/a.txt": b"old", "out/b.txt": b"mine"}
    (out / "c.txt").mkdir()
    with pytest.raises(BadParameter, match=r"c\.txt"):
        write(out, "a.txt", "c.txt")
    assert listing(tmp_path) == {"out/a.txt": b"old", "out/b.txt": b"mine"}
    write(out, "a.txt")
    assert listing(tmp_path) == {"out/a.txt": b"new", "out/b.txt": b"mine"}


def test_a_program_fault_exits_with_1_and_leaves_nothing(monkeypatch, log, tmp_path):
    def broken(*_, **__):
        raise RuntimeError("the unexpected")

    monkeypatch.setattr("antidrive.report.fit_page", broken)
    result = antidrive("identify", log, "--out", tmp_path / "out")
    assert result.code == 1
    assert "fault of the program" in result.err
    assert list(tmp_path.iterdir()) == []
    monkeypatch.setattr(cli, "app", lambda *_, **__: (_ for _ in ()).throw(KeyboardInterrupt))
    assert antidrive("demo").code == 130


def test_as_a_process_of_its_own(tmp_path):
    program = [sys.executable, "-c", "import sys; from antidrive.cli import main; sys.exit(main())"]
    log, base = write_csv(tmp_path / "log.csv", columns(PLAIN, duration=4.0)), write_model(tmp_path / "base.json")
    good = subprocess.run(
        [*program, "identify", str(log), "--base", str(base), "--json"], cwd=tmp_path, capture_output=True, text=True
    )
    assert good.returncode == 0, good.stderr
    assert good.stderr == ""
    assert strict_json(good.stdout)["schema"] == 1
    assert sorted(listing(tmp_path / "antidrive-out")) == ["fit.json", "model.json", "report.html"]
    bad = subprocess.run([*program, "identify", "absent.csv"], cwd=tmp_path, capture_output=True, text=True)
    assert bad.returncode == 2
    assert "absent.csv" in bad.stderr
    assert "Traceback" not in bad.stderr
    assert bad.stderr.count("\n") == 1


def test_help_answers_at_once_and_imports_nothing_heavy():
    code = (
        "import sys; from antidrive.cli import main; main(['--help']);"
        "heavy = {'casadi', 'pandas', 'scipy', 'numpy'} & set(sys.modules);"
        "sys.exit(str(heavy) if heavy else 0)"
    )
    begin = time.perf_counter()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "diagnose" in done.stdout
    assert time.perf_counter() - begin < 2.0  # 0.25 s on a quiet machine
