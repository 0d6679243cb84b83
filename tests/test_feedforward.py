"""Feed-forward as code: C99 and Structured Text say what `model.inverse` says."""

from __future__ import annotations

import ctypes
import math
import os
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from plant import BadParameter, ServoModel
from plant.effects import (
    BackEmf,
    Cogging,
    DeadZone,
    EndStop,
    InputDelay,
    LoadDependentFriction,
    PreslidingHysteresis,
    StribeckFriction,
    TorqueOffset,
)
from plant.effects.nonparametric_curve import CurveOverTorque, CurveOverVelocity
from plant.effects.parameter_varying import FrictionOverTurn
from plant.feedforward import Feedforward, feedforward_code

COMPILER = shutil.which("cc") or shutil.which("gcc")
MATIEC = os.environ.get("MATIEC")  # the folder in which matiec was built: iec2c, and lib beside it
NAMED = ServoModel(
    inertia=0.5,
    gravity=0.3,
    viscous_friction=0.2,
    effects=(
        InputDelay(time=0.01),
        BackEmf(constant=0.1),
        DeadZone(half_width=0.1),
        TorqueOffset(torque=-0.05),
        LoadDependentFriction(coefficient=0.1),
        StribeckFriction(coulomb=0.2, excess=0.1, velocity=0.3),
        Cogging(amplitude=0.05, order=6.0, phase=0.4),
        EndStop(angle=0.8, stiffness=3.0),
    ),
)
REMEMBERING = ServoModel(
    inertia=0.5,
    gravity=0.3,
    viscous_friction=0.2,
    effects=(DeadZone(half_width=0.1), PreslidingHysteresis(torque=0.2, stiffness=3.0)),
)
CURVED = ServoModel(
    inertia=0.5,
    gravity=0.3,
    viscous_friction=0.2,
    effects=(
        CurveOverVelocity(low=-3.0, high=3.0, c0=0.3, c2=0.2, c6=-0.2, c8=-0.3),
        CurveOverTorque(low=-2.0, high=2.0, c0=-0.1, c2=0.1, c8=0.1),
        FrictionOverTurn(low=0.0, high=2.0 * math.pi, c0=0.1, c3=0.2),
    ),
)
LINEAR = ServoModel(inertia=3.0, gravity=0.0, viscous_friction=10.0, axis="linear")
MODELS = {"named": NAMED, "remembering": REMEMBERING, "curved": CURVED, "linear": LINEAR}


def motion() -> np.ndarray:
    """(T, 3) angle, velocity, acceleration of a swing with a stop, in numbers that single precision has too."""
    time = np.arange(400) * 0.01
    angle, velocity = np.sin(3.0 * time), 3.0 * np.cos(3.0 * time)
    velocity[100:110] = 0.0
    return np.column_stack((angle, velocity, -9.0 * angle)).astype(np.float32).astype(float)


def expected(model: ServoModel) -> pd.DataFrame:
    return model.inverse(*motion().T)


def compiled(made: Feedforward, folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Torque (T,) and shares (T, n) that the C code gives along the motion."""
    for name, text in made.files.items():
        (folder / name).write_text(text)
    line = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-shared", "-fPIC"]
    subprocess.run([str(COMPILER), *line, "elbow_feedforward.c", "-o", "library.so", "-lm"], cwd=folder, check=True)
    library = ctypes.CDLL(str(folder / "library.so"))
    real = ctypes.c_float if made.single else ctypes.c_double
    kept = (real * 64)()
    library.elbow_feedforward.restype = real
    library.elbow_feedforward_init(ctypes.byref(kept), real(motion()[0, 0]))
    torques, shares = [], []
    for row in motion():
        torques.append(library.elbow_feedforward(ctypes.byref(kept), *(real(value) for value in row)))
        shares.append(kept[: len(made.shares)])
    return np.array(torques), np.array(shares)


@pytest.mark.skipif(COMPILER is None, reason="there is no C compiler")
@pytest.mark.parametrize("single", [False, True])
@pytest.mark.parametrize("name", MODELS)
def test_the_c_code_gives_the_torque_of_the_model(name, single, tmp_path):
    model, made = MODELS[name], feedforward_code(MODELS[name], single=single, name="elbow")
    torque, shares = compiled(made, tmp_path)
    wanted = expected(model)
    close = {"rtol": 2e-5, "atol": 2e-5} if single else {"rtol": 1e-12, "atol": 1e-12}
    assert np.allclose(torque, wanted.iloc[:, -1], **close)
    assert np.allclose(shares, wanted[list(made.shares)], **close)
    assert np.ptp(torque) > 1.0


def test_single_precision_says_how_its_phase_is_rounded():
    ripple = Cogging(amplitude=3.0, order=2513.0, phase=0.4)
    rough = ServoModel(inertia=3.0, gravity=0.0, axis="linear", effects=(ripple,))
    said = "Single precision rounds the phase of the cogging, by up to 0.0005 rad for each m of the position from zero."
    for file in ("antidrive_feedforward.h", "antidrive_feedforward.st"):
        assert said in feedforward_code(rough, single=True).files[file]
        assert "Single precision" not in feedforward_code(rough).files[file]
        assert "Single precision" not in feedforward_code(LINEAR, single=True).files[file]
    place = np.linspace(0.0, 2.0, 9999)
    off = np.float32(ripple.order) * place.astype(np.float32) - ripple.order * place
    assert 0.2 < np.max(np.abs(off[1:]) / (5e-4 * place[1:])) < 1.0


def test_only_a_model_with_presliding_speaks_of_it():
    for model, told in ((LINEAR, False), (REMEMBERING, True)):
        header = feedforward_code(model).files["antidrive_feedforward.h"]
        assert ("presliding starts unloaded" in header) == told


def evaluated(text: str, rows: np.ndarray) -> list[dict[str, float]]:
    """All variables of a function block after each row, by a few lines that know no more of the language than it uses.

    It is independent of how the code is written: literals, assignments and calls become Python's.
    """
    variables: dict[str, float] = {}
    for name, value in re.findall(r"^    (\w+) : (?:L?REAL|BOOL)(?: := ([-\d.E]+))?;", text, re.MULTILINE):
        variables[name] = float(value or 0.0)
    body = re.sub(r"\(\*.*?\*\)", "", text[text.rindex("END_VAR") + 7 : text.index("END_FUNCTION_BLOCK")])
    body = re.sub(r"IF NOT (\w+) THEN(.*?)END_IF;", r"", body, flags=re.DOTALL)  # the first call; done below
    lines = []
    for name, value in re.findall(r"(\w+) := ([^;]*);", body):
        value = re.sub(r"(?<![<>:])=", "==", value.replace("<>", "!="))
        for word in ("AND", "OR", "NOT"):
            value = re.sub(rf"\b{word}\b", word.lower(), value)
        lines.append(compile(f"{name} = {value}", "block", "exec"))
    words = {
        "SEL": lambda which, no, yes: yes if which else no,
        "MIN": min,
        "MAX": max,
        "ABS": abs,
        "EXP": math.exp,
        "LN": math.log,
        "SQRT": math.sqrt,
        "SIN": math.sin,
        "COS": math.cos,
        "TRUNC": math.trunc,
        "DINT_TO_LREAL": float,
        "DINT_TO_REAL": float,
    }
    if "angle_before" in variables:
        variables["angle_before"] = rows[0, 0]
    found = []
    for row in rows:
        variables |= dict(zip(list(variables)[:3], row, strict=True))
        for line in lines:
            exec(line, words, variables)
        found.append(dict(variables))
    return found


@pytest.mark.parametrize("name", MODELS)
def test_the_structured_text_gives_the_torque_of_the_model(name):
    model, made = MODELS[name], feedforward_code(MODELS[name], name="elbow")
    found = evaluated(made.files["elbow_feedforward.st"], motion())
    wanted = expected(model)
    for share in made.shares:
        assert np.allclose([row[f"share_{share}"] for row in found], wanted[share], rtol=1e-9, atol=1e-9), share
    last = list(wanted)[-1]
    assert np.allclose([row[last] for row in found], wanted[last], rtol=1e-9, atol=1e-9)


DRIVER = """
#include <stdio.h>
#include "iec_std_lib.h"
#include "accessor.h"
TIME __CURRENT_TIME; BOOL __DEBUG;
#include "POUS.h"
#include "POUS.c"
int main(void) {
  static FB_ELBOWFEEDFORWARD block; double x, v, a;
  FB_ELBOWFEEDFORWARD_init__(&block, 0);
  while (scanf("%lf %lf %lf", &x, &v, &a) == 3) {
    block.PLACE.value = x; block.VELOCITY.value = v; block.ACCELERATION.value = a;
    FB_ELBOWFEEDFORWARD_body__(&block);
    printf("%.17g\\n", (double)block.OUTPUT.value);
  }
  return 0;
}
"""


@pytest.mark.skipif(MATIEC is None or COMPILER is None, reason="MATIEC names no folder with the compiler matiec")
@pytest.mark.parametrize("single", [False, True])
@pytest.mark.parametrize("name", MODELS)
def test_matiec_compiles_the_structured_text(name, single, tmp_path):
    model, made = MODELS[name], feedforward_code(MODELS[name], single=single, name="elbow")
    (tmp_path / "elbow.st").write_text(made.files["elbow_feedforward.st"])
    library = Path(str(MATIEC)) / "lib"
    subprocess.run([f"{MATIEC}/iec2c", "-I", library, "-T", tmp_path, tmp_path / "elbow.st"], check=True)
    wanted, place = expected(model).iloc[:, -1], "ANGLE" if model.axis == "rotary" else "POSITION"
    (tmp_path / "main.c").write_text(DRIVER.replace("OUTPUT", str(wanted.name).upper()).replace("PLACE", place))
    line = [str(COMPILER), "-w", f"-I{library / 'C'}", f"-I{tmp_path}", tmp_path / "main.c", "-lm"]
    subprocess.run([*line, "-o", tmp_path / "run"], check=True)
    rows = "\n".join(" ".join(map(repr, row)) for row in motion().tolist())
    done = subprocess.run([tmp_path / "run"], input=rows, capture_output=True, text=True, check=True)
    close = {"rtol": 2e-5, "atol": 2e-5} if single else {"rtol": 1e-9, "atol": 1e-9}
    assert np.allclose([float(line) for line in done.stdout.split()], wanted, **close)


def test_units_and_limits_are_in_the_header():
    made = feedforward_code(NAMED, name="elbow_2", single=True)
    header, source, block = made.files.values()
    assert "angle [rad], velocity [rad/s], acceleration [rad/s^2]" in header
    assert "typedef float elbow_2_real;" in header
    assert "#define ELBOW_2_LEAD 0.01" in header
    assert "stribeck_friction_velocity = 0.3f; /* rad/s: Stribeck velocity v_s */" in source
    assert "FUNCTION_BLOCK FB_Elbow2Feedforward" in block
    assert "stribeck_friction_velocity : REAL := 0.3; (* rad/s: Stribeck velocity v_s *)" in block
    for text in (header, block):
        assert "give set-points that lie 0.01 s ahead" in text
    assert made.summary()["left_out"] == ["The torque acts late: give set-points that lie 0.01 s ahead."]
    assert max(len(line) for line in header.splitlines()) < 130


def test_a_linear_axis_has_its_units():
    header = feedforward_code(LINEAR).files["antidrive_feedforward.h"]
    assert "force [N]" in header
    assert "position [m], velocity [m/s], acceleration [m/s^2]" in header


@pytest.mark.parametrize("name", ["", "Elbow", "2nd", "a__b", "a-b", "elbow_"])
def test_a_name_that_is_no_identifier_is_refused(name):
    with pytest.raises(BadParameter, match="small letters"):
        feedforward_code(NAMED, name=name)
