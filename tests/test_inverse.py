"""The inverse model: filtered motion and the relative torque error, against motions known exactly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from identification.inverse import filtered_motion, torque_error
from identification.log import Log
from plant import ServoModel, simulate
from plant.effects import AsymmetricFriction

Array = NDArray[np.float64]

DT = 0.005
TIME = np.arange(3000) * DT
SWING = 2.0 * np.sin(2 * np.pi * 0.4 * TIME) + 1.2 * np.sin(2 * np.pi * 1.1 * TIME + 1.0)
RIGID = ServoModel(inertia=2.0, gravity=0.5, viscous_friction=0.8)


def recorded(model: ServoModel, command: Array = SWING) -> Log:
    path = simulate(model, command=command, dt=DT, substeps=8)
    names = ("torque", "angle") if model.axis == "rotary" else ("force", "position")
    return Log.from_arrays(time=TIME, **dict(zip(names, (command, path[:-1, 0]), strict=True)))


def test_filtered_torque_respects_the_limit_of_the_drive() -> None:
    (run,) = recorded(RIGID).runs
    held = replace(run, command=4.0 * np.sin(TIME), servo_gain=np.full(3000, 0.5), command_limit=1.5)
    drive = np.clip(4.0 * np.sin(TIME) - 0.5 * run.output, -1.5, 1.5)
    motion = filtered_motion(held, 20.0)
    inner = slice(100, -100)
    assert motion.torque[inner] == pytest.approx(drive[inner], abs=0.03)
    assert np.max(np.abs(drive)) == 1.5
    assert motion.acceleration[inner] == pytest.approx(np.gradient(np.gradient(run.output, DT), DT)[inner], abs=0.05)


def test_the_torque_error_knows_the_direction_of_friction() -> None:
    asymmetric = RIGID.with_effect(AsymmetricFriction(forward=0.2, backward=0.6))
    turned = RIGID.with_effect(AsymmetricFriction(forward=0.6, backward=0.2))
    even = RIGID.with_effect(AsymmetricFriction(forward=0.4, backward=0.4))
    log = recorded(asymmetric)
    errors = [torque_error(log, model, cutoff=10.0) for model in (asymmetric, even, turned)]
    assert errors[0] < 0.05
    assert errors[1] > 2.5 * errors[0]
    assert errors[2] > 1.8 * errors[1]
    assert torque_error(recorded(RIGID), RIGID, cutoff=10.0) < 2e-3


def test_a_load_that_friction_holds_lacks_no_torque() -> None:
    """Until the torque exceeds friction and gravity nothing moves, and any smaller one is as good."""
    rubs = RIGID.with_effect(AsymmetricFriction(forward=1.5, backward=1.0))
    log = recorded(rubs)
    (run,) = log.runs
    counted = replace(log, runs=(replace(run, output=np.round(run.output / 1e-4) * 1e-4),))
    motion = filtered_motion(counted.runs[0], 15.0)
    assert 0.2 < np.mean(motion.still) < 0.8
    assert torque_error(counted, rubs, cutoff=15.0) < 0.1
    weaker = RIGID.with_effect(AsymmetricFriction(forward=0.5, backward=0.3))
    assert torque_error(counted, weaker, cutoff=15.0) > 0.3


def test_noise_of_an_encoder_does_not_move_a_load_at_rest() -> None:
    """Without counts its noise had a direction, and with the true friction the inverse model was worse than without."""
    rubs = RIGID.with_effect(AsymmetricFriction(forward=1.5, backward=1.0))
    log = recorded(rubs)
    noise = 2e-5 * np.random.default_rng(0).normal(size=TIME.size)
    noisy = replace(log, runs=(replace(log.runs[0], output=log.runs[0].output + noise),))
    assert 0.2 < np.mean(filtered_motion(noisy.runs[0], 15.0).still) < 0.8
    assert torque_error(noisy, rubs, cutoff=15.0) < 0.1
    assert torque_error(noisy, RIGID, cutoff=15.0) > 0.5
