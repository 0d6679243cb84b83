"""C for a target: the torques of the Python controller, in bounds that are counted, and the command that writes it."""

from __future__ import annotations

import gzip
import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from front_door import antidrive, listing, write_model
from target import MODELS, PAPER, UNEQUAL, Loaded, at_its_worst, built, played, recorded

from mpc import Controller, effort
from mpc.export import FILES, _own, export
from plant import Rig, ServoModel, read_model

needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc here")
pytestmark = needs_gcc
OPTIONS = {  # of the controller, and whether the reference is known ahead
    "rigid": ({}, False),
    "late": (
        {"max_torque": 0.2, "rotor_inertia": 1e-5, "motor_friction": 1e-3, "horizon": 12, "angle_limits": (-0.1, 0.05)},
        True,
    ),
    "lag": ({"sqp_iterations": 3, "torque_rate": 20.0, "preload_rate": 0.5, "motor_resolution": 1e-3}, True),
    "compliance": ({"sample_time": 0.004, "horizon": 20, "speed_limit": 0.2}, False),
}


def controller(name: str) -> Controller:
    options = OPTIONS[name][0]
    return Controller(MODELS[name], UNEQUAL if name == "late" else PAPER, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", MODELS)
def test_the_target_hands_out_the_torques_of_python(name: str, tmp_path: Path) -> None:
    recording = recorded(controller(name), ahead=OPTIONS[name][1])
    assert len(set(recording.statuses)) > 3  # among them readings that are lost and a jump
    used = controller(name)
    used.step(0.1, 0.2)  # what the exported one has seen does not count
    torques, statuses = played(built(export(used).files, tmp_path / "double", "-O2"), recording.lines)
    assert statuses == recording.statuses
    np.testing.assert_array_equal(torques, recording.torques)


@pytest.mark.parametrize(
    ("name", "turns", "ahead", "near"),
    [
        ("rigid", 0, False, 1e-4),
        pytest.param("late", 0, False, 1e-4, marks=pytest.mark.long),
        pytest.param("compliance", 0, False, 1e-4, marks=pytest.mark.long),
        ("rigid", 0, True, 2e-3),
        ("rigid", 10, False, 1e-2),
    ],
)
def test_single_precision_is_near(name: str, turns: int, ahead: bool, near: float, tmp_path: Path) -> None:
    """Sample for sample from the same memory, as README.txt says, and in a loop of its own."""
    used = Controller(MODELS[name], PAPER, max_torque=0.3)
    double, single, beside = (
        Loaded(export(used, single=short), tmp_path / f"{k}") for k, short in enumerate((False, True, True))
    )
    rig, rngs, begin = Rig.paper_like(), [np.random.default_rng(0) for _ in range(2)], 2 * np.pi * turns
    states, count = [rig.rest(begin, (0.02, -0.02))] * 2, 160
    sample = np.arange(count + used.horizon + 1)
    wanted = begin + 0.05 * np.where(sample < 80, 1.0, np.cos(0.02 * (sample - 80)))
    misses, errors = np.empty(count), np.empty((count, 2))
    for k in range(count):
        reference = wanted[k : k + used.horizon + 1] if ahead else float(wanted[k])
        shown = [rig.measure(state, rng) for state, rng in zip(states, rngs, strict=True)]
        beside.memory[:] = double.memory
        torques = double.step(shown[0], reference), single.step(shown[1], reference)
        misses[k] = np.max(np.abs(beside.step(shown[0], reference) - torques[0])) / used.max_torque
        states = [rig.advance(state, xi, 0.005) for state, xi in zip(states, torques, strict=True)]
        errors[k] = [state.angle - wanted[k] for state in states]
    rms = np.sqrt(np.mean(errors**2, axis=0))
    print(f"{name}, {turns} turns: misses {misses.max():.1e} of max_torque; errors {rms[0]:.5f} and {rms[1]:.5f} rad")
    assert misses.max() < near
    assert rms[1] == pytest.approx(rms[0], rel=0.02)


@pytest.mark.parametrize(
    "limits", [{"speed_limit": 0.25}, {"torque_rate": 8.0}, {"angle_limits": (-0.2, 0.2)}], ids=str
)
def test_single_precision_keeps_limits(limits: dict[str, object], tmp_path: Path) -> None:
    made = export(Controller(MODELS["rigid"], PAPER, **limits), single=True)  # type: ignore[arg-type]
    loaded, rig, rng = Loaded(made, tmp_path), Rig.paper_like(), np.random.default_rng(0)
    state, uncertified, before, most = rig.rest(0.0, (0.02, -0.02)), 0, 0.0, np.zeros(3)
    for k in range(500):
        torques = loaded.step(rig.measure(state, rng), 0.3 * np.sin(0.01 * k))
        state = rig.advance(state, torques, 0.005)
        uncertified += bool(loaded.status & 64)
        torque = float(PAPER.output_torque(torques))
        most = np.maximum(most, [abs(state.angle), abs(state.velocity), abs(torque - before) / 0.005 * (k > 0)])
        before = torque
    print(f"{limits}: {uncertified} of 500 not certified; greatest angle, speed and rate {most}")
    assert uncertified <= 10  # as README.txt says
    allowed = {"angle_limits": 0.2004, "speed_limit": 0.255, "torque_rate": 8.016}
    (name,) = limits
    assert most[list(allowed).index(name)] < allowed[name]


@pytest.mark.parametrize("single", [False, True])
@pytest.mark.parametrize("name", ["rigid", "late", "lag"])
def test_no_nan_and_bounds_hold_for_any_input(name: str, single: bool, tmp_path: Path) -> None:
    made = export(controller(name), single=single)
    program = built(made.files, tmp_path, "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    rng, wild = np.random.default_rng(0), [np.nan, np.inf, -np.inf, 1e30, -1e18, 1e300, 1e-300, 1e6, 0.0]
    columns = 4 if name == "lag" else 2
    rows = np.where(rng.random((500, columns)) < 0.2, rng.choice(wild, (500, columns)), rng.normal(size=(500, columns)))
    lines = "".join(",".join(repr(float(number)) for number in row) + "\n" for row in rows)
    torques, statuses = played(program, lines)
    least, most = (np.float32(limit) if single else limit for limit in (0.02, 0.3))
    assert torques.shape == (500, 2)
    for magnitudes in (torques[:, 0], -torques[:, 1]):
        assert np.all((magnitudes >= least) & (magnitudes <= most))
    assert len(set(statuses)) > 5


PAIR = """#include <stdio.h>
#include "antidrive_controller.h"
int main(void)
{
  static struct antidrive_controller one, other;
  antidrive_real torques[2], alone[50][2];
  int k, alike = 0;
  antidrive_init(&one);
  for (k = 0; k < 50; ++k) antidrive_step(&one, 0.001 * k, 0.1, alone[k]);
  antidrive_init(&one);
  antidrive_init(&other);
  for (k = 0; k < 50; ++k) {
    antidrive_step(&other, -0.002 * k, -0.3, torques);
    antidrive_step(&one, 0.001 * k, 0.1, torques);
    alike += torques[0] == alone[k][0] && torques[1] == alone[k][1];
  }
  printf("%d %d\\n", alike, (int)sizeof one);
  return 0;
}
"""


def test_several_controllers_take_the_documented_memory(tmp_path: Path) -> None:
    made = export(controller("rigid"))
    program = built({**made.files, "pair.c": PAIR}, tmp_path, main="pair.c")
    result = subprocess.run([program], capture_output=True, text=True, check=True)
    assert result.stdout == f"50 {made.memory}\n"
    assert f"{made.memory} bytes" in made.files["README.txt"]
    symbols = subprocess.run(["nm", "-g", "--defined-only", program], capture_output=True, text=True, check=True)
    assert not re.search(r" [TDB] (solve|control_step|casadi\w*|stage)$", symbols.stdout, re.M)


@pytest.mark.parametrize("name", MODELS)
def test_the_worst_case_is_counted(name: str, tmp_path: Path) -> None:
    used = controller(name)
    program = built(at_its_worst(export(used)), tmp_path, "-O0", "--coverage")
    readings = ["0.1", "nan", "nan"] if used.motor_resolution else ["0.1"]
    ahead = [*["0.2"] * (used.horizon - 1), "9", "9"]  # known ahead, and searched for a jump to the end
    columns = ",".join([*readings, *ahead])
    subprocess.run([program], input=f"{columns}\n", capture_output=True, text=True, check=True)
    note = next(tmp_path.glob("*antidrive_controller.gcda"))
    subprocess.run(["gcov", "--json-format", note.name], cwd=tmp_path, capture_output=True, check=True)
    reported = json.loads(gzip.decompress(next(tmp_path.glob("*antidrive_controller*.json.gz")).read_bytes()))
    counts = {entry["name"]: entry["execution_count"] for file in reported["files"] for entry in file["functions"]}
    expected = effort.calls(used._machine_code.stages, used._sizes, worst=True)
    expected["preview"] = 0  # which is for a reference that is not known ahead
    assert {stage: counts[stage] for stage in expected} == expected


def stack_of(folder: Path) -> int:
    """Of all functions of the controller as if they were one chain, as the compiler tells them [bytes]."""
    file = next(folder.glob("*antidrive_controller.su"))
    lines = [line.split("\t") for line in file.read_text().splitlines()]
    assert all(line[2] in ("static", "dynamic,bounded") for line in lines)
    return sum(int(line[1]) for line in lines)


@pytest.mark.parametrize(("name", "single"), [("rigid", True), ("lag", False)])
def test_the_stack_is_bounded(name: str, single: bool, tmp_path: Path) -> None:
    made = export(controller(name), single=single)
    for level in ("-O0", "-O2"):
        built(made.files, tmp_path / level, level, "-fstack-usage")
        used = stack_of(tmp_path / level)
        print(f"{name}, {made.precision}, {level}: {used} bytes of stack at most, {made.stack} told")
        assert used <= made.stack


CLOCK = """#include <stdio.h>
#include <time.h>
#include "antidrive_controller.h"
static struct antidrive_controller controller;
int main(void)
{
  static double angle[4096], reference[4096];
  int count = 0, round, k;
  antidrive_real torques[2], best = 1e9;
  while (count < 4096 && scanf("%lf,%lf", angle + count, reference + count) == 2) ++count;
  for (round = 0; round < 20; ++round) {
    clock_t begin = clock();
    antidrive_init(&controller);
    for (k = 0; k < count; ++k) antidrive_step(&controller, angle[k], reference[k], torques);
    double each = (double)(clock() - begin) / CLOCKS_PER_SEC / count;
    if (each < best) best = each;
  }
  printf("%.9f %d\\n", best, count);
  return 0;
}
"""


def test_a_step_takes_less_than_ten_microseconds(tmp_path: Path) -> None:
    recording = recorded(controller("rigid"), ahead=False)
    program = built({**export(controller("rigid")).files, "clock.c": CLOCK}, tmp_path, "-O2", main="clock.c")
    result = subprocess.run([program], input=recording.lines, capture_output=True, text=True, check=True).stdout
    seconds, count = result.split()
    print(f"a step takes {1e6 * float(seconds):.1f} us on average")
    assert int(count) == len(recording.statuses)
    assert float(seconds) < 10e-6


@pytest.mark.skipif(shutil.which("valgrind") is None, reason="no callgrind here: instructions are not counted")
@pytest.mark.parametrize("single", [False, True])
def test_instructions_of_a_step_scale_with_its_operations(single: bool, tmp_path: Path) -> None:
    made = export(controller("rigid"), single=single)
    lines = "".join(recorded(controller("rigid"), ahead=False).lines.splitlines(keepends=True)[100:160])
    steps = instructions(built(made.files, tmp_path / "usual", "-O2"), lines)
    (worst,) = instructions(built(at_its_worst(made), tmp_path / "worst", "-O2"), lines.splitlines()[0])
    usual = float(np.median(steps))
    print(f"{made.precision}: {usual:.0f} instructions usually, {max(steps)} in the hardest here, {worst} at most")
    print(f"counted operations: {made.usual}, {made.worst}")
    assert max(steps) < worst
    for measured, counted in ((usual, made.usual), (worst, made.worst)):
        assert 1.0 < measured / counted.total < 4.0


def instructions(program: Path, lines: str) -> list[int]:
    """How many each step takes, what it calls included."""
    counting = ["--tool=callgrind", "--toggle-collect=antidrive_step", "--dump-after=antidrive_step"]
    line = ["valgrind", *counting, "--callgrind-out-file=steps", str(program)]
    subprocess.run(line, input=lines, capture_output=True, text=True, check=True, cwd=program.parent)
    reported = [
        re.search(r"^(?:summary|totals): (\d+)", file.read_text(), re.M) for file in program.parent.glob("steps*")
    ]
    return [int(found[1]) for found in reported if found and int(found[1])]


def test_the_command_writes_files_that_cmake_builds(tmp_path: Path) -> None:
    model, out = write_model(tmp_path / "model.json", MODELS["late"]), tmp_path / "out"
    torques = ["--max-torque", 0.2, "--min-torque", 0.03]
    words = ["--gears", "20,31:161", "--horizon", 12, "--sample-time", 0.004, *torques]
    result = antidrive("export", model, *words, "--out", out, "--json")
    assert result.code == 0, result.err
    reported = json.loads(result.out)
    assert sorted(listing(out)) == sorted(reported["files"]) == sorted(_own("antidrive", file) for file in FILES)
    limits = {"min_torque": 0.03, "max_torque": 0.2, "sample_time": 0.004, "horizon": 12}
    same = Controller(read_model(model).model, UNEQUAL, **limits)  # type: ignore[arg-type]
    assert listing(out) == {name: text.encode() for name, text in export(same).files.items()}
    if shutil.which("cmake") is None:
        pytest.skip("no cmake here: the build is not tried")
    for step in (("-B", "build"), ("--build", "build")):
        done = subprocess.run(["cmake", *step], cwd=out, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr
        assert "warning" not in done.stdout + done.stderr
    recording = recorded(same, ahead=True, samples=100)
    torques, _ = played(out / "build" / "driver", "angle,reference\n" + recording.lines)
    np.testing.assert_array_equal(torques, recording.torques)


def test_the_driver_refuses_lines_that_it_does_not_understand(tmp_path: Path) -> None:
    reported = controller("rigid")
    program = built(export(reported).files, tmp_path)
    for line in ("1\n", "1,2,3\n", "0.1,0.2\nhello\n"):
        result = subprocess.run([program], input="angle,reference\n" + line, capture_output=True, text=True)
        assert result.returncode == 2
        assert f"numbers instead of 2 or {reported.horizon + 2}" in result.stderr


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("--horizon", 1), "horizon"),
        (("--sample-time", 0), "sample_time"),
        (("--min-torque", 0.4), "min_torque"),
        (("--gears", "20,20:0"), "gears"),
        (("--gears", 20), "20,20:161"),
        (("--gears", "20,20:161", "--ratio", 8), "give one of them"),
        (("--ratio", "8,0"), "other than 0"),
        (("--one-drive",), "--ratio"),
        (("--max-torque", "0.3,0.2,0.1"), "one for each"),
        (("--name", "1st"), "word of C"),
        (("--out", "taken"), "is a file"),
    ],
)
def test_what_cannot_be_exported_is_reported_in_a_sentence(
    words: tuple[object, ...], reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken").write_text("mine")
    model = write_model(tmp_path / "model.json")
    before = listing(tmp_path)
    result = antidrive("export", model, "--out", "out", *words)
    assert result.code == 2
    assert reason in result.err
    assert result.err.count("\n") == 1
    assert listing(tmp_path) == before


def test_a_missing_model_or_one_without_drives_is_not_exported(tmp_path: Path) -> None:
    linear = write_model(tmp_path / "model.json", ServoModel(gravity=0.0, axis="linear"))
    for model, reason in ((linear, "--ratio"), (tmp_path / "absent.json", "cannot be read")):
        result = antidrive("export", model, "--out", tmp_path / "out")
        assert (result.code, result.err.count(reason), result.err.count("\n")) == (2, 1, 1)
        assert not (tmp_path / "out").exists()
