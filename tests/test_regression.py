"""Where a fit starts: regressions of which one at least is near the machine, whatever else the log has."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from identification.fit import base_model, fit
from identification.log import Log
from identification.regression import starting_values
from plant import ServoModel, simulate
from plant.effects import CoulombFriction, DeadZone, InputDelay, TorqueOffset

Array = NDArray[np.float64]

DT = 0.005
TIME = np.arange(3000) * DT
COMMAND = 2.0 * np.sin(2 * np.pi * 0.4 * TIME) + 1.2 * np.sin(2 * np.pi * 1.1 * TIME + 1.0)
RIGID = ServoModel(inertia=2.0, gravity=0.5, viscous_friction=0.8)


def recorded(model: ServoModel, command: Array = COMMAND, *, noise: float = 0.0, dt: float = DT) -> Log:
    path = simulate(model, command=command, dt=dt, substeps=8)[:-1, 0]
    path = path + noise * np.random.default_rng(1).standard_normal(path.size)
    names = ("torque", "angle") if model.axis == "rotary" else ("force", "position")
    return Log.from_arrays(time=dt * np.arange(path.size), **dict(zip(names, (command, path), strict=True)))


def nearest(starts: list[Array], truth: Array) -> Array:
    return min(starts, key=lambda values: float(np.abs(values - truth).sum()))


def test_the_regressions_find_the_rigid_servo() -> None:
    start = replace(RIGID, inertia=9.0, gravity=-3.0, viscous_friction=0.1)
    found = starting_values(recorded(RIGID), start)
    assert nearest(found, RIGID.values) == pytest.approx([2.0, 0.5, 0.8], rel=0.02)


def test_a_start_is_tried_once() -> None:
    starts = starting_values(recorded(RIGID), RIGID)
    apart = [np.abs(one / other - 1.0).max() for k, one in enumerate(starts) for other in starts[:k]]
    assert min(apart, default=1.0) > 0.01


def test_regression_finds_a_dead_zone_missing_at_the_start() -> None:
    truth = RIGID.with_effect(DeadZone(half_width=0.6))
    without_zone = RIGID.with_effect(DeadZone(half_width=0.0))
    found = nearest(starting_values(recorded(truth), replace(without_zone, inertia=9.0)), truth.values)
    assert found[:3] == pytest.approx([2.0, 0.5, 0.8], rel=0.1)
    assert found[3] == pytest.approx(0.6, rel=0.2)


def test_a_linear_axis_has_no_gravity_to_start_from() -> None:
    truth = ServoModel(inertia=5.0, gravity=0.0, viscous_friction=9.0, axis="linear")
    found = nearest(starting_values(recorded(truth, 4.0 * COMMAND), replace(truth, inertia=1.0)), truth.values)
    assert found == pytest.approx([5.0, 0.0, 9.0], rel=0.02)


def test_friction_offset_and_delay_leave_one_start_unbiased() -> None:
    """A small motor under a random binary command, as they come out of a laboratory."""
    motor = ServoModel(inertia=1.2e-4, gravity=0.0, viscous_friction=2.9e-3)
    hidden = (CoulombFriction(torque=0.03), TorqueOffset(torque=0.01), InputDelay(time=0.01))
    for effect in hidden:
        motor = motor.with_effect(effect)
    command = 0.7 * np.random.default_rng(3).choice([-1.0, -0.5, 0.5, 1.0], 150).repeat(3)
    log = recorded(motor, command, noise=1e-3, dt=0.01)
    off = [np.abs(v[[0, 2]] / [1.2e-4, 2.9e-3] - 1.0).max() for v in starting_values(log, base_model(log))]
    assert min(off) < 0.2
    assert max(off) > 0.35


def test_a_load_at_rest_gives_no_start() -> None:
    log = Log.from_arrays(time=TIME, torque=0.01 * COMMAND, angle=np.zeros(3000))
    assert starting_values(log, RIGID) == []


@pytest.mark.parametrize("samples", [2, 20, 35])
def test_a_few_samples_are_no_trouble(samples: int) -> None:
    (run,) = recorded(RIGID).runs
    short = replace(recorded(RIGID), runs=(run.slice(0, samples),))
    assert all(np.isfinite(values).all() for values in starting_values(short, RIGID))


def test_the_default_start_is_of_the_size_of_the_machine() -> None:
    for scale in (1e-6, 1.0, 1e3):
        truth = ServoModel(inertia=2.0 * scale, gravity=0.0, viscous_friction=0.8 * scale)
        begun = base_model(recorded(truth, scale * COMMAND))
        assert 0.1 < begun.inertia / truth.inertia < 10.0
        assert 0.1 < begun.viscous_friction / truth.viscous_friction < 10.0


def test_an_unidentifiable_dead_zone_leaves_the_other_parameters() -> None:
    """Of plus and minus one torque it only takes a share, as more of everything else would."""
    command = 0.7 * np.random.default_rng(2).choice([-1.0, 1.0], 120).repeat(5)
    motor = ServoModel(inertia=1.2e-3, gravity=0.0, viscous_friction=2.9e-2)
    found = fit(recorded(motor, command, noise=1e-4, dt=0.01))
    assert found.unidentifiable == ("dead_zone.half_width",)
    assert found.fixed == ("dead_zone.half_width",)
    assert found.failed is None
    assert "dead_zone.half_width  cannot be determined" in str(found)
    assert found.model.values[[0, 2, 3]] == pytest.approx([1.2e-3, 2.9e-2, 0.0], rel=0.02)
