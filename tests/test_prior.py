"""What is known before a log is seen, and what the log cannot see: neither may spoil what it does see."""

from __future__ import annotations

import numpy as np
import pytest
from machine import Machine, excitation, record

from identification.fit import fit
from identification.inverse import torque_error
from identification.log import Log
from identification.noise import log_likelihood
from identification.objective import Objective
from identification.prior import natural_scales
from identification.problem import Problem
from plant import ServoModel
from plant.effects import AsymmetricFriction, CoulombFriction
from plant.effects.nonparametric_curve import HEIGHTS, CurveOverTorque, CurveOverVelocity

PLAIN = Machine(effects={})


def in_levels(levels: tuple[float, ...], *, scale: float = 1.0, machine: Machine = PLAIN) -> Log:
    """A log in which the torque takes a few values only."""
    command = np.random.default_rng(5).choice(levels, size=80).repeat(50)
    moved = record(machine, scale * command, seed=5).run()
    return Log(runs=(type(moved)(**{**vars(moved), "command": command}),), axis="rotary")


def test_two_confounded_parameters_keep_their_joint_evidence() -> None:
    """Dry friction of one level and of two: none of the three is known, the sum is."""
    log = record(PLAIN.hiding(coulomb_friction={"torque": 0.4}), excitation(3, duration=20.0), seed=3).log()
    start = ServoModel(
        inertia=2.0,
        gravity=0.5,
        viscous_friction=0.8,
        effects=(CoulombFriction(torque=0.1), AsymmetricFriction(forward=0.1, backward=0.1, viscous_difference=0.0)),
    )
    found = fit(log, start)
    assert {"coulomb_friction.torque", "asymmetric_friction.forward"} <= set(found.unidentifiable)
    one, two = found.model.effect("coulomb_friction"), found.model.effect("asymmetric_friction")
    assert isinstance(one, CoulombFriction)
    assert isinstance(two, AsymmetricFriction)
    assert one.torque + two.forward == pytest.approx(0.4, abs=5e-3)
    assert one.torque + two.backward == pytest.approx(0.4, abs=5e-3)
    problem = Problem.of(log, found.model)
    cost = problem.cost(problem.pack(found.model.values, found.initial), found.bandwidth, 0.0)
    assert log_likelihood(cost, found.samples) == pytest.approx(found.log_likelihood, abs=0.1)


def test_a_curve_does_not_overshoot_between_few_torque_levels() -> None:
    log = in_levels((-6.0, -0.2, -0.1, 0.1, 0.2, 6.0), machine=PLAIN.hiding(coulomb_friction={"torque": 0.5}))
    start = CurveOverTorque(low=-6.0, high=6.0)
    model = ServoModel(inertia=2.0, gravity=0.5, viscous_friction=0.8, effects=(start,))
    found = fit(log, model, fixed=("inertia", *start.shape()[:2]))
    heights, level = found.model.values[-len(HEIGHTS) :], natural_scales(log)["N m"]
    assert np.abs(heights).max() < level
    assert found.unidentifiable == ()
    stds = np.sqrt(np.diag(found.covariance))[-len(HEIGHTS) :]
    assert 0.1 * level < stds[2] < 1.05 * level  # where no torque was: not known, but for what was known before
    assert stds[[0, 4, 8]].max() < 0.03 * level


def test_a_log_outweighs_the_prior_of_a_curve() -> None:
    """A sixth more torque than is read, over all of its range."""
    log = in_levels(tuple(np.linspace(-6.0, 6.0, 25)), scale=7.0 / 6.0)
    start = CurveOverTorque(low=-6.0, high=6.0)
    model = ServoModel(inertia=2.0, gravity=0.5, viscous_friction=0.8, effects=(start,))
    found = fit(log, model, fixed=("inertia", *start.shape()[:2]))
    assert found.model.values[-len(HEIGHTS) :] == pytest.approx(np.linspace(-1.0, 1.0, 9), abs=0.03)
    assert torque_error(log, found.model, cutoff=5.0) < 0.3 * torque_error(log, model, cutoff=5.0)


def test_the_slope_of_the_objective_is_that_of_its_cost() -> None:
    log = record(PLAIN, excitation(4, duration=5.0), seed=4).log()
    curve = CurveOverVelocity(low=-3.0, high=3.0, **dict(zip(HEIGHTS, 40.0 * np.sin(np.arange(9.0)), strict=True)))
    model = ServoModel(inertia=2.0, gravity=0.5, viscous_friction=0.8, effects=(curve,))
    problem = Problem.of(log, model, fixed=curve.shape())
    point = problem.pack(model.values, np.zeros((1, 2)))
    here = problem.linearise(point, 5.0, 0.0)
    for place in range(len(problem.free)):
        step = np.zeros_like(point)
        step[place] = 1e-5
        up, down = (problem.linearise(point + sign * step, 5.0, 0.0).cost for sign in (1.0, -1.0))
        assert 2.0 * here.gradient[place] == pytest.approx((up - down) / 2e-5, rel=1e-4, abs=1e-6 * here.cost)


def test_without_a_curve_nothing_is_known_before() -> None:
    log = record(PLAIN, excitation(4, duration=5.0), seed=4).log()
    assert Objective.of(log, ServoModel.paper()).prior is None
    curve = CurveOverVelocity(low=-3.0, high=3.0)
    held = ServoModel.paper().with_effect(curve)
    assert Objective.of(log, held, fixed=[n for n in held.names if n.startswith(curve.name)]).prior is None


def test_a_curve_begins_flat() -> None:
    curve = CurveOverVelocity(low=-3.0, high=3.0, c0=1.0, c8=2.0)
    assert curve.begun() == CurveOverVelocity(low=-3.0, high=3.0)
