"""Each effect's regressors: from the torque that a model lacks back to the effect that would explain it."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from machine import Machine, Record, excitation, record

from plant import catalogue
from plant.effects import Effect, Motion
from plant.effects.effect import Array, within

TRUE: dict[str, dict[str, float]] = {
    "input_delay": {"time": 0.010},
    "actuator_lag": {"time_constant": 0.020},
    "dead_zone": {"half_width": 0.9},
    "torque_offset": {"torque": -0.2},
    "coulomb_friction": {"torque": 0.4},
    "asymmetric_friction": {"forward": 0.4, "backward": 0.2, "viscous_difference": 0.1},
    "stribeck_friction": {"coulomb": 0.3, "excess": 0.2, "velocity": 0.4},
    "quadratic_drag": {"drag": 0.05},
    "gravity_offset": {"beta": -0.2},
    "cogging": {"amplitude": 0.2, "order": 11.0, "phase": 0.7},
}


@cache
def moved() -> Record:
    command = excitation(5, duration=20.0)
    return record(Machine(effects={}), command, noise=0.0, bits=None)


def missing(name: str, motion: Record) -> Array:
    """(T,) torque that a small effect adds along a motion [N m], straight from its law."""
    p, x, v, u = TRUE[name], motion.angle[:, 0], motion.velocity[:, 0], motion.command[:, 0]
    machine = Machine(gravity=0.0, viscous_friction=0.0, effects={name: p})
    if name == "input_delay":
        return np.concatenate((np.full(2, u[0]), u[:-2])) - u
    if name == "actuator_lag":
        behind, decay = [u[0]], np.exp(-0.005 / p["time_constant"])
        for command in u[:-1]:
            behind.append(command + (behind[-1] - command) * decay)
        return np.array(behind) - u
    if name == "dead_zone":
        return machine.behind_dead_zone(u) - u
    dry = machine.dry(v, np.sign(v)) if machine.slides else 0.0
    return np.asarray(machine.pull(x, v, np.zeros_like(x)) - np.sign(v) * dry)


def seen(name: str) -> Motion:
    motion = moved()
    return Motion(
        time=motion.time,
        angle=motion.angle[:, 0],
        velocity=motion.velocity[:, 0],
        torque=motion.command[:, 0],
        score=missing(name, motion)[:, None],  # of a torque seen at once
        reading_score=np.zeros((motion.time.size, 1)),
        acceleration=np.gradient(motion.velocity[:, 0], motion.time),
        command=motion.command[:, 0],
        servo_gain=np.zeros(motion.time.size),
        run=np.zeros(motion.time.size, dtype=np.intp),
        inertia=2.0,
        velocity_resolution=1e-3,
    )


def best_start(name: str) -> tuple[Effect, float]:
    """The start that regression on the effect's own regressors suggests, and the share of the torque left over."""
    motion, found = seen(name), []
    for regressors in catalogue[name].regressors(motion):
        score = motion.score[:, 0]
        coefficients, *_ = np.linalg.lstsq(regressors.columns, score)
        left = score - regressors.columns @ coefficients
        found.append((float(left @ left / (score @ score)), regressors.start(coefficients)))
    left, effect = min(found, key=lambda entry: entry[0])
    return effect, left


@pytest.mark.parametrize("name", TRUE)
def test_a_trace_leads_back_to_its_effect(name: str) -> None:
    effect, left = best_start(name)
    assert left < 0.25
    for parameter, value in TRUE[name].items():
        found = getattr(effect, parameter)
        slack = 0.02 if parameter == "order" else 0.5  # of shapes on a grid only the neighbourhood is asked for
        assert found == pytest.approx(value, rel=slack, abs=0.15 if parameter == "phase" else 0.0)


@pytest.mark.parametrize("name", TRUE)
def test_traces_are_finite_and_their_starts_lie_within_bounds(name: str) -> None:
    motion = seen("quadratic_drag")
    every = list(catalogue[name].regressors(motion))
    assert every
    for regressors in every:
        assert regressors.columns.shape[0] == motion.time.size
        assert np.isfinite(regressors.columns).all()
        assert regressors.searched >= 1
        for size in (-1e3, 0.0, 1e-9, 1e3):
            assert regressors.start(np.full(regressors.columns.shape[1], size)).name == name  # a constructor validates


@pytest.mark.parametrize("name", [n for n in TRUE if n != "cogging"])
def test_a_load_that_stands_still_breaks_no_trace(name: str) -> None:
    count = 200
    still = Motion(
        time=np.arange(count) * 0.005,
        angle=np.zeros(count),
        velocity=np.zeros(count),
        torque=np.zeros(count),
        score=np.zeros((count, 1)),
        reading_score=np.zeros((count, 1)),
        acceleration=np.zeros(count),
        command=np.zeros(count),
        servo_gain=np.zeros(count),
        run=np.zeros(count, dtype=np.intp),
        inertia=2.0,
        velocity_resolution=1e-3,
    )
    for regressors in catalogue[name].regressors(still):
        assert np.isfinite(regressors.columns).all()


def test_cogging_asks_for_travel() -> None:
    motion = seen("cogging")
    still = Motion(**{**vars(motion), "angle": np.zeros_like(motion.angle)})
    assert list(catalogue["cogging"].regressors(still)) == []


def test_within_moves_a_start_inside_its_bounds() -> None:
    lag = catalogue["actuator_lag"]
    assert within(-1.0, lag, "time_constant") == lag.parameters()[0].lower > 0.0
    assert within(9.0, lag, "time_constant") == 9.0  # how long it may be follows from the log
    assert within(0.001, lag, "time_constant", floor=0.01) == 0.01
