"""What drives the load: the follower's torque or force, from whatever the log has in its place."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from identification.errors import MalformedLog
from identification.reading.request import Reading
from identification.recording import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Command:
    """The command of a log.

    values: (T,) follower torque [N m] or force [N]; of a position servo, its gain times the set-point.
    servo_gain: (T,) torque per angle of a position servo [N m/rad]; zero where the log gives the torque.
    name: what the file calls it.
    unit: "N m", "N", or what stands in its place.
    notes: what limits a result, such as an unknown scale.
    """

    values: Array
    servo_gain: Array
    name: str
    unit: str
    notes: tuple[str, ...] = ()


def command_of(
    file: str, found: Mapping[str, str], channels: Mapping[str, Array], axis: str, reading: Reading
) -> Command:
    """The command in the channels (contract column -> values) of a file.

    Raises `MalformedLog` where pinion torques come without their gear train.
    """
    direct = "torque" if axis == "rotary" else "force"
    unit = "N m" if axis == "rotary" else "N"
    none = np.zeros(len(channels["time"]))
    if direct in channels:
        return Command(values=channels[direct], servo_gain=none, name=found[direct], unit=unit)
    if "torque_1" in channels and "torque_2" in channels:
        if reading.gears is None:
            raise MalformedLog(
                f"{file}: the torques of two pinions need the gear train to become the follower's torque; "
                "give its tooth counts, or a column 'torque'."
            )
        first, second = np.asarray(reading.gears.torque_map, dtype=np.float64)  # paper, eq. (2)
        follower = first * channels["torque_1"] + second * channels["torque_2"]
        return Command(values=follower, servo_gain=none, name=f"{found['torque_1']}, {found['torque_2']}", unit=unit)
    note = f"torque scale unknown: {file} has a set-point but no {direct}, so torques are per radian of its error"
    note = note if axis == "rotary" else note.replace("torques are per radian", "forces are per metre")
    return Command(
        values=channels["setpoint"], servo_gain=none + 1.0, name=found["setpoint"], unit="unknown", notes=(note,)
    )
