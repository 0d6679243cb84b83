"""Lost motion of two opposed drives: backlash, stiffness and load-dependent friction, from sweeps of the preload."""

from __future__ import annotations

from identification.lost_motion.sweep import DriveLostMotion, LostMotion, Measured, lost_motion

__all__ = ["DriveLostMotion", "LostMotion", "Measured", "lost_motion"]
