"""The capability map of two drives, in a table and in words."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from allocation import Allocator, CapabilityMap, capability_map
from plant.errors import BadParameter

_POINTS = 81  # along each axis; odd, so that zero is one of them


def whole_map(allocator: Allocator, inertia: float) -> CapabilityMap:
    """The map over all torques that the drives can give at rest, and over the accelerations that they would make.

    Raises:
        BadParameter: the inertia is not positive, or no torque can be held at all.
    """
    most = float(np.max(np.abs(allocator.bounds.reachable())))
    if not (np.isfinite(inertia) and inertia > 0):
        raise BadParameter(f"inertia must be finite and above zero, not {inertia:g}.")
    if most == 0:
        raise BadParameter("At these limits the preload takes all the torque; lower min_torque or motor_friction.")
    axis = most * np.linspace(-1.0, 1.0, _POINTS)
    return capability_map(allocator, inertia=inertia, acceleration=axis / inertia, load_torque=axis)


def table(found: CapabilityMap) -> pd.DataFrame:
    """One row for each acceleration and load torque; empty cells where it is out of reach."""
    a, load = np.meshgrid(found.acceleration, found.load_torque, indexing="ij")
    columns = {"acceleration": a, "load_torque": load}
    columns |= {"least_preload": found.least_preload, "margin": found.margin, "heat": found.heat}
    return pd.DataFrame({name: values.ravel() for name, values in columns.items()})


def summary(found: CapabilityMap) -> dict[str, Any]:
    """The map in a few numbers: what is held at rest, what is reached without load, and what standing still costs."""
    still, idle = np.argmin(np.abs(found.acceleration)), np.argmin(np.abs(found.load_torque))
    held = found.load_torque[found.reachable[still]]
    return {
        "load_torque_at_rest": [held[0], held[-1]],
        "acceleration_without_load": found.edge[idle],
        "least_preload_at_rest": found.least_preload[still, idle],
        "heat_at_rest": found.heat[still, idle],
        "units": {"torque": "N m", "acceleration": "rad/s^2", "preload": "N m per tooth", "heat": "N^2 m^2"},
    }


def sentences(found: CapabilityMap) -> list[str]:
    """The same for readers."""
    told = summary(found)
    (least, most), (slowest, fastest) = told["load_torque_at_rest"], told["acceleration_without_load"]
    return [
        f"With teeth that stay together, the drives hold load torques from {least:.4g} to {most:.4g} N m at rest.",
        f"Without load they reach accelerations from {slowest:.4g} to {fastest:.4g} rad/s².",
        f"Standing still without load takes a preload of {told['least_preload_at_rest']:.4g} N m per tooth, and the "
        f"squares of the torques then sum up to {told['heat_at_rest']:.4g} N² m².",
    ]
