"""Logs on which the base model lacks nearly everything are diagnosed; a torque that drives another load is refused."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

from drawn_machines import drawn
from hanging_pendulum import hanging_pendulum
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


def test_a_base_model_that_explains_no_torque_starts_slower() -> None:
    """The likeliest one followed the load with an inertia twenty times that of the machine."""
    found = diagnose(drawn(106).log, candidates=["torque_offset"], inverse=False)
    assert found.torque_error.estimation_before < 1.0
    assert found.verdict == "unknown"


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


def test_a_pendulum_that_hangs_at_zero_is_diagnosed() -> None:
    """The base model takes the axis for horizontal at zero; it follows this log with any torque, by a fast observer.

    With a slower one it can be searched from, but beside the true effects the fast one is the likelier. It was refused:
    a regression explained more, so the torque seemed to follow the motion.
    """
    log, validation = hanging_pendulum(1, 4.0), hanging_pendulum(2, 5.0)
    candidates = ["gravity_offset", "coulomb_friction", "cogging"]
    found = diagnose(log, holdout=validation, candidates=candidates)
    assert found.verdict == "named"
    assert {cause.effect for cause in found.causes} == set(candidates)
    (gravity,) = (cause for cause in found.causes if cause.effect == "gravity_offset")
    assert gravity.parameters["beta"].value == pytest.approx(0.135, rel=0.02)
    assert found.extended.bandwidth > 4.0 * found.base.bandwidth
    assert found.gain.held_out_rms_after < 0.01 * found.gain.held_out_rms_before
