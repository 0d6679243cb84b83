"""Torque allocation: how the torque of the output gear is shared by the drives."""

from __future__ import annotations

from allocation.admissible import Admissibility, admissible, admissible_directions, null_space
from allocation.allocation import Allocation
from allocation.allocator import Allocator
from allocation.bounds import Bounds
from allocation.capability import CapabilityMap, capability_map
from allocation.enumeration import enumerate_admissible
from allocation.errors import InfeasibleTorque
from allocation.least_effort import least_effort
from allocation.limits import Limits, PerDrive
from allocation.preload import Preload
from allocation.structure import Structure

__all__ = [
    "Admissibility",
    "Allocation",
    "Allocator",
    "Bounds",
    "CapabilityMap",
    "InfeasibleTorque",
    "Limits",
    "PerDrive",
    "Preload",
    "Structure",
    "admissible",
    "admissible_directions",
    "capability_map",
    "enumerate_admissible",
    "least_effort",
    "null_space",
]


def __dir__() -> list[str]:
    return [*__all__]
