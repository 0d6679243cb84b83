"""A controller can be pickled, and so sent to other processes, and continues with its state."""

from __future__ import annotations

import copy
import pickle
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest
from closed_machine import goes_on

from mpc import Controller
from plant import GearTrain, ServoModel
from plant.effects import Backlash, InputDelay

LATE = ServoModel.paper().with_effect(InputDelay(time=0.012)).with_effect(Backlash(gap=0.01, motor_share=0.2))


def used(count: int) -> Controller:
    options = {"angle_limits": (-0.2, 0.2), "torque_rate": 50.0, "preload_rate": 0.5, "motor_friction": 1e-3}
    controller = Controller(LATE, GearTrain.paper(), horizon=12, **options)  # type: ignore[arg-type]
    for k in range(count):
        controller.step(1e-4 * k**2, 0.1)
    return controller


@pytest.mark.parametrize("other", [lambda c: pickle.loads(pickle.dumps(c)), copy.deepcopy], ids=["pickle", "copy"])
@pytest.mark.parametrize("count", [0, 30])
def test_it_goes_on_where_it_was(other: object, count: int) -> None:
    one = used(count)
    two = other(one)  # type: ignore[operator]
    assert two is not one
    assert two.compiled == one.compiled
    for name in ("model", "gears", "horizon", "angle_limits", "torque_rate", "motor_friction", "sqp_iterations"):
        assert getattr(two, name) == getattr(one, name)
    torques = goes_on(one)
    assert np.array_equal(goes_on(two), torques)  # independently of each other
    assert np.ptp(torques) > 0.0


def test_it_works_in_another_process() -> None:
    controller = used(10)
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        there = pool.submit(goes_on, controller).result(timeout=120)
    assert np.array_equal(there, goes_on(controller))
