"""A servo in the simulators that it is exported to: MuJoCo, also from URDF, and an FMU in FMPy."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
from fmu_instance import Slave

from plant import ServoModel, servo_fmu
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
        found.append(float(data.joint("load").qpos[0]) if servo is None else float(servo.reading(data)))
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
