"""A direct-drive pendulum that hangs at an angle of zero, with the cogging of its motor, by equations of its own."""

from __future__ import annotations

import numpy as np

from identification.log import Log


def hanging_pendulum(seed: int, rate: float) -> Log:
    """Ten seconds under a torque of two sines of about `rate` [rad/s]; of the cogging a third harmonic is no sine."""
    time, fine = 0.002 * np.arange(5000), 10
    torque = 0.08 * np.sin(rate * time) + 0.01 * np.sin(2.7 * rate * time + seed)
    step, angle, speed, angles = 0.002 / fine, 0.0, 0.0, []
    for drive in torque:
        angles.append(angle)
        for _ in range(fine):
            gravity, cogging = 0.135 * np.sin(angle), 0.004 * np.sin(24 * angle + 0.4) + 0.0024 * np.sin(72 * angle + 1)
            friction = 0.001 * speed + 0.0035 * np.tanh(speed / 0.01)
            speed += step * (drive - gravity - friction - cogging) / 0.0015
            angle += step * speed
    return Log.from_arrays(time=time, torque=torque, angle=np.round(np.array(angles) / 3.8e-4) * 3.8e-4)
