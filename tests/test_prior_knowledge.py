"""What a person knows of a model before the log is seen: values, bounds and priors, in fits and diagnoses."""

from __future__ import annotations

import json
from importlib import import_module

import numpy as np
import pytest
from front_door import PLAIN, TRUTH, columns

from diagnosis import diagnose, diagnose_all
from diagnosis.refit import problem_near
from identification import Fit, Log, fit, fit_report, fit_to_dict
from identification.fit import fit_with_prior, known_of
from identification.prior_knowledge import PriorKnowledge
from identification.problem import Problem
from plant import BadParameter, ServoModel
from plant.effects import CoulombFriction

LOG = Log.from_arrays(**columns(PLAIN, duration=8.0))
GRAVITY = PLAIN.names.index("gravity")


def fitted_near(fit: Fit, model: ServoModel) -> Fit:
    return problem_near(fit, model).descend(fit)


@pytest.fixture(scope="module")
def free() -> Fit:
    return fit(LOG, PLAIN)


def test_a_prior_moves_estimate_and_error_by_bayes_rule(free: Fit) -> None:
    others = [name for name in PLAIN.names if name != "inertia"]
    alone = fit(LOG, free.model, fixed=others)["inertia"]
    mean, std = alone.value + 2.0 * alone.std, alone.std
    found = fit(LOG, free.model, fixed=others, prior={"inertia": (mean, std)})
    weights = np.array([alone.std**-2, std**-2])
    expected = weights @ (alone.value, mean) / weights.sum()
    # the standard error allows for the colour of the innovations, the estimate does not
    assert found["inertia"].value == pytest.approx(expected, abs=0.15 * alone.std)
    assert found["inertia"].std == pytest.approx(weights.sum() ** -0.5, rel=0.1)


def test_a_prior_changes_the_likelihood_and_not_the_noise(free: Fit) -> None:
    value, std = free["gravity"].value, 1e-7
    mean = value + 10.0 * std  # so sharp that the estimate goes there, and so near that the log does not mind
    found = fit(LOG, free.model, prior={"gravity": (mean, std)})
    assert found["gravity"].value == pytest.approx(mean, abs=std)
    assert found["gravity"].std == pytest.approx(std, rel=1e-3)
    assert found.log_likelihood == pytest.approx(free.log_likelihood, abs=0.5)
    assert found.noise_std == pytest.approx(free.noise_std, rel=1e-3)
    problem = Problem.of(LOG, found.model, known=found.known)
    point = problem.pack(found.model.values, found.initial)
    off = point.copy()
    off[problem.free.index(GRAVITY)] = mean + 3.0 * std
    costs = [problem.cost(p, found.bandwidth, 0.0) for p in (point, off)]
    assert 0.5 * found.samples * np.log(costs[1] / costs[0]) == pytest.approx(4.5, abs=0.2)


def test_the_slope_of_the_cost_is_right_with_a_prior(free: Fit) -> None:
    known = fit(LOG, free.model, prior={"gravity": (0.7, 0.01)}).known
    problem = Problem.of(LOG, free.model, known=known)
    point = problem.pack(free.model.values, free.initial)
    place, step = problem.free.index(GRAVITY), 1e-5
    costs = [problem.cost(point + sign * step * np.eye(point.size)[place], 5.0, 0.0) for sign in (-1, 1)]
    slope = 0.5 * (costs[1] - costs[0]) / (2 * step)
    assert problem.linearise(point, 5.0, 0.0).gradient[place] == pytest.approx(slope, rel=1e-4)


@pytest.mark.parametrize("mean", [0.01, 50.0])
def test_a_prior_that_the_log_contradicts_does_not_break_the_fit(mean: float, free: Fit) -> None:
    found = fit(LOG, PLAIN, prior={"inertia": (mean, 1e-3 * mean)})
    assert np.isfinite(found.log_likelihood)
    assert found.log_likelihood < free.log_likelihood - 100.0


def test_bounds_hold_and_are_reported(free: Fit) -> None:
    found = fit(LOG, bounds={"inertia": (0.1, 0.3), "viscous_friction": (0.1, 3.0)})
    assert found["inertia"].value == 0.3
    assert found["inertia"].at_bound
    assert "bounds of inertia: 0.1 .. 0.3 kg m^2" in fit_report(found)
    reported = json.loads(json.dumps(fit_to_dict(found)))["parameters"]
    assert reported["inertia"]["bounds"] == [0.1, 0.3]
    assert "bounds" not in reported["gravity"]
    wide = fit(LOG, PLAIN, bounds={"inertia": (0.1, 3.0)})
    assert wide["inertia"].value == pytest.approx(free["inertia"].value, rel=1e-6)


def test_a_fixed_value_is_kept_and_reported() -> None:
    found = fit(LOG, fixed={"inertia": 0.9})
    assert (found["inertia"].value, found["inertia"].fixed) == (0.9, True)
    assert found.model.inertia == 0.9
    assert fit(LOG, fixed=["gravity"])["gravity"].value == 0.0
    assert "prior of inertia: 0.8 ± 0.01 kg m^2" in fit_report(fit(LOG, PLAIN, prior={"inertia": (0.8, 0.01)}))


def test_what_is_known_holds_when_an_effect_comes_to_the_model() -> None:
    log, given = Log.from_arrays(**columns(TRUTH, duration=6.0)), {"fixed": {"gravity": 0.6}}
    given["bounds"] = {"inertia": (0.7, 0.79), "coulomb_friction.torque": (0.05, 0.39)}
    given["prior"] = {"viscous_friction": (0.5, 1e-6)}
    known = known_of(**given, start=PLAIN, effects=[CoulombFriction], stated=True)
    base = fit_with_prior(log, PLAIN, known)
    richer = fitted_near(base, base.model.with_effect(CoulombFriction(torque=0.8)))
    for each in (base, richer, fitted_near(richer, PLAIN)):
        assert each.model.gravity == 0.6
        assert 0.7 <= each.model.inertia <= 0.79
        assert each.model.viscous_friction == pytest.approx(0.5, abs=1e-4)
    assert 0.05 <= richer["coulomb_friction.torque"].value <= 0.39
    held = known_of({"coulomb_friction.torque": 0.35}, None, None, PLAIN, [CoulombFriction], stated=True)
    held_fit = fit_with_prior(log, PLAIN, held)
    richer = fitted_near(held_fit, held_fit.model.with_effect(CoulombFriction(torque=0.8)))
    assert richer["coulomb_friction.torque"].value == 0.35


def test_a_diagnosis_hands_on_what_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    heard = []

    def listen(log, start, known, *_, **__):
        heard.append(known)
        raise BadParameter("heard.")

    monkeypatch.setattr(import_module("diagnosis.diagnose_once"), "fit_with_prior", listen)
    given = {"fixed": {"cogging.order": 12}, "bounds": {"inertia": (1, 2)}, "prior": {"gravity": (1, 2)}}
    for task in (lambda: diagnose(LOG, **given), lambda: next(diagnose_all([LOG], **given))):
        with pytest.raises(BadParameter, match="heard"):
            task()
    assert heard == [PriorKnowledge(**given)] * 2


BAD = {
    "unknown": ({"bounds": {"mass": (0, 1)}}, r"bounds: 'mass' is not a parameter; there are inertia, gravity"),
    "unknown fixed": ({"fixed": ["mass"]}, r"fixed: 'mass' is not a parameter"),
    "no value": ({"fixed": ["inertia"]}, r"inertia has no value to keep; give one, as in inertia=0.2"),
    "crossed": ({"bounds": {"inertia": (0.3, 0.1)}}, r"bounds: inertia = 0.3 .. 0.1: the first must be below"),
    "negative": ({"bounds": {"inertia": (-1.0, 1.0)}}, r"bounds: inertia = -1 is outside 1e-\d+ .. inf"),
    "negative prior": ({"prior": {"inertia": (-1.0, 1.0)}}, r"prior: inertia = -1 is outside"),
    "negative value": ({"fixed": {"inertia": -1.0}}, r"fixed: inertia = -1 is outside"),
    "one number": ({"bounds": {"inertia": 0.3}}, r"two finite numbers \(least, greatest\), not 0.3"),
    "three numbers": ({"prior": {"inertia": (1, 2, 3)}}, r"two finite numbers"),
    "words": ({"prior": {"inertia": "ab"}}, r"two finite numbers"),
    "sharp": ({"prior": {"inertia": (1, 0)}}, r"must be above zero, not 0; fix it instead"),
    "endless": ({"bounds": {"inertia": (0.1, np.inf)}}, r"two finite numbers"),
    "twice": ({"fixed": {"inertia": 1}, "prior": {"inertia": (1, 2)}}, r"prior: inertia is fixed"),
}


@pytest.mark.parametrize("case", BAD)
@pytest.mark.parametrize("task", [fit, diagnose])
def test_what_cannot_be_is_reported_in_one_sentence(task, case) -> None:
    words, expected = BAD[case]
    with pytest.raises(BadParameter, match=expected) as caught:
        task(LOG, **words)
    assert "\n" not in str(caught.value)
    assert str(caught.value).endswith(".")


def test_an_effect_that_is_left_out_has_no_parameters_to_know() -> None:
    with pytest.raises(BadParameter, match=r"cogging\.order"):
        diagnose(LOG, exclude=["cogging"], bounds={"cogging.order": (10, 20)})
    with pytest.raises(BadParameter, match="no value to keep"):
        diagnose(LOG, ServoModel.paper(), fixed=["cogging.order"])
