"""The arrays of a controller by name: inputs, state and results of a step. Both forms of the step share them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from mpc.control import OUTCOME
from mpc.slots import Fed, History, Learnt

Array = NDArray[np.float64]


def laid_out(states: int, horizon: int, late: int, rows: int, watched: int) -> dict[str, Array]:
    """Zero arrays for n states, a horizon of N samples, a dead time of `late` samples and `rows` intervals per stage.

    `watched` is the memory size of the encoder fault detection. Constants and the states of estimator and governor are
    not included.
    """
    n, N, samples = states, horizon, late + horizon
    remembered = {
        "history": len(History),  # the last wanted angles of a scalar reference
        "past": late + 3,  # net torques, oldest first: those of the dead time, and the two around the last sample
        "plan": N + 1,  # whether there is a plan, and its torques
        "pressed": rows * N,  # active set besides the torques: held at an end (1, -1) or at the price (2, -2)
        "forces": rows * N,  # multipliers of these interval ends
        "bounds": 3 * N,  # active bound, lower and upper bound of the torque of each stage
        "preload": 1,  # lambda of the last sample
        "load": 1,  # torque of the load without acceleration
        "learnt": len(Learnt),  # adaptation of friction
        "watched": watched,  # see `mpc.encoder_faults`
        "following_error": 1,  # mean square of the following error, in units of the permitted error
        "rubs": late + 3,  # friction compensation torques, in addition to those of past
        "fed": len(Fed),  # see `mpc.feed_forward`
    }
    handed = {
        "measurements": 3,
        "elapsed": 1,  # time since the last sample, if it differs from the sample time
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
        "speeds": N + late + 2,  # of the governed reference
        "guess": N,
        "states": (samples + 1) * n,
        "A": samples * n * n,
        "B": samples * n * 2,
        "range": 2 * N,
        "unit": 1,
        "taken": N,  # torque that the reference requires in each sample of the horizon
        "feed": N + 1,  # feedforward torque: of the last sample, and of each sample of the horizon
        "rub": N,  # friction compensation torque of each stage
        "data": 2 * N,
        "barrier": 2 * rows * N,  # cost terms added by the active set and the interior point method
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
    """Zero arrays that are consecutive parts of one array, so that one copy copies all."""
    ends = np.cumsum([0, *sizes.values()])
    whole = np.zeros(ends[-1])
    return {name: whole[begin:end] for name, begin, end in zip(sizes, ends[:-1], ends[1:], strict=True)}
