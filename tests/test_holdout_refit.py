"""Parameters that differ in validation data are reported, and no effect is sure then; the model stays as it is."""

from dataclasses import replace

import numpy as np
import pytest
from machine import Machine, excitation, record
from scipy.signal import lfilter

from diagnosis import diagnose
from diagnosis.explanation.wording import measured
from diagnosis.holdout_refit import _compared, contradiction, holdout_differences
from identification.fit import fit
from identification.fit_result import FittedParameter
from identification.log import Log
from plant import ServoModel
from plant.effects import Cogging, CoulombFriction, PayloadChange, PreslidingHysteresis


def log_of(machine: Machine, seed: int, duration: float = 20.0) -> Log:
    return record(machine, excitation(seed, duration=duration), seed=seed, noise=1e-3).log()


def rubbing(torque: float) -> Machine:
    return Machine().hiding(coulomb_friction={"torque": torque})


@pytest.fixture(scope="module")
def fitted():
    return fit(log_of(rubbing(0.3), 1), ServoModel.paper().with_effect(CoulombFriction(torque=0.2)))


@pytest.mark.parametrize("seed", [2, 3, 4])
def test_the_same_machine_has_nothing_to_add(fitted, seed):
    assert holdout_differences(fitted, log_of(rubbing(0.3), seed)) == ()


def test_of_a_machine_that_changed_the_parameter_is_reported(fitted):
    (opinion,) = holdout_differences(fitted, log_of(rubbing(0.6), 2))
    assert opinion.parameter == "coulomb_friction.torque"
    assert opinion.value == pytest.approx(0.3, abs=0.02)
    assert opinion.held_out_value == pytest.approx(0.6, abs=0.02)
    then = measured(opinion.value, opinion.std, "N m")
    now = measured(opinion.held_out_value, opinion.held_out_std, "N m")
    assert str(opinion) == f"coulomb friction: torque {now} instead of {then}"


@pytest.mark.parametrize(("swing", "noise", "known"), [(0.3, 0.05, True), (0.2, 1e-3, False)])
def test_a_log_that_excites_more_shows_what_the_first_could_not(swing, noise, known):
    torque = swing * np.sin(np.arange(0.0, 10.0, 0.005)) + (0.55 if known else 0.0)  # the latter within the dead zone
    base = fit(record(Machine(gravity=0.0), torque, seed=1, noise=noise).log(), ServoModel.paper())
    differences = {opinion.parameter: opinion for opinion in holdout_differences(base, log_of(Machine(gravity=0.0), 2))}
    inertia = differences["inertia"]
    assert inertia.held_out_value == pytest.approx(2.0, abs=5.0 * inertia.held_out_std)
    assert (inertia.value is not None) == known
    assert ("cannot tell" in str(inertia)) != known


def test_no_effect_is_sure_that_needs_very_different_values():
    log = log_of(rubbing(0.3), 1)
    candidates = ["coulomb_friction"]
    same = diagnose(log, None, log_of(rubbing(0.3), 2), candidates=candidates)
    other = diagnose(log, None, log_of(rubbing(0.47), 2), candidates=candidates)
    assert (same.verdict, same.contradicted) == ("named", None)
    assert same.causes[0].probability > 0.9
    assert not any("validation data" in warning and "alone" in warning for warning in same.warnings)
    whole = 1.0 - same.gain.held_out_rms_after / same.gain.held_out_rms_before
    assert same.causes[0].gain == pytest.approx(whole)  # there is no other cause, and one measure of it
    assert (other.verdict != "named", other.causes[0].probability) == (True, 0.9)
    assert "the validation data contradict the model" in str(other).splitlines()[0]
    assert any("no effect is sure" in each and "coulomb friction: torque 0.47" in each for each in other.warnings)
    np.testing.assert_array_equal(same.model.values, other.model.values)


def test_a_flat_likelihood_excludes_no_value():
    """Once the load has slipped, a stiffness matters little: 0.02 +- 0.012 N m/rad is not much less likely than 0.1."""
    machine = Machine().hiding(presliding_hysteresis={"torque": 0.00366, "stiffness": 0.0987})
    model = ServoModel.paper().with_effect(PreslidingHysteresis(torque=0.00366, stiffness=0.1))
    found = fit(record(machine, excitation(102000, duration=30.0), seed=51000, noise=1e-3).log(), model)
    other = record(machine, excitation(102001, duration=15.0), seed=51001, noise=1e-3).log()
    (difference,) = holdout_differences(found, other)
    assert difference.parameter == "presliding_hysteresis.stiffness"
    assert abs(difference.held_out_value - difference.value) > 0.5 * difference.value
    assert not difference.much


def test_a_sure_effect_that_harms_validation_contradicts():
    gains = {"backlash": (-0.01, 0.1), "cogging": (0.5, 0.1)}
    assert contradiction(["backlash", "cogging"], [gains], ()) == "they are predicted better without backlash"
    assert contradiction(["cogging"], [gains], ()) is None  # one that is not sure contradicts nothing
    several_steps = {**gains, "backlash": (0.2, 0.1)}
    assert contradiction(["backlash", "cogging"], [gains, several_steps], ()) is None


def line(value: float | None, std: float | None, name: str = "viscous_friction") -> FittedParameter:
    return FittedParameter(name=name, value=value, std=std, unit="N m s/rad", start=0.5)


@pytest.mark.parametrize(
    ("here", "there", "message"),
    [
        (line(1.0, 0.1), line(1.0 + 4.1 * np.hypot(0.1, 0.2), 0.2), True),
        (line(1.0, 0.1), line(1.0 - 4.1 * np.hypot(0.1, 0.2), 0.2), True),
        (line(1.0, 0.1), line(1.0 + 3.9 * np.hypot(0.1, 0.2), 0.2), False),
        (line(-1.0, 0.001), line(-1.051, 0.001), True),
        (line(-1.0, 0.001), line(-1.049, 0.001), False),  # surely another, but of no use to anybody
        (line(1.0, 0.51), line(1.0, 0.1), True),  # no other, but told far better
        (line(1.0, 0.49), line(1.0, 0.1), False),
        (line(1.0, 0.049), line(1.0, 1e-4), False),  # known well enough
        (line(None, None), line(1.0, 0.1), True),
        (line(1.0, 0.1), line(None, None), False),
        (replace(line(0.0, 0.1), at_bound=True), line(9.0, 0.1), False),
        (line(1.0, 0.1), replace(line(9.0, 0.1), at_bound=True), False),
        (replace(line(1.0, None), fixed=True), line(9.0, 0.1), False),
        (line(1.0, 0.1, "curve_over_angle.k3"), line(9.0, 0.1, "curve_over_angle.k3"), False),
    ],
)
def test_what_is_reported(here, there, message):
    assert (_compared(here, there) is not None) == message


@pytest.mark.parametrize(("there", "message"), [(-3.12, None), (-2.8, 2.0 * np.pi - 2.8), (3.5, 3.5)])
def test_phases_are_compared_around_the_circle(there, message):
    opinion = _compared(line(3.12, 0.01, "cogging.phase"), line(there, 0.01, "cogging.phase"))
    assert (opinion and opinion.held_out_value) == (message and pytest.approx(message))


def test_the_noise_has_the_colour_that_was_found(fitted):
    """The estimates of ten such records scatter by 0.012 N m; a fit that takes the noise for white claims less."""
    (run,) = log_of(rubbing(0.6), 2).runs
    shake = np.random.default_rng(1).standard_normal(len(run))
    noise = 0.01 * lfilter([np.sqrt(1.0 - 0.95**2)], [1.0, -0.95], shake)
    noisy = Log(runs=(replace(run, output=run.output + noise),), axis="rotary")
    aware = replace(fitted, log=replace(fitted.log, colour=(0.95, 0.0)))
    (plain,), (coloured,) = (holdout_differences(found, noisy) for found in (fitted, aware))
    assert plain.parameter == coloured.parameter == "coulomb_friction.torque"
    assert coloured.held_out_std == pytest.approx(0.012, rel=0.05)
    assert plain.held_out_std < 0.95 * coloured.held_out_std


def test_a_wave_shifted_by_half_a_period_is_found_again():
    """From the old phase a descent ends at no wave at all."""

    def rippling(phase: float) -> Machine:
        return Machine().hiding(cogging={"amplitude": 0.3, "order": 7.0, "phase": phase})

    truth = ServoModel.paper().with_effect(Cogging(amplitude=0.3, order=7.0, phase=0.4))
    (opinion,) = holdout_differences(fit(log_of(rippling(0.4), 1), truth), log_of(rippling(0.4 + np.pi), 2))
    assert opinion.parameter == "cogging.phase"
    assert np.cos(opinion.held_out_value - 0.4 - np.pi) == pytest.approx(1.0, abs=1e-3)


def test_an_instant_is_looked_for_only_where_it_may_lie() -> None:
    def changed(time: float) -> Machine:
        return Machine().hiding(payload_change={"time": time, "inertia": 0.6, "gravity": 0.2})

    log = log_of(changed(8.0), 1)
    found = fit(log, ServoModel.paper().with_effect(PayloadChange(time=8.0, inertia=0.5, gravity=0.1)))
    (other,) = holdout_differences(found, log_of(changed(8.6), 2))
    assert other.parameter == "payload_change.time"
    later = log_of(changed(8.0), 4)
    later = replace(later, runs=(later.runs[0].slice(2600, len(later.runs[0])),))
    assert later.runs[0].time[0] > 9.0
    assert "payload_change.time" not in {each.parameter for each in holdout_differences(found, later)}
