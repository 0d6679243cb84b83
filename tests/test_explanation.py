"""Why an effect is named: sentences say what the diagnosis' numbers say, pictures show what was hidden."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from front_door import antidrive, columns, write_csv
from machine import Machine, excitation, record
from test_unknown_causes import Windage

from antidrive.html_page import printed
from diagnosis import Diagnosis, EffectSet, Experiment, diagnose
from diagnosis.evidence.posterior import special_cases
from diagnosis.experiment.signal_families import Signal
from diagnosis.explanation.cumulative_evidence import cumulative_evidence, residual_over_variable
from diagnosis.explanation.detectable import detectable
from diagnosis.explanation.wording import measured, percent, strength
from diagnosis.holdout import gain_errors
from identification import fit
from identification.log import Log
from plant import ServoModel
from plant.effects import AsymmetricFriction, Cogging

CART = Path(__file__).parents[1] / "notebooks" / "data" / "axis.csv"
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
def unnamed() -> Diagnosis:
    return diagnose(log_of(quadratic_drag={"drag": 0.03}), candidates=("coulomb_friction",))


def holds(found: EffectSet, name: str) -> bool:
    """Whether a set has an effect, or one that contains it."""
    return any(name in special_cases(other) for other in found.effects)


def test_evidence_compares_the_best_sets_with_and_without() -> None:
    found = friction()
    (cause,) = found.causes
    (reason,) = found.explain().reasons
    with_it, without = (
        max(each.log_marginal for each in found.sets if holds(each, cause.effect) is there and each.fit)
        for there in (True, False)
    )
    assert cause.log_bayes == pytest.approx(with_it - without)
    assert strength(cause.log_bayes) in reason.sentences[0]
    assert f"{measured(cause.rms, None, 'N m')} rms, {percent(cause.share)} of the power" in reason.sentences[1]


def test_size_gain_and_rest_are_the_numbers_of_the_diagnosis() -> None:
    found = friction()
    reported = str(found.explain())
    size = found.causes[0].parameters["torque"]
    assert f"torque {measured(size.value, size.std, 'N m')}" in reported
    gain, error = found.gain, gain_errors(found)
    before = measured(gain.held_out_rms_before, error.before, "rad")
    after = measured(gain.held_out_rms_after, error.after, "rad")
    assert f"reduced by {percent(gain.cut, error.cut)}, from {before} to {after} rms" in reported
    floor = gain.noise_floor
    assert f"{measured(gain.held_out_rms_after / floor, error.after / floor)} times the noise floor" in reported
    missing = found.residual_before
    assert f"the residual torque of the base model is {measured(missing.rms, missing.rms_std, 'N m')} rms" in reported
    assert f"predict {percent(found.whiteness)} of the variance" in reported
    worse = replace(gain, held_out_rms_after=1.5 * gain.held_out_rms_before)
    assert "increased by 50" in str(replace(found, gain=worse).explain())


def test_the_evidence_adds_up_and_its_moments_are_reported() -> None:
    found = friction()
    (reason,) = found.explain().reasons
    without = found.without["coulomb_friction"]
    assert without is found.base
    assert reason.cumulative_evidence is not None
    assert reason.cumulative_evidence.evidence[-1] == pytest.approx(
        found.extended.log_likelihood - without.log_likelihood, rel=1e-3
    )
    assert reason.cumulative_evidence.densest[0] < 0.2
    assert "comes from the whole log" in str(found.explain())
    extended, base = found.extended, without
    moment = (reason.cumulative_evidence.time > 9.0) & (reason.cumulative_evidence.time < 10.0)
    lone = replace(base, innovations=np.where(moment, 4.0, 1.0) * extended.innovations, noise_std=extended.noise_std)
    share, when = cumulative_evidence(lone, extended).densest
    assert share > 0.5
    assert when == pytest.approx(9.5, abs=1.5)
    assert "Look there for a fault in the data" in str(replace(found, without={"coulomb_friction": lone}).explain())


def test_the_residual_torque_shows_the_jump_that_was_hidden() -> None:
    found = friction()
    seen = found.explain().reasons[0].residual_over_variable
    assert seen is not None
    assert (seen.variable, seen.unit, seen.torque_unit) == ("velocity", "rad/s", "N m")
    np.testing.assert_allclose(seen.predicted, seen.before - seen.after, atol=1e-12)
    slow = np.abs(seen.centre) < 0.7
    below, above = (float(seen.predicted[slow & side].mean()) for side in (seen.centre < 0, seen.centre > 0))
    assert 0.5 * FRICTION < below - above < 2.5 * FRICTION  # 2 F_c, less what viscous friction and filter take
    assert 0 < seen.standing_out < seen.centre.size


def test_a_fine_ripple_is_seen_within_one_period() -> None:
    """Over the whole travel of the cart an interval has 24 periods, and its mean is zero."""
    units = {"time": "ms", "position": "mm"}
    log = Log.read(CART, mapping={"time": "t", "force": "F", "position": "x"}, units=units)
    friction = AsymmetricFriction(forward=18.0, backward=24.0)
    base = ServoModel(axis="linear", inertia=95.0, gravity=0.0, viscous_friction=210.0, effects=(friction,))
    before, after = fit(log, base), fit(log, base.with_effect(Cogging(amplitude=3.0, order=2513.0, phase=0.4)))
    seen = residual_over_variable(before, after)
    assert seen is not None
    assert (seen.variable, seen.unit) == ("position modulo 0.0025 m", "m")
    assert 0.0 <= seen.centre.min() < seen.centre.max() <= 0.0025
    assert seen.share > 0.9
    assert seen.standing_out > 18
    wave = 3.0 * np.sin(2513.274 * seen.centre + 0.4)
    assert np.corrcoef(seen.before, wave)[0, 1] > 0.95
    np.testing.assert_allclose(seen.predicted, wave, atol=0.3)


def test_a_model_that_leaves_more_torque_missing_shows_nothing() -> None:
    assert residual_over_variable(friction().base, friction().extended) is not None
    assert residual_over_variable(friction().extended, friction().base) is None


def test_what_lags_or_bends_shows_over_no_variable() -> None:
    (reason,) = late().explain().reasons
    assert reason.residual_over_variable is None
    assert "does not show it over one variable" in " ".join(reason.sentences)


def test_each_of_several_causes_is_reported_beside_the_others() -> None:
    found = several()
    together = found.extended.log_likelihood - found.base.log_likelihood
    assert {cause.effect for cause in found.causes} == {"coulomb_friction", "cogging"}
    for cause, reason in zip(found.causes, found.explain().reasons, strict=True):
        assert reason.effect == cause.effect
        assert reason.cumulative_evidence is not None
        assert 100.0 < reason.cumulative_evidence.evidence[-1] < together - 10.0
    assert "Probability above 90 %: cogging and Coulomb friction." in found.explain().posterior


def test_competing_hypotheses_come_with_signature_and_experiment() -> None:
    found = late()
    assert found.verdict == "ambiguous"
    experiment = Experiment(
        competing=("input_delay", "sensor_lag"),
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
    assert "the measurement lags by a fixed time" in text
    assert "phase falls with frequency" in text
    assert "the two are known to be confounded" in text
    assert any(sentence.startswith("Alternatives: ") for sentence in explained.posterior)
    assert str(experiment) in text
    assert str(experiment) not in str(found.explain())
    assert "does not tell" not in str(friction().explain())


@pytest.mark.long
def test_hidden_sizes_are_those_at_the_detection_threshold() -> None:
    found = clean()
    sizes = detectable(found.base, [each.effect for each in found.rejected])
    assert set(sizes) == {"torque_offset", "quadratic_drag"}
    assert f"torque offset {sizes['torque_offset'].value:.2g} N m" in str(found.explain())
    for factor, verdicts in ((0.4, {"nothing_missing"}), (1.8, {"named", "ambiguous"})):
        hidden = {"quadratic_drag": {"drag": factor * sizes["quadratic_drag"].value}}
        again = diagnose(log_of(seed=1, **hidden), candidates=("torque_offset", "quadratic_drag"))
        assert again.verdict in verdicts


def test_nothing_is_reported_to_hide_where_it_cannot_be_known() -> None:
    assert detectable(clean().base, ["backlash"]) == {}


def test_unmodelled_torque_is_reported_with_size_and_variable() -> None:
    found = unnamed()
    assert found.verdict == "unknown"
    (reason,) = found.explain().reasons
    assert reason.effect is None
    assert f"about {percent(found.unknown.share)} of the torque in the log" in reason.sentences[0]
    assert "A curve over velocity raises the log-likelihood" in " ".join(reason.sentences)
    assert any("depends on velocity" in sentence for sentence in found.explain().posterior)


def test_every_rejected_effect_has_one_reason() -> None:
    found = friction()
    assert {each.effect for each in found.rejected} == {*FEW} - {"coulomb_friction"}
    for each in found.rejected:
        assert each.reason
        assert "\n" not in each.reason


class Ducts(Windage):
    name = "duct_air"
    title = "air in the ducts"
    signature = "a roar"


def test_an_effect_of_ones_own_has_its_title_and_its_signature() -> None:
    found = friction()
    model = ServoModel.paper().with_effect(Ducts(drag=0.01))
    cause = replace(found.causes[0], effect="duct_air", parameters={})
    extended = replace(found.extended, model=model)
    sets = (replace(found.sets[0], effects=("duct_air",)), *found.sets)
    text = str(
        replace(found, causes=(cause,), extended=extended, sets=sets, without={"duct_air": found.base}).explain()
    )
    assert "Why air in the ducts. The evidence for air in the ducts is" in text
    assert "Its signature: a roar." in text


@pytest.mark.parametrize(
    ("log_bayes", "words"),
    [
        (0.0, "weak (log Bayes factor 0)"),
        (2.25, "positive (log Bayes factor 2.25)"),
        (10.6, "decisive (log Bayes factor 10.6)"),
        (27818.4, "decisive (log Bayes factor 27818)"),
        (-3.5, "against it (log Bayes factor -3.5)"),
    ],
)
def test_evidence_in_words(log_bayes: float, words: str) -> None:
    assert strength(log_bayes) == words


def test_the_command_prints_what_the_report_explains(monkeypatch, tmp_path) -> None:
    found = friction()
    monkeypatch.setattr(import_module("diagnosis.diagnose"), "diagnose", lambda *_, **__: found)
    log = write_csv(tmp_path / "log.csv", columns(duration=4.0))
    result = antidrive("diagnose", log, "--out", tmp_path / "out")
    assert result.code == 0, result.err
    explained = found.explain()
    lines = [line.strip() for line in result.out.splitlines()]
    (cause,) = found.causes
    assert cause.probability > 0.9
    assert lines[1].startswith(
        f"Coulomb friction: probability {percent(cause.probability)}, evidence {strength(cause.log_bayes)}; torque 0."
    )
    page = (tmp_path / "out" / "report.html").read_text()
    for sentence in (*explained.missing, *explained.posterior, *explained.reasons[0].sentences, *explained.outcome):
        assert printed(sentence) in page
    part = page.split("<h2>Explanations</h2>")[1].split("<h2>Validation error")[0]
    bars, *pictures = part.split("application/json")
    assert 'class="bars"' in bars
    assert ["along the log" in pictures[0], "predicted by the extended model" in pictures[1]] == [True, True]
    assert len(pictures) == 2
