"""Which effects of a round are refitted: side by side the same as one after the other."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from machine import Machine, excitation, record

from diagnosis import diagnose, stepwise_search
from diagnosis import hypothesis as contestants
from diagnosis import stepwise_round as rounds
from diagnosis.hypothesis import Hypothesis, posterior_of
from diagnosis.model_probability import CLEAR, NONE, SEEN
from diagnosis.result import Candidate
from diagnosis.score_test import ScreenedEffect
from diagnosis.stepwise_round import _PROMISING, _REFITS, _WORTH, Addition, _neighbours, _worth_a_refit
from identification.fit import fit
from identification.fit_result import Fit
from plant import ServoModel
from plant.effects import Backlash, CableStiffness, CoulombFriction, EndStop, RateLimit, TorqueOffset


def one_by_one(suspects: list[ScreenedEffect], promised: dict[str, float], delivered: dict[str, float]) -> list[str]:
    """The rule as it is meant: each suspect is decided when everything before it has been refitted."""
    leader, refitted = max(suspect.evidence for suspect in suspects), []
    once = {suspect.name: promised[suspect.name] + float(np.log(suspect.searched)) for suspect in suspects}
    for suspect in sorted(suspects, key=lambda suspect: -once[suspect.name]):
        promise = once[suspect.name]
        best = max((delivered[name] for name in refitted), default=-np.inf)
        close = suspect.evidence >= _WORTH * leader and len(refitted) < _REFITS
        if promise > _PROMISING and (close or promise > best):
            refitted.append(suspect.name)
    return refitted


numbers = st.floats(-20.0, 100.0)


@given(st.lists(st.tuples(numbers, numbers, numbers, st.sampled_from([1, 10, 1000])), min_size=1, max_size=12))
@settings(max_examples=300, deadline=None)
def test_together_the_same_effects_are_refitted_as_one_by_one(
    drawn: list[tuple[float, float, float, int]],
) -> None:
    start = (CoulombFriction(torque=0.1),)
    suspects = [
        ScreenedEffect(name=f"e{k}", evidence=evidence, coefficients=1, searched=searched, starts=start)
        for k, (evidence, _, _, searched) in enumerate(drawn)
    ]
    promised = {f"e{k}": promise for k, (_, promise, _, _) in enumerate(drawn)}
    delivered = {f"e{k}": value for k, (_, _, value, _) in enumerate(drawn)}
    scores, refits, sizes = dict(promised), {}, []
    for some in _worth_a_refit(suspects, scores, refits, observed=False):  # type: ignore[arg-type]
        sizes.append(len(some))
        for suspect in some:
            refits[suspect.name], scores[suspect.name] = None, delivered[suspect.name]
    assert list(refits) == one_by_one(suspects, promised, delivered)
    assert all(sizes)


def test_the_leaders_come_together() -> None:
    start = (CoulombFriction(torque=0.1),)
    suspects = [
        ScreenedEffect(name=f"e{k}", evidence=50.0 - k, coefficients=1, searched=1, starts=start) for k in range(3)
    ]
    scores = {suspect.name: suspect.evidence for suspect in suspects}
    first = next(iter(_worth_a_refit(suspects, scores, {}, observed=False)))
    assert [suspect.name for suspect in first] == ["e0", "e1", "e2"]


@pytest.mark.parametrize(("second", "rounds"), [(0.3, ["base", "better", "fit"]), (1e-30, ["base", "fit"])])
def test_a_better_null_repeats_the_round_only_if_it_could_matter(
    monkeypatch: pytest.MonkeyPatch, second: float, rounds: list[str]
) -> None:
    """It rises by 10: more than a rival lags behind with odds of 0.3, less than one with odds of 1e-30 does."""
    fits: list[Any] = [SimpleNamespace(name=name) for name in ("base", "better", "fit")]
    base, better, fit = fits
    found = Addition(effect="a", fit=fit, odds={"a": 1.0 - second, "b": second}, evidence=100.0, contest=())
    asked: list[str] = []
    bars: list[float] = []

    def one_round(at: Any, *_: Any, bar: float) -> Addition | None:
        asked.append(at.name)
        bars.append(bar)
        return None if at is fit else found

    rises = {("better", "base"): 10.0, ("fit", "better"): 90.0}
    monkeypatch.setattr(stepwise_search, "stepwise_round", one_round)
    monkeypatch.setattr(stepwise_search, "_better_null", lambda at, _: better if at is base else None)
    monkeypatch.setattr(stepwise_search, "evidence_of", lambda after, before: rises[after.name, before.name])
    monkeypatch.setattr(stepwise_search, "backward_elimination", lambda _, additions, *__: additions)
    monkeypatch.setattr(stepwise_search, "passes_validation", lambda *_: True)
    monkeypatch.setattr(stepwise_search, "without_random_walk_artefacts", lambda _, additions, *__: additions)
    monkeypatch.setattr(stepwise_search, "without_sensor_filters", lambda _, additions, *__: additions)
    monkeypatch.setattr(stepwise_search, "consistent_additions", lambda _, additions, *__: additions)
    monkeypatch.setattr(stepwise_search, "with_likeliest_effects", lambda additions, _: additions)
    outcome = stepwise_search.reselected(stepwise_search.forward_selection(base))
    assert asked == rounds
    assert bars == [SEEN for _ in rounds[:-1]] + [CLEAR]  # a companion has to be surer than a first name
    assert outcome.base is better
    assert [addition.effect for addition in outcome.additions] == ["a"]
    assert outcome.additions[0].evidence == (90.0 if len(rounds) == 2 else 100.0)


@pytest.mark.parametrize(("mended_by", "found"), [("both", ["input_delay", "payload_change"]), ("three", [])])
@pytest.mark.parametrize("rival", ["sensor_lag", "torque_offset"])
def test_search_goes_one_effect_beyond_a_rejected_one(
    monkeypatch: pytest.MonkeyPatch, rival: str, mended_by: str, found: list[str]
) -> None:
    """A delay with which the model does not hold up unseen, be it in doubt or not; with the next name it does."""
    fits: list[Any] = [
        SimpleNamespace(name=name, model=ServoModel.paper()) for name in ("base", "late", "both", "three")
    ]
    in_doubt = {"input_delay": 0.55, rival: 0.44, NONE: 0.01}
    following = {
        "base": Addition(effect="input_delay", fit=fits[1], odds=in_doubt, evidence=50.0, contest=()),
        "late": Addition(effect="payload_change", fit=fits[2], odds={"payload_change": 1.0}, evidence=50.0, contest=()),
        "both": Addition(effect="cogging", fit=fits[3], odds={"cogging": 1.0}, evidence=50.0, contest=()),
        "three": None,
    }
    if mended_by == "both":
        following["both"] = None
    monkeypatch.setattr(stepwise_search, "stepwise_round", lambda at, *_, bar: following[at.name])
    monkeypatch.setattr(stepwise_search, "_better_null", lambda *_: None)
    monkeypatch.setattr(stepwise_search, "backward_elimination", lambda _, additions, *__: additions)
    monkeypatch.setattr(stepwise_search, "passes_validation", lambda before, after: after.name == mended_by)
    monkeypatch.setattr(stepwise_search, "without_random_walk_artefacts", lambda _, additions, *__: additions)
    monkeypatch.setattr(stepwise_search, "without_sensor_filters", lambda _, additions, *__: additions)
    monkeypatch.setattr(stepwise_search, "consistent_additions", lambda _, additions, *__: additions)
    monkeypatch.setattr(stepwise_search, "with_likeliest_effects", lambda additions, _: additions)
    outcome = stepwise_search.reselected(stepwise_search.forward_selection(fits[0]))
    assert [addition.effect for addition in outcome.additions] == found


@pytest.mark.parametrize(
    ("evidence", "stands", "refused"), [(101.0, False, ("a",)), (99.0, False, ()), (101.0, True, ())]
)
def test_an_effect_rejected_in_validation_is_reported_as_unknown(
    monkeypatch: pytest.MonkeyPatch, evidence: float, stands: bool, refused: tuple[str, ...]
) -> None:
    base, fit = (SimpleNamespace(name=name) for name in ("base", "fit"))
    found = Addition(effect="a", fit=fit, odds={"a": 1.0}, evidence=evidence, contest=())  # type: ignore[arg-type]
    monkeypatch.setattr(stepwise_search, "stepwise_round", lambda at, *_, bar: found if at is base else None)
    monkeypatch.setattr(stepwise_search, "_better_null", lambda *_: None)
    monkeypatch.setattr(stepwise_search, "backward_elimination", lambda _, additions, *__: additions)
    monkeypatch.setattr(stepwise_search, "passes_validation", lambda *_: stands)
    assert stepwise_search.forward_selection(base).refused == refused  # type: ignore[arg-type]


def test_what_was_refused_leaves_something_unknown(monkeypatch: pytest.MonkeyPatch) -> None:
    module = import_module("diagnosis.diagnose")
    log = record(Machine(), excitation(1, duration=10.0), seed=1, noise=1e-3).log()
    assert diagnose(log, candidates=["cogging"]).verdict == "nothing_missing"
    monkeypatch.setattr(
        module,
        "forward_selection",
        lambda *a, **k: replace(stepwise_search.forward_selection(*a, **k), refused=("cogging",)),
    )
    assert diagnose(log, candidates=["cogging"]).verdict == "unknown"


def test_an_effect_is_compared_under_its_own_noise_colour(monkeypatch: pytest.MonkeyPatch) -> None:
    """A rival that is a little likelier, but on evidence of another colour, had taken it from a name that is plain."""
    plain, slow = SimpleNamespace(log_likelihood=40.0, widens=1.0), SimpleNamespace(log_likelihood=41.0, widens=50.0)
    none: Any = SimpleNamespace(log_likelihood=0.0)
    monkeypatch.setattr(contestants, "widening", lambda at, than: at.widens)
    monkeypatch.setattr(contestants, "evidence_of", lambda at, than, over=None: at.log_likelihood / (over or at.widens))
    monkeypatch.setattr(contestants, "parameter_cost", lambda at, than: 0.0)
    monkeypatch.setattr(contestants, "is_plausible", lambda at, name: True)
    monkeypatch.setattr(contestants, "is_its_special_case", lambda at, name: False)
    contest = {
        name: Hypothesis(effect=CoulombFriction(torque=0.1), coefficients=1, charge=3.0) for name in ("plain", "slow")
    }
    fits: Any = {"plain": plain, "slow": slow}
    together, alone = posterior_of(contest, fits, none), posterior_of(contest, {"slow": fits["slow"]}, none)
    assert together[NONE] < 1e-10
    assert alone[NONE] > 0.9
    assert together["plain"] == pytest.approx(together["slow"], rel=0.05)


def test_confounded_effects_are_refitted_despite_a_low_score() -> None:
    """Behind an observer a soft cable is all but gone from the screen, and a stop that acts in one place is not."""
    starts = {
        "end_stop": EndStop(angle=3.0, stiffness=1.0),
        "cable_stiffness": CableStiffness(stiffness=0.1, cubic=0.0, rest_angle=0.0),
        "torque_offset": TorqueOffset(torque=0.1),
        "coulomb_friction": CoulombFriction(torque=0.1),
    }
    seen = {"end_stop": 60.0, "cable_stiffness": 11.0, "torque_offset": 0.4, "coulomb_friction": 9.0}
    suspects = [
        ScreenedEffect(name=name, evidence=evidence, coefficients=1, searched=1, starts=(starts[name],))
        for name, evidence in seen.items()
    ]
    refits: dict[str, Any] = {"end_stop": None}
    (asked,) = _neighbours(suspects, {"end_stop": 55.0}, refits)
    assert asked.name == "cable_stiffness"
    refits["cable_stiffness"] = None
    assert _neighbours(suspects, {"end_stop": 55.0, "cable_stiffness": 70.0}, refits) == []  # an offset is not there


@pytest.mark.parametrize(("rate", "close"), [(500.0, True), (250.0, False)])
def test_similar_shapes_are_searched_for_close_rivals_only(
    monkeypatch: pytest.MonkeyPatch, rate: float, close: bool
) -> None:
    """A gap has many of them and each costs a fit; of a gap far behind the leader none would win."""
    log = record(Machine().hiding(rate_limit={"rate": rate}), excitation(22, duration=10.0), seed=22).log()
    base, searched, tried = fit(log, ServoModel.paper()), list[str](), list[Candidate]()

    def noted(at: Fit, found: Fit, name: str) -> Fit:
        searched.append(name)
        return found

    monkeypatch.setattr(rounds, "multistart_refit", noted)
    found = rounds.stepwise_round(base, {kind.name: kind for kind in (RateLimit, Backlash)}, 1, tried, None)
    assert found is not None
    assert found.effect == "rate_limit"
    (gap,) = (candidate.evidence for candidate in tried if candidate.effect == "backlash")
    assert (found.evidence - gap < 100.0) == close
    assert sorted(searched) == (["backlash", "rate_limit"] if close else ["rate_limit"])
    assert {candidate.effect for candidate in tried if candidate.refitted} == {"rate_limit", "backlash"}
