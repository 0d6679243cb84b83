"""Errors of torque allocation."""

from __future__ import annotations

from plant.errors import AntidriveError


class InfeasibleTorque(AntidriveError, ValueError):
    """No pinion torques satisfy the bounds."""
