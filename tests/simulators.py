"""A servo in the tools that it is exported to: MuJoCo, URDF, an FMU, Modelica, and a linear model."""

from __future__ import annotations

import importlib.util
import logging
from pathlib import Path
from unittest.mock import patch

import casadi as ca
import numpy as np
from fmu_instance import Slave

from plant import ServoModel, linearise, servo_fmu
from plant.linear import operating_point
from plant.modelica_class import modelica_class
from plant.mujoco_model import mujoco_model
from plant.urdf import urdf


def in_mujoco(
    model: ServoModel, command: np.ndarray, dt: float, folder: Path, *, angle: float = 0.0, velocity: float = 0.0
) -> np.ndarray:
    """(T,) what the sensor shows at each sample, by the files of `mujoco_model`."""
    import mujoco

    folder.mkdir(parents=True, exist_ok=True)
    made = mujoco_model(model, sample_time=dt)
    for name, text in made.files.items():
        (folder / name).write_text(text)
    machine = mujoco.MjModel.from_xml_path(str(folder / "antidrive.xml"))
    data, servo = mujoco.MjData(machine), None
    data.qpos[:], data.qvel[:] = angle, velocity
    if len(made.files) > 1:
        spec = importlib.util.spec_from_file_location("antidrive_mujoco", folder / "antidrive_mujoco.py")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        servo = module.Servo(machine)
    found = []
    for torque in command:
        found.append(float(data.joint("load").qpos[0]) if servo is None else float(servo.measurement(data)))
        for _ in range(round(dt / machine.opt.timestep)):
            if servo is None:
                data.ctrl[0] = torque
                mujoco.mj_step(machine, data)
            else:
                servo.step(machine, data, torque)
    return np.array(found)


def in_urdf(
    model: ServoModel, command: np.ndarray, dt: float, *, angle: float = 0.0, velocity: float = 0.0
) -> np.ndarray:
    """(T,) angle of the load, by the URDF in MuJoCo, in steps of half a millisecond at most."""
    import mujoco

    machine = mujoco.MjModel.from_xml_string(urdf(model).text)
    steps = int(np.ceil(dt / 5e-4))
    machine.opt.timestep = dt / steps
    data, found = mujoco.MjData(machine), []
    data.qpos[:], data.qvel[:] = angle, velocity
    for torque in command:
        found.append(float(data.qpos[0]))
        data.qfrc_applied[0] = torque
        mujoco.mj_step(machine, data, steps)
    return np.array(found)


def in_fmu(
    model: ServoModel, command: np.ndarray, dt: float, folder: Path, *, angle: float = 0.0, velocity: float = 0.0
) -> np.ndarray:
    """(T,) what the sensor shows at each sample, by the FMU with one torque in FMPy."""
    slave, found = Slave(servo_fmu(model, sample_time=dt), folder, first_angle=angle, first_velocity=velocity), []
    for torque in command:
        found += slave.get("angle")
        slave.sample(torque=float(torque))
    slave.close()
    return np.array(found)


def in_modelica(
    model: ServoModel, command: np.ndarray, dt: float, *, angle: float = 0.0, velocity: float = 0.0
) -> np.ndarray:
    """(T,) angle at each sample: the class translated by pymoca, integrated by Runge and Kutta's method.

    pymoca cannot translate a dead time, so it is applied to the command.
    """
    from pymoca.backends.casadi.generator import generate
    from pymoca.parser import parse

    logging.getLogger("pymoca").setLevel(logging.ERROR)
    late = float(model.delay())
    text = modelica_class(model.without_effect("input_delay")).text
    with patch.object(ca.MX, "__div__", ca.MX.__truediv__, create=True):  # as pymoca calls it
        made = generate(parse(text), "Antidrive")
    states, others = len(made.states), len(made.alg_states)
    x, rates, inner, torque = (ca.MX.sym(n, c) for n, c in (("x", states), ("r", states), ("i", others), ("u", 1)))
    values = ca.DM([float(p.value) for p in made.parameters])
    off = made.dae_residual_function(0, x, rates, inner, torque, ca.DM(0, 1), values)
    parts = {"x": ca.vertcat(rates, inner), "p": ca.vertcat(x, torque), "g": off}
    solve, guess = ca.rootfinder("solve", "newton", parts), np.ones(states + others)
    names, steps = [s.symbol.name() for s in made.states], int(np.ceil(dt / 6.25e-4))
    h, z = dt / steps, np.array([{"angle": angle, "velocity": velocity}.get(name, 0.0) for name in names])

    def rate(at: np.ndarray, input_torque: float) -> np.ndarray:
        return np.array(solve(guess, np.append(at, input_torque))).ravel()[:states]

    found = []
    for sample in range(len(command)):
        found.append(z[names.index("angle")])
        for step in range(steps):
            at = int(np.floor(sample + (step + 0.5) / steps - late / dt))
            now = command[at] if at >= 0 else 0.0
            first = rate(z, now)
            second = rate(z + h / 2 * first, now)
            third = rate(z + h / 2 * second, now)
            z = z + h / 6 * (first + 2 * second + 2 * third + rate(z + h * third, now))
    return np.array(found)


def in_state_space(
    model: ServoModel, command: np.ndarray, dt: float, *, angle: float, velocity: float, around: float, width: float
) -> np.ndarray:
    """(T,) angle at each sample by the linear model around an angle, simulated by python-control."""
    import control

    system = linearise(model, sample_time=dt, angle=around, width=width)
    torque, _ = operating_point(model, sample_time=dt, angle=around, velocity=0.0, width=width)
    begun = [{"angle": angle - around, "velocity": velocity}.get(name, 0.0) for name in system.state_labels]
    found = control.forced_response(system, inputs=command - torque, initial_state=begun)
    return np.asarray(around + found.outputs)
