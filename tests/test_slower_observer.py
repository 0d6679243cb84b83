"""Logs on which the base model lacks nearly everything are diagnosed; a torque that drives another load is refused."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

from drawn_machines import drawn
from machine import excitation

from diagnosis import diagnose
from identification.errors import Unidentifiable


@pytest.mark.parametrize(("seed", "missing"), [(356, "end_stop"), (100629, "cable_stiffness")])
def test_a_log_is_diagnosed_however_much_the_base_model_lacks(seed: int, missing: str) -> None:
    """The likeliest observer of the base model follows the load whatever the torque is.

    The spring's load was told not to move, since the base model erred as much as it moved.
    """
    made = drawn(seed)
    found = diagnose(made.log, candidates=[missing])
    assert {cause.effect: cause.probability > 0.9 for cause in found.causes} == {missing: True}
    base = made.facts()["base"]
    assert found.model.inertia == pytest.approx(base["inertia"], rel=0.1)
    assert found.model.viscous_friction == pytest.approx(base["viscous_friction"], rel=0.2)


def test_a_torque_that_drives_another_load_is_refused() -> None:
    """A spring alone swings as well, so the angle is explained with an inertia that no torque moves."""
    time = 0.005 * np.arange(4000)
    swing = 0.5 * np.sin(0.8 * np.pi * time) + 1e-4 * np.random.default_rng(0).normal(size=(2, time.size))[1]
    log = {"time": time, "torque": excitation(3, duration=20.0), "angle": swing}
    with pytest.raises(Unidentifiable, match="Check that this torque drives this angle"):
        diagnose(log, candidates=["cable_stiffness"])


def test_a_load_that_does_not_move_is_reported() -> None:
    noise = 1e-4 * np.random.default_rng(0).normal(size=2000)
    log = {"time": 0.005 * np.arange(2000), "torque": excitation(3, duration=10.0), "angle": noise}
    with pytest.raises(Unidentifiable, match="The load does not move"):
        diagnose(log, candidates=["coulomb_friction"])
