"""A joint in a tight position loop, whose torque was measured: the torque follows the motion.

The loop is so stiff that a disturbance hardly moves the load, but the drive answers it with a torque. The measurement
of the torque is noisy. The equations are integrated here, without the plant's own steps.
"""

from __future__ import annotations

import numpy as np

from identification import Log

INERTIA, GRAVITY, VISCOUS, COULOMB = 0.8, 3.0, 1.5, 2.0
SAMPLE_TIME, STEPS = 0.005, 10
_STIFFNESS, _DAMPING = 4000.0, 160.0  # of the loop
_FORGETTING = 20.0  # of the disturbance [1/s]
_HERTZ, _AMPLITUDE = np.array([0.1, 0.23, 0.37, 0.61]), np.array([0.6, 0.4, 0.25, 0.12])


def tight_loop(
    seed: int, *, disturbance: float, noise: float = 0.3, duration: float = 40.0, coulomb: float = COULOMB
) -> Log:
    """A log of the joint; `disturbance` and `noise` are standard deviations of a load torque and of its measurement."""
    rng = np.random.default_rng(seed)
    phase, h = rng.uniform(0.0, 2.0 * np.pi, 4), SAMPLE_TIME / STEPS
    time = h * np.arange(int(duration / SAMPLE_TIME) * STEPS)
    waves = 2.0 * np.pi * np.outer(time, _HERTZ) + phase
    reference, speed = np.sin(waves) @ _AMPLITUDE, np.cos(waves) @ (_AMPLITUDE * 2.0 * np.pi * _HERTZ)
    pushes = disturbance * np.sqrt(2.0 * _FORGETTING * h) * rng.normal(size=time.size)
    x, v, d = reference[0], speed[0], 0.0
    path = np.empty((time.size, 2))
    for k, (wanted, moving, push) in enumerate(zip(reference.tolist(), speed.tolist(), pushes.tolist(), strict=True)):
        torque = _STIFFNESS * (wanted - x) + _DAMPING * (moving - v)
        path[k] = x, torque
        d += push - h * _FORGETTING * d
        v += h * (torque + d - GRAVITY * np.cos(x) - VISCOUS * v - coulomb * np.tanh(v / 0.005)) / INERTIA
        x += h * v
    angle, torque = np.round(path[::STEPS, 0], 6), path[:, 1].reshape(-1, STEPS).mean(axis=1)
    measured = np.append(torque[0], 0.5 * (torque[1:] + torque[:-1]))  # around each sampling instant
    return Log.from_arrays(time=time[::STEPS], torque=measured + noise * rng.normal(size=angle.size), angle=angle)
