"""Lost motion of two opposed drives: gap, stiffness and friction that grows with load, from sweeps of their preload."""

from __future__ import annotations

from identification.lost_motion.sweep import DriveLostMotion, LostMotion, Measured, lost_motion

__all__ = ["DriveLostMotion", "LostMotion", "Measured", "lost_motion"]
