"""Code for a target beside other code: two controllers in a program, C++, -ffast-math, FMUs with absurd numbers."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmu_instance import Slave
from front_door import antidrive, write_model
from target import MODELS, PAPER, STRICT, built, played, recorded

from antidrive.cli_drive_options import DRIVES, LIMITS, TUNING
from mpc import Controller, controller_fmu, export
from plant import ServoModel, servo_fmu
from plant.model_file import ModelFile, read_model

pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc here")
BOTH = """#include <stdio.h>
#include "elbow_controller.h"
#include "wrist_controller.h"
int main(void)
{
  static struct elbow_controller elbow;
  static struct wrist_controller wrist;
  elbow_real one[ELBOW_DRIVES];
  wrist_real other[WRIST_DRIVES];
  int k;
  elbow_init(&elbow);
  wrist_init(&wrist);
  for (k = 0; k < 100; ++k) elbow_step(&elbow, 0.001 * k, 0.3, one), wrist_step(&wrist, 0.001 * k, 0.3, other);
  printf("%.17g %.17g %.17g %.17g %g %g\\n", one[0], one[1], other[0], other[1], ELBOW_MAX_TORQUE, WRIST_MAX_TORQUE);
  return 0;
}
"""
DESIGNS = {"elbow": {"max_torque": 0.3}, "wrist": {"max_torque": 0.1, "horizon": 12}}


def designs() -> dict[str, Controller]:
    return {name: Controller(MODELS["rigid"], PAPER, **options) for name, options in DESIGNS.items()}  # type: ignore[arg-type]


def compiled(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(words, cwd=folder, capture_output=True, text=True)


def test_two_controllers_link_into_one_program(tmp_path: Path) -> None:
    for name, one in designs().items():
        for file, text in export(one, name=name).files.items():
            (tmp_path / file).write_text(text)
    (tmp_path / "both.c").write_text(BOTH)
    sources = ("elbow_controller.c", "wrist_controller.c", "both.c")
    result = compiled(tmp_path, "gcc", *STRICT, *sources, "-o", "both", "-lm")
    assert result.returncode == 0, result.stderr
    *torques, most, other = map(float, compiled(tmp_path, "./both").stdout.split())
    expected = []
    for one in designs().values():
        control = [one.step(0.001 * k, 0.3) for k in range(100)][-1]
        expected += control.torques.tolist()
    assert torques == expected
    assert (most, other) == (0.3, 0.1)


@pytest.mark.skipif(shutil.which("g++") is None, reason="no g++ here")
@pytest.mark.parametrize("single", [False, True])
def test_the_code_is_valid_as_cpp_and_hands_out_the_same_torques(single: bool, tmp_path: Path) -> None:
    one = Controller(MODELS["lag"], PAPER, angle_limits=(-0.2, 0.3))
    files, lines = export(one, single=single).files, recorded(one, ahead=False, samples=120).lines
    torques, _ = played(built(files, tmp_path / "c", "-O2"), lines)
    (tmp_path / "cpp").mkdir()
    for name, text in files.items():
        (tmp_path / "cpp" / name).write_text(text)
    strict = ("-x", "c++", "-std=c++11", "-Wall", "-Wextra", "-Werror", "-ffp-contract=off", "-O2")
    result = compiled(tmp_path / "cpp", "g++", *strict, "antidrive_controller.c", "driver.c", "-o", "program", "-lm")
    assert result.returncode == 0, result.stderr
    again, _ = played(tmp_path / "cpp" / "program", lines)
    np.testing.assert_allclose(again, torques, rtol=1e-4 if single else 0.0)


@pytest.mark.parametrize("flag", ["-ffast-math", "-Ofast", "-ffinite-math-only"])
def test_fast_math_is_refused_by_the_compiler(flag: str, tmp_path: Path) -> None:
    for name, text in export(designs()["elbow"]).files.items():
        (tmp_path / name).write_text(text)
    result = compiled(tmp_path, "gcc", flag, "-c", "antidrive_controller.c")
    assert result.returncode != 0
    assert "without -ffast-math" in result.stderr


@pytest.mark.parametrize(
    "absurd", [{"inertia": 0.0}, {"inertia": -1.0}, {"viscous_friction": -1.0}, {"gravity": np.nan}]
)
def test_an_fmu_refuses_what_python_refuses(
    absurd: dict[str, float], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    fmu = servo_fmu(MODELS["rigid"], sample_time=0.005)
    with pytest.raises(FMICallException):
        Slave(fmu, tmp_path, **absurd)
    assert next(iter(absurd)) in capfd.readouterr().out


def test_fmus_of_several_machines_have_names_of_their_own(tmp_path: Path) -> None:
    model = write_model(tmp_path / "model.json", MODELS["rigid"])
    result = antidrive("export", model, "--fmu", "--name", "elbow", "--out", tmp_path / "out")
    assert result.code == 0, result.err
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["elbow_controller.fmu", "elbow_plant.fmu"]
    slave = Slave(controller_fmu(designs()["elbow"], name="elbow"), tmp_path / "slave")
    assert slave.description.coSimulation.modelIdentifier == "elbow_controller"
    slave.close()


def test_every_option_of_the_controller_is_on_the_command_line() -> None:
    own = {field.name for field in fields(Controller) if field.init} - {"model", "gears"}
    assert set(LIMITS) | set(TUNING) == own
    assert not set(DRIVES) & own


def test_sample_time_and_gears_come_from_the_log_or_are_reported(tmp_path: Path) -> None:
    known = ModelFile(model=MODELS["rigid"], std={}, sample_time=0.004, gears=PAPER)
    known.write(tmp_path / "known.json")
    assert read_model(tmp_path / "known.json").gears == PAPER.__class__(pinion_teeth=(20, 20), output_teeth=161)
    result = antidrive("export", tmp_path / "known.json", "--out", tmp_path / "known")
    assert result.code == 0, result.err
    assert "Sample time 0.004 s, that of the model's log." in result.out
    assert "Drives 20,20:161, as the log of the model was read." in result.out
    assert "#define ANTIDRIVE_SAMPLE_TIME 0.004 " in (tmp_path / "known" / "antidrive_controller.h").read_text()
    by_hand = write_model(tmp_path / "by-hand.json", ServoModel(inertia=2.0))
    result = antidrive("export", by_hand, "--out", tmp_path / "by-hand")
    assert "Assumed: a sample time of 0.005 s" in result.out
    assert "Assumed: the gears 20,20:161 of the paper" in result.out


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({}, "The usual step fits, the worst one does NOT FIT into a sample of 5000 us"),
        ({"sample_time": 0.001}, "Even the usual step does NOT FIT into a sample of 1000 us"),
    ],
)
def test_what_does_not_fit_into_a_sample_is_reported(options: dict[str, float], words: str) -> None:
    made = export(Controller(MODELS["rigid"], PAPER, horizon=30, bandwidth=4.0, **options))
    assert words in made.sentences()[-1]
    assert made.summary()["fits"] == {"usual": "usual step fits" in words, "worst": False}
    assert made.files["README.txt"].count("DOES NOT FIT") == 2 - ("usual step fits" in words)


def test_what_fits_is_not_warned_of() -> None:
    made = export(Controller(MODELS["rigid"], PAPER, horizon=10, sample_time=0.02, bandwidth=1.5), single=True)
    assert len(made.sentences()) == 2
    assert made.summary()["fits"] == {"usual": True, "worst": True}
