"""The capability map of two drives, as a table and in sentences."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from allocation import Allocator, CapabilityMap, capability_map
from plant.drive_train import DriveTrain
from plant.errors import BadParameter
from plant.gears import GearTrain
from plant.number import refuse_huge

if TYPE_CHECKING:
    import pandas as pd

_POINTS = 81  # along each axis; odd, so that zero is one of them


@dataclass(frozen=True, kw_only=True)
class Units:
    """Units of a capability map; by default those of a gear train on a rotary axis."""

    torque: str = "N m"
    acceleration: str = "rad/s²"
    preload: str = "N m per tooth"

    @classmethod
    def of(cls, train: DriveTrain, axis: str) -> Units:
        """Of a drive train on a rotary or linear axis; with ratios instead of teeth the preload is a drive's torque."""
        force = {"torque": "N", "acceleration": "m/s²"} if axis == "linear" else {}
        return cls(**force, **({} if isinstance(train, GearTrain) else {"preload": "N m"}))


ROTARY = Units()


def whole_map(allocator: Allocator, inertia: float) -> CapabilityMap:
    """The map over all torques that the drives can give at rest, and over the corresponding accelerations.

    Raises:
        BadParameter: the inertia is not positive, or the preload leaves no torque at all.
    """
    most = float(np.max(np.abs(allocator.bounds.reachable())))
    if not (np.isfinite(inertia) and inertia > 0):
        raise BadParameter(f"inertia must be finite and above zero, not {inertia:g}.")
    refuse_huge("inertia", inertia)
    if most == 0:
        raise BadParameter("At these limits the preload takes all of max_torque; lower min_torque or motor_friction.")
    axis = most * np.linspace(-1.0, 1.0, _POINTS)
    return capability_map(allocator, inertia=inertia, acceleration=axis / inertia, load_torque=axis)


def table(found: CapabilityMap) -> pd.DataFrame:
    """One row for each acceleration and load torque; empty cells where it is not reachable."""
    import pandas as pd

    a, load = np.meshgrid(found.acceleration, found.load_torque, indexing="ij")
    columns = {"acceleration": a, "load_torque": load}
    columns |= {"least_preload": found.least_preload, "margin": found.margin, "copper_loss": found.copper_loss}
    return pd.DataFrame({name: values.ravel() for name, values in columns.items()})


def summary(found: CapabilityMap, units: Units = ROTARY) -> dict[str, Any]:
    """Key numbers of the map: load torques at rest, accelerations without load, preload and loss at standstill."""
    still, idle = np.argmin(np.abs(found.acceleration)), np.argmin(np.abs(found.load_torque))
    held = found.load_torque[found.reachable[still]]
    return {
        "load_torque_at_rest": [held[0], held[-1]],
        "acceleration_without_load": found.edge[idle],
        "least_preload_at_rest": found.least_preload[still, idle],
        "copper_loss_at_rest": found.copper_loss[still, idle],
        "units": {
            "torque": units.torque,
            "acceleration": units.acceleration.replace("²", "^2"),
            "preload": units.preload,
            "copper_loss": "N^2 m^2",
        },
    }


def sentences(found: CapabilityMap, units: Units = ROTARY) -> list[str]:
    """The key numbers in sentences."""
    if not found.reachable[np.argmin(np.abs(found.acceleration))].any():
        return ["At rest the drives hold none of these load torques without losing contact."]
    data = summary(found)
    (least, most), (slowest, fastest) = data["load_torque_at_rest"], data["acceleration_without_load"]
    return [
        f"Without losing contact the drives hold load torques from {least:.4g} to {most:.4g} {units.torque} at rest.",
        f"Without load they reach accelerations from {slowest:.4g} to {fastest:.4g} {units.acceleration}.",
        f"At rest without load the preload is {data['least_preload_at_rest']:.4g} {units.preload}, and the copper-loss "
        f"index {data['copper_loss_at_rest']:.4g} N² m².",
    ]
