"""Hysteresis without a name: it holds Dahl's friction, and carries loops that the catalogue does not have."""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
import pytest
from machine import Machine, excitation, record

from diagnosis import diagnose
from diagnosis.score_test import Screen
from identification.fit import fit
from identification.log import Log
from plant import Effect, ServoModel, simulate
from plant.effects import PreslidingHysteresis, Stage, State
from plant.effects.effect import Expression, Moment, parameter
from plant.effects.hysteresis import Hysteresis
from plant.effects.nonparametric_curve import HEIGHTS

KNOTS = np.linspace(-1.0, 1.0, len(HEIGHTS))


def test_a_straight_line_over_the_memory_is_dahls_friction() -> None:
    bare = ServoModel(inertia=2.0, gravity=0.5, viscous_friction=0.8)
    line = dict(zip(HEIGHTS, -0.3 * KNOTS, strict=True))
    forms = (PreslidingHysteresis(torque=0.3, stiffness=8.0), Hysteresis(low=-1.0, high=1.0, way=0.3 / 8.0, **line))
    command = excitation(1, duration=3.0)
    one, other = (simulate(bare.with_effect(form), command=command, dt=0.005, substeps=5) for form in forms)
    assert np.ptp(one[:, 0]) > 1.0
    assert other[:, :2] == pytest.approx(one[:, :2], abs=1e-9)


def test_its_trace_holds_that_of_dahls_friction() -> None:
    log, model = record(Machine(), excitation(1, duration=5.0), noise=1e-3).log(), ServoModel.paper()
    base = fit(log, model)
    motion = Screen.of(base).motion
    regressors = list(zip(PreslidingHysteresis.regressors(motion), Hysteresis.regressors(motion), strict=True))
    assert len(regressors) == 8
    for dahl, own in regressors:
        assert own.columns @ -KNOTS == pytest.approx(dahl.columns[:, 0], abs=1e-9)


@pytest.mark.long
def test_dahls_friction_that_may_not_be_named_is_unknown() -> None:
    """Friction that differs between the directions stood in for it, and left most of it to an observer."""
    hidden = {"presliding_hysteresis": {"torque": 0.3, "stiffness": 8.1}}
    log, held_out = (
        record(Machine().hiding(**hidden), excitation(place, duration=duration), seed=place, noise=1e-3).log()
        for place, duration in ((22000, 30.0), (22001, 15.0))
    )
    found = diagnose(log, None, held_out, candidates=["coulomb_friction", "asymmetric_friction", "stribeck_friction"])
    assert found.verdict == "unknown"
    assert "travel since reversal" in found.unexplained.depends_on


@dataclass(frozen=True, kw_only=True)
class Harness(Effect):
    """A loop that nobody listed: a bundle of wires that is dragged along, stiffer on the one side than on the other."""

    name = title = "harness"
    stage = Stage.LOAD
    equation = signature = ""
    states = (State.RELAXED,)
    longest_step = 1e-3

    size: float = parameter("{torque}", "torque when it slides", lower=0.0)

    def slide(self, state: Expression, travel: Expression) -> Expression:
        direction = ca.sign(travel)
        return direction + (state - direction) * ca.exp(-ca.fabs(travel) / 0.4)

    def load_torque(self, at: Moment, state: Expression) -> Expression:
        memory = self.slide(state, at.travel)
        return -self.size * (memory + 0.5 * memory**2)


@pytest.mark.long
def test_a_loop_that_nobody_listed_takes_no_name() -> None:
    truth = ServoModel.paper().with_effect(Harness(size=0.3))
    logs = []
    for number, duration in enumerate((30.0, 15.0)):
        command = excitation(2 + number, duration=duration)
        moved = simulate(truth, command=command, dt=0.005, substeps=10)[: command.size, 0]
        run = record(Machine(), command, seed=number).run()
        noise = 1e-3 * np.random.default_rng(number).standard_normal(command.size)
        logs.append(Log(runs=(replace(run, output=moved + noise),), axis="rotary"))
    near = ["coulomb_friction", "presliding_hysteresis", "torque_offset"]
    found = diagnose(logs[0], None, logs[1], candidates=near)
    assert found.verdict in ("unknown", "ambiguous")
    assert all(cause.probability < 0.9 for cause in found.causes)
