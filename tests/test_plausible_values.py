"""Values that a cause hardly ever has are paid for: a spring that is soft over half of the travel is seldom a stop."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from machine import Machine, excitation, record

from diagnosis import diagnose, effects_against_curves
from diagnosis.hypothesis import Hypothesis
from diagnosis.model_probability import visibility_cost
from diagnosis.refit import evidence_of, is_plausible, refit
from diagnosis.stepwise_search import Outcome
from identification.fit import base_model, fit
from plant.effects import CableStiffness, Effect, EncoderEccentricity, EndStop
from plant.effects.effect import TURN


@pytest.mark.parametrize(
    ("effect", "plausible"),
    [
        (EndStop(angle=3.0, stiffness=90.0), True),
        (EndStop(angle=-1.0, stiffness=-2.0), True),
        (EndStop(angle=3.0, stiffness=0.003), False),
        (EndStop(angle=3.0, stiffness=0.0), False),
        (CableStiffness(stiffness=0.01), True),
        (CableStiffness(stiffness=0.01, rest_angle=-12.0), True),
        (CableStiffness(stiffness=0.01, rest_angle=-30.0), False),
        (CableStiffness(stiffness=-0.01, cubic=0.02), False),
        (EncoderEccentricity(amplitude=0.001, order=0.97, phase=0.3), True),
        (EncoderEccentricity(amplitude=0.001, order=0.7, phase=0.3), False),
        (EncoderEccentricity(amplitude=0.001, order=1.5, phase=0.3), True),
    ],
    ids=lambda value: " ".join(map(str, (value.name, *value.values))) if isinstance(value, Effect) else "",
)
def test_what_a_cause_can_be(effect: Effect, plausible: bool) -> None:
    assert effect.plausible(low=-4.0, high=5.0, speed=2.0, inertia=2.0, turn=TURN) is plausible


def test_a_soft_spring_over_the_travel_is_no_end_stop() -> None:
    """The stop fits as well, and pays for two parameters where the cable pays for three."""
    cable = Machine().hiding(cable_stiffness={"stiffness": 5.54e-6, "cubic": 1.108e-7, "rest_angle": 0.4})
    log, unseen = (record(cable, excitation(24000 + k, duration=30.0), seed=12000 + k).log() for k in (0, 1))
    found = diagnose(log, holdout=unseen)
    stop = next(c for c in found.candidates if c.effect == "end_stop")
    own = next(c for c in found.candidates if c.effect == "cable_stiffness")
    assert own.evidence - 1.0 < stop.evidence < own.evidence + 3.0
    assert own.plausible
    assert not stop.plausible
    assert [cause.effect for cause in found.causes] == ["cable_stiffness"]
    assert "End stop: such a cause hardly ever has the fitted values, so its probability is lowered." in str(
        found.explain()
    )


def test_a_slow_wave_needs_two_periods_in_the_log() -> None:
    geared = EncoderEccentricity(amplitude=0.001, order=0.25, phase=0.3)
    assert not geared.plausible(low=0.0, high=40.0, speed=2.0, inertia=2.0, turn=TURN)
    assert geared.plausible(low=-20.0, high=40.0, speed=2.0, inertia=2.0, turn=TURN)


def test_on_a_linear_axis_nothing_comes_once_a_turn() -> None:
    """One metre is no measure of a screw or a scale: only what was seen twice is a wave."""
    pitch = EncoderEccentricity(amplitude=1e-5, order=5.0, phase=0.3)
    assert not pitch.plausible(low=0.0, high=1.0, speed=2.0, inertia=2.0, turn=0.0)
    assert pitch.plausible(low=0.0, high=3.0, speed=2.0, inertia=2.0, turn=0.0)


def test_strange_values_have_to_explain_much_more() -> None:
    log = record(Machine().hiding(torque_offset={"torque": 0.2}), excitation(2, duration=20.0)).log()
    base = fit(log, base_model(log))
    far = CableStiffness(stiffness=1e-4, rest_angle=2000.0)
    pulled = refit(base, far, fixed=("cable_stiffness.stiffness",))
    assert not is_plausible(pulled, "cable_stiffness")
    own = Hypothesis(effect=far, coefficients=3, charge=0.0)
    evidence = evidence_of(pulled, base)
    assert own.visible(pulled, base) == pytest.approx(evidence - visibility_cost(3) - np.log(1000.0))


def test_an_unknown_offset_is_not_reported_as_a_distant_cable() -> None:
    """It would fit, from 70 rad away; a curve without a name says as much."""
    offset = Machine().hiding(torque_offset={"torque": 0.15})
    log, unseen = (record(offset, excitation(24000 + k, duration=30.0), seed=12000 + k).log() for k in (0, 1))
    found = diagnose(log, holdout=unseen, exclude=["torque_offset"])
    cable = next(c for c in found.candidates if c.effect == "cable_stiffness")
    assert cable.probability > 0.99
    assert not cable.plausible
    assert found.verdict == "unknown"
    assert found.causes == ()
    assert found.gain.cut > 0.95


@dataclass(frozen=True)
class Told:
    """As much of an addition as is asked for here."""

    effect: str
    fit: Any


@pytest.mark.parametrize(
    ("bandwidth", "strange", "left"),
    [
        (5.0, {"b"}, ["c"]),
        (5.0, {"b", "c"}, []),
        (5.0, set(), ["a", "b", "c"]),
        (0.0, {"b"}, ["a", "b", "c"]),
    ],
)
def test_implausible_effects_and_their_dependants_are_dropped(
    monkeypatch: pytest.MonkeyPatch, bandwidth: float, strange: set[str], left: list[str]
) -> None:
    """An effect of the base keeps its place, whatever its values are."""

    def fit(*names: str) -> Any:
        model = SimpleNamespace(effects=names, without_effect=lambda gone: [n for n in names if n != gone])
        return SimpleNamespace(model=model, bandwidth=bandwidth)

    def still_needed(kept: list[Any], at: Any) -> tuple[list[Any], Any]:
        """The first of three pays only beside the second."""
        staying = [addition for addition in kept if addition.effect != "a"]
        return staying, fit("base", *(addition.effect for addition in staying))

    last = fit("base", "a", "b", "c")
    additions: Any = tuple(Told(effect=name, fit=last) for name in "abc")
    outcome = Outcome(base=fit("base"), additions=additions, candidates=())
    monkeypatch.setattr(effects_against_curves, "is_plausible", lambda at, name: name not in {"base", *strange})
    monkeypatch.setattr(effects_against_curves, "fitted_near", lambda at, names: fit(*names))
    monkeypatch.setattr(effects_against_curves, "still_needed", still_needed)
    monkeypatch.setattr(
        effects_against_curves, "refitted_path", lambda base, kept, at: [Told(effect=a.effect, fit=at) for a in kept]
    )
    monkeypatch.setattr(effects_against_curves, "_beside_curves", lambda outcome, curves: (outcome, "beside"))
    monkeypatch.setattr(
        effects_against_curves, "_several", lambda outcome, beside, curves: (outcome, beside, ["doubt"])
    )
    found, _, said = effects_against_curves.supported_effects(outcome)
    assert [addition.effect for addition in found.additions] == left
    assert found.fit.model.effects[0] == "base"
    assert found.strange == tuple(name for name in "abc" if name not in left and name in strange)
    assert said == ["doubt"]


def test_an_end_stop_at_the_edge_of_the_travel_is_identified() -> None:
    """After the hit a free simulation goes elsewhere; behind the observer that holds it a soft stop shows nothing."""
    command = excitation(32000, duration=30.0)
    (free,) = record(Machine(), command, seed=16000, noise=0.0).log().runs
    angle = free.output.max() - 0.00093 * np.ptp(free.output)
    stop = Machine().hiding(end_stop={"angle": angle, "stiffness": 30.0})
    (cause,) = diagnose(record(stop, command, seed=16000).log()).causes
    assert cause.effect == "end_stop"
    assert cause.parameters["angle"].value == pytest.approx(angle, abs=0.01)
