"""The plant: what moves, and how. Every other package asks here."""

from __future__ import annotations

from plant.discrete import sample_step
from plant.drive_train import DriveTrain
from plant.effects import Effect, catalogue
from plant.errors import AntidriveError, BadModelFile, BadParameter
from plant.fleet import Fleet
from plant.fmu import Fmu
from plant.gears import GearTrain, Ratios
from plant.linear import linearise
from plant.model_file import ModelFile, read_model
from plant.rig import Rig
from plant.servo import ServoModel
from plant.servo_fmu import servo_fmu
from plant.simulation import simulate

__all__ = [
    "AntidriveError",
    "BadModelFile",
    "BadParameter",
    "DriveTrain",
    "Effect",
    "Fleet",
    "Fmu",
    "GearTrain",
    "ModelFile",
    "Ratios",
    "Rig",
    "ServoModel",
    "catalogue",
    "linearise",
    "read_model",
    "sample_step",
    "servo_fmu",
    "simulate",
]
