"""The model in other simulators does what it does here, and what they cannot say is listed."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from front_door import TRUTH, antidrive, listing, write_model
from simulators import in_fmu, in_mujoco, in_urdf

from plant import BadParameter, ServoModel, simulate
from plant.effects import (
    ActuatorLag,
    AsymmetricFriction,
    Backlash,
    Cogging,
    Compliance,
    CoulombFriction,
    DeadZone,
    EncoderEccentricity,
    EndStop,
    FrictionDrift,
    GravityOffset,
    InputDelay,
    LoadDependentFriction,
    PreslidingHysteresis,
    SensorLag,
    StribeckFriction,
    TorqueSaturation,
    catalogue,
)
from plant.modelica_class import modelica_class
from plant.mujoco_model import mujoco_model
from plant.urdf import urdf

mujoco = pytest.importorskip("mujoco")

ROOT = Path(__file__).parents[1]
DT = 0.005
TIME = np.arange(500) * DT
COMMAND = 2.0 * np.sin(2.0 * np.pi * 0.6 * TIME) + 0.8 * np.sign(np.sin(2.0 * np.pi * 0.83 * TIME))
EFFECTS = {
    "rigid": (GravityOffset(beta=0.2),),
    "native": (
        InputDelay(time=0.01),
        ActuatorLag(time_constant=0.02),
        TorqueSaturation(limit=1.5),
        CoulombFriction(torque=0.3),
    ),
    "late and dead": (InputDelay(time=0.01), DeadZone(half_width=0.3)),
    "lag before dead zone": (ActuatorLag(time_constant=0.02), DeadZone(half_width=0.3)),
    "friction": (
        LoadDependentFriction(coefficient=0.1),
        StribeckFriction(coulomb=0.2, excess=0.2, velocity=0.3),
        Cogging(amplitude=0.2, order=5.0, phase=0.2),
    ),
    "directions": (AsymmetricFriction(forward=0.4, backward=0.1), EndStop(angle=0.3, stiffness=200.0)),
    "presliding": (
        PreslidingHysteresis(torque=0.3, stiffness=5.0),
        EncoderEccentricity(amplitude=0.05, order=1.0, phase=0.2),
    ),
    "compliance": (Compliance(frequency=60.0, damping=0.05, motor_share=0.3), CoulombFriction(torque=0.3)),
    "backlash": (Backlash(gap=0.05, motor_share=0.2, flank_frequency=200.0),),
}


def model_with(*effects: object) -> ServoModel:
    return ServoModel(inertia=0.5, gravity=0.3, viscous_friction=0.2, effects=effects)


@pytest.mark.parametrize("name", EFFECTS)
def test_mujoco_moves_as_the_model_does(name, tmp_path):
    model = model_with(*EFFECTS[name])
    states = simulate(model, command=COMMAND, dt=DT)
    here = np.array([float(model.measurement(state)) for state in states[:-1]])
    there = in_mujoco(model, COMMAND, DT, tmp_path)
    assert np.ptp(here) > 0.5
    assert np.sqrt(np.mean((there - here) ** 2)) < 3e-3 * np.ptp(here)  # of the first order in steps of 0.5 ms


def test_each_effect_is_in_the_mjcf_or_called_or_left_out():
    made = mujoco_model(
        model_with(
            *EFFECTS["native"], DeadZone(half_width=0.1), FrictionDrift(viscous_rate=0.1), SensorLag(time_constant=0.01)
        )
    )
    assert made.native == (
        "inertia", "viscous friction", "gravity", "Coulomb friction", "torque limit", "actuator lag", "input delay",
    )  # fmt: skip
    assert made.called == ("dead zone",)
    assert made.left_out == (
        "Not in it: sensor lag.",
        "Left out, because it holds for the log alone: friction drift.",
    )
    rigid = mujoco_model(model_with())
    assert (rigid.called, list(rigid.files)) == ((), ["antidrive.xml"])


def test_the_page_on_simulators_lists_what_is_left_out():
    page = " ".join((ROOT / "docs/howto/simulators.md").read_text(encoding="utf-8").split())
    for kind in catalogue.values():
        model = ServoModel(effects=(kind(**{spec.name: 0.3 for spec in kind.parameters()}),))
        if mujoco_model(model).left_out or modelica_class(model).left_out:
            assert kind.title in page, kind.name


def test_urdf_has_damping_friction_limit_and_weight():
    effects = (
        TorqueSaturation(limit=1.5),
        GravityOffset(beta=0.2),
        StribeckFriction(coulomb=0.2, excess=0.1, velocity=0.1),
    )
    made = urdf(model_with(*effects, DeadZone(half_width=0.1)))
    machine = mujoco.MjModel.from_xml_string(made.text)
    assert machine.dof_damping[0] == pytest.approx(0.2)
    assert machine.dof_frictionloss[0] == pytest.approx(0.2)
    data = mujoco.MjData(machine)
    for angle in (0.0, 0.7, 2.0):
        data.qpos[0] = angle
        mujoco.mj_forward(machine, data)
        assert data.qfrc_bias[0] == pytest.approx(0.3 * np.cos(angle) + 0.2 * np.sin(angle))
    full = np.zeros((1, 1))
    mujoco.mj_fullM(machine, data, full) if mujoco.__version__ >= "4" else mujoco.mj_fullM(machine, full, data.qM)
    assert full[0, 0] == pytest.approx(0.5)
    assert made.left_out == (
        "As its nearest Coulomb friction: Stribeck friction.",
        "URDF cannot express: dead zone.",
    )


def test_what_a_sensor_adds_is_listed_too():
    model = model_with(DeadZone(half_width=0.1), EncoderEccentricity(amplitude=0.01, order=1.0, phase=0.3))
    assert urdf(model).left_out == ("URDF cannot express: dead zone, encoder eccentricity.",)
    made = mujoco_model(model)
    assert made.called == ("dead zone", "encoder eccentricity")
    assert "dead zone, encoder eccentricity." in made.files["antidrive_mujoco.py"].splitlines()[0]
    assert "cycles/rev: periods per turn" in made.files["antidrive_mujoco.py"]
    assert " -0" not in made.files["antidrive.xml"]


def test_urdf_moves_as_what_it_can_describe():
    model = model_with(CoulombFriction(torque=0.3))
    here = simulate(model, command=COMMAND, dt=DT)[:-1, 0]
    there = in_urdf(model, COMMAND, DT)
    assert np.sqrt(np.mean((there - here) ** 2)) < 0.02 * np.ptp(here)  # its friction creeps where it should stick


def test_the_fmu_with_one_torque_moves_as_the_model_does(tmp_path):
    here = simulate(TRUTH, command=COMMAND[:200], dt=DT)[:-1, 0]
    assert in_fmu(TRUTH, COMMAND[:200], DT, tmp_path).tolist() == here.tolist()


LINEAR = {
    "rigid": (CoulombFriction(torque=6.0), TorqueSaturation(limit=60.0)),
    "dead": (InputDelay(time=0.01), DeadZone(half_width=5.0), Cogging(amplitude=3.0, order=60.0, phase=0.2)),
    "presliding": (PreslidingHysteresis(torque=6.0, stiffness=60.0), EndStop(angle=0.1, stiffness=4000.0)),
    "compliance": (Compliance(frequency=60.0, damping=0.05, motor_share=0.3), CoulombFriction(torque=6.0)),
}


@pytest.mark.parametrize("name", LINEAR)
def test_a_linear_axis_slides_in_mujoco(name, tmp_path):
    model = ServoModel(axis="linear", inertia=20.0, gravity=0.0, viscous_friction=30.0, effects=LINEAR[name])
    force = 30.0 * COMMAND
    here = simulate(model, command=force, dt=DT)[:-1, 0]
    there = in_mujoco(model, force, DT, tmp_path)
    assert np.ptp(here) > 0.2
    assert np.sqrt(np.mean((there - here) ** 2)) < 3e-3 * np.ptp(here)
    for text in mujoco_model(model).files.values():
        assert not re.findall(r"angle \[|torque \[|\[rad\]|\[N m\]|kg m\^2", text)


def test_a_linear_axis_is_a_prismatic_joint_in_urdf():
    effects = (CoulombFriction(torque=6.0), TorqueSaturation(limit=60.0))
    model = ServoModel(axis="linear", inertia=20.0, gravity=0.0, viscous_friction=30.0, effects=effects)
    made = urdf(model)
    assert '<joint name="antidrive" type="prismatic">' in made.text
    assert '<limit lower="-1000" upper="1000" effort="60" velocity="1e9"/>' in made.text
    assert '<mass value="20"/>' in made.text
    assert made.left_out == ("The travel is not in the model: write yours in place of 1000 m.",)
    here = simulate(model, command=20.0 * COMMAND, dt=DT)[:-1, 0]  # within the limit
    assert np.sqrt(np.mean((in_urdf(model, 20.0 * COMMAND, DT) - here) ** 2)) < 0.02 * np.ptp(here)


@pytest.mark.parametrize(
    ("unit", "axis", "said"),
    [
        ("A", "rotary", "need a torque in N m, but that of the model is in A; .* with --torque-constant"),
        ("V", "rotary", "need a torque in N m, but that of the model is in V; .* with --scale torque="),
        ("m", "linear", "need a force in N, but that of the model is in m; .* with --kp"),
    ],
)
def test_a_torque_without_its_scale_is_refused(unit, axis, said):
    for make in (mujoco_model, urdf):
        with pytest.raises(BadParameter, match=said):
            make(ServoModel(gravity=0.0, axis=axis, torque_unit=unit))


@pytest.mark.parametrize(
    ("form", "files"),
    [
        ("mujoco", ["antidrive.xml", "antidrive_mujoco.py"]),
        ("urdf", ["antidrive.urdf"]),
        ("modelica", ["Antidrive.mo"]),
        ("plant", ["antidrive_plant.fmu"]),
    ],
)
def test_the_command_writes_the_files(form, files, tmp_path):
    model, out = write_model(tmp_path / "model.json", TRUTH), tmp_path / "out"
    result = antidrive("export", model, f"--{form}", "--out", out, "--json")
    assert result.code == 0, result.err
    assert sorted(listing(out)) == files == json.loads(result.out)["files"]
    again = antidrive("export", model, f"--{form}", "--feedforward", "--out", out)
    assert (again.code, again.err.count("two exports")) == (2, 1)
