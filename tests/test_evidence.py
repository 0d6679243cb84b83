"""Sets of effects weighed by one evidence, with the unnamed taking part in each."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from machine import Machine, excitation, record
from scipy.stats import multivariate_normal

from diagnosis import Diagnosis, diagnose
from diagnosis.evidence import fitted_sets
from diagnosis.evidence.discrepancy import _at
from diagnosis.evidence.families import Families
from diagnosis.evidence.fitted_sets import fitted as fitted_near
from diagnosis.evidence.marginal import families_along, marginal_likelihood
from diagnosis.evidence.posterior import over_blocks
from diagnosis.evidence.proposals import proposals_of
from diagnosis.evidence.signatures import Signatures
from identification.fit import fit
from identification.fit_result import Fit
from identification.least_squares import bounded_least_squares
from identification.log import Log
from plant.effects import AsymmetricFriction, CoulombFriction, TorqueOffset, catalogue
from plant.servo import ServoModel
from plant.simulation import simulate

FEW = ["coulomb_friction", "asymmetric_friction", "torque_offset", "quadratic_drag", "input_delay", "gravity_offset"]


def log_of(seed: int, noise: float = 1e-3, **hidden: dict[str, float]) -> Log:
    machine = Machine().hiding(**hidden) if hidden else Machine()
    return record(machine, excitation(seed, duration=15.0), seed=seed, noise=noise).log()


def names(found: Diagnosis) -> list[str]:
    return sorted(cause.effect for cause in found.causes)


def with_smooth_torque(log: Log, size: float) -> Log:
    """The same motion, for which the torque in the log is wrong by a smooth function of the angle."""
    runs = []
    for run in log.runs:
        unmodelled = np.sin(3.0 * run.output) + 0.5 * np.cos(5.0 * run.output + 1.0)
        level = size * np.sqrt(np.mean(run.command**2) / np.mean(unmodelled**2))
        runs.append(replace(run, command=run.command + level * unmodelled))
    return replace(log, runs=tuple(runs))


def test_nothing_drawn_along_a_motion_knows_a_later_reading() -> None:
    """A torque made from the next readings explains their noise, and whatever carries it looks likely."""
    goal = np.repeat(np.random.default_rng(3).uniform(-1.0, 1.0, 20), 50)
    angle = simulate(ServoModel(), command=40.0 * goal, dt=0.005, servo_gain=40.0, servo_damping=4.0)[:-1, 0]
    noisy = angle + 1e-3 * np.random.default_rng(4).standard_normal(angle.size)
    log = Log.from_arrays(time=0.005 * np.arange(goal.size), setpoint=goal, angle=noisy, kp=40.0, kd=4.0)
    (run,) = log.runs
    fitted = fit(log)
    changed = replace(run, output=np.where(np.arange(len(run)) < 500, run.output, run.output + 0.1))
    families = families_along(fitted)
    assert families is not None
    motions = []
    for each in (run, changed):
        behind = replace(fitted, bandwidth=80.0, log=replace(log, runs=(each,)))
        found = marginal_likelihood(behind, (), families, catalogue=1, observer=80.0)
        assert found is not None
        motions.append(found.screen.motion)
    before, after = motions
    for name in ("angle", "velocity", "acceleration", "torque"):
        np.testing.assert_array_equal(getattr(before, name)[:500], getattr(after, name)[:500], err_msg=name)
        assert np.any(getattr(before, name)[500:] != getattr(after, name)[500:])


def test_one_and_two_hidden_effects_are_named_and_nothing_else() -> None:
    one = diagnose(log_of(4, coulomb_friction={"torque": 0.18}), candidates=FEW)
    assert (one.verdict, names(one)) == ("named", ["coulomb_friction"])
    assert one.causes[0].probability > 0.9
    assert one.causes[0].parameters["torque"].value == pytest.approx(0.18, rel=0.02)
    two = diagnose(log_of(5, coulomb_friction={"torque": 0.18}, input_delay={"time": 0.012}), candidates=FEW)
    assert (two.verdict, names(two)) == ("named", ["coulomb_friction", "input_delay"])


def test_where_nothing_is_hidden_nothing_is_missing() -> None:
    found = diagnose(log_of(6), candidates=FEW)
    assert (found.verdict, names(found), found.minor) == ("nothing_missing", [], ())
    assert found.unknown.share < 1e-3


def test_an_unexplained_torque_is_unknown_and_its_size_learned() -> None:
    found = diagnose(with_smooth_torque(log_of(7, noise=1e-5), 0.03), candidates=FEW)
    assert names(found) == []
    assert found.verdict == "unknown"
    assert "angle" in found.unexplained.depends_on
    assert 0.03 / 4.0 < found.unknown.share < 0.03 * 4.0


def test_an_effect_above_the_unmodelled_torque_keeps_its_name() -> None:
    hidden = log_of(8, coulomb_friction={"torque": 0.5})
    found = diagnose(with_smooth_torque(hidden, 0.01), candidates=FEW)
    assert "coulomb_friction" in names(found)
    assert found.causes[0].probability > 0.9


def test_a_base_model_that_converges_slowly_is_no_obstacle(monkeypatch: pytest.MonkeyPatch) -> None:
    """Inertia and damping that trade places take more iterations than a set has; the base model had its own."""

    def in_few_iterations(start: Fit, models: list[ServoModel], bandwidth: float) -> Fit:
        return replace(fitted_near(start, models, bandwidth), converged=False)

    monkeypatch.setattr(fitted_sets, "fitted", in_few_iterations)
    found = diagnose(log_of(4), candidates=["quadratic_drag"])
    assert [each.effects for each in found.sets] == [()]


def test_probabilities_of_the_sets_sum_to_one() -> None:
    found = diagnose(log_of(4, coulomb_friction={"torque": 0.18}), candidates=FEW)
    assert sum(each.probability for each in found.sets) == pytest.approx(1.0)
    assert [each.probability for each in found.sets] == sorted((e.probability for e in found.sets), reverse=True)
    own = sum(each.probability for each in found.sets if "coulomb_friction" in each.effects)
    assert found.causes[0].probability <= own
    joined_words = found.to_dict()["sets"]
    assert all(each["probability"] >= 0.01 for each in joined_words)
    assert joined_words[0]["effects"] == ["coulomb_friction"]


def set_with_blocks(log_marginal: float, of_blocks: Any, names: tuple[str, ...] = ()) -> Any:
    """A set of effects as far as its probability needs it."""

    def by_block(blocks: int) -> Any:
        return np.array([part.sum() for part in np.array_split(np.asarray(of_blocks, dtype=float), blocks)])

    return SimpleNamespace(
        names=frozenset(names), log_marginal=log_marginal, likelihood=SimpleNamespace(by_block=by_block)
    )


def test_a_set_is_sure_where_the_blocks_of_a_log_agree() -> None:
    """Twenty in log odds that all blocks bring are sure; that one of them brings, while others object, are not."""
    none = set_with_blocks(0.0, np.zeros(100))
    agreed, disagreed = np.full(100, 0.2), np.r_[np.full(5, 16.0), np.full(95, -60.0 / 95.0)]
    assert agreed.sum() == pytest.approx(20.0)
    assert disagreed.sum() == pytest.approx(20.0)
    assert over_blocks([set_with_blocks(20.0, agreed), none], {})[0] > 0.999
    assert 0.3 < over_blocks([set_with_blocks(20.0, disagreed), none], {})[0] < 0.7


def test_validation_data_take_evidence_and_give_none() -> None:
    """Five in log odds do not stand against ten on validation data; nor do those make a name surer that they favour."""
    none, wave = (set_with_blocks(log_odds, np.zeros(100), names) for log_odds, names in ((0.0, ()), (5.0, ("wave",))))
    alone, opposed, favoured, of_another = (
        over_blocks([wave, none], against)[0]
        for against in ({}, {"wave": np.full(20, -0.5)}, {"wave": np.full(20, 0.5)}, {"drag": np.full(20, -0.5)})
    )
    assert opposed < 0.05 < 0.99 < alone
    assert favoured == pytest.approx(alone)
    assert of_another == pytest.approx(alone)


def test_the_blocks_of_a_log_make_its_whole_likelihood() -> None:
    fitted = fit(log_of(4, coulomb_friction={"torque": 0.18}))
    families = families_along(fitted)
    assert families is not None
    beside = marginal_likelihood(fitted, {"dead_zone"}, families, catalogue=5, observer=fitted.bandwidth)
    assert beside is not None
    few, many = (beside.likelihood.by_block(blocks) for blocks in (3, 50))
    assert few.shape == (3,)
    assert few.sum() == pytest.approx(many.sum())
    left = beside.discrepancy.left - beside.discrepancy.columns @ beside.discrepancy.posterior.functions
    variance = beside.discrepancy.posterior.variance
    counted = beside.fit.log.runs[0].valid
    whole = multivariate_normal(cov=variance).logpdf(left[counted]).sum()
    assert many.sum() == pytest.approx(float(whole))


@pytest.mark.parametrize("size", [0.01, 0.03, 0.1])
def test_the_size_of_an_unmodelled_torque_is_learned(size: float) -> None:
    log = with_smooth_torque(log_of(8, coulomb_friction={"torque": 0.5}), size)
    fitted = fit(log, ServoModel.paper().with_effect(CoulombFriction(torque=0.5)))
    families = families_along(fitted)
    assert families is not None
    slower = fitted_near(fitted, [fitted.model], fitted.bandwidth / 4.0)  # a fast observer follows the torque
    beside = marginal_likelihood(slower, {"dead_zone"}, families, catalogue=5, observer=fitted.bandwidth)
    assert beside is not None
    assert size / 4.0 < beside.likelihood.share < size * 4.0


def test_a_parameter_that_others_can_follow_wins_no_evidence() -> None:
    """A torque offset beside asymmetric friction costs its place in the catalogue, and changes nothing else."""
    beside = AsymmetricFriction(forward=0.5, backward=0.5, viscous_difference=0.0)
    plain = fit(log_of(8, coulomb_friction={"torque": 0.5}), ServoModel.paper().with_effect(beside))
    families = families_along(plain)
    assert families is not None
    more = fitted_near(plain, [plain.model.with_effect(TorqueOffset(torque=0.01))], plain.bandwidth)
    base = {"dead_zone", "asymmetric_friction"}
    less, wider = (
        marginal_likelihood(each, base, families, catalogue=5, observer=plain.bandwidth) for each in (plain, more)
    )
    assert less is not None
    assert wider is not None
    assert wider.log_marginal - less.log_marginal == pytest.approx(-np.log(5.0), abs=0.1)


def test_what_is_below_rounding_is_no_evidence() -> None:
    """Responses that explain more power than there is once made a log marginal likelihood of 1e35."""
    likelihood, *_ = _at(np.array([[1.0]]), np.array([1.0]), 0.5, 100, np.array([1.0]))
    assert likelihood == -np.inf


def test_the_discrepancy_is_integrated_out_as_a_gaussian_is() -> None:
    """Beside the log-density of the whole covariance, s^2 I + D S D', of values and columns drawn at random."""
    rng = np.random.default_rng(0)
    columns, scale = rng.normal(size=(60, 5)), np.array([0.5, 0.2, 0.0, 1.0, 0.3])
    values = columns @ (scale * rng.normal(size=5)) + 0.7 * rng.normal(size=60)
    likelihood, variance, functions, weights = _at(
        columns.T @ columns, columns.T @ values, float(values @ values), 60, scale
    )
    covariance = variance * np.eye(60) + columns @ np.diag(scale**2) @ columns.T
    assert likelihood == pytest.approx(multivariate_normal(np.zeros(60), covariance).logpdf(values))
    np.testing.assert_allclose(
        np.eye(60) - columns @ weights @ columns.T, variance * np.linalg.inv(covariance), atol=1e-10
    )
    gain = np.diag(scale**2) @ columns.T @ np.linalg.inv(covariance)
    np.testing.assert_allclose(functions, gain @ values, atol=1e-10)
    assert functions[2] == 0.0


def test_families_are_as_large_as_the_torque_whatever_its_unit() -> None:
    log = log_of(9)
    base = fit(log)
    drawn = families_along(base)
    assert drawn is not None
    explanation = marginal_likelihood(base, {"dead_zone"}, drawn, catalogue=5, observer=base.bandwidth)
    motion = explanation.screen.motion  # type: ignore[union-attr]
    assert drawn.torque.shape == (len(log.runs[0]), len(drawn.variables) - drawn.measurement.shape[1])
    largest = np.sqrt(np.mean(drawn.torque**2, axis=0)).max()
    assert largest == pytest.approx(np.sqrt(np.mean(motion.torque**2)))
    milli = replace(motion, command=1e3 * motion.command, torque=1e3 * motion.torque)
    np.testing.assert_allclose(Families.along(milli).torque, 1e3 * drawn.torque, rtol=1e-9, atol=1e-9)


def test_on_a_linear_axis_no_unit_of_length_takes_part() -> None:
    log = log_of(9)
    motion = marginal_likelihood(
        base := fit(log), {"dead_zone"}, families_along(base), catalogue=5, observer=0.0
    ).screen.motion  # type: ignore[arg-type, union-attr]
    linear = replace(motion, turn=0.0)
    milli = replace(linear, angle=1e3 * linear.angle, velocity=1e3 * linear.velocity)
    np.testing.assert_allclose(
        Families.along(milli).measurement, Families.along(linear).measurement, rtol=1e-9, atol=1e-9
    )


def test_a_regressor_of_rounding_alone_explains_nothing() -> None:
    information = np.array([[1.0, 1e-3, 0.1], [1e-3, -1e-20, 1e10], [0.1, 1e10, -1e-20]])
    found = bounded_least_squares(information, np.array([1.0, 1e-3, 0.5]))
    assert np.isfinite(found).all()


@pytest.mark.long
def test_no_set_has_two_motors_before_one_load() -> None:
    """A spring and a gap in one drivetrain are two models of it; beside each other they were fitted in vain."""
    log = record(Machine().hiding(backlash={"gap": 0.01, "motor_share": 0.3}), excitation(1, duration=10.0)).log()
    fitted = fit(log)
    families = families_along(fitted)
    assert families is not None
    base = marginal_likelihood(fitted, {"dead_zone"}, families, catalogue=2, observer=fitted.bandwidth)
    assert base is not None
    both = {name: catalogue[name] for name in ("backlash", "compliance", "encoder_eccentricity")}
    proposed = {each.names for each in proposals_of(Signatures.at(base, both, len(both)))}
    assert {"backlash", "compliance"} not in proposed
    assert frozenset({"backlash"}) in proposed


@pytest.mark.parametrize(("turns", "repeats"), [(5.0, True), (0.8, False)])
def test_unmodelled_torque_repeats_with_each_turn_of_the_load(turns: float, repeats: bool) -> None:
    motion = marginal_likelihood(
        base := fit(log_of(9)), {"dead_zone"}, families_along(base), catalogue=5, observer=0.0
    ).screen.motion  # type: ignore[arg-type, union-attr]
    angle = 2.0 * np.pi * turns * (motion.angle - motion.angle.min()) / np.ptp(motion.angle)
    families = Families.along(replace(motion, angle=angle)).torque
    wave = np.sin(7.0 * angle + 0.4)
    left = wave - families @ np.linalg.lstsq(families, wave, rcond=1e-9)[0]
    assert (np.std(left) < 1e-6) == repeats
