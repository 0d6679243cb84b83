"""The plant: model, effects, simulation and exports of a servo. Every other package builds on it."""

from __future__ import annotations

from plant.discrete import sample_step
from plant.drive_table import DriveTable, drive_table
from plant.drive_train import DriveTrain
from plant.effects import Effect, catalogue
from plant.errors import AntidriveError, BadModelFile, BadParameter
from plant.feedforward import Feedforward, feedforward_code
from plant.first_experiment import DriveLimits, first_experiment
from plant.fleet import Fleet
from plant.fmu import Fmu
from plant.gears import GearTrain, Ratios
from plant.linear import linearise
from plant.model_file import ModelFile, read_model, write_model
from plant.modelica_class import ModelicaClass, modelica_class
from plant.mujoco_model import MujocoModel, mujoco_model
from plant.rig import Rig
from plant.servo import ServoModel
from plant.servo_fmu import servo_fmu
from plant.simulation import simulate
from plant.urdf import Urdf, urdf

__all__ = [
    "AntidriveError",
    "BadModelFile",
    "BadParameter",
    "DriveLimits",
    "DriveTable",
    "DriveTrain",
    "Effect",
    "Feedforward",
    "Fleet",
    "Fmu",
    "GearTrain",
    "ModelFile",
    "ModelicaClass",
    "MujocoModel",
    "Ratios",
    "Rig",
    "ServoModel",
    "Urdf",
    "catalogue",
    "drive_table",
    "feedforward_code",
    "first_experiment",
    "linearise",
    "modelica_class",
    "mujoco_model",
    "read_model",
    "sample_step",
    "servo_fmu",
    "simulate",
    "urdf",
    "write_model",
]


def __dir__() -> list[str]:
    return [*__all__, "effects", "signals"]
