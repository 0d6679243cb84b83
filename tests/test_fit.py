"""The fit finds what was put into an independent machine, says how sure it is, and says what it cannot know."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from machine import (
    Follower,
    Machine,
    Record,
    chirp_and_steps,
    excitation,
    load_fluctuation,
    record,
    wandering_reference,
)

from identification.fit import fit
from identification.fit_result import Fit
from identification.log import Log
from identification.problem import Problem
from plant import BadParameter, ServoModel
from plant.effects import CoulombFriction, DeadZone, TorqueOffset

NAMES = ("inertia", "gravity", "viscous_friction", "dead_zone.half_width")
TRUE = (2.0, 0.5, 0.8, 0.5)


@cache
def open_loop() -> Record:
    """Three records of the paper's machine, 30 s of chirp and steps each, from different first angles and speeds."""
    commands = np.column_stack([chirp_and_steps(seed, duration=30.0) for seed in range(3)])
    return record(Machine(), commands, seed=1, angle=np.array([0.0, 1.0, -2.0]), velocity=np.array([0.0, 0.5, -0.5]))


@cache
def fitted(number: int = 0) -> Fit:
    return fit(open_loop().log(number))


def assert_recovers(found: Fit, true: dict[str, float], *, within: float = 0.01, sigmas: float = 5.0) -> None:
    for name, value in true.items():
        line = found[name]
        assert line.value is not None, name
        assert line.std is not None, name
        assert line.value == pytest.approx(value, rel=within), name
        assert abs(line.value - value) < sigmas * line.std, name


@pytest.mark.parametrize("number", range(3))
def test_chirp_and_steps_give_the_four_parameters(number: int) -> None:
    found = fitted(number)
    assert found.converged
    assert_recovers(found, dict(zip(NAMES, TRUE, strict=True)))
    assert found.noise_std == pytest.approx(1e-3, rel=0.05)


def test_several_runs_count_together_with_own_initial_states() -> None:
    together = fit(open_loop().log_of_runs())
    assert_recovers(together, dict(zip(NAMES, TRUE, strict=True)))
    assert together.initial == pytest.approx(np.array([[0.0, 0.0], [1.0, 0.5], [-2.0, -0.5]]), abs=2e-3)
    for name in NAMES:
        assert together[name].std < min(fitted(number)[name].std for number in range(3))  # type: ignore[type-var]


STARTS = [(5.0, 5.0, 5.0, 5.0), (0.2, 0.2, 0.2, 0.2), (5.0, 0.2, 5.0, 0.2), (0.2, 5.0, 5.0, 0.2), (0.2, 5.0, 0.2, 5.0)]


@pytest.mark.parametrize("factors", STARTS, ids=str)
def test_every_start_off_by_a_factor_of_five_converges(factors: tuple[float, ...]) -> None:
    start = ServoModel.paper().with_values(np.array(TRUE) * factors)
    found = fit(open_loop().log(1), start)
    assert found.model.values == pytest.approx(fitted(1).model.values, rel=1e-4)
    assert [line.start for line in found.parameters] == pytest.approx(start.values.tolist())


@cache
def closed_loop() -> Record:
    loops = Follower(reference=wandering_reference(1, duration=30.0))
    return record(Machine(), loops, seed=2)


def test_a_log_recorded_in_closed_loop_is_no_worse() -> None:
    assert_recovers(fit(closed_loop().log()), dict(zip(NAMES, TRUE, strict=True)))


@pytest.mark.parametrize("duration", [4.0, 10.0])
def test_a_load_that_could_fall_is_identified_in_its_loop(duration: float) -> None:
    """Upright, an error of the start grows by e in a sixteenth of a second: free simulation would tell nothing."""
    arm = Machine(inertia=0.02, gravity=5.0, viscous_friction=0.3, effects={})
    loop = Follower(reference=wandering_reference(3, duration=duration), stiffness=80.0, damping=2.0)
    found = fit(record(arm, loop, seed=3, noise=2e-5, bits=19).log())
    assert_recovers(found, {"inertia": 0.02, "gravity": 5.0, "viscous_friction": 0.3}, within=1e-3)
    assert found.noise_std < 2.5e-5
    assert found.bandwidth > 0.0


def test_how_long_a_log_lasts_asks_for_no_observer() -> None:
    """An error of the initial speed grows with time where nothing holds the load: that is no load that falls."""
    log = record(Machine(gravity=0.0, viscous_friction=0.02, effects={}), excitation(1, duration=10.0)).log()
    (run,) = log.runs
    slow = replace(log, runs=(replace(run, time=1e3 * run.time, command=1e-6 * run.command),))
    assert (fit(log).bandwidth, fit(slow).bandwidth) == (0.0, 0.0)


def test_a_fluctuating_load_is_taken_as_process_noise() -> None:
    command = chirp_and_steps(4, duration=30.0)
    out = record(Machine(), command, seed=3, load_torque=load_fluctuation(0, 0.05, (command.size, 1)))
    found = fit(out.log())
    assert found.bandwidth > 0.0
    assert_recovers(found, dict(zip(NAMES, TRUE, strict=True)), within=0.05)


def test_an_integrating_plant_does_not_drift_in_the_fit() -> None:
    """No gravity, hardly any friction, and a load that fluctuates: a free simulation walks away by radians."""
    machine = Machine(gravity=0.0, viscous_friction=0.02, effects={})
    command = np.column_stack([chirp_and_steps(5, duration=30.0)])
    extra = load_fluctuation(1, 0.1, command.shape, correlation_time=0.1)
    out = record(machine, command, seed=4, load_torque=extra)
    quiet = record(machine, command, noise=0.0, bits=None)
    assert np.abs(out.angle - quiet.angle).max() > 0.1
    found = fit(out.log(), ServoModel(inertia=1.0, gravity=0.0, viscous_friction=0.1))
    assert found.bandwidth > 0.0
    assert found["inertia"].value == pytest.approx(2.0, rel=0.01)
    for name, true in (("inertia", 2.0), ("gravity", 0.0), ("viscous_friction", 0.02)):
        line = found[name]
        assert line.value is not None
        assert line.std is not None
        assert abs(line.value - true) < 5 * line.std


@pytest.mark.parametrize("torque", [0.0, 0.4])
def test_a_load_that_never_turns_does_not_show_gravity(torque: float) -> None:
    """Clamped: the torque moves nothing, so nothing can be told, and no number is made up."""
    command = torque * chirp_and_steps(6, duration=10.0)
    clamped = Machine(effects={"coulomb_friction": {"torque": 100.0}})
    found = fit(record(clamped, command, seed=5).log(), ServoModel())
    assert "gravity" in found.unidentifiable
    assert found["gravity"].value is None
    assert found["gravity"].std is None
    assert "gravity" in str(found)
    assert "cannot be determined" in str(found)


def test_a_load_at_rest_does_not_determine_inertia_and_friction() -> None:
    out = record(Machine(effects={}), np.zeros(2000), seed=6, angle=-np.pi / 2)
    found = fit(out.log(), ServoModel())
    assert {"inertia", "viscous_friction"} <= set(found.unidentifiable)


def test_a_parameter_that_wants_past_its_bound_is_flagged() -> None:
    driven = Machine(viscous_friction=-0.05)  # something helps the motion along: no such model exists
    found = fit(record(driven, chirp_and_steps(7, duration=20.0), seed=7).log())
    assert found["viscous_friction"].value == 0.0
    assert found["viscous_friction"].at_bound
    assert "AT BOUND" in str(found)
    assert not fitted()["viscous_friction"].at_bound


def test_dry_friction_is_found_in_its_exact_form() -> None:
    machine = Machine().hiding(coulomb_friction={"torque": 0.3})
    out = record(machine, chirp_and_steps(8, duration=30.0), seed=8)
    start = ServoModel.paper().with_effect(CoulombFriction(torque=0.05))
    found = fit(out.log(), start)
    assert_recovers(found, {**dict(zip(NAMES, TRUE, strict=True)), "coulomb_friction.torque": 0.3})


def test_masked_samples_do_not_count() -> None:
    log = open_loop().log(0)
    run = log.runs[0]
    rng = np.random.default_rng(0)
    hit = rng.random(len(run)) < 0.05
    spoilt = replace(run, output=np.where(hit, run.output + rng.uniform(-5, 5, len(run)), run.output), valid=~hit)
    found = fit(replace(log, runs=(spoilt,)))
    assert found.samples == int((~hit).sum())
    assert_recovers(found, dict(zip(NAMES, TRUE, strict=True)))
    assert not found.innovations[hit].any()


def test_a_fixed_parameter_stays_and_has_no_error() -> None:
    found = fit(open_loop().log(0), replace(ServoModel.paper(), inertia=2.0), fixed=("inertia",))
    assert found["inertia"].fixed
    assert (found["inertia"].value, found["inertia"].std) == (2.0, None)
    assert "(fixed)" in str(found)
    assert_recovers(found, dict(zip(NAMES[1:], TRUE[1:], strict=True)))
    assert found.covariance.shape == (3, 3)


def test_uncertainty_is_consistent_with_itself() -> None:
    found = fitted()
    assert found.covariance == pytest.approx(found.covariance.T)
    assert [found[name].std for name in NAMES] == pytest.approx(np.sqrt(np.diag(found.covariance)))
    assert np.diag(found.correlation) == pytest.approx(1.0)
    assert np.abs(found.correlation).max() <= 1.0 + 1e-9
    white = np.corrcoef(found.innovations[1:], found.innovations[:-1])[0, 1]
    assert abs(white) < 4 / np.sqrt(found.samples)


def test_the_report_has_what_one_looks_for() -> None:
    text = str(fitted())
    for name, unit in zip(NAMES, ("kg m^2", "N m", "N m s/rad", "N m"), strict=True):
        line = next(row for row in text.splitlines() if row.strip().startswith(name))
        assert "±" in line
        assert unit in line
        assert "%" in line
    assert "6000 samples" in text
    assert "log-likelihood" in text


def test_what_cannot_be_fitted_is_refused() -> None:
    log = open_loop().log(0)
    with pytest.raises(BadParameter, match="mass"):
        fit(log, fixed=("mass",))
    with pytest.raises(BadParameter, match="mass"):
        fitted()["mass"]
    linear = ServoModel(inertia=1.0, gravity=0.0, viscous_friction=1.0, axis="linear")
    with pytest.raises(BadParameter, match="linear"):
        fit(log, linear)


def test_a_linear_axis_is_fitted_without_gravity() -> None:
    cart = Machine(inertia=90.0, gravity=0.0, viscous_friction=200.0, effects={"torque_offset": {"torque": 8.0}})
    out = record(cart, 100.0 * chirp_and_steps(9, duration=20.0), seed=9, noise=1e-5, bits=None)
    log = Log(runs=out.log().runs, axis="linear", command_unit="N")
    model = ServoModel(
        inertia=1.0, gravity=0.0, viscous_friction=1.0, effects=(TorqueOffset(torque=0.0),), axis="linear"
    )
    found = fit(log, model)
    assert found["gravity"].fixed
    assert_recovers(found, {"inertia": 90.0, "viscous_friction": 200.0, "torque_offset.torque": 8.0})
    assert found["inertia"].unit == "kg"


def test_no_dead_zone_is_found_as_none() -> None:
    out = record(Machine(effects={}), chirp_and_steps(10, duration=30.0), seed=10)
    found = fit(out.log(), ServoModel().with_effect(DeadZone(half_width=0.3)))
    width = found["dead_zone.half_width"]
    assert width.value is None or width.value < 5 * (width.std or 0.0) or width.at_bound
    assert_recovers(found, dict(zip(NAMES[:3], TRUE[:3], strict=True)))


def test_a_fully_fixed_model_still_fits_its_initial_state() -> None:
    log = open_loop().log(1)
    found = fit(log, ServoModel.paper(), fixed=NAMES)
    assert found.initial == pytest.approx(np.array([[1.0, 0.5]]), abs=2e-3)
    assert found.model == ServoModel.paper()
    assert found.noise_std == pytest.approx(1e-3, rel=0.05)


def test_a_model_worse_than_its_start_gets_an_observer() -> None:
    """From a free simulation with friction to one without: what friction did is left to the observer."""
    log = record(Machine().hiding(coulomb_friction={"torque": 0.1}), excitation(1, duration=20.0)).log()
    rich = fit(log, ServoModel.paper().with_effect(CoulombFriction(torque=0.1)))
    assert rich.bandwidth == 0.0
    direct, less = fit(log, ServoModel.paper()), Problem.of(log, ServoModel.paper()).descend(rich)
    assert direct.bandwidth > 0.0
    assert less.log_likelihood > direct.log_likelihood - 1.0
