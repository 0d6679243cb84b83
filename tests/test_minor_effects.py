"""Causes and minor effects: what is no larger than the unmodelled torque may be a part of it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from machine import Machine, excitation, record
from test_evidence import FEW as FEW_EFFECTS
from test_evidence import log_of, with_smooth_torque

from diagnosis import Diagnosis, diagnose
from diagnosis.diagnose_once import _minor
from diagnosis.evidence.families import Families
from diagnosis.evidence.marginal import Explanation
from diagnosis.evidence.posterior import Posterior, beside_discrepancy
from diagnosis.evidence.sizes import Sizes
from diagnosis.motion import motion_of
from diagnosis.result import Estimate, Minor
from diagnosis.verdict import judged
from identification.fit import fit
from identification.problem import Problem

FEW = [*FEW_EFFECTS, "cogging", "cable_stiffness", "encoder_eccentricity", "periodic_disturbance", "end_stop"]


@cache
def friction_alone() -> Diagnosis:
    return diagnose(log_of(8, coulomb_friction={"torque": 0.5}), candidates=FEW)


@cache
def friction_and_more() -> Diagnosis:
    return diagnose(with_smooth_torque(log_of(8, coulomb_friction={"torque": 0.5}), 0.02), candidates=FEW)


def test_of_what_no_effect_explains_no_part_is_sure() -> None:
    found = friction_and_more()
    sure = {cause.effect for cause in found.causes if cause.probability > 0.9}
    assert sure <= {"coulomb_friction"}
    assert found.verdict in ("ambiguous", "unknown", "named")
    friction = {"coulomb_friction", "asymmetric_friction"}
    together = sum(each.probability for each in found.sets if friction & set(each.effects))
    assert together > 0.7
    assert found.unknown.probability > 0.5
    assert 0.02 / 5.0 < found.unknown.share < 0.02 * 5.0


def explanation_of(
    sizes: dict[str, float],
    discrepancy: float = 0.0,
    *,
    at_its_limit: bool = False,
    special: dict[str, tuple[str, float]] | None = None,
) -> Explanation:
    """A set whose effects have such sizes beside a discrepancy, and beyond their special cases."""
    beyond = Sizes(fit=None, names=frozenset(sizes), bandwidth=0.0, here=None, discrepancy=discrepancy)  # type: ignore[arg-type]
    beyond.__dict__.update(effects=sizes, beyond_special=special or {}, beyond=lambda name, out: sizes[name])
    beside = SimpleNamespace(posterior=SimpleNamespace(at_its_limit=at_its_limit))
    made: Any = SimpleNamespace(names=frozenset(sizes), sizes=beyond, discrepancy=beside)
    return cast(Explanation, made)


def share_of(explanation: Explanation, name: str) -> float:
    """Probability of an effect of a set that is sure by its evidence."""
    return sum(p for names, p in beside_discrepancy(explanation, 1.0).items() if name in names)


def test_what_a_law_may_be_wrong_by_is_no_cause() -> None:
    """No law is exact to a hundredth of itself: what is smaller beside another effect may be that. Alone it is not."""
    assert share_of(explanation_of({"drift": 1.0, "wave": 1e-3}), "wave") < 0.02
    assert share_of(explanation_of({"drift": 1.0, "wave": 1e-3}), "drift") > 0.999
    assert share_of(explanation_of({"drift": 1.0, "wave": 0.1}), "wave") > 0.98
    assert share_of(explanation_of({"wave": 1e-3}), "wave") > 0.999


@pytest.mark.parametrize("discrepancy", [0.0, 0.001, 0.02, 0.1])
def test_what_an_effect_adds_to_its_special_case_is_weighed(discrepancy: float) -> None:
    """An asymmetry of 0.13 N m in a friction of 1.5 N m may be a part of 0.27 N m that are unmodelled."""
    for more, kept in ((0.05, 25.0 / 26.0), (0.01, 0.5), (0.001, 1.0 / 101.0)):
        explanation = explanation_of({"stribeck": 1.0}, discrepancy, special={"stribeck": ("coulomb", more)})
        whole = 1.0 / (1.0 + discrepancy**2)
        wide = min(kept, 1.0 / (1.0 + (discrepancy / more) ** 2))
        assert share_of(explanation, "stribeck") == pytest.approx(whole * wide)
        assert share_of(explanation, "coulomb") == pytest.approx(whole * (1.0 - wide))


def test_nothing_is_sure_where_the_fit_has_failed() -> None:
    """Where the unmodelled torque is as large as it may be, an effect may be the nearest to what is missing."""
    assert share_of(explanation_of({"drag": 5.0}, discrepancy=0.1), "drag") > 0.99
    assert share_of(explanation_of({"drag": 5.0}, discrepancy=0.1, at_its_limit=True), "drag") <= 0.5


def posterior_of(sets: dict[tuple[str, ...], float], evident: tuple[str, ...] | None = None) -> Posterior:
    """A posterior that believes in some sets; by the evidence alone one of them may be the only one."""
    quiet = SimpleNamespace(posterior=SimpleNamespace(something=0.0))
    fits: Any = tuple(SimpleNamespace(names=frozenset(each), discrepancy=quiet) for each in sets)
    return Posterior(
        sets=fits,
        probabilities=tuple(p if evident is None else float(each == evident) for each, p in sets.items()),
        reported=dict(sorted(((frozenset(each), p) for each, p in sets.items()), key=lambda item: -item[1])),
    )


def judgement_of(posterior: Posterior) -> tuple[str, ...]:
    found = judged(posterior, SimpleNamespace(excess=0.0), shows=False, ruled_out=None)  # type: ignore[arg-type]
    return (found.verdict, *found.causes)


@pytest.mark.parametrize(("cogging", "verdict"), [(0.05, "named"), (0.15, "ambiguous"), (0.45, "ambiguous")])
def test_a_minor_effect_in_doubt_leaves_the_verdict_open(cogging: float, verdict: str) -> None:
    sets = {("coulomb_friction",): 1.0 - cogging, ("coulomb_friction", "cogging"): cogging}
    posterior = posterior_of(sets, evident=("coulomb_friction", "cogging"))
    assert judgement_of(posterior) == (verdict, "coulomb_friction")


@pytest.mark.parametrize(("other", "verdict"), [(0.2, "named"), (0.45, "named"), (0.55, "ambiguous")])
def test_named_while_likelier_than_not_nothing_else_is_missing(other: float, verdict: str) -> None:
    """Of the others none may be likely by itself."""
    sets = {
        ("coulomb_friction",): 1.0 - other,
        ("coulomb_friction", "cogging"): 0.5 * other,
        ("coulomb_friction", "payload_change"): 0.5 * other,
    }
    assert judgement_of(posterior_of(sets)) == (verdict, "coulomb_friction")


def test_one_of_confounded_effects_is_reported_beside_a_cause() -> None:
    alike = {("coulomb_friction", name): 1.0 / 3.0 for name in ("input_delay", "actuator_lag", "sensor_lag")}
    assert judgement_of(posterior_of(alike)) == ("ambiguous", "coulomb_friction", "input_delay")


def test_a_wider_form_of_a_cause_is_nothing_else() -> None:
    sets = {
        ("coulomb_friction",): 0.4,
        ("coulomb_friction", "asymmetric_friction"): 0.3,
        ("coulomb_friction", "stribeck_friction"): 0.3,
    }
    assert judgement_of(posterior_of(sets)) == ("named", "coulomb_friction")


@pytest.mark.parametrize(("likelier", "causes"), [("stribeck_friction", ["coulomb_friction"]), ("cogging", [])])
def test_a_special_case_of_what_is_ruled_out_is_no_substitute(likelier: str, causes: list[str]) -> None:
    """Stribeck friction that no machine has still holds Coulomb friction; cogging that no machine has does not."""
    posterior = posterior_of({("coulomb_friction",): 0.99, (): 0.01})
    missing = SimpleNamespace(excess=0.0)
    found = judged(posterior, missing, shows=False, ruled_out=frozenset({likelier}))  # type: ignore[arg-type]
    assert list(found.causes) == causes


def test_a_lone_effect_keeps_its_probability() -> None:
    found = friction_alone()
    (cause,) = found.causes
    assert (found.verdict, cause.effect, found.minor) == ("named", "coulomb_friction", ())
    assert cause.probability > 0.99
    assert found.unknown.share < 1e-3
    assert cause.rms == pytest.approx(0.5, rel=0.2)
    assert cause.share > 0.7


def test_the_sets_are_a_distribution_that_agrees_with_the_causes() -> None:
    for found in (friction_alone(), friction_and_more()):
        reported = found.to_dict()
        assert reported["schema"] == 2
        probabilities = [each["probability"] for each in reported["sets"]]
        assert probabilities == sorted(probabilities, reverse=True)
        assert 0.9 < sum(probabilities) <= 1.0 + 1e-9
        for cause in found.causes:
            own = sum(each.probability for each in found.sets if cause.effect in each.effects)
            assert own == pytest.approx(cause.probability, abs=0.02)


def test_a_minor_effect_has_its_parameters() -> None:
    found = SimpleNamespace(fit=friction_alone().extended, without={"coulomb_friction": None})
    small = _minor(found, "coulomb_friction", 0.6)  # type: ignore[arg-type]
    assert small.parameters["torque"].value == pytest.approx(0.5, rel=0.05)


def test_minor_effects_are_reported_as_such() -> None:
    small = Minor(effect="cogging", probability=0.4, share=0.01, rms=0.002)
    reported = str(replace(friction_alone(), minor=(small,)))
    assert "Minor: cogging (0.002 N m rms), no larger than the unexplained torque" in reported
    sized = replace(small, parameters={"amplitude": Estimate(value=0.003, std=0.0004, unit="N m")})
    reported = replace(friction_alone(), minor=(sized,))
    assert "Minor: cogging (amplitude 0.0030 ± 0.0004 N m; 0.002 N m rms), no larger" in str(reported)
    assert reported.to_dict()["minor"][0]["parameters"] == {"amplitude": {"value": 0.003, "std": 0.0004, "unit": "N m"}}
    assert "Minor" not in str(friction_alone())


def test_an_error_of_the_measurement_does_not_see_its_own_noise() -> None:
    """In a closed loop the torque over a sample is made from the measurement at its beginning."""
    fitted = fit(record(Machine(), excitation(4, duration=3.0), seed=4).log())
    problem = Problem.of(fitted.log, fitted.model)
    values, initial = problem.unpack(problem.pack(fitted.model.values, fitted.initial))
    predictions = problem.predictor.predict(values, initial, bandwidth=20.0, width=0.0)
    scores = np.zeros((sum(map(len, fitted.log.runs)), 1))
    motion = motion_of(fitted, problem, list(predictions), 20.0, (scores, scores))
    last = np.append(motion.acceleration[:-1], 1e3)
    before, after = (Families.along(each).measurement for each in (motion, replace(motion, acceleration=last)))
    np.testing.assert_array_equal(before, after)
