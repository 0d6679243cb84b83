"""Whether a signal recurs with the load's state, so that it cannot be distinguished from a function of that state."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plant.effects.motion import Motion

_CELLS = 24  # along the angle and along the velocity


def returns_to_its_states(motion: Motion, phasor: NDArray[np.complex128]) -> float:
    """Mean product of a phasor (T,) on one visit to a state, and its conjugate on another visit.

    1 if it is the same on all visits, about 0 if it is independent of the state or no state is visited twice. A state
    is a cell of the plane of angle and velocity; a visit lasts from entering to leaving it.
    """
    across = motion.angle - motion.angle.min(), motion.velocity - motion.velocity.min()
    cells = [np.minimum(_CELLS * x / max(float(x.max()), 1e-300), _CELLS - 1).astype(int) for x in across]
    cell = cells[0] * _CELLS + cells[1]
    entered = np.flatnonzero(np.diff(cell, prepend=-1))
    means = np.add.reduceat(phasor, entered) / np.diff(entered, append=cell.size)
    visits = np.bincount(cell[entered], minlength=_CELLS**2)
    together = np.bincount(cell[entered], means.real, _CELLS**2) + 1j * np.bincount(
        cell[entered], means.imag, _CELLS**2
    )
    alone = np.bincount(cell[entered], np.abs(means) ** 2, _CELLS**2)
    pairs = float(np.sum(visits * (visits - 1)))
    return float(np.sum(np.abs(together) ** 2 - alone)) / pairs if pairs else 0.0
