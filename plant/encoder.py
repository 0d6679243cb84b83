"""Encoders with counts, noise and delay."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Trail = tuple[tuple[float, Array], ...]
"""Past angles (B, 1 + drives) of loads and rotors with their age [s], newest first; for encoders with delay."""


def counted(angle: ArrayLike, counts: ArrayLike) -> Array:
    """The angle [rad] in whole counts of an encoder, shape of the input; unchanged where there are no counts."""
    exact, turn = np.asarray(angle, dtype=np.float64), np.asarray(counts, dtype=np.float64)
    resolution = 2 * np.pi / np.where(turn == 0, np.inf, turn)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(turn == 0, exact, np.round(exact / resolution) * resolution))


def encoder_angles(state: Array) -> Array:
    """(B, 1 + drives) angles of load and rotors [rad] in states (B, S) as in `plant.flank.states`."""
    drives = (state.shape[1] - 2) // 4
    return state[:, [0, *range(2, 2 + drives)]]


def recent_values(state: Array, trail: Trail, delay: float) -> Array:
    """(B, 1 + drives) angles [rad] measured with a delay `delay` [s]; before the start: the first angles."""
    if not trail:
        return encoder_angles(state)
    ages = np.array([0.0, *(age for age, _ in trail)])
    angles = np.array([encoder_angles(state), *(past for _, past in trail)])
    later = min(int(np.searchsorted(ages, delay * (1.0 - 1e-9))), len(ages) - 1)
    if ages[later] <= delay * (1.0 + 1e-9):
        return np.asarray(angles[later])
    share = (delay - ages[later - 1]) / (ages[later] - ages[later - 1])
    return np.asarray((1.0 - share) * angles[later - 1] + share * angles[later])


def recent(trail: Trail, duration: float, delay: float) -> Trail:
    """A trail after a further duration [s], without angles too old for encoders with a delay `delay` [s]."""
    aged = tuple((age + duration, angles) for age, angles in trail)
    needed = next((k for k, (age, _) in enumerate(aged) if age >= delay * (1.0 - 1e-9)), len(aged) - 1)
    return aged[: needed + 1]
