"""What has no name competes with the names: a look-alike of a cause that the catalogue lacks is not sure."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from machine import Array, Machine, record

from diagnosis import diagnose
from diagnosis.diagnose_once import _sets
from diagnosis.evidence.posterior import Posterior, beside_discrepancy
from diagnosis.evidence.prior import forms
from diagnosis.evidence.sizes import Sizes
from diagnosis.explanation.posterior_sentences import set_title
from diagnosis.verdict import Judgement, alternatives, judged, variables
from identification.log import Log
from identification.objective import Objective
from mpc import Controller, analyse_loop
from plant import Rig, ServoModel, simulate
from plant.effects import ActuatorLag, CoulombFriction
from plant.effects.lagged_torque import LaggedTorque
from plant.effects.nonparametric_curve import CurveOverVelocity
from plant.inverse import time_lead, unmodelled_effects

LAGS = ("actuator_lag", "input_delay", "sensor_lag", "compliance", "backlash")
"""What a lag may be called."""


def switching(seed: int, *, duration: float, sample_time: float, size: float) -> Array:
    """(T,) a torque that only switches between two values, each held for 5 to 40 samples."""
    draw, signs = np.random.default_rng(seed), list[float]()
    while len(signs) < duration / sample_time:
        signs += [1.0 if len(signs) == 0 or signs[-1] < 0 else -1.0] * int(draw.integers(5, 40))
    return size * np.array(signs[: round(duration / sample_time)])


def log_of_a_lag() -> Log:
    """Of less than a sample: a limit of the rate with the right value does nearly the same to all jumps of a size."""
    torque = switching(1, duration=40.0, sample_time=0.02, size=8.0)
    machine = Machine().hiding(actuator_lag={"time_constant": 0.009})
    return record(machine, torque, sample_time=0.02, noise=2e-4, bits=None).log()


def test_a_lag_that_has_no_name_is_no_rate_limit() -> None:
    found = diagnose(log_of_a_lag(), exclude=LAGS)
    assert found.verdict == "unknown"
    assert found.unknown.depends_on == ("lagged torque",)
    assert found.unknown.probability > 0.9
    assert found.unknown.share > 0.01
    assert not [cause for cause in found.causes if cause.probability > 0.9]
    assert found.model.effect("lagged_torque") is not None
    likeliest = found.sets[0]
    assert likeliest.effects == ()
    assert likeliest.unknown == ("lagged torque",)
    assert set_title(likeliest, found) == "torque that lags"
    assert set_title(replace(likeliest, fit=None), found) == "something over lagged torque"


def test_a_lag_that_has_a_name_gets_it() -> None:
    """What has no name can do the same, and has one number more."""
    found = diagnose(log_of_a_lag(), candidates=("actuator_lag", "rate_limit", "coulomb_friction"))
    assert found.verdict == "named"
    assert [cause.effect for cause in found.causes] == ["actuator_lag"]


def test_all_of_a_torque_that_lags_is_a_lag() -> None:
    time = np.arange(200) * 0.005
    torque = np.where(time % 0.3 < 0.15, 4.0, -3.0)
    servo = ServoModel(inertia=2.0, gravity=0.5, viscous_friction=0.8)

    def angle(model: ServoModel) -> Array:
        return simulate(model, command=torque, dt=0.005)[:, :2]

    whole = angle(servo.with_effect(LaggedTorque(time_constant=0.03, part=1.0)))
    np.testing.assert_allclose(whole, angle(servo.with_effect(ActuatorLag(time_constant=0.03))), atol=1e-12)
    none = angle(servo.with_effect(LaggedTorque(time_constant=0.03, part=0.0)))
    np.testing.assert_allclose(none, angle(servo), atol=1e-12)
    assert np.max(np.abs(whole - none)) > 1e-3


def test_what_uses_the_model_knows_of_a_torque_that_lags() -> None:
    """Its defaults are as slow as with a lag, and set-points lie ahead by what lags."""
    servo, gears = ServoModel(inertia=2.0, gravity=0.5, viscous_friction=0.8), Rig.paper_like().gears
    late = servo.with_effect(LaggedTorque(time_constant=0.02, part=0.9))
    assert analyse_loop(Controller(late, gears, min_torque=0.02, max_torque=0.3)).peak_sensitivity < 2.05
    assert time_lead(late) == pytest.approx(0.018)
    assert any("act late" in sentence or "acts late" in sentence for sentence in unmodelled_effects(late))
    assert not any("Not compensated" in sentence for sentence in unmodelled_effects(late))


def posterior_of(**shares: float) -> Posterior:
    """Over sets, whose names are joined by `and`."""
    sets = {frozenset(filter(None, names.split("_and_"))): p for names, p in shares.items()}
    quiet = SimpleNamespace(something=0.0, at_its_limit=False)
    discrepancy = SimpleNamespace(posterior=quiet, explained_by=dict)
    log = SimpleNamespace(log=SimpleNamespace(axis="linear"))
    fits: Any = tuple(
        SimpleNamespace(names=names, discrepancy=discrepancy, fit=log, log_marginal=0.0) for names in sets
    )
    return Posterior(sets=fits, probabilities=tuple(sets.values()), reported=sets)


@pytest.mark.parametrize(
    ("without", "verdict"), [(0.95, "unknown"), (0.7, "ambiguous"), (0.05, "named")], ids=["sure", "likely", "unlikely"]
)
def test_what_replaces_an_effect_is_no_cause(without: float, verdict: str) -> None:
    shares = {"cogging_and_curve_over_angle": without, "cogging": 0.98 - without, "": 0.02}
    posterior, missing = posterior_of(**shares), SimpleNamespace(excess=0.0, curves=())
    found = judged(posterior, missing, shows=False, ruled_out=None)  # type: ignore[arg-type]
    assert found.verdict == verdict
    assert set(found.causes) == {"cogging"}
    assert set(posterior.names()) == {"cogging"}
    assert found.depends_on == (("position",) if without > 0.5 else ())
    assert alternatives(posterior, "cogging") == ()


def test_a_set_that_was_not_fitted_reports_its_replacement() -> None:
    """Else it would read as if nothing more were missing."""
    posterior = posterior_of(cogging_and_curve_over_angle=0.9, cogging=0.1)
    left = {frozenset({"curve_over_angle"}): 0.8, frozenset({"cogging"}): 0.2}
    judgement = Judgement(verdict="unknown", causes={}, minor={}, depends_on=("position",))
    first, second = _sets(replace(posterior, reported=left), judgement)
    assert (first.effects, first.unknown, first.fit) == ((), ("position",), None)
    assert (second.effects, second.unknown) == (("cogging",), ())


def test_a_name_has_to_exceed_what_has_none() -> None:
    """The curve is only as good as its knots; what is smaller beside it may be a part of what it leaves."""
    sizes = SimpleNamespace(
        beyond=lambda name, out: {"cogging": 3.0, "torque_offset": 0.1}[name],
        beyond_special={},
        unexplained=1.0,
        to_exceed=lambda name: 1.0,
        is_left=lambda *_: 1.0,
    )
    sound = SimpleNamespace(posterior=SimpleNamespace(at_its_limit=False))
    names = frozenset({"cogging", "torque_offset", "curve_over_angle"})
    explanation: Any = SimpleNamespace(names=names, sizes=sizes, discrepancy=sound)
    found = beside_discrepancy(explanation, 1.0)
    assert sum(found.values()) == pytest.approx(1.0)
    assert all("curve_over_angle" in each for each in found)
    assert found[frozenset({"cogging", "curve_over_angle"})] == pytest.approx(0.9, abs=0.02)


def test_what_took_a_names_place_counts_with_the_discrepancy() -> None:
    names, anything = frozenset({"cogging", "torque_offset", "curve_over_angle"}), SimpleNamespace()
    sizes: Any = Sizes(fit=anything, names=names, bandwidth=0.0, here=anything, discrepancy=3.0)  # type: ignore[arg-type]
    sizes.__dict__["effects"] = {"cogging": 900.0, "torque_offset": 2.0, "curve_over_angle": 4.0}
    assert sizes.unexplained == pytest.approx(5.0)
    assert sizes.to_exceed("cogging") == pytest.approx(5.0)
    assert sizes.to_exceed("torque_offset") == pytest.approx(9.0)  # a hundredth of the largest


def test_what_a_curve_could_be_is_fixed_beside_it_alone() -> None:
    """Where the curve is taken out again, the base model's own parameter moves as before."""
    log, servo = log_of_a_lag(), ServoModel(inertia=2.0, gravity=0.5, viscous_friction=0.8)
    with_it = Objective.of(log, servo.with_effect(CurveOverVelocity(low=-3.0, high=3.0)))
    without = Objective.of(log, servo, known=with_it.known)
    stated = Objective.of(log, servo, known=Objective.of(log, with_it.model, fixed=["inertia"]).known)

    def free(objective: Objective) -> set[str]:
        return {objective.model.names[place] for place in objective.free}

    assert "viscous_friction" not in free(with_it)
    assert "curve_over_velocity.low" not in free(with_it)
    assert free(without) == {"inertia", "gravity", "viscous_friction"}
    assert free(stated) == {"gravity", "viscous_friction"}


def test_what_the_most_informative_variable_needs_is_reported() -> None:
    """Angle tells nearly as much as velocity and is told; time adds to it; torque tells half, but adds nothing."""
    alone = {"velocity": 0.6, "angle": 0.5, "torque": 0.3, "time": 0.2}
    added = {"angle": 0.05, "torque": 0.02, "time": 0.15}

    def explained_by(beside: tuple[str, ...] = ()) -> dict[str, float]:
        return {v: 0.0 if "time" in beside else added[v] for v in added if v not in beside} if beside else alone

    log = SimpleNamespace(log=SimpleNamespace(axis="rotary"))
    best: Any = SimpleNamespace(names=frozenset(), discrepancy=SimpleNamespace(explained_by=explained_by), fit=log)
    found: Any = SimpleNamespace(best=best), SimpleNamespace(curves=())
    assert variables(*found, frozenset()) == ("velocity", "angle", "time")
    # what validation data ruled out as a prediction still says on what it depends
    assert variables(*found, frozenset({"ripple_over_time", "cogging"})) == ("time",)
    best.names = frozenset({"curve_over_angle"})
    assert variables(*found, frozenset({"ripple_over_time"})) == ("angle",)


def test_where_nothing_is_named_the_residual_itself_is_examined() -> None:
    """A wave in time is no smooth function of anything; nothing of the catalogue stands there that it could replace."""
    machine = Machine().hiding(periodic_disturbance={"amplitude": 0.4, "frequency": 1.4, "phase": 0.3})
    torque = switching(3, duration=30.0, sample_time=0.02, size=4.0)
    log = record(machine, torque, sample_time=0.02, noise=2e-4, bits=None).log()
    found = diagnose(log, candidates=("coulomb_friction", "torque_offset", "quadratic_drag"))
    assert found.verdict == "unknown"
    assert found.unknown.depends_on == ("time",)
    assert found.model.effect("ripple_over_time") is not None
    assert found.gain.held_out_rms_after < 0.5 * found.gain.held_out_rms_before


def test_what_has_no_name_is_charged_as_a_wider_form() -> None:
    assert forms(LaggedTorque) == 2
    assert forms(CoulombFriction) == 1
