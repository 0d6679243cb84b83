"""Drives and sample time of a machine: from the options, else from the model file, else assumed and reported."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from plant.drive_train import DriveTrain
from plant.errors import BadParameter
from plant.gears import GearTrain, Ratios, drive_train
from plant.model_file import ModelFile

SAMPLE_TIME = 0.005  # [s]


def drives(options: Mapping[str, Any], known: ModelFile | None = None) -> tuple[DriveTrain, list[str]]:
    """The drive train, and the assumptions on it, in sentences.

    Args:
        options: the given options, see `antidrive.cli_drive_options.DRIVES`.
        known: the model, whose log may have been read with its gears.

    Raises:
        BadParameter: options that contradict each other, or a linear axis without a given ratio.
    """
    teeth, ratio = options.get("gears"), options.get("ratio")
    if teeth is not None and ratio is not None:
        raise BadParameter("--gears and --ratio both describe the gear train; give one of them.")
    text, linear = teeth or ratio, known is not None and known.model.axis == "linear"
    assumed = []
    train: DriveTrain
    if text is not None:
        train = GearTrain.parse(text) if teeth else drive_train(text)
    elif known is not None and known.gears is not None:
        train = known.gears
        assumed = [f"Drives {train}, as the log of the model was read."]
    elif linear or options.get("one_drive"):
        what = "force of each drive [N] for 1 N m" if linear else "torque on the load for 1 N m of the drive"
        raise BadParameter(f"Give the {what} with --ratio; neither the log nor the model has it.")
    else:
        train = GearTrain.paper()
        assumed = [f"Assumed: the gears {train} of the paper; give --gears or --ratio."]
    return _others(train, options), assumed


def _others(train: DriveTrain, options: Mapping[str, Any]) -> DriveTrain:
    """The drive train reduced to a single drive, or with pre-reductions."""
    if options.get("one_drive"):
        train = Ratios(ratios=tuple(train.torque_map.tolist())[:1])
    if (turns := options.get("pre_reduction")) is not None:
        turns = Ratios.parse(turns)
        numbers = turns.ratios[: train.drives]
        whole = train if isinstance(train, Ratios) else Ratios(ratios=tuple(train.torque_map.tolist()))
        return replace(whole, pre_reduction=numbers)
    return train


def sample_time(options: Mapping[str, Any], known: ModelFile) -> tuple[float, list[str]]:
    """Seconds between two samples, and the assumptions on them, in sentences."""
    if options.get("sample_time") is not None:
        return options["sample_time"], []
    if known.sample_time is not None:
        return known.sample_time, [f"Sample time {known.sample_time:g} s, that of the model's log."]
    return SAMPLE_TIME, [f"Assumed: a sample time of {SAMPLE_TIME:g} s; give --sample-time."]
