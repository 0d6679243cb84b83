"""Writes the two synthetic logs beside it: a cart on a ball screw under position control, in the manner of the EMPS.

Two files, as the public data set has them (Janot, Gautier and Brunot 2019): the same motion twice, the second time with
pulses of force on top. The machine hides friction that is greater backwards and a ripple once per turn of the screw.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from plant import ServoModel, simulate
from plant.effects import AsymmetricFriction, Cogging

FOLDER = Path(__file__).parent
DT, FINE = 0.005, 20  # a sample [s], and the integration steps in it: many more than the ripple needs
MACHINE = ServoModel(
    inertia=95.0,
    gravity=0.0,
    viscous_friction=210.0,
    axis="linear",
    effects=(
        AsymmetricFriction(forward=18.0, backward=24.0),
        Cogging(amplitude=3.0, order=2 * np.pi / 0.0025, phase=0.4),
    ),
)
STIFFNESS, DAMPING = 3.0e4, 2.0e3  # of the position loop [N/m, N s/m]


def goal(time: np.ndarray) -> np.ndarray:
    """Smooth strokes to and fro [m], each shorter than the one before; at most 0.22 turns of the screw in a sample."""
    strokes, hold = 0.06 * 0.8 ** np.arange(8) * np.where(np.arange(8) % 2, -1.0, 1.0), 1.5
    share = np.clip((time[:, None] - hold * np.arange(8)) / (0.75 * hold), 0.0, 1.0)
    return (strokes * (share - np.sin(2 * np.pi * share) / (2 * np.pi))).sum(axis=1)


def record(seed: int, pulses: float) -> pd.DataFrame:
    """What the drive logs: milliseconds, newtons, millimetres."""
    rng, time = np.random.default_rng(seed), DT * np.arange(2400)
    wanted, state = goal(time), np.zeros(2)
    push = pulses * (np.sin(2 * np.pi * 1.3 * time) > 0.95) * np.sign(np.sin(2 * np.pi * 0.21 * time))
    speed, position, force = np.gradient(wanted, DT), np.empty(time.size), np.empty(time.size)
    for k in range(time.size):
        position[k] = state[0] + 2e-6 * rng.standard_normal()
        force[k] = STIFFNESS * (wanted[k] - state[0]) + DAMPING * (speed[k] - state[1]) + push[k]
        force[k] = np.round(force[k], 2)
        state = simulate(MACHINE, command=force[k : k + 1], dt=DT, state=state, substeps=FINE)[-1]
    return pd.DataFrame({"t": np.round(1e3 * time, 1), "F": force, "x": np.round(1e3 * position, 4)})


if __name__ == "__main__":
    record(0, 0.0).to_csv(FOLDER / "axis.csv", index=False)
    record(1, 60.0).to_csv(FOLDER / "axis_pulses.csv", index=False)
