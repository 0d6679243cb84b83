"""The constant arrays of a controller, by name, as its step reads them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpc.encoder_faults import numbers as watching
from mpc.friction import friction_numbers
from mpc.prepared import prepared
from mpc.soft_limits import moved, prices
from mpc.stage_allocation import allocation, reach
from mpc.time_optimal_law import governed
from mpc.tuning import quiet

Array = NDArray[np.float64]

_ASTRAY = 30.0
"""Permitted following error in standard deviations of the sensor. The path that the acceleration of the reference gives
within 1/w, a t^2/2, is permitted in addition."""


def constant_numbers(made: Any, machine: Array) -> dict[str, Array]:
    """The constants of a `Controller` with its estimator and governor; `machine`: see `mpc.stage_allocation`."""
    P, greatest, wave = made._terminal_weight, made._greatest, 2 * np.pi * made.bandwidth
    noise, share = float(np.sqrt(made.estimator.levels[0])), made.bandwidth * made.sample_time
    others = [wave, made.governor.attainable, made.torque_rate * made.sample_time, _ASTRAY * noise, share]
    return {
        "model": made.estimator.predictor.parameters,
        "stage_numbers": made.estimator.predictor.prepared,
        "reach_numbers": prepared(reach()).of(machine),
        "allocation_numbers": prepared(allocation()).of(machine),
        "govern_numbers": prepared(governed(made.governor.soft is not None)).of(np.array([made.sample_time])),
        "acting": made.estimator.acting,
        "levels": made.estimator.levels,
        "machine": machine,
        "tuning": np.array([made._rate_weight, *P[np.triu_indices(2)], made.model.inertia, greatest, *others]),
        "prices": prices(made._rate_weight, made._greatest, made.model.inertia, made.sample_time),
        "moved": moved(made.model.inertia, made.sample_time),
        "soft": made._soft,
        "watching": watching(
            made.estimator,
            made.encoder_range,
            greatest,
            2 * greatest / made.model.inertia,
            held=made.gears.drives > 1,
        ),
        "rubbing": friction_numbers(
            std=made.friction_std,
            wave=wave,
            noise=noise,
            resolution=made.encoder_resolution,
            jitter=made.encoder_noise,
            floor=made._floor,
            greatest=greatest,
            memory=1.0 / (made._observer * made.sample_time),
            quiet=quiet(made._floor, made._greatest),
            jerk=made.governor.jerk,
        ),
    }
