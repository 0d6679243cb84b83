"""A position loop around a moving reference: in an external controller, or inside a position servo."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drawn_machines.motion import Array, Law
from drawn_machines.servo import Machine


@dataclass(frozen=True, kw_only=True)
class Loop:
    """PD with a filtered derivative, and partial feed-forward of inertia and gravity, once per sample.

    Attributes:
        inner: whether the loop is that of a position servo, whose command is its set-point.
    """

    kp: float
    kd: float
    corner: float
    sample_time: float
    forward_inertia: float
    forward_gravity: float
    inner: bool

    @classmethod
    def drawn(cls, rng: np.random.Generator, machine: Machine, fastest: float, dt: float, *, inner: bool) -> Loop:
        """Two to six times as fast as the motion, limited by the sample rate."""
        swing = min(fastest * rng.uniform(2.0, 6.0), 0.25 / dt)
        damping = 2.0 * rng.uniform(0.6, 1.0) * machine.inertia * swing
        knows = rng.uniform(0.7, 1.1) if rng.random() < 0.4 else 0.0
        return cls(
            kp=float(f"{machine.inertia * swing**2:.4g}"),
            kd=float(f"{max(damping - machine.viscous_friction, 0.2 * damping):.4g}"),
            corner=5.0 * swing,
            sample_time=dt,
            forward_inertia=knows * machine.inertia,
            forward_gravity=knows * machine.gravity,
            inner=inner,
        )

    def law(self, reference: Array) -> Law:
        """The torque for a measurement, or the set-point."""
        if self.inner:
            goals = reference.tolist()
            return lambda k, reading, time: goals[k]
        dt = self.sample_time
        speed = np.gradient(reference, dt)
        ahead = self.forward_inertia * np.gradient(speed, dt) + self.forward_gravity * np.cos(reference)
        wanted, moving, known = reference.tolist(), speed.tolist(), ahead.tolist()
        keep = float(np.exp(-self.corner * dt))
        last: list[float] = []
        seen = [0.0]

        def torque(k: int, reading: float, time: float) -> float:
            if last:
                seen[0] = keep * seen[0] + (1.0 - keep) * (reading - last[0]) / dt
            last[:] = [reading]
            return self.kp * (wanted[k] - reading) + self.kd * (moving[k] - seen[0]) + known[k]

        return torque
