"""The arrays of a controller by name: what a step reads, remembers and writes. Both forms of the step share them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from mpc.control import OUTCOME
from mpc.slots import Fed, Learnt, Told

Array = NDArray[np.float64]


def laid_out(states: int, horizon: int, late: int, rows: int, watched: int) -> dict[str, Array]:
    """Zeros for n states, N samples looked ahead, a delay of so many whole samples, and so many intervals a stage.

    The constants of a model are not among them, nor what estimator and governor remember: their owners have them. Of
    the watch over the sensors so many numbers are remembered.
    """
    n, N, samples = states, horizon, late + horizon
    remembered = {
        "told": len(Told),  # the last wanted angles, of a reference that is told one number a sample
        "past": late + 3,  # torques under way, oldest first: those of a delay, and the two around the last sample
        "plan": N + 1,  # whether there is one, and its torques
        "pressed": rows * N,  # which other numbers are held at an end (1, -1) or given up to their price (2, -2)
        "forces": rows * N,  # with which these ends push back
        "bounds": 3 * N,  # which of them holds, and both, at each stage
        "preload": 1,  # lambda of the last sample
        "load": 1,  # torque that the load takes without accelerating
        "learnt": len(Learnt),  # of friction
        "watched": watched,  # see `mpc.encoder_faults`
        "astray": 1,  # mean square of what the load is off its reference, in units of what is admitted
        "rubs": late + 3,  # torques against friction, beside those of past
        "fed": len(Fed),  # see `mpc.feed_forward`
    }
    handed = {
        "readings": 3,
        "elapsed": 1,  # since the last sample, if it is not the sample time
        "wanted": N + 1,
    }
    answer = {
        "outcome": OUTCOME,  # margin, disturbance, residual
        "torques": 2 * N,
        "angles": N + 1,
    }
    work = {
        "ahead": N + late + 2,
        "steps": N,  # changes of the wanted angle from sample to sample
        "speeds": N + late + 2,  # of what is ahead
        "guess": N,
        "states": (samples + 1) * n,
        "A": samples * n * n,
        "B": samples * n * 2,
        "range": 2 * N,
        "unit": 1,
        "taken": N,  # torque that the reference takes in each sample of the horizon
        "feed": N + 1,  # what of it is fed: in the last sample, and in each of the horizon
        "rub": N,  # torque against friction of each stage
        "data": 2 * N,
        "barrier": 2 * rows * N,  # what the interior point method adds to the cost
        "fence": 2 * rows * N,  # ends of the intervals of each stage
        "end": 2,
        "law": (2 * n + 5) * N,
        "s": (N + 1) * (n + 1),
        "e": N,
        "held": N,
        "acceleration": N,
    }
    ends = ("slack", "force", "excess", "spare", "gap", "stiff", "pull", "nearer", "wider", "harder", "farther")
    inside = dict.fromkeys(ends, 2 * rows * N) | dict.fromkeys(("inside", "middle", "half", "curvature"), N)
    every = remembered | handed | work | inside | {"kept": 2 * N + 2}
    return _one_behind_the_other(answer) | {name: np.zeros(size) for name, size in every.items()}


def _one_behind_the_other(sizes: Mapping[str, int]) -> dict[str, Array]:
    """Zeros that are parts of one array, which is copied at once."""
    ends = np.cumsum([0, *sizes.values()])
    whole = np.zeros(ends[-1])
    return {name: whole[begin:end] for name, begin, end in zip(sizes, ends[:-1], ends[1:], strict=True)}
