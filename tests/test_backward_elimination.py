"""What earlier additions are still needed for beside the last one, and whether each still has the best name."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest
from machine import Machine, excitation, record

import diagnosis.backward_elimination as elimination
from diagnosis.backward_elimination import (
    _handed_over,
    _simplest_that_does,
    backward_elimination,
    can_be_added,
    with_likeliest_effects,
)
from diagnosis.hypothesis import Hypothesis
from diagnosis.model_probability import NONE
from diagnosis.refit import evidence_of, refit
from diagnosis.stepwise_round import Addition
from identification.fit import fit
from identification.fit_result import Fit
from plant import Effect, ServoModel, catalogue
from plant.effects import (
    ActuatorLag,
    AsymmetricFriction,
    Backlash,
    Compliance,
    CoulombFriction,
    InputDelay,
    PreslidingHysteresis,
    StribeckFriction,
    TorqueOffset,
)

RUBS, PUSHES, WAITS = CoulombFriction(torque=0.3), TorqueOffset(torque=0.15), InputDelay(time=0.02)


@cache
def base(*hidden: Effect) -> Fit:
    """Of a machine that hides effects from the model."""
    values = {
        effect.name: {spec.name: getattr(effect, spec.name) for spec in effect.parameters() if spec.fitted}
        for effect in hidden
    }
    log = record(Machine().hiding(**values), excitation(2, duration=10.0), seed=2).log()
    return fit(log, ServoModel.paper())


def contestant(effect: Effect) -> Hypothesis:
    return Hypothesis(effect=effect, coefficients=len(effect.values), charge=3.0)


def added(start: Fit, *effects: Effect, rival: Effect | None = None) -> list[Addition]:
    """One effect after the other; the first was chosen from a rival too."""
    additions: list[Addition] = []
    for effect in effects:
        at = additions[-1].fit if additions else start
        found = refit(at, effect)
        others = [rival] if rival is not None and not additions else []
        odds = {effect.name: 0.7, **{other.name: 0.2 for other in others}, NONE: 0.1}
        contest = tuple(contestant(each) for each in (effect, *others))
        evidence = evidence_of(found, at)
        additions.append(Addition(effect=effect.name, fit=found, odds=odds, evidence=evidence, contest=contest))
    return additions


def names(additions: list[Addition]) -> list[str]:
    return [addition.effect for addition in additions]


def held(additions: list[Addition]) -> set[str]:
    """What the last model has, beside the motors' dead zone."""
    return {effect.name for effect in additions[-1].fit.model.effects} - {"dead_zone"}


def test_what_no_longer_pays_is_taken_out() -> None:
    start = base(RUBS)
    left = backward_elimination(start, added(start, PUSHES, RUBS), catalogue, None)
    assert names(left) == ["coulomb_friction"]
    assert held(left) == {"coulomb_friction"}


def test_what_is_needed_stays() -> None:
    start = base(RUBS, PUSHES)
    additions = added(start, PUSHES, RUBS)
    left = backward_elimination(start, additions, catalogue, None)
    assert all(one is other for one, other in zip(left, additions, strict=True))


def test_a_special_case_replaces_an_equal_general_form() -> None:
    start = base(RUBS)
    additions = added(start, AsymmetricFriction(forward=0.3, backward=0.3), PUSHES, rival=RUBS)
    left = backward_elimination(start, additions, catalogue, None)
    assert names(left) == ["coulomb_friction", "torque_offset"]
    assert held(left) == {"coulomb_friction", "torque_offset"}
    assert left[0].odds == pytest.approx({"coulomb_friction": 0.9, NONE: 0.1})


def test_a_special_case_that_is_not_asked_for_takes_no_place() -> None:
    """An offset that the user had excluded was told at 1.000: as the special case of a cable's spring."""
    start = base(RUBS)
    additions = added(start, AsymmetricFriction(forward=0.3, backward=0.3), PUSHES)
    others = {name: kind for name, kind in catalogue.items() if name != "coulomb_friction"}
    assert names(backward_elimination(start, additions, others, None)) == ["asymmetric_friction", "torque_offset"]


@pytest.mark.parametrize(("velocity", "stays"), [(1e-5, False), (0.1, True)])
def test_a_shape_too_narrow_to_be_seen_goes_whatever_it_gains(
    monkeypatch: pytest.MonkeyPatch, velocity: float, stays: bool
) -> None:
    start = base(RUBS)
    hump = StribeckFriction(coulomb=0.3, excess=0.1, velocity=velocity)
    monkeypatch.setattr(elimination, "evidence_of", lambda *_: 1000.0)
    monkeypatch.setattr(elimination, "fitted_near", lambda near, model: replace(near, model=model))
    found = _simplest_that_does(replace(start, model=start.model.with_effect(hump)), hump, catalogue)
    assert (found is None) == stays
    assert stays or (found is not None and found[0] == CoulombFriction(torque=0.3))


def test_what_the_last_one_contains_is_gone() -> None:
    start = base(RUBS)
    wider = StribeckFriction(coulomb=0.3, excess=0.05, velocity=0.1)
    assert names(backward_elimination(start, added(start, RUBS, wider), catalogue, None)) == ["stribeck_friction"]


def test_odds_are_handed_over_also_to_what_had_none() -> None:
    (addition,) = added(base(RUBS), RUBS)
    assert _handed_over(addition, PUSHES) == pytest.approx({"torque_offset": 0.7, NONE: 0.1})


@pytest.mark.parametrize("stands", [True, False])
def test_an_early_effect_is_compared_again_beside_later_ones(monkeypatch: pytest.MonkeyPatch, stands: bool) -> None:
    """A better name must hold up unseen."""
    monkeypatch.setattr(elimination, "passes_validation", lambda *_: stands)
    additions = added(base(WAITS, PUSHES), ActuatorLag(time_constant=0.02), PUSHES, rival=WAITS)
    weighed = with_likeliest_effects(additions, None)
    first = "input_delay" if stands else "actuator_lag"
    assert names(weighed) == [first, "torque_offset"]
    assert held(weighed) == {first, "torque_offset"}
    if stands:
        assert weighed[0].odds["input_delay"] > 0.999
        without = refit(base(WAITS, PUSHES), PUSHES)
        assert weighed[0].evidence == pytest.approx(evidence_of(weighed[-1].fit, without), rel=1e-3)


@pytest.mark.long
def test_beside_the_others_a_gap_has_another_shape() -> None:
    """The shape that it had while an offset was missing is no better than a spring, and no descent leaves its peak."""
    spring = Compliance(frequency=50.0, damping=0.5, motor_share=0.5)
    start = base(Backlash(gap=0.005, motor_share=0.3), PUSHES)
    additions = added(start, Backlash(gap=0.003, motor_share=0.56), PUSHES, rival=spring)
    weighed = with_likeliest_effects(additions, None)
    assert names(weighed) == ["backlash", "torque_offset"]
    assert weighed[0].odds["backlash"] > 0.999
    assert weighed[-1].fit.log_likelihood > additions[-1].fit.log_likelihood + 50.0
    assert weighed[-1].fit["backlash.gap"].value == pytest.approx(0.005, rel=0.2)


def test_a_single_name_has_been_weighed() -> None:
    additions = added(base(WAITS, PUSHES), ActuatorLag(time_constant=0.02), rival=WAITS)
    assert with_likeliest_effects(additions, None) == additions


def test_a_special_case_is_weighed_from_where_its_leader_came_to(monkeypatch: pytest.MonkeyPatch) -> None:
    """Friction of two levels that are alike is Coulomb friction, though a fit of that had stopped on the way."""
    start = base(RUBS, PUSHES)
    additions = added(start, CoulombFriction(torque=0.3), PUSHES, rival=AsymmetricFriction(forward=0.3, backward=0.3))
    descend = elimination.fitted_near

    def stopping(fit: Fit, model: ServoModel) -> Fit:
        """From afar the fit of Coulomb friction stops where it does no good."""
        found = descend(fit, model)
        near = fit.model.effect("asymmetric_friction") is not None
        lost = model.effect("coulomb_friction") is not None and not near
        return replace(found, log_likelihood=found.log_likelihood - 500.0) if lost else found

    monkeypatch.setattr(elimination, "fitted_near", stopping)
    final = additions[-1].fit
    spoiled = [*additions[:-1], replace(additions[-1], fit=replace(final, log_likelihood=final.log_likelihood - 500.0))]
    named = with_likeliest_effects(spoiled, None)
    assert names(named) == ["coulomb_friction", "torque_offset"]
    assert named[-1].fit.log_likelihood > final.log_likelihood - 1.0


def test_nothing_is_reduced_to_what_another_effect_says_already(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside friction of two levels, presliding that does not pay goes: of friction of one level nothing is new."""
    tried: list[set[str]] = []

    def short(model: ServoModel, at: Fit) -> bool:
        tried.append({effect.name for effect in model.effects})
        return True

    two = AsymmetricFriction(forward=0.3, backward=0.2, viscous_difference=0.0)
    contacts = PreslidingHysteresis(torque=0.1, stiffness=50.0)
    start = base(RUBS)
    monkeypatch.setattr(elimination, "is_far_below", short)
    _simplest_that_does(replace(start, model=start.model.with_effect(two).with_effect(contacts)), contacts, catalogue)
    assert tried == [{"dead_zone", "asymmetric_friction"}]
    assert not can_be_added(start.model.with_effect(two), RUBS)
    assert can_be_added(start.model.with_effect(two), contacts)
