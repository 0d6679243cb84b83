"""Why a name won: every sentence says what the diagnosis' numbers say, and the pictures show what was hidden."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import lru_cache
from importlib import import_module

import numpy as np
import pytest
from front_door import antidrive, columns, write_csv
from machine import Machine, excitation, record
from test_unknown_causes import Windage

from antidrive.html_page import printed
from diagnosis import Diagnosis, Experiment, diagnose
from diagnosis.experiment.signal_families import Signal
from diagnosis.explanation.cumulative_evidence import cumulative_evidence, residual_over_variable
from diagnosis.explanation.detectable import detectable
from diagnosis.explanation.hypothesis_comparison import AGAIN, NOTICED, HypothesisComparison, comparison_of
from diagnosis.explanation.wording import measured, percent, strength
from diagnosis.holdout import gain_errors
from diagnosis.model_probability import NONE, probabilities
from diagnosis.result import Candidate
from identification.log import Log
from plant import ServoModel

FRICTION = 0.1  # N m
FEW = ("coulomb_friction", "stribeck_friction", "cogging", "input_delay")


def log_of(seed: int = 0, **hidden: dict[str, float]) -> Log:
    return record(Machine().hiding(**hidden), excitation(1, duration=30.0), seed=seed).log()


@lru_cache
def friction() -> Diagnosis:
    return diagnose(log_of(coulomb_friction={"torque": FRICTION}), candidates=FEW)


@lru_cache
def several() -> Diagnosis:
    hidden = {"coulomb_friction": {"torque": 0.2}, "cogging": {"amplitude": 0.2, "order": 11.0, "phase": 0.7}}
    return diagnose(log_of(**hidden), candidates=FEW)


@lru_cache
def late() -> Diagnosis:
    return diagnose(log_of(input_delay={"time": 0.0007}), candidates=("input_delay", "sensor_lag"))


@lru_cache
def clean() -> Diagnosis:
    return diagnose(log_of(), candidates=("torque_offset", "quadratic_drag"))


@lru_cache
def nameless() -> Diagnosis:
    return diagnose(log_of(quadratic_drag={"drag": 0.03}), candidates=("coulomb_friction", "asymmetric_friction"))


def numbers(text: str) -> list[float]:
    """The rises of the log-likelihood and the log Bayes factors in a sentence, in order."""
    return [float(n) for n in re.findall(r"(?:by |log Bayes factor )(-?\d+(?:\.\d+)?)", text)]


def test_the_margin_is_that_of_the_round() -> None:
    asked = ("coulomb_friction", "presliding_hysteresis")
    found = diagnose(log_of(coulomb_friction={"torque": 0.003}), candidates=asked)
    (reason,) = found.explain().reasons
    tried = {c.effect: c for c in found.candidates if c.round == 1}
    first, second = (tried[name] for name in asked)
    contest = reason.contest
    assert contest is not None
    assert [c.effect for c in (contest.leader, *contest.rivals)] == [*asked, "none"]
    assert found.explain().short == (reason.sentences[0],)
    said = numbers(reason.sentences[0])
    assert said == pytest.approx([first.evidence, second.evidence, first.score - second.score], rel=0.01)
    assert "runner-up, presliding hysteresis" in reason.sentences[0]
    shares = np.exp([c.score for c in (contest.leader, *contest.rivals)] - np.array(contest.leader.score))
    told = [c.probability for c in (contest.leader, *contest.rivals)]
    assert shares / shares.sum() == pytest.approx(told, rel=1e-6)


def test_a_lone_effect_is_tested_against_none() -> None:
    found = friction()
    (cause,) = found.causes
    alone = replace(found, candidates=tuple(c for c in found.candidates if c.effect == "coulomb_friction"))
    said = alone.explain().short[0]
    assert "no other effect comes near" in said
    first = next(c for c in alone.candidates if c.round == 1)
    assert numbers(said) == pytest.approx([first.evidence, first.visible], rel=0.01)
    rival = replace(first, effect="stribeck_friction", evidence=first.evidence + 3.0, score=first.score - 4.0)
    said = replace(found, candidates=(first, rival)).explain().short[0]
    assert numbers(said) == pytest.approx([first.evidence, first.evidence + 3.0, 4.0], rel=0.01)
    assert said.endswith("for Coulomb friction against Stribeck friction is strong (log Bayes factor 4).")
    weighed = replace(cause, evidence=123.0, probability=0.8, alternatives=(("stribeck_friction", 0.2),))
    again = comparison_of(replace(found, causes=(weighed,)), weighed)
    assert again.round == AGAIN
    said = replace(found, causes=(weighed,)).explain().short[0]
    assert numbers(said) == pytest.approx([123.0, np.log(4.0)], rel=0.01)


def test_size_gain_and_rest_are_the_numbers_of_the_diagnosis() -> None:
    found = friction()
    told = str(found.explain())
    size = found.causes[0].parameters["torque"]
    assert f"torque {measured(size.value, size.std, 'N m')}" in told
    gain, error = found.gain, gain_errors(found)
    before = measured(gain.held_out_rms_before, error.before, "rad")
    after = measured(gain.held_out_rms_after, error.after, "rad")
    assert f"cut by {percent(gain.cut, error.cut)}, from {before} to {after} rms" in told
    floor = gain.noise_floor
    assert f"{measured(gain.held_out_rms_after / floor, error.after / floor)} times the noise floor" in told
    missing = found.residual_before
    assert f"the residual torque of the base model is {measured(missing.rms, missing.rms_std, 'N m')} rms" in told
    assert f"From their past {percent(found.whiteness)} of the variance" in told
    worse = replace(gain, held_out_rms_after=1.5 * gain.held_out_rms_before)
    assert "raised by 50" in str(replace(found, gain=worse).explain())


def test_the_evidence_adds_up_and_its_moments_are_told() -> None:
    found = friction()
    (reason,) = found.explain().reasons
    total = found.extended.log_likelihood - found.base.log_likelihood
    assert reason.cumulative_evidence is not None
    assert reason.cumulative_evidence.evidence[-1] == pytest.approx(total, rel=1e-3)
    assert reason.cumulative_evidence.densest[0] < 0.2
    assert "comes from the whole log" in str(found.explain())
    extended, base = found.extended, found.base
    moment = (reason.cumulative_evidence.time > 9.0) & (reason.cumulative_evidence.time < 10.0)
    lone = replace(base, innovations=np.where(moment, 4.0, 1.0) * extended.innovations, noise_std=extended.noise_std)
    share, when = cumulative_evidence(lone, extended).densest
    assert share > 0.5
    assert when == pytest.approx(9.5, abs=1.5)
    assert "Look there for a fault in the data" in str(replace(found, base=lone).explain())


def test_the_missing_torque_shows_the_jump_that_was_hidden() -> None:
    found = friction()
    seen = found.explain().reasons[0].residual_over_variable
    assert seen is not None
    assert (seen.variable, seen.unit, seen.torque_unit) == ("velocity", "rad/s", "N m")
    np.testing.assert_allclose(seen.predicted, seen.before - seen.after, atol=1e-12)
    slow = np.abs(seen.centre) < 0.7
    below, above = (float(seen.predicted[slow & side].mean()) for side in (seen.centre < 0, seen.centre > 0))
    assert 0.5 * FRICTION < below - above < 2.5 * FRICTION  # 2 F_c, less what viscous friction and filter take
    assert 0 < seen.standing_out < seen.centre.size


def test_a_model_that_leaves_more_torque_missing_shows_nothing() -> None:
    assert residual_over_variable(friction().base, friction().extended) is not None
    assert residual_over_variable(friction().extended, friction().base) is None


def test_what_lags_or_bends_shows_over_no_variable() -> None:
    (reason,) = late().explain().reasons
    assert reason.residual_over_variable is None
    assert "shows it over no single variable" in " ".join(reason.sentences)


def test_each_of_several_causes_is_weighed_beside_the_others() -> None:
    found = several()
    together = found.extended.log_likelihood - found.base.log_likelihood
    assert {cause.effect for cause in found.causes} == {"coulomb_friction", "cogging"}
    for cause, reason in zip(found.causes, found.explain().reasons, strict=True):
        assert reason.effect == cause.effect
        assert reason.contest is not None
        assert not {c.effect for c in reason.contest.rivals} & {other.effect for other in found.causes}
        assert reason.cumulative_evidence is not None
        assert 100.0 < reason.cumulative_evidence.evidence[-1] < together - 10.0
        costs = re.search(r"the extended model falls by ([\d.]+)\.", " ".join(reason.sentences))
        if reason.contest.round != AGAIN:
            assert costs is not None
            assert float(costs[1]) == pytest.approx(reason.cumulative_evidence.evidence[-1], rel=0.01)


def test_competing_hypotheses_come_with_signature_and_experiment() -> None:
    found = late()
    assert found.verdict == "ambiguous"
    experiment = Experiment(
        rivals=("input_delay", "sensor_lag"),
        time=np.arange(2.0),
        torque=np.zeros(2),
        start=0.0,
        signal=Signal(family="chirp", numbers={}, amplitude=1.0, bias=0.0),
        separation=7.0,
        absorbed=0.1,
        chirp_separation=1.0,
        chirp_absorbed=0.9,
        chirp_duration=24.0,
        predictions=(np.zeros(2), np.zeros(2)),
        axis="rotary",
    )
    explained = found.explain(experiment)
    text = str(explained)
    assert "This log does not tell " in text
    assert "the reading lags by a fixed time" in text
    assert "phase falls with frequency" in text
    assert "the two are known to be confounded" in text
    assert str(experiment) in text
    assert str(experiment) not in str(found.explain())
    assert "does not tell" not in str(friction().explain())


def test_hidden_sizes_are_those_at_the_detection_threshold() -> None:
    found = clean()
    sizes = detectable(found.base, [c for c in found.candidates if c.round == 1])
    assert set(sizes) == {"torque_offset", "quadratic_drag"}
    assert f"torque offset {sizes['torque_offset'].value:.2g} N m" in str(found.explain())
    for factor, verdicts in ((0.4, {"nothing_missing"}), (1.8, {"named", "ambiguous"})):
        hidden = {"quadratic_drag": {"drag": factor * sizes["quadratic_drag"].value}}
        again = diagnose(log_of(seed=1, **hidden), candidates=("torque_offset", "quadratic_drag"))
        assert again.verdict in verdicts


def test_nothing_is_said_to_hide_where_it_cannot_be_said() -> None:
    tried = [replace(c, effect="backlash") for c in clean().candidates[:1]]
    assert detectable(clean().base, tried) == {}


def test_names_that_are_not_believed_are_told_with_their_odds() -> None:
    found = nameless()
    assert found.verdict == "unknown"
    (reason,) = found.explain().reasons
    assert reason.effect is None
    contest = HypothesisComparison.of_round(found.candidates, 1)
    assert contest.something == pytest.approx(np.log(1 / contest_none(contest) - 1), rel=1e-6)
    if contest.something < NOTICED:
        assert (
            f"is missing is {strength(contest.something)}; a log Bayes factor of {NOTICED:.3g}" in reason.sentences[0]
        )
    assert "A curve over velocity raises the log-likelihood" in " ".join(reason.sentences)
    dearer = tuple(replace(c, score=c.score + 100.0) for c in found.candidates)
    assert "it is rejected" in replace(found, candidates=dearer).explain().short[0]


def contest_none(contest: HypothesisComparison) -> float:
    return next(c.probability for c in (contest.leader, *contest.rivals) if c.effect == NONE)


def candidate(effect: str, evidence: float, score: float, **more: object) -> Candidate:
    given = {"round": 1, "visible": score, "probability": 0.5, "refitted": True, "parameters": {}} | more
    return Candidate(effect=effect, evidence=evidence, score=score, **given)


def test_who_took_part_is_told() -> None:
    found = friction()
    (cause,) = found.causes
    tried = (
        candidate("stribeck_friction", cause.evidence, 90.0),
        candidate("asymmetric_friction", 111.0, -np.inf),
        candidate("cogging", 50.0, 40.0),
        candidate("input_delay", 7.25, 3.0, refitted=False),
    )
    text = str(replace(found, candidates=tried).explain())
    assert "It was found as Stribeck friction. Beside the effects found later only this special case" in text
    assert "Asymmetric friction fits no better" in text
    assert "In round 1 of the search 3 of 4 effects were fitted" in text
    assert "input delay promised most (+7.25)" in text


class Ducts(Windage):
    name = "duct_air"
    title = "air in the ducts"
    trace = "a roar"


def test_an_effect_of_ones_own_has_its_title_and_its_mark() -> None:
    found = friction()
    model = ServoModel.paper().with_effect(Ducts(drag=0.01))
    cause = replace(found.causes[0], effect="duct_air", parameters={})
    text = str(replace(found, causes=(cause,), extended=replace(found.extended, model=model)).explain())
    assert "Why air in the ducts. Air in the ducts raises" in text
    assert "Its signature: a roar." in text


@pytest.mark.parametrize(
    ("log_bayes", "said"),
    [
        (0.0, "weak (log Bayes factor 0)"),
        (2.25, "positive (log Bayes factor 2.25)"),
        (10.6, "decisive (log Bayes factor 10.6)"),
        (27818.4, "decisive (log Bayes factor 27818)"),
        (-3.5, "against it (log Bayes factor -3.5)"),
    ],
)
def test_evidence_in_words(log_bayes: float, said: str) -> None:
    assert strength(log_bayes) == said


def test_the_report_explains_the_margin_that_is_printed(monkeypatch, tmp_path) -> None:
    found = friction()
    monkeypatch.setattr(import_module("diagnosis.diagnose"), "diagnose", lambda *_, **__: found)
    log = write_csv(tmp_path / "log.csv", columns(duration=4.0))
    spoken = antidrive("diagnose", log, "--out", tmp_path / "out")
    assert spoken.code == 0, spoken.err
    explained = found.explain()
    lines = [line.strip() for line in spoken.out.splitlines()]
    assert lines.index(explained.short[0]) == 2  # behind headline and cause
    page = (tmp_path / "out" / "report.html").read_text()
    for sentence in (*explained.missing, *explained.reasons[0].sentences, *explained.outcome):
        assert printed(sentence) in page
    part = page.split("<h2>Missing effects")[1].split("<h2>Validation error")[0]
    bars, *pictures = part.split("application/json")
    assert "no effect more" in bars.split('class="bars"')[1]
    assert ["along the log" in pictures[0], "predicted by the extended model" in pictures[1]] == [True, True]
    assert len(pictures) == 2


def test_extreme_evidence_is_reported_without_overflow() -> None:
    found = friction()
    for score in (5000.0, -5000.0):
        sure = replace(found.candidates[0], effect="coulomb_friction", evidence=score, score=score, visible=score)
        contest = HypothesisComparison.of_round((sure,), sure.round)
        assert contest.leader.effect == ("coulomb_friction" if score > 0 else "none")
        odds = probabilities({"coulomb_friction": score}, {"coulomb_friction": score})
        assert odds["coulomb_friction"] == pytest.approx(1.0 if score > 0 else 0.0, abs=1e-12)
        assert sum(odds.values()) == pytest.approx(1.0)
