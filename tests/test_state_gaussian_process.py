"""Names beside a torque that may be any smooth function of the state: a change in time has to be one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from machine import Machine, excitation, record

import diagnosis.overdispersion as dispersion
from diagnosis import diagnose, state_gaussian_process
from diagnosis.hypothesis import Hypothesis
from diagnosis.overdispersion import Overdispersion, overdispersion
from diagnosis.refit import refit
from diagnosis.state_gaussian_process import beside_gaussian_process, gaussian_process_evidence
from diagnosis.stepwise_round import Addition, stepwise_round
from diagnosis.stepwise_search import Outcome, forward_selection, reselected
from identification.fit import fit
from identification.fit_result import Fit
from identification.log import Log
from plant import Effect, ServoModel
from plant.effects import (
    CableStiffness,
    Cogging,
    CoulombFriction,
    EncoderEccentricity,
    FrictionDrift,
    GravityOffset,
    PayloadChange,
    PreslidingHysteresis,
)
from plant.effects.effect import Array

CHANGES = {"payload_change": {"time": 9.3, "inertia": 0.15, "gravity": 0.1}}
PULLS = {"cable_stiffness": {"stiffness": 0.1, "cubic": 0.05, "rest_angle": 0.3}}
GIVES = {"presliding_hysteresis": {"torque": 0.5, "stiffness": 2.0}}
GIVING = PreslidingHysteresis(torque=0.3, stiffness=1.0)
CHANGING = PayloadChange(time=4.0, inertia=0.1, gravity=0.1)
KNOWN = ServoModel.paper().with_effect(CableStiffness(stiffness=0.1, cubic=0.05, rest_angle=0.3))
DRIFTING = FrictionDrift(viscous_rate=0.01, coulomb_rate=0.01)


def sweep(hidden: dict[str, dict[str, float]]) -> Log:
    """Four seconds of small motion, and then one sweep over and over."""
    time = np.arange(0.0, 30.0, 0.005)
    command = np.where(time < 4.0, np.sin(1.2 * np.pi * time), 5.0 * np.sin(0.5 * np.pi * (time - 4.0)))
    return record(replace(Machine(), gravity=1.5).hiding(**hidden), command, seed=3).log()


@cache
def asked(effect: str) -> Outcome:
    """What one round makes of a sweep with an effect if it knows of payload changes only."""
    base = fit(sweep(CHANGES if effect == "payload_change" else GIVES))
    found = stepwise_round(base, {"payload_change": PayloadChange}, 1, [], None)
    assert found is not None
    return Outcome(base=base, additions=(found,), candidates=())


def test_a_payload_that_changed_stays() -> None:
    outcome = asked("payload_change")
    (found,) = beside_gaussian_process(outcome.additions, outcome.base)
    assert found.effect == "payload_change"
    assert found.odds["payload_change"] > 0.99
    assert instant(found.fit) == pytest.approx(9.3, abs=0.05)


def instant(found: Fit) -> float:
    (change,) = (effect for effect in found.model.effects if isinstance(effect, PayloadChange))
    return change.time


def test_an_apparent_payload_at_the_start_of_a_sweep_is_dropped() -> None:
    """Contacts that give leave an error that the small motion has and the sweep has not."""
    outcome = asked("presliding_hysteresis")
    (found,) = outcome.additions
    assert found.odds["payload_change"] > 0.99
    assert instant(found.fit) == pytest.approx(4.0, abs=0.5)
    assert beside_gaussian_process(outcome.additions, outcome.base) == ()


def test_an_effect_that_explains_more_replaces_the_process() -> None:
    outcome = asked("presliding_hysteresis")
    (found,) = outcome.additions
    gives = Hypothesis(effect=GIVING, coefficients=2, charge=4.0)
    (better,) = beside_gaussian_process((replace(found, contest=(*found.contest, gives)),), outcome.base)
    assert better.effect == "presliding_hysteresis"
    assert better.odds["presliding_hysteresis"] > 0.99
    assert [effect.name for effect in better.fit.model.effects] == ["dead_zone", "presliding_hysteresis"]


def test_a_divergent_effect_is_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    outcome = asked("presliding_hysteresis")
    (found,) = outcome.additions
    near = state_gaussian_process.fitted_near

    def grown(fit: Fit, model: ServoModel) -> Fit:
        fitted = near(fit, model)
        lost = model.effect("presliding_hysteresis") is not None
        return replace(fitted, log_likelihood=-np.inf, initial=fitted.initial * np.nan) if lost else fitted

    monkeypatch.setattr(state_gaussian_process, "fitted_near", grown)
    gives = Hypothesis(effect=GIVING, coefficients=2, charge=4.0)
    assert beside_gaussian_process((replace(found, contest=(*found.contest, gives)),), outcome.base) == ()
    monkeypatch.setattr(
        state_gaussian_process, "fitted_near", lambda fit, model: replace(near(fit, model), log_likelihood=-np.inf)
    )
    (kept,) = beside_gaussian_process(outcome.additions, outcome.base)
    assert kept.effect == "payload_change"  # nothing holds without it


def test_a_name_that_stays_is_fitted_without_the_one_that_goes() -> None:
    log = sweep({**GIVES, **PULLS})
    outcome = reselected(
        forward_selection(fit(log), {"payload_change": PayloadChange, "cable_stiffness": CableStiffness})
    )
    assert {addition.effect for addition in outcome.additions} == {"payload_change", "cable_stiffness"}
    (left,) = beside_gaussian_process(outcome.additions, outcome.base)
    assert left.effect == "cable_stiffness"
    assert left.fit.model.effect("payload_change") is None
    again = refit(outcome.base, CableStiffness(stiffness=0.1))
    assert left.fit.log_likelihood == pytest.approx(again.log_likelihood, abs=0.5)


def test_every_step_of_the_way_is_fitted_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """The gain of each name is measured from step to step."""
    outcome = reselected(forward_selection(fit(sweep({**GIVES, **PULLS})), {"cable_stiffness": CableStiffness}))
    (first,) = outcome.additions
    second = replace(first, effect="payload_change", fit=refit(first.fit, CHANGING))
    third = replace(first, effect="presliding_hysteresis", fit=refit(second.fit, GIVING))
    names = [Hypothesis(effect=e, coefficients=2, charge=4.0) for e in third.fit.model.effects if e.name != "dead_zone"]
    additions = tuple(
        replace(addition, contest=tuple(name for name in names if name.effect.name == addition.effect))
        for addition in (first, second, third)
    )
    monkeypatch.setattr(
        state_gaussian_process,
        "gaussian_process_evidence",
        lambda fit: 99.0 if fit.model.effect("payload_change") else 999.0,
    )
    left = beside_gaussian_process(additions, outcome.base)
    steps = [{effect.name for effect in addition.fit.model.effects} - {"dead_zone"} for addition in left]
    assert steps == [{"cable_stiffness"}, {"cable_stiffness", "presliding_hysteresis"}]


@pytest.mark.parametrize(("first", "last"), [(GIVING, GIVING), (CHANGING, DRIFTING)], ids=["state", "time"])
def test_a_change_in_time_takes_the_place_of_another_only(
    monkeypatch: pytest.MonkeyPatch, first: Effect, last: Effect
) -> None:
    """However little the function takes of it."""
    base = asked("presliding_hysteresis").base
    monkeypatch.setattr(
        state_gaussian_process,
        "gaussian_process_evidence",
        lambda fit: 999.0 if fit.model.effect("friction_drift") else 99.0,
    )
    monkeypatch.setattr(state_gaussian_process, "passes_validation", lambda before, after: True)
    monkeypatch.setattr(state_gaussian_process, "is_far_below", lambda model, fit: False)
    names = tuple(Hypothesis(effect=effect, coefficients=2, charge=4.0) for effect in (first, DRIFTING))
    found = refit(base, first)
    addition = Addition(effect=first.name, fit=found, odds={first.name: 1.0}, evidence=9.0, contest=names)
    assert [left.effect for left in beside_gaussian_process((addition,), base)] == [last.name]


@pytest.mark.parametrize(("stiffness", "name"), [(0.1, "cable_stiffness"), (-0.1, "gravity_offset")])
def test_a_spring_that_pushes_away_is_no_cable(monkeypatch: pytest.MonkeyPatch, stiffness: float, name: str) -> None:
    for part, answer in (("gaussian_process_evidence", 99.0), ("passes_validation", True), ("is_far_below", False)):
        monkeypatch.setattr(state_gaussian_process, part, lambda *_, answer=answer: answer)
    base = fit(sweep({"cable_stiffness": {"stiffness": stiffness, "cubic": 0.0, "rest_angle": 0.3}}))
    beside, pulls = GravityOffset(beta=-0.1), CableStiffness(stiffness=stiffness)
    names = tuple(Hypothesis(effect=effect, coefficients=1, charge=4.0) for effect in (beside, pulls))
    found = refit(base, beside)
    addition = Addition(effect=beside.name, fit=found, odds={beside.name: 1.0}, evidence=9.0, contest=names)
    assert [left.effect for left in beside_gaussian_process((addition,), base)] == [name]


@pytest.mark.long
def test_a_diagnosis_says_which_name_it_has_dropped() -> None:
    hidden = {**GIVES, **PULLS}
    found = diagnose(sweep(hidden), None, sweep(hidden), candidates=["payload_change", "cable_stiffness"])
    assert [cause.effect for cause in found.causes] == ["cable_stiffness"]
    (dropped,) = (warning for warning in found.warnings if "is rejected: a smooth function" in warning)
    assert dropped.startswith("Payload change")
    # What gives before it slides may not be named: it stands beside the cable, and both leave nothing.
    assert found.model.effect("hysteresis") is not None
    assert found.gain.held_out_rms_after < 1.1 * found.gain.noise_floor


def test_a_complete_model_leaves_nothing_to_the_function() -> None:
    commands = excitation(4, duration=15.0)
    complete = record(Machine(), commands, seed=4).log()
    assert gaussian_process_evidence(fit(complete)) < 1.0
    assert gaussian_process_evidence(fit(sweep(PULLS))) > 20.0


def test_names_of_a_model_that_leaves_nothing_are_not_touched() -> None:
    log = record(Machine().hiding(coulomb_friction={"torque": 0.1}), excitation(4, duration=15.0), seed=4).log()
    outcome = reselected(forward_selection(fit(log), {"coulomb_friction": CoulombFriction}))
    assert [addition.effect for addition in outcome.additions] == ["coulomb_friction"]
    assert beside_gaussian_process(outcome.additions, outcome.base) is outcome.additions


@dataclass(frozen=True)
class Predicted:
    """What a prediction has of it: innovations (T,) and their slopes (T, 5), the last two by the initial state."""

    innovations: Array
    jacobian: Array


def spoken(monkeypatch: pytest.MonkeyPatch, slopes: Array, noise: Array) -> Overdispersion:
    """Unevenness about the first parameter of three, after a fit to noise."""
    basis = np.linalg.qr(slopes)[0]
    predicted = Predicted(noise - basis @ (basis.T @ noise), slopes)
    predictor = SimpleNamespace(predict=lambda *_, **__: [predicted])
    problem = SimpleNamespace(free=(0, 1, 2), predictor=predictor)
    monkeypatch.setattr(dispersion, "problem_near", lambda fit, model: problem)
    model = SimpleNamespace(names=("effect.size", "inertia", "gravity"), values=None)
    return overdispersion(SimpleNamespace(model=model, initial=None, bandwidth=0.0), "effect")  # type: ignore[arg-type]


def test_noise_makes_parts_disagree_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the fit has followed of it is allowed for: without that, parts would seem to agree far too well."""
    rng, time = np.random.default_rng(0), np.arange(1000.0)
    fading = np.exp(-time / 10.0)
    slow = np.column_stack((np.sin(np.outer(time, (0.004, 0.01, 0.017))), fading, time * fading))
    found = [spoken(monkeypatch, slow, rng.standard_normal(1000)) for _ in range(400)]
    assert 0.33 < np.mean([each.factor > 1.0 for each in found]) < 0.5
    assert 0.02 < np.mean([each.least > 1.0 for each in found]) < 0.09
    changing = np.sign(np.sin(0.02 * time)) * slow[:, 0]  # what a model may lack
    found = [spoken(monkeypatch, slow, rng.standard_normal(1000) + changing) for _ in range(20)]
    assert np.median([each.factor for each in found]) > 5.0
    assert np.median([each.least for each in found]) > 2.0


def test_an_effect_in_one_part_only_has_no_overdispersion(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    slopes = rng.standard_normal((1000, 5))
    slopes[:, 0] *= np.arange(1000) < 100
    for _ in range(20):
        assert spoken(monkeypatch, slopes, rng.standard_normal(1000)) == (1.0, 1.0)
    slopes[:, 0] = 0.0
    assert spoken(monkeypatch, slopes, rng.standard_normal(1000)) == (1.0, 1.0)


def test_a_complete_model_speaks_as_evenly_as_noise_lets_it() -> None:
    evenly = [
        overdispersion(
            fit(record(Machine().hiding(**PULLS), excitation(k, duration=15.0), seed=k).log(), KNOWN), name
        ).factor
        for k in range(3)
        for name in ("cable_stiffness", "dead_zone")
    ]
    assert np.median(evenly) < 1.3
    assert max(evenly) < 3.0


def test_what_a_model_lacks_makes_the_parts_of_a_log_disagree() -> None:
    """Contacts that give say one thing of the spring while the motion is small, and another in the sweep."""
    assert overdispersion(fit(sweep(PULLS), KNOWN), "cable_stiffness").factor < 2.0
    assert overdispersion(fit(sweep({**PULLS, **GIVES}), KNOWN), "cable_stiffness").factor > 5.0


def test_the_more_unevenly_a_log_speaks_the_less_evidence_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of what a name says beyond the charge for its search, which knows already how high such peaks are."""
    line, other = (
        Cogging(amplitude=0.1, order=9.0, phase=0.0),
        EncoderEccentricity(amplitude=1e-3, order=9.0, phase=0.0),
    )
    base = asked("presliding_hysteresis").base
    names = {
        effect.name: Hypothesis(effect=effect, coefficients=0, charge=charge)
        for effect, charge in ((line, 100.0), (other, 20.0))
    }
    fits = {name: replace(base, model=base.model.with_effect(own.effect)) for name, own in names.items()}
    evidence = {"cogging": 130.0, "encoder_eccentricity": 45.0}
    for over, least, most in ((1.0, 0.99, 1.0), (10.0, 0.5, 0.9)):
        monkeypatch.setattr(
            state_gaussian_process, "overdispersion", lambda fit, name, over=over: Overdispersion(over, 1.0)
        )
        odds = state_gaussian_process._odds(names, fits, evidence, base)
        assert next(iter(odds)) == "cogging"
        assert least < odds["cogging"] < most


def test_an_effect_beside_the_process_must_be_as_sure_as_it(monkeypatch: pytest.MonkeyPatch) -> None:
    outcome = asked("payload_change")
    monkeypatch.setattr(state_gaussian_process, "gaussian_process_evidence", lambda fit: 99.0)
    for none, left in ((0.0005, ["payload_change"]), (0.002, [])):
        answer = {"payload_change": 1.0 - none, "none": none}
        monkeypatch.setattr(state_gaussian_process, "_odds", lambda *_, answer=answer: answer)
        assert [kept.effect for kept in beside_gaussian_process(outcome.additions, outcome.base)] == left


@pytest.mark.parametrize(
    ("beside_change", "alone", "lost"),
    [(True, False, False), (False, True, False), (False, False, False), (False, True, True)],
)
def test_where_one_name_has_gone_the_others_are_asked_again(
    monkeypatch: pytest.MonkeyPatch, beside_change: bool, alone: bool, lost: bool
) -> None:
    """The weakest is asked first, beside a name that goes later: it may have held it up, or kept it down.

    One whose motion then grows without bound is not.
    """
    near = state_gaussian_process.fitted_near
    base, spring = asked("presliding_hysteresis").base, CableStiffness(stiffness=0.1)
    first = refit(base, spring)
    names = (Hypothesis(effect=spring, coefficients=1, charge=4.0),)
    weak = Addition(effect="cable_stiffness", fit=first, odds={"cable_stiffness": 1.0}, evidence=9.0, contest=names)
    strong = Addition(effect="payload_change", fit=refit(first, CHANGING), odds={}, evidence=99.0, contest=())

    def once_more(addition: Addition, fit: Fit) -> tuple[Addition | None, Fit]:
        changes = fit.model.effect("payload_change") is not None
        holds = addition.effect == "cable_stiffness" and (beside_change if changes else alone)
        return (addition, fit) if holds else (None, refit_without(fit, addition.effect))

    def refit_without(fit: Fit, name: str) -> Fit:
        return near(fit, fit.model.without_effect(name))

    def refit_with(fit: Fit, model: ServoModel) -> Fit:
        fitted = near(fit, model)
        return replace(fitted, log_likelihood=-np.inf) if lost else fitted

    monkeypatch.setattr(state_gaussian_process, "fitted_near", refit_with)
    monkeypatch.setattr(state_gaussian_process, "_once_more", once_more)
    monkeypatch.setattr(state_gaussian_process, "gaussian_process_evidence", lambda fit: 99.0)
    left = beside_gaussian_process((weak, strong), base)
    assert [addition.effect for addition in left] == (["cable_stiffness"] if alone and not lost else [])
    for addition in left:
        assert [effect.name for effect in addition.fit.model.effects] == ["dead_zone", "cable_stiffness"]
        assert addition.fit.log_likelihood == pytest.approx(first.log_likelihood, abs=0.5)
