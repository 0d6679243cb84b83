"""A plain motion as a log's columns, and how to write it: the sound log that the tests of logs then spoil."""

from __future__ import annotations

from pathlib import Path

import numpy as np


def motion(samples=600, dt=0.005, counts=None, noise=0.0, seed=0):
    """Columns of a smooth swing; the angle optionally read by an encoder of `counts` lines."""
    time = dt * np.arange(samples)
    angle = 0.6 * np.sin(2 * np.pi * 0.8 * time) + 0.2 * np.sin(2 * np.pi * 2.1 * time + 1)
    velocity = np.gradient(angle, time)
    angle = angle + noise * np.random.default_rng(seed).standard_normal(samples)
    if counts is not None:
        angle = np.round(angle * counts / (2 * np.pi)) * 2 * np.pi / counts
    torque = np.gradient(velocity, time) + 0.5 * np.cos(angle) + 0.8 * velocity
    return {"time": time, "torque": torque, "angle": angle, "velocity": velocity}


def text(columns, separator=",", decimal="."):
    """The columns as a text table."""
    lines = [separator.join(columns)]
    for row in zip(*columns.values(), strict=True):
        lines.append(separator.join(f"{value:.9g}".replace(".", decimal) for value in row))
    return "\n".join(lines) + "\n"


def write(path: Path, columns, **style) -> Path:
    path.write_text(text(columns, **style))
    return path
