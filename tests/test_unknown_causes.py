"""A cause that may not be named is not given another name: the variable is told, and a curve carries the gain."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from machine import Machine, excitation, load_fluctuation, record

from diagnosis import Diagnosis, diagnose
from diagnosis.candidates import chosen
from diagnosis.explanation.posterior_sentences import posterior_sentences
from diagnosis.explanation.reasons import reason_for_none
from diagnosis.residual_torque import effects_over
from identification.log import Log
from plant import BadParameter, Effect, ModelFile, ServoModel, catalogue, read_model, simulate
from plant.effects import CoulombFriction, DeadZone, Motion, Regressors, Stage
from plant.effects.effect import Array, Expression, Moment, parameter
from plant.effects.friction_over_velocity import FrictionOverVelocity
from plant.effects.nonparametric import plain, unnamed
from plant.effects.nonparametric_curve import HEIGHTS, Curve, CurveOverAngle, CurveOverVelocity, Nonparametric
from plant.effects.parameter_varying import FrictionOverTurn
from plant.effects.ripple import RippleOverAngle

TURN = {"low": 0.0, "high": 2.0 * np.pi}


CABLE = {"cable_stiffness": {"stiffness": 0.1, "cubic": 0.002, "rest_angle": 0.4}}


def log_of(**hidden: dict[str, float]) -> Log:
    return record(Machine().hiding(**hidden), excitation(1, duration=30.0)).log()


@cache
def cable_beside_gravity() -> Diagnosis:
    """What is found of a cable if all that is asked for is an offset of gravity."""
    return diagnose(log_of(**CABLE), candidates=["gravity_offset"])


def test_a_curve_has_to_predict_better() -> None:
    """On data that it was not fitted to; paying for its parameters is not enough. Here the cable is gone in them."""
    assert cable_beside_gravity().model.effect("curve_over_angle") is not None
    without_cable = record(Machine(), excitation(2, duration=15.0)).log()
    again = diagnose(log_of(**CABLE), holdout=without_cable, candidates=["gravity_offset"])
    assert again.model.effects == again.base.model.effects
    assert again.verdict == "unknown"
    assert again.gain is not None
    assert again.gain.held_out_rms_after <= again.gain.held_out_rms_before


def test_what_was_excluded_is_reported_under_no_other_name() -> None:
    """Coulomb friction is a special case of both candidates; as it is excluded, the answer is unknown over velocity."""
    log = log_of(coulomb_friction={"torque": 0.3})
    found = diagnose(log, candidates=["asymmetric_friction", "stribeck_friction"])
    assert (found.verdict, found.causes) == ("unknown", ())
    assert "velocity" in found.unknown.depends_on
    assert found.gain is not None
    assert found.gain.held_out_rms_after < 0.1 * found.gain.held_out_rms_before
    allowed = diagnose(log, candidates=["asymmetric_friction", "coulomb_friction"])
    assert [(cause.effect, cause.probability > 0.99) for cause in allowed.causes] == [("coulomb_friction", True)]


@pytest.mark.parametrize(
    ("hidden", "near", "variable", "nonparametric", "formula"),
    [
        (
            {"quadratic_drag": {"drag": 0.03}},
            None,
            "velocity",
            "curve_over_velocity",
            r"looks like -0\.0\d+ v \|v\| \[N m\], beside viscous friction",
        ),
        pytest.param(
            CABLE,
            ("torque_offset", "gravity_offset", "cogging", "asymmetric_friction"),
            "angle",
            "curve_over_angle",
            r"looks like (.* )?-0\.1\d+ x ",
            marks=pytest.mark.long,
        ),
    ],
    ids=["drag", "cable"],
)
def test_what_the_catalogue_lacks_is_unknown_and_its_gain_is_had(
    hidden: dict[str, dict[str, float]], near: tuple[str, ...] | None, variable: str, nonparametric: str, formula: str
) -> None:
    """One beside the whole catalogue; for time the others beside those of it that stand near."""
    (name,) = hidden
    log = log_of(**hidden)
    found = diagnose(log, candidates=near, exclude=[name])
    assert found.verdict == "unknown"
    assert found.causes == ()
    assert found.unexplained.depends_on[0] == variable
    assert nonparametric in [effect.name for effect in found.model.effects]
    with_name = diagnose(log, candidates=[name])
    assert [cause.effect for cause in with_name.causes] == [name]
    assert found.gain.cut > 0.9 * with_name.gain.cut
    assert any(re.search(formula, warning) for warning in found.warnings)


@pytest.mark.long
def test_of_what_the_catalogue_lacks_only_a_true_part_is_sure() -> None:
    """Friction that differs by direction holds Coulomb friction and an offset."""
    near = ("coulomb_friction", "stribeck_friction", "presliding_hysteresis", "torque_offset", "friction_drift")
    hidden = {"forward": 0.4, "backward": 0.3, "viscous_difference": 0.1}
    found = diagnose(log_of(asymmetric_friction=hidden), candidates=near)
    assert found.verdict in ("unknown", "ambiguous")
    sure = {cause.effect for cause in found.causes if cause.probability > 0.9}
    assert sure <= {"coulomb_friction", "torque_offset"}


def test_an_error_of_the_measurement_without_a_name_is_reported() -> None:
    """No torque is missing then; a random load that an observer follows would do as well for a simulation."""
    log = log_of(encoder_eccentricity={"amplitude": 0.003, "order": 1.0, "phase": 0.4})
    found = diagnose(log, candidates=["coulomb_friction", "torque_offset"])
    assert found.verdict == "unknown"
    assert found.causes == ()
    assert found.unknown.probability < 0.5
    assert found.unknown.measurement_error > 0.999
    assert posterior_sentences(found) == ("Unexplained: an error of the measurement; it depends on angle.",)
    assert "an error of the measurement (probability > 99.9 %)" in reason_for_none(found).sentences[0]


def test_effects_that_explain_less_than_a_curve_are_dropped() -> None:
    log = log_of(cable_stiffness={"stiffness": 0.1, "cubic": 0.002, "rest_angle": 0.4})
    found = diagnose(log, candidates=["gravity_offset"])
    assert found.verdict == "unknown"
    assert found.causes == ()
    assert found.unexplained.depends_on[0] == "angle"
    assert [effect.name for effect in found.model.effects] == ["dead_zone", "curve_over_angle"]


@pytest.mark.long
def test_true_effects_are_compared_if_curves_are_not_far_better() -> None:
    """Beside a load that shakes: curves would explain nearly as much."""
    hidden = {**CABLE, "coulomb_friction": {"torque": 0.3}}
    rough = load_fluctuation(3, 0.02, (6000, 1), correlation_time=0.02)
    log = record(Machine().hiding(**hidden), excitation(1, duration=30.0), load_torque=rough).log()
    reported: list[str] = []
    found = diagnose(log, candidates=list(hidden), progress=reported.append)
    assert found.base.bandwidth > 0.0
    assert {cause.effect for cause in found.causes} == set(hidden)


@pytest.mark.long
def test_a_law_of_two_variables_is_nonparametric_without_a_cause() -> None:
    """Friction that grows with the load, where only dry friction of one size may be named."""
    machine = Machine().hiding(load_dependent_friction={"coefficient": 0.1})
    log, held_out = (
        record(machine, excitation(place, duration=duration), seed=place // 2, noise=1e-3).log()
        for place, duration in ((22000, 30.0), (22001, 15.0))
    )
    found = diagnose(log, None, held_out, candidates=["asymmetric_friction"])
    assert not [cause for cause in found.causes if cause.probability > 0.9]
    assert found.model.effect("friction_over_torque") is not None
    assert found.gain.held_out_rms_after < 0.3 * found.gain.held_out_rms_before


def test_gravity_stays_what_it_was_beside_a_curve_over_the_angle() -> None:
    """It is such a curve itself: set free, the two run off against one another, and beyond the knots it shows."""
    found = cable_beside_gravity()
    assert found.model.effect("curve_over_angle") is not None
    assert found.model.gravity == found.base.model.gravity


def test_variables_have_the_names_of_the_axis() -> None:
    levelled = record(
        replace(Machine(), gravity=0.0).hiding(quadratic_drag={"drag": 0.03}), excitation(1, duration=30.0)
    )
    log = replace(levelled.log(), axis="linear", command_unit="N")
    found = diagnose(log, candidates=["torque_offset"])
    assert found.verdict == "unknown"
    assert found.unexplained.depends_on[0] == "velocity"
    over = {curve.over for curve in plain.values()}
    assert {effects_over(name, "linear") for name in over} == {"velocity", "position", "force", "time"}
    assert {effects_over(name, "rotary") for name in over} == over


def test_a_clean_log_gets_no_nonparametric_curve() -> None:
    found = diagnose(log_of())
    assert found.verdict == "nothing_missing"
    assert [effect.name for effect in found.model.effects] == ["dead_zone"]


def example(kind: type[Nonparametric]) -> Nonparametric:
    """Every coefficient another, none negative."""
    first = {"low": -3.0, "high": 4.0, "rate": 2.0, "time_constant": 0.01}
    values = {spec.name: first.get(spec.name, 0.1 * place) for place, spec in enumerate(kind.parameters())}
    return kind(**values)


@pytest.mark.parametrize("kind", unnamed.values(), ids=lambda kind: kind.name)
def test_it_is_saved_with_the_model(kind: type[Nonparametric], tmp_path) -> None:
    model = ServoModel.paper().with_effect(example(kind))
    ModelFile(model=model, std={}).write(tmp_path / "model.json")
    assert read_model(tmp_path / "model.json").model == model


@pytest.mark.parametrize("kind", [k for k in unnamed.values() if not k.states], ids=lambda kind: kind.name)
def test_its_trace_is_what_it_does(kind: type[Nonparametric]) -> None:
    """Columns times coefficients: the torque, the friction against the motion, or the error of the reading.

    Of what remembers see `test_hysteresis`.
    """
    rng = np.random.default_rng(3)
    time, velocity = 0.005 * np.arange(400), rng.normal(size=400)
    angle, torque = 5.0 * np.sin(3.0 * time) + 2.0 * rng.normal(size=400), rng.normal(size=400)
    motion = Motion(
        time=time,
        angle=angle,
        velocity=velocity,
        acceleration=np.zeros(400),
        command=torque,
        servo_gain=np.zeros(400),
        torque=torque,
        score=(np.sin(9.0 * angle) ** 2 + np.sin(60.0 * time) ** 2)[:, None],
        reading_score=np.sin(9.0 * angle)[:, None] ** 2,
        run=np.zeros(400, dtype=int),
        inertia=1.0,
        velocity_resolution=1e-9,
    )
    regressors = next(iter(kind.regressors(motion)))
    coefficients = rng.uniform(0.1, 1.0, regressors.columns.shape[1])
    effect = regressors.start(coefficients)
    at = Moment(angle=angle, velocity=velocity, torque=torque, time=time + (0.0025 if "ripple" in kind.name else 0.0))
    friction = effect.dry_friction(at)
    does = [
        np.broadcast_to(np.array(effect.load_torque(at, 0.0)).ravel(), 400),
        np.zeros(400) if friction is None else -np.sign(velocity) * np.array(friction[0]).ravel(),
        np.array(effect.measurement(angle, 0.0)).ravel() - angle,
    ]
    assert regressors.acts_on == ("measurement" if kind.stage == Stage.SENSOR else "torque")
    np.testing.assert_allclose(regressors.columns @ coefficients, sum(does), atol=1e-9)


def simulated(effect: Nonparametric) -> tuple[Log, Log]:
    """A log of a machine with an effect that the catalogue does not have, and one to validate by."""
    truth = ServoModel.paper().with_effect(DeadZone(half_width=0.5)).with_effect(effect)
    logs = []
    for number, duration in enumerate((30.0, 15.0)):
        command = excitation(2 + number, duration=duration)
        moved = simulate(truth, command=command, dt=0.005, substeps=4)[: command.size, 0]
        measured = moved + 1e-3 * np.random.default_rng(number).standard_normal(command.size)
        run = record(Machine(), command[:2]).run()
        time, still = 0.005 * np.arange(command.size), np.zeros(command.size)
        run = replace(run, time=time, command=command, output=measured, valid=still == 0.0, servo_gain=still)
        logs.append(Log(runs=(run,), axis="rotary"))
    return logs[0], logs[1]


@pytest.mark.long
def test_friction_that_varies_over_the_turn_has_no_sure_name() -> None:
    log, validation = simulated(FrictionOverTurn(**TURN, c0=0.1, c1=0.2, c2=0.3, c3=0.2, c4=0.1))
    found = diagnose(log, None, validation)
    assert found.verdict in ("unknown", "ambiguous")
    assert all(cause.probability < 0.9 for cause in found.causes)


@pytest.mark.long
def test_a_ripple_of_three_waves_is_identified_by_its_waves() -> None:
    """No single wave of the catalogue is as likely; each is found to a hundredth of its size."""
    log, validation = simulated(RippleOverAngle(rate=7.0, s1=0.1, c2=0.1, c3=0.1))
    found = diagnose(log, None, validation)
    assert (found.verdict, found.unknown.depends_on) == ("unknown", ("angle",))
    ripple = found.model.effect("ripple_over_angle")
    assert isinstance(ripple, RippleOverAngle)
    assert ripple.rate == pytest.approx(7.0, rel=1e-3)
    assert (ripple.s1, ripple.c2, ripple.c3) == pytest.approx((0.1, 0.1, 0.1), rel=0.01)
    assert found.gain is not None
    assert found.gain.held_out_rms_after < 0.03 * found.gain.held_out_rms_before
    assert any(re.search(r"sin\(7 x\).*cos\(14 x\).*cos\(21 x\) \[N m\]", line) for line in found.warnings)


def test_a_curve_is_flat_outside_its_range_and_passes_its_knots() -> None:
    values = [0.3, -0.1, 0.2, 0.0, 0.5, 0.4, -0.2, 0.1, 0.7]
    curve = CurveOverAngle(low=-3.0, high=4.0, **{f"c{k}": value for k, value in enumerate(values)})
    ends = [float(curve.load_torque(Moment(angle=x), 0.0)) for x in (-9.0, -3.0, 0.5, 4.0, 9.0)]
    assert ends == pytest.approx([0.3, 0.3, 0.5, 0.7, 0.7])


def test_a_velocity_curve_continues_with_its_end_slope() -> None:
    """What is viscous in it and what the model has as viscous friction are one thing, and no fit knows the shares."""
    values = [0.3, -0.1, 0.2, 0.0, 0.5, 0.4, -0.2, 0.1, 0.7]
    curve = CurveOverVelocity(low=-3.0, high=4.0, **{f"c{k}": value for k, value in enumerate(values)})

    def torque(velocity: float) -> float:
        return float(curve.load_torque(Moment(velocity=velocity), 0.0))

    assert [torque(-3.0), torque(4.0)] == pytest.approx([0.3, 0.7])
    first, last = (torque(-3.0 + 1e-6) - 0.3) / 1e-6, (0.7 - torque(4.0 - 1e-6)) / 1e-6
    slope = (9.0 * first + 16.0 * last) / 25.0
    assert [torque(9.0) - 0.7, torque(-9.0) - torque(-4.0)] == pytest.approx([5.0 * slope, -5.0 * slope], rel=1e-4)
    knots = [float(knot) for knot in curve.knots(-3.0, 4.0)]
    assert (knots[0], knots[-1]) == (-3.0, 4.0)
    assert np.all(np.diff(knots) > 0)
    viscous = replace(curve, **{f"c{k}": -0.2 * knot for k, knot in enumerate(knots)})
    speeds = np.linspace(-9.0, 8.0, 50)
    assert [float(viscous.load_torque(Moment(velocity=v), 0.0)) for v in speeds] == pytest.approx(-0.2 * speeds)
    assert "viscous_friction" in CurveOverVelocity.shape()


@pytest.mark.parametrize("ends", [(0.5, 3.0), (-3.0, -0.5), (-1.0, 3.0), (0.0, 3.0)])
def test_what_is_viscous_stays_so_whatever_speeds_were_seen(ends: tuple[float, float]) -> None:
    knots = [float(knot) for knot in CurveOverVelocity.knots(*ends)]
    curve = CurveOverVelocity(low=ends[0], high=ends[1], **{f"c{k}": -0.2 * knot for k, knot in enumerate(knots)})
    speeds = np.linspace(-5.0, 5.0, 41)
    assert [float(curve.load_torque(Moment(velocity=v), 0.0)) for v in speeds] == pytest.approx(-0.2 * speeds)


@pytest.mark.parametrize("mirrored", [1.0, -1.0])
def test_speeds_seen_in_one_direction_count_for_the_other(mirrored: float) -> None:
    """A held-out log may be as fast backward as the fit's was forward: a straight line is far from a cubic there."""
    low, high = sorted((-0.7 * mirrored, 3.7 * mirrored))
    knots = [float(knot) for knot in CurveOverVelocity.knots(low, high)]
    curve = CurveOverVelocity(low=low, high=high, **{f"c{k}": -0.01 * knot**3 for k, knot in enumerate(knots)})
    for speed in (-3.7, -2.0, -0.8, 0.8, 2.0, 3.7):
        assert float(curve.load_torque(Moment(velocity=speed), 0.0)) == pytest.approx(-0.01 * speed**3, abs=0.005)
    near, far = (float(curve.load_torque(Moment(velocity=-mirrored * speed), 0.0)) for speed in (0.69999, 0.70001))
    assert near == pytest.approx(far, abs=1e-5)


@pytest.mark.parametrize("kind", [CurveOverAngle, CurveOverVelocity])
def test_a_curve_has_every_parabola_as_it_is_and_bends_smoothly(kind: type[Curve]) -> None:
    knots = np.array([float(knot) for knot in kind.knots(-3.0, 4.0)])
    values = np.linspace(-3.0, 4.0, 400)
    hats = kind.hats(values, -3.0, 4.0)
    assert hats @ (1.0 - 2.0 * knots + 0.5 * knots**2) == pytest.approx(1.0 - 2.0 * values + 0.5 * values**2)
    assert hats.sum(axis=1) == pytest.approx(np.ones(400))
    sides = [kind.hats(knots[1:-1] + d, -3.0, 4.0) for d in (-1e-6, 0.0, 1e-6)]
    before, at, after = (side @ np.sin(2.0 * knots) for side in sides)
    assert at == pytest.approx(np.sin(2.0 * knots[1:-1]))
    assert (after - at) / 1e-6 == pytest.approx((at - before) / 1e-6, abs=1e-4)


def test_dry_friction_without_a_name_stays_dry() -> None:
    """A smooth curve would be steep where the motion reverses, and nothing would stick."""
    log = log_of(asymmetric_friction={"forward": 0.4, "backward": 0.3, "viscous_difference": 0.0})
    found = diagnose(log, candidates=["torque_offset"])
    curve = found.model.effect("friction_over_velocity")
    assert isinstance(curve, FrictionOverVelocity)
    assert curve.dry == pytest.approx(0.35, rel=0.02)
    assert curve.dry_friction(Moment()) == (curve.dry, curve.dry)
    both = [float(curve.height(Moment(velocity=v))) for v in (-1.0, 1.0)]
    assert np.mean(both) == pytest.approx(-0.05, abs=0.01)


def test_named_dry_friction_excludes_a_friction_curve() -> None:
    """It would take the name's place, whatever the name."""
    assert FrictionOverVelocity.beside(ServoModel.paper())
    rubs = ServoModel.paper().with_effect(CoulombFriction(torque=0.3))
    assert not FrictionOverVelocity.beside(rubs)
    assert CurveOverVelocity.beside(rubs)
    curved = ServoModel.paper().with_effect(FrictionOverVelocity(low=-1.0, high=1.0, dry=0.1))
    assert not CurveOverVelocity.beside(curved)
    assert CurveOverAngle.beside(curved)


def test_over_a_turn_the_end_goes_on_as_the_beginning() -> None:
    knots = 2.0 * np.pi * np.arange(9) / 9
    angles = np.linspace(-7.0, 9.0, 300)
    hats = FrictionOverTurn.hats(angles, 0.0, 2.0 * np.pi)
    assert hats.sum(axis=1) == pytest.approx(np.ones(300))
    assert hats @ np.sin(knots) == pytest.approx(np.sin(angles), abs=0.01)


@dataclass(frozen=True, kw_only=True)
class Windage(Effect):
    """Somebody's own effect: a drag with the cube of speed."""

    name = "windage"
    title = "windage"
    stage = Stage.LOAD
    equation = r"-c v^3"
    signature = "cubic over velocity"

    drag: float = parameter("{torque} s^3/{angle}^3", "drag", lower=0.0)

    def load_torque(self, at: Moment, state: Expression) -> Expression:
        return -self.drag * at.velocity**3

    @classmethod
    def regressors(cls, motion: Motion) -> Iterator[Regressors]:
        yield Regressors(
            columns=-(motion.velocity**3)[:, None], positive=(True,), start=lambda c: cls(drag=max(float(c[0]), 0.0))
        )


def test_an_effect_of_ones_own_takes_part() -> None:
    found = diagnose(log_of(quadratic_drag={"drag": 0.03}), candidates=["coulomb_friction", Windage])
    considered = {*(name for each in found.sets for name in each.effects), *(each.effect for each in found.rejected)}
    assert considered == {"windage", "coulomb_friction"}
    assert any("windage" in each.effects for each in found.sets)


def test_an_effect_of_ones_own_can_win() -> None:
    log = log_of()
    (run,) = log.runs
    model = ServoModel.paper().with_effect(Windage(drag=0.01))
    heard = simulate(model, command=run.command, dt=log.sample_time)[:-1, 0]
    noise = 1e-3 * np.random.default_rng(0).standard_normal(heard.size)
    found = diagnose(replace(log, runs=(replace(run, output=heard + noise),)), candidates=[*catalogue, Windage])
    assert found.verdict == "named"
    (cause,) = found.causes
    assert cause.effect == "windage"
    assert cause.parameters["drag"].value == pytest.approx(0.01, rel=0.02)


def test_varying_friction_begins_where_none_of_it_is_cut_off() -> None:
    heights = np.array([0.1, -0.2, 0.0, 0.3, 0.1, 0.0, -0.1, 0.2, 0.0])

    def begun(some: Array) -> Array:
        ends = {"low": 0.0, "high": 2.0 * np.pi}
        return np.array(FrictionOverTurn(**ends, **dict(zip(HEIGHTS, some, strict=True))).begun().values[2:])

    assert begun(heights).min() == 0.0
    assert np.ptp(begun(heights)) == pytest.approx(np.ptp(heights))
    assert begun(np.abs(heights)) == pytest.approx(np.abs(heights))


def test_a_choice_must_make_sense() -> None:
    assert set(chosen(None, ["backlash"])) == set(catalogue) - {"backlash"}
    assert list(chosen(["cogging", Windage], ())) == ["cogging", "windage"]
    with pytest.raises(BadParameter, match="'stiktion' is no effect; the catalogue has torque_measurement_lag"):
        chosen(["stiktion"], ())
    with pytest.raises(BadParameter, match="exclude: 'stiktion'"):
        chosen(None, ["stiktion"])
    with pytest.raises(BadParameter, match="No effect is left"):
        chosen(["cogging"], ["cogging"])
