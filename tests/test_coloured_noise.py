"""Coloured noise of the reading: the fit finds its colour, and what is missing is named through it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from machine import Machine, excitation, record
from scipy.signal import lfilter

from diagnosis import diagnose
from identification import coloured_noise
from identification.coloured_noise import with_coloured_noise
from identification.fit import base_model, fit, fit_with_prior
from identification.log import Log
from identification.noise import Whitening, autoregression, short_autoregression, whiten
from identification.prior_knowledge import PriorKnowledge
from identification.problem import Problem
from plant import ServoModel

FADES = 0.9  # from one sample to the next
STD = 1e-3


def coloured(machine: Machine, seed: int) -> Log:
    log = record(machine, excitation(seed, duration=20.0), seed=seed, noise=0.0).log()
    (run,) = log.runs
    shake = np.random.default_rng(seed).standard_normal(len(run))
    noise = STD * np.sqrt(1.0 - FADES**2) * lfilter([1.0], [1.0, -FADES], shake)
    return replace(log, runs=(replace(run, output=run.output + noise),))


def test_the_fit_finds_the_colour_and_the_parameters_behind_it():
    log = coloured(Machine(), 3)
    found = fit(log)
    assert sum(found.log.colour) == pytest.approx(FADES, abs=0.05)
    assert found.bandwidth == 0.0
    assert found.noise_floor == pytest.approx(STD, rel=0.2)
    truth = {"inertia": 2.0, "gravity": 0.5, "viscous_friction": 0.8, "dead_zone.half_width": 0.5}
    for name, value in truth.items():
        assert found[name].value == pytest.approx(value, abs=4.0 * found[name].std)
    # An observer that takes the noise for motion misses friction by a tenth and more.
    led_astray = Problem.of(log, base_model(log)).solve()
    assert abs(led_astray["viscous_friction"].value - 0.8) > 10.0 * abs(found["viscous_friction"].value - 0.8)


def test_what_is_fixed_stays_so_beside_the_colour():
    model = ServoModel.paper()
    found = fit(coloured(Machine(), 3), model, fixed=["inertia"])
    assert sum(found.log.colour) == pytest.approx(FADES, abs=0.05)
    assert found.fixed == ("inertia",)
    assert found.model.inertia == model.inertia


@pytest.mark.parametrize(("rises", "believed"), [((9.9,), None), ((10.1,), 0), ((10.1, 30.0, 20.0), 1), ((), None)])
def test_coloured_noise_needs_clearly_higher_likelihood(monkeypatch, rises, believed):
    white = SimpleNamespace(log_likelihood=1000.0)
    found = [SimpleNamespace(log_likelihood=1000.0 + rise, failed=None) for rise in rises]
    monkeypatch.setattr(coloured_noise, "_coloured", lambda _: iter(found))
    assert with_coloured_noise(white) is (white if believed is None else found[believed])


@pytest.mark.parametrize(
    "hidden",
    [
        {"coulomb_friction": {"torque": 0.2}},
        {"presliding_hysteresis": {"torque": 0.2, "stiffness": 6.0}},
        {"cable_stiffness": {"stiffness": 0.3, "cubic": 0.2, "rest_angle": 0.3}},
    ],
    ids=lambda hidden: next(iter(hidden)),
)
def test_errors_of_a_poor_model_are_no_coloured_noise(hidden):
    """A colour explains more of them than white noise, and a regression that knows of no machine far more than both."""
    light = Machine(inertia=0.02, gravity=0.0, viscous_friction=0.05).hiding(**hidden)
    log = record(light, 0.1 * excitation(3, duration=10.0), seed=3, noise=2e-5, bits=19).log()
    white = Problem.of(log, base_model(log)).solve()
    coloured = max(each.log_likelihood for each in coloured_noise._coloured(white))
    assert white.log_likelihood + 500.0 < coloured < coloured_noise.by_regression(log)
    assert not fit_with_prior(log, base_model(log), PriorKnowledge(), of_the_sensor=True).log.colour
    assert fit(log).log.colour


def test_the_regression_is_of_what_was_measured_in_any_unit():
    log = record(Machine(), excitation(3, duration=5.0), seed=3).log()
    (run,) = log.runs
    likelihood = coloured_noise.by_regression(log)
    speeds = replace(run, response="velocity", velocity=run.output, output=np.cumsum(run.output))
    assert coloured_noise.by_regression(replace(log, runs=(speeds,))) == pytest.approx(likelihood, abs=1e-3)
    other = replace(log, runs=(replace(run, command=1e-13 * run.command),))
    assert coloured_noise.by_regression(other) == pytest.approx(likelihood, abs=1e-3)


def test_a_colour_that_leaves_nothing_of_the_model_is_none(monkeypatch) -> None:
    """It would stand for the motion: of a model without what matters most it explains more than any noise."""
    white = SimpleNamespace(log_likelihood=1000.0)
    lost = SimpleNamespace(log_likelihood=5000.0, failed="its parameters do not change how well")
    without_colour = SimpleNamespace(log_likelihood=1200.0, failed=None)
    for found, believed in (([lost], white), ([lost, without_colour], without_colour)):
        monkeypatch.setattr(coloured_noise, "_coloured", lambda _, found=found: iter(found))
        assert with_coloured_noise(white) is believed


@pytest.mark.parametrize(
    ("gain", "memory", "count"),
    [
        (0.051, 0.0051, 4),  # behind observers of 10, 3.3, 1.1 and 0.37 rad/s
        (0.049, 0.0051, 0),  # what a poor model can leave as well
        (0.051, 0.0049, 0),  # no longer than a sample
        (0.051, 0.101, 3),  # outlasts the corrections of the fastest
        (0.051, 0.301, 2),
    ],
)
def test_noise_colour_is_tried_beyond_the_observer_bandwidth(monkeypatch, gain, memory, count):
    fitted = SimpleNamespace(
        log=SimpleNamespace(sample_time=0.005),
        model=None,
        known=PriorKnowledge(),
        bandwidth=30.0,
        samples=1000,
        log_likelihood=0.0,
    )
    shown = SimpleNamespace(log_likelihood=gain * fitted.samples, noise_memory=memory)
    problem = SimpleNamespace(
        solve=lambda **_: fitted, recoloured=lambda _, least: shown if shown.log_likelihood > least else None
    )
    monkeypatch.setattr(coloured_noise, "Problem", SimpleNamespace(of=lambda *_, **__: problem))
    monkeypatch.setattr(coloured_noise, "replace", lambda fit, **__: fit)
    assert len(list(coloured_noise._coloured(fitted))) == count


def test_white_noise_stays_white():
    assert fit(record(Machine(), excitation(3, duration=20.0), seed=3, noise=STD).log()).log.colour == ()


@pytest.mark.parametrize("seed", [3, 4])
def test_coloured_noise_has_no_cause(seed):
    found = diagnose(coloured(Machine(), seed))
    assert found.verdict == "nothing_missing"
    assert any("coloured, with a memory of about 0.05" in warning for warning in found.warnings)


def test_an_effect_is_identified_under_coloured_noise():
    found = diagnose(coloured(Machine().hiding(coulomb_friction={"torque": 0.18}), 4))
    assert [cause.effect for cause in found.causes] == ["coulomb_friction"]
    assert found.causes[0].parameters["torque"].value == pytest.approx(0.18, rel=0.03)
    assert sum(found.extended.log.colour) == pytest.approx(FADES, abs=0.05)


@pytest.mark.long
@pytest.mark.parametrize(
    ("effect", "values"),
    [
        ("cogging", {"amplitude": 0.3, "order": 7.0, "phase": 0.4}),
        ("torque_saturation", {"limit": 5.1}),
    ],
)
def test_a_large_effect_is_identified_under_coloured_noise(effect, values):
    log = coloured(Machine().hiding(**{effect: values}), 3)
    base = fit(log)
    assert base.bandwidth > 0.0  # a slow observer keeps the poor model near the log, and the noise shows behind it
    assert sum(base.log.colour) == pytest.approx(FADES, abs=0.1)
    found = diagnose(log)
    assert [cause.effect for cause in found.causes] == [effect]
    for name, value in values.items():
        assert found.causes[0].parameters[name].value == pytest.approx(value, rel=0.05)
    assert sum(found.extended.log.colour) == pytest.approx(FADES, abs=0.05)
    assert found.extended.bandwidth == 0.0


def test_whitening_goes_on_from_piece_to_piece():
    rng = np.random.default_rng(0)
    values = rng.standard_normal((50, 3))
    white = Whitening((0.7, -0.2))
    pieces = np.vstack([white(values[:20]), white(values[20:])])
    assert pieces == pytest.approx(whiten(values, np.array([0.7, -0.2])))


def test_a_short_autoregression_finds_what_made_the_noise():
    rng = np.random.default_rng(1)
    noise = lfilter([1.0], [1.0, -1.2, 0.4], rng.standard_normal(20000))
    assert short_autoregression(noise) == pytest.approx((1.2, -0.4), abs=0.03)


def test_overflow_and_rest_have_no_noise_colour() -> None:
    """From a real log there was an array with infs in it."""
    noise = lfilter([1.0], [1.0, -FADES], np.random.default_rng(1).standard_normal(4000))
    assert short_autoregression(1e200 * noise) == pytest.approx(short_autoregression(noise))
    for nothing in (np.zeros(100), np.append(noise, np.inf), np.append(noise, np.nan)):
        assert short_autoregression(nothing) == (0.0, 0.0)
        assert autoregression(nothing).size == 0
