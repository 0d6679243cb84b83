"""What an unnamed curve looks like is said as a short formula, or not at all."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from machine import Machine, excitation, record

from diagnosis.formula_suggestion import formula_terms, suggested_formula
from identification.fit import fit
from plant import ServoModel
from plant.effects.effect import Array
from plant.effects.nonparametric_curve import KNOTS, CurveOverAngle, CurveOverTime, CurveOverVelocity


@pytest.mark.parametrize(
    ("over", "law", "terms"),
    [
        ("velocity", lambda v: -0.15 * v * np.abs(v) + 0.7 * v, {"v |v|": -0.15}),  # the straight part is viscous
        ("velocity", lambda v: -0.3 * np.sign(v) + 0.01 * v**3, {"sgn(v)": -0.3, "v^3": 0.01}),
        ("angle", lambda x: 0.2 * np.sin(x), {"sin(x)": 0.2}),
        ("angle", lambda x: 0.04 - 0.1 * x, {"1": 0.04, "x": -0.1}),
        ("position", lambda x: 0.3 * x**3, {"x^3": 0.3}),
        ("torque", lambda u: -0.2 * u * np.abs(u), {"u |u|": -0.2}),
    ],
)
def test_a_law_of_one_or_two_terms_is_recognised(
    over: str, law: Callable[[Array], Array], terms: dict[str, float]
) -> None:
    places = np.linspace(-2.0, 3.0, KNOTS)
    assert formula_terms(over, places, law(places), np.eye(KNOTS)) == pytest.approx(terms, rel=1e-6)


@pytest.mark.parametrize("over", ["velocity", "angle", "torque"])
def test_a_bump_is_like_none_of_them(over: str) -> None:
    places = np.linspace(-2.0, 3.0, KNOTS)
    assert formula_terms(over, places, np.exp(-(((places - 1.0) / 0.5) ** 2)), np.eye(KNOTS)) == {}
    assert formula_terms(over, places, np.zeros(KNOTS), np.eye(KNOTS)) == {}


def test_an_undetermined_knot_does_not_reject_a_formula() -> None:
    places = np.linspace(-2.0, 3.0, KNOTS)
    heights, sure = 0.2 * np.sin(places), np.eye(KNOTS)
    heights[0] += 1.0
    assert formula_terms("angle", places, heights, sure) == {}
    sure[0, 0] = 1e-9
    assert formula_terms("angle", places, heights, sure) == pytest.approx({"sin(x)": 0.2}, rel=1e-3)


def test_knots_are_where_the_curve_has_them() -> None:
    knots = np.array([float(knot) for knot in CurveOverVelocity.knots(-3.0, 2.0)])
    assert CurveOverVelocity.hats(knots, -3.0, 2.0) == pytest.approx(np.eye(KNOTS), abs=1e-9)


def test_an_excluded_drag_is_suggested_from_its_curve() -> None:
    log = record(Machine().hiding(quadratic_drag={"drag": 0.1}), excitation(1, duration=20.0)).log()
    shape = {f"c{k}": 0.0 for k in range(KNOTS)}
    with_curve = ServoModel.paper().with_effect(CurveOverVelocity(low=-3.0, high=3.0, **shape))
    fixed = ["curve_over_velocity.low", "curve_over_velocity.high", "viscous_friction"]
    suggested = suggested_formula(fit(log, with_curve, fixed=fixed))
    assert suggested is not None
    assert "Over velocity v" in suggested
    assert "looks like -0." in suggested
    assert " v |v| [N m], beside viscous friction" in suggested
    assert suggested.endswith("not a finding.")


def test_a_linear_axis_is_described_by_position_and_force() -> None:
    log = record(replace(Machine(), gravity=0.0), excitation(1, duration=5.0)).log()
    axis = replace(log, axis="linear", command_unit="N")
    shape = {f"c{k}": 0.1 * np.sin(0.5 * k - 2.0) for k in range(KNOTS)}
    curve = CurveOverAngle(low=-2.0, high=2.0, **shape)
    kept = [f"curve_over_angle.{name}" for name in ("low", "high")]
    model = ServoModel(inertia=2.0, viscous_friction=0.8, gravity=0.0, axis="linear").with_effect(curve)
    found = fit(axis, model, fixed=kept)
    like_a_sine = found.model.without_effect(curve.name).with_effect(curve)
    suggested = suggested_formula(replace(found, model=like_a_sine, covariance=np.eye(len(found.free))))
    assert suggested is not None
    assert suggested.startswith("Over position x the force that the model lacks looks like ")
    assert "[N]" in suggested
    assert "sin(" not in suggested


def test_over_time_nothing_is_suggested_nor_without_a_curve() -> None:
    log = record(Machine(), excitation(1, duration=5.0)).log()
    assert suggested_formula(fit(log, ServoModel.paper())) is None
    shape = {f"c{k}": 0.0 for k in range(KNOTS)}
    timed = ServoModel.paper().with_effect(CurveOverTime(low=0.0, high=5.0, **shape))
    assert suggested_formula(fit(log, timed, fixed=["curve_over_time.low", "curve_over_time.high"])) is None
