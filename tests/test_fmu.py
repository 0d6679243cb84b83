"""FMUs of plant and controller, driven by FMPy: the samples of Python to the last bit."""

from __future__ import annotations

import json
import shutil
import subprocess
import zipfile
from importlib.util import find_spec
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmu_instance import Slave
from front_door import antidrive, listing, write_model
from target import MODELS, PAPER, UNEQUAL, recorded

from mpc import Controller, controller_fmu
from mpc.status import sentence
from plant import BadParameter, Fmu, ServoModel, sample_step, servo_fmu, simulate
from plant.discrete import sample_reading
from plant.effects import Backlash, CoulombFriction, DeadZone, FrictionDrift, InputDelay, SensorLag
from plant.machine_code import compiler
from plant.simulation import beginning

DT = 0.005
LATE = ServoModel.paper().with_effect(InputDelay(time=0.0132)).with_effect(CoulombFriction(torque=0.2))
PLANTS = {
    "late": LATE.with_effect(SensorLag(time_constant=0.01)),
    "gap": MODELS["lag"].with_effect(Backlash(gap=0.01, motor_share=0.3)),
    "drift": MODELS["rigid"].with_effect(FrictionDrift(viscous_rate=0.5, coulomb_rate=0.2)),
    "linear": ServoModel(gravity=0.0, axis="linear", effects=(DeadZone(half_width=0.3),)),
}


def commands(samples: int) -> np.ndarray:
    """Noise that is held for some samples, strong enough to leave every dead zone."""
    rng = np.random.default_rng(0)
    return np.repeat(rng.normal(scale=3.0, size=samples // 5 + 1), 5)[:samples]


def shown(model: ServoModel, states: np.ndarray) -> np.ndarray:
    return np.array(sample_reading(model).map(len(states))(states.T, model.values)).ravel()


@pytest.mark.parametrize("name", PLANTS)
def test_the_plant_is_the_simulation(name: str, tmp_path: Path) -> None:
    model, command = PLANTS[name], commands(300)
    states = simulate(model, command=command, dt=DT)
    angle, torque = ("position", "force") if name == "linear" else ("angle", "torque")
    slave, found = Slave(servo_fmu(model, sample_time=DT), tmp_path), []
    for value in command:
        found.append(slave.get(f"load_{angle}", "velocity", angle))
        slave.sample(**{torque: value})
    assert np.ptp(states[:, 0]) > 0.05
    np.testing.assert_array_equal(found, np.column_stack((states[:-1, :2], shown(model, states[:-1]))))
    slave.close()


def test_the_parameters_count_and_so_does_where_it_starts(tmp_path: Path) -> None:
    fmu, command = servo_fmu(LATE, sample_time=DT), commands(100)
    given = {"inertia": 3.0, "input_delay.time": 0.031, "coulomb_friction.torque": 0.5}
    named = {name.replace(".", "__"): value for name, value in given.items()}
    slave = Slave(fmu, tmp_path, first_angle=0.7, first_velocity=-1.0, **named)
    other = LATE.with_values([given.get(name, value) for name, value in zip(LATE.names, LATE.values, strict=True)])
    states = simulate(other, command=command, dt=DT, state=beginning(other, angle=0.7, velocity=-1.0))
    for value, state in zip(command, states, strict=False):
        assert slave.get("load_angle", "velocity") == state[:2].tolist()
        slave.sample(torque=value)
    for spec in LATE.parameters:
        declared = slave.variables[spec.name]
        assert (declared.causality, declared.unit, float(declared.start)) == (
            "parameter", spec.unit, LATE.values[LATE.names.index(spec.name)]
        )  # fmt: skip
        assert declared.min is None or float(declared.min) == spec.lower
    slave.close()


def test_a_tool_may_step_finer_and_coarser_than_a_sample(tmp_path: Path) -> None:
    fmu, command = servo_fmu(LATE, sample_time=DT), commands(60)
    slave, finer, coarser = (Slave(fmu, tmp_path / name) for name in ("one", "fine", "coarse"))
    for k, value in enumerate(command):
        before = slave.get("angle")
        slave.sample(torque=value)
        for part in range(3):
            assert finer.get("angle") == before
            finer.set(torque=value if part == 0 else 99.0)  # what comes inside a sample is too late for it
            finer.step((k + part / 3) * DT, DT / 3)
        assert finer.get("angle") == slave.get("angle")
        if k % 5 == 0:
            coarser.set(torque=value)
            coarser.step(k * DT, 5 * DT)
        if k % 5 == 4:
            assert coarser.get("angle", "velocity") == slave.get("angle", "velocity")
    for each in (slave, finer, coarser):
        each.close()


@pytest.mark.parametrize("fmu", [servo_fmu(LATE, sample_time=DT), controller_fmu(Controller(LATE, PAPER))])
def test_fmu_instances_are_independent_and_restart_at_any_time(fmu: Fmu, tmp_path: Path) -> None:
    one, other = Slave(fmu, tmp_path / "one"), Slave(fmu, tmp_path / "other")
    inputs = [variable.name for variable in fmu.variables if variable.causality == "input"]
    outputs = [variable.name for variable in fmu.variables if variable.causality == "output"]
    first = []
    for value in commands(40):
        other.sample(**dict.fromkeys(inputs, -value))
        one.sample(**dict.fromkeys(inputs, value))
        first.append(one.get(*outputs))
    one.slave.reset()
    one.begin(7.3)
    for value, expected in zip(commands(40), first, strict=True):
        one.sample(**dict.fromkeys(inputs, value))
        assert one.get(*outputs) == expected
    assert other.get(*outputs) != first[-1]
    one.close()
    other.close()


@pytest.mark.parametrize("name", ["late", "lag"])
def test_the_controller_hands_out_the_torques_of_python(name: str, tmp_path: Path) -> None:
    motors = {"motor_resolution": 1e-3} if name == "lag" else {}
    used = Controller(MODELS[name], PAPER, **motors)  # type: ignore[arg-type]
    recording = recorded(used, ahead=False, samples=300)
    slave = Slave(controller_fmu(used), tmp_path)
    inputs = ["angle", *(["motor_angle_1", "motor_angle_2"] if motors else []), "reference"]
    for line, torques, status in zip(recording.lines.splitlines(), recording.torques, recording.statuses, strict=True):
        slave.sample(**dict(zip(inputs, map(float, line.split(",")), strict=True)))
        assert slave.get("torque_1", "torque_2") == torques.tolist()
        (reasons,) = slave.get("status")
        assert status == ("optimal" if reasons == 0 else f"degraded: {sentence(reasons)}")
    assert len(set(recording.statuses)) > 3
    slave.close()


def test_both_close_the_loop_of_python(tmp_path: Path) -> None:
    model = LATE.without_effect("input_delay")
    options = {"min_torque": 0.03, "max_torque": 0.3, "horizon": 20}
    used, again = (Controller(model, UNEQUAL, **options) for _ in range(2))  # type: ignore[arg-type]
    plant = Slave(servo_fmu(model, sample_time=DT, gears=UNEQUAL), tmp_path)
    controller = Slave(controller_fmu(used), tmp_path)
    step, state, ratios = sample_step(model), beginning(model), UNEQUAL.torque_map
    for _ in range(750):
        (angle,) = plant.get("angle")
        control = again.step(angle, 0.2)
        controller.sample(angle=angle, reference=0.2)
        first, second = controller.get("torque_1", "torque_2")
        assert [first, second] == control.torques.tolist()
        assert controller.get("margin", "disturbance") == [control.margin, control.disturbance]
        plant.sample(torque_1=first, torque_2=second)
        torque = ratios[0] * first + ratios[1] * second
        state = np.array(step(state, [torque, torque, 0, np.inf, 0, DT, 0, 0], model.values)).ravel()
        assert plant.get("load_angle", "velocity") == state[:2].tolist()
    assert plant.get("angle")[0] == pytest.approx(0.2, abs=2e-3)
    plant.close()
    controller.close()


def test_a_tool_simulates_the_file_at_its_own_step(tmp_path: Path) -> None:
    path = tmp_path / "plant.fmu"
    servo_fmu(PLANTS["drift"], sample_time=DT).write(path)
    command = np.array([(0.0, 3.0), (1.0, 3.0)], dtype=[("time", float), ("torque", float)])
    found = fmpy.simulate_fmu(str(path), stop_time=1.0, input=command, output=["load_angle"])
    assert found["time"][1] == DT
    expected = simulate(PLANTS["drift"], command=np.full(200, 3.0), dt=DT)[:, 0]
    np.testing.assert_array_equal(found["load_angle"], expected)


@pytest.mark.parametrize("kind", ["plant", "controller"])
def test_a_tool_goes_back_to_where_it_was(kind: str, tmp_path: Path) -> None:
    plant = servo_fmu(MODELS["rigid"], sample_time=DT)
    slave = Slave(plant if kind == "plant" else controller_fmu(Controller(MODELS["rigid"], PAPER)), tmp_path)
    inputs = ["torque"] if kind == "plant" else ["angle", "reference"]
    outputs = ["angle", "velocity"] if kind == "plant" else ["torque_1", "torque_2", "status"]

    def played(values: np.ndarray) -> list[list[float]]:
        found = []
        for value in values:
            slave.sample(**dict.fromkeys(inputs, 0.1 * value))
            found.append(slave.get(*outputs))
        return found

    played(commands(20))
    samples, state = slave.samples, slave.slave.getFMUstate()
    kept = slave.slave.serializeFMUstate(state)
    first = played(commands(30))
    for back in (state, slave.slave.deSerializeFMUstate(kept)):
        slave.slave.setFMUstate(back)
        slave.samples = samples
        assert played(commands(30)) == first
        slave.slave.freeFMUstate(back)
    slave.close()


def test_what_is_not_understood_is_refused(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    fmu = servo_fmu(MODELS["rigid"], sample_time=DT)
    slave = Slave(fmu, tmp_path)
    for length in (0.0, -DT, np.nan, np.inf):
        with pytest.raises(FMICallException):
            slave.step(0.0, length)
    with pytest.raises(FMICallException):
        slave.slave.getReal([99])
    with pytest.raises(FMICallException):
        slave.slave.getString([0])
    slave.slave.guid = "{another}"
    with pytest.raises(Exception, match="instantiate"):
        slave.slave.instantiate()
    printed = capfd.readouterr().out
    for reason in ("forward by a finite time", "no variable", "fmi2GetString is not offered", "modelDescription.xml"):
        assert reason in printed, printed
    with pytest.raises(BadParameter, match="sample_time"):
        servo_fmu(MODELS["rigid"], sample_time=0.0)
    with pytest.raises(BadParameter, match="linear"):
        servo_fmu(PLANTS["linear"], sample_time=DT, gears=PAPER)


def test_the_file_is_the_same_each_time_and_brings_its_source(tmp_path: Path) -> None:
    for name in ("one.fmu", "two.fmu"):
        servo_fmu(MODELS["rigid"], sample_time=DT).write(tmp_path / name)
    assert (tmp_path / "one.fmu").read_bytes() == (tmp_path / "two.fmu").read_bytes()
    other = servo_fmu(MODELS["rigid"], sample_time=0.004)
    with zipfile.ZipFile(tmp_path / "one.fmu") as made:
        assert other.guid not in made.read("modelDescription.xml").decode()
        assert "sample_step" in made.read("sources/antidrive_plant.c").decode()


WILD = """
#include <stdio.h>
int main(void)
{
  const double wild[] = {0, NAN, INFINITY, -INFINITY, 1e300, -1e-300, 7, -0.3};
  struct slave *slave = fmi2Instantiate("wild", CO_SIMULATION, GUID, "", NULL, 0, 0);
  double now = 0, value;
  unsigned which;
  fmi2SetupExperiment(slave, 0, 0, 0, 0, 0);
  fmi2EnterInitializationMode(slave);
  fmi2ExitInitializationMode(slave);
  for (int k = 0; k < 4000; ++k) {
    for (which = 0; which < VARIABLES; ++which) {
      value = wild[(k / 7 + 3 * which + k * k) % 8];
      if (k % (11 + which) == 0) fmi2SetReal(slave, &which, 1, &value);
    }
    value = SAMPLE_TIME * (1 + k % 9) / 3;
    if (fmi2DoStep(slave, now, value, 1)) return 1;
    now += value;
    for (which = 0; which < VARIABLES; ++which) fmi2GetReal(slave, &which, 1, &value);
  }
  which = VARIABLES;
  if (fmi2GetReal(slave, &which, 1, &value) != ERROR || fmi2DoStep(slave, now, NAN, 1) != ERROR) return 1;
  fmi2FreeInstance(slave);
  puts("whole");
  return 0;
}
"""


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc here")
@pytest.mark.parametrize("fmu", [servo_fmu(LATE, sample_time=DT), controller_fmu(Controller(LATE, PAPER))])
def test_nothing_is_undefined_whatever_is_set(fmu: Fmu, tmp_path: Path) -> None:
    (tmp_path / "wild.c").write_text(fmu.source + WILD)
    unused = ["-Wno-unused-parameter", "-Wno-unused-function"]  # CasADi writes some
    strict = ["-std=c99", "-Wall", "-Wextra", "-Werror", *unused]
    checked = ["-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all", "wild.c", "-o", "wild", "-lm"]
    done = subprocess.run(["gcc", *strict, *checked], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    done = subprocess.run([tmp_path / "wild"], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "whole\n"), done.stderr


def test_without_a_compiler_there_is_no_fmu(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fmu = servo_fmu(MODELS["rigid"], sample_time=DT)
    for command, reason in (("", "needs a C compiler"), ("false", "cannot compile")):
        monkeypatch.setenv("CC", command)
        compiler.cache_clear()
        with pytest.raises(BadParameter, match=reason):
            fmu.write(tmp_path / "plant.fmu")
        assert listing(tmp_path) == {}
    compiler.cache_clear()


@pytest.mark.skipif(find_spec("ziglang") is None, reason="no ziglang here: no libraries for other platforms")
def test_ziglang_brings_the_other_platforms(tmp_path: Path) -> None:
    servo_fmu(MODELS["rigid"], sample_time=DT).write(tmp_path / "plant.fmu")
    assert set(fmpy.supported_platforms(str(tmp_path / "plant.fmu"))) >= {"linux64", "darwin64", "win64"}


def test_the_command_writes_both(tmp_path: Path) -> None:
    model, out = write_model(tmp_path / "model.json", LATE), tmp_path / "out"
    result = antidrive("export", model, "--fmu", "--out", out, "--sample-time", 0.004, "--json")
    assert result.code == 0, result.err
    reported = json.loads(result.out)
    assert sorted(listing(out)) == sorted(reported["files"]) == ["antidrive_controller.fmu", "antidrive_plant.fmu"]
    for entry in reported["fmus"]:
        found = fmpy.read_model_description(str(out / f"{entry['name']}.fmu"))
        assert float(found.defaultExperiment.stepSize) == 0.004
        by = {kind: [v.name for v in found.modelVariables if v.causality == kind] for kind in ("input", "output")}
        assert (by["input"], by["output"]) == (entry["inputs"], entry["outputs"])
    assert "input_delay.time" in reported["fmus"][1]["parameters"]
    refused = antidrive("export", model, "--fmu", "--single", "--out", tmp_path / "other")
    assert (refused.code, refused.err.count("double precision"), refused.err.count("\n")) == (2, 1, 1)
    assert not (tmp_path / "other").exists()
