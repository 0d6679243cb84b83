"""What can go wrong when a torque is shared."""

from __future__ import annotations

from plant.errors import AntidriveError


class InfeasibleTorque(AntidriveError, ValueError):
    """No pinion torques at all satisfy the bounds."""
