"""How a follower torque is shared by the drives."""

from __future__ import annotations

from allocation.admissible import Admissibility, admissible, enumerate_admissible
from allocation.allocator import Allocation, Allocator
from allocation.bounds import Bounds
from allocation.errors import InfeasibleTorque
from allocation.least_effort import least_effort

__all__ = [
    "Admissibility",
    "Allocation",
    "Allocator",
    "Bounds",
    "InfeasibleTorque",
    "admissible",
    "enumerate_admissible",
    "least_effort",
]
