"""What differs from run to run: payloads that are known, parameters fitted for each run, and runs that disagree."""

from pathlib import Path

import numpy as np
import pytest
from machine import Machine, excitation, record

from diagnosis import diagnose
from identification import fit
from identification.between_run_differences import between_run_differences, farthest_apart, is_coefficient
from identification.errors import MalformedLog
from identification.inverse import torque_error
from identification.log import Log
from identification.predictor import Predictor
from identification.run_parameters import own_values
from identification.sums_over_runs import places, point_size
from plant import ServoModel
from plant.effects import Compliance, CoulombFriction
from plant.effects.nonparametric_curve import CurveOverVelocity
from plant.errors import BadParameter

CASE = Path(__file__).parents[1].parent / "shared" / "cases" / "use" / "14-several-payloads" / "payloads.csv"
MASS, RADIUS, G = np.array([0.0, 2.0, 5.0]), 0.4, 9.80665
INERTIA, GRAVITY = 2.0 + MASS * RADIUS**2, 0.5 + MASS * G * RADIUS
PLAIN: dict[str, dict[str, float]] = {}


def columns_of(made):
    """The runs of a batch below one another, as they stand in a table."""
    samples, machines = made.command.shape
    return {
        "time": np.tile(made.time, machines),
        "torque": made.command.T.ravel(),
        "angle": made.measured.T.ravel(),
        "run": np.repeat(np.arange(1, machines + 1), samples),
    }


def made(machine, seconds=12.0, seed=0, scale=1.0, runs=3):
    commands = np.column_stack([excitation(seed + run, duration=seconds, scale=scale) for run in range(runs)])
    return record(machine, commands, seed=seed, angle=np.full(runs, -np.pi / 2))


def start(friction=0.1):
    return ServoModel(inertia=1.0, gravity=0.0, viscous_friction=0.1, effects=(CoulombFriction(torque=friction),))


@pytest.fixture(scope="module")
def loaded():
    """Three runs of one arm with known masses at its end, and dry friction."""
    machine = Machine(
        inertia=INERTIA, gravity=GRAVITY, viscous_friction=0.8, effects={"coulomb_friction": {"torque": 0.3}}
    )
    return columns_of(made(machine, scale=2.0))


TRUE = {"inertia": 2.0, "gravity": 0.5, "viscous_friction": 0.8, "coulomb_friction.torque": 0.3}


def test_a_known_payload_of_a_run_is_no_part_of_the_model(loaded):
    mass = np.repeat(MASS, loaded["time"].size // 3)
    log = Log.from_arrays(
        **loaded, payload_mass=1e3 * mass, payload_radius=0 * mass + RADIUS, units={"payload_mass": "g"}
    )
    found = fit(log, start())
    for name, true in TRUE.items():
        assert abs(found[name].value - true) < 4.0 * found[name].std + 1e-3 * true, name
        assert found[name].std < 0.02 * true, name
    assert not any("disagree" in text for text in found.log.warnings)
    stated = Log.from_arrays(**loaded, payload_inertia=mass * RADIUS**2, payload_gravity=mass * G * RADIUS)
    for run, same in zip(log.runs, stated.runs, strict=True):
        assert run.own == pytest.approx(same.own)
    without = Log.from_arrays(**loaded)
    assert torque_error(log, found.model, cutoff=5.0) < 0.5 * torque_error(without, found.model, cutoff=5.0)


def test_chosen_parameters_differ_by_run_and_others_are_shared(loaded):
    log = Log.from_arrays(**loaded)
    found = fit(log, start(), per_run=("inertia", "gravity"))
    for run in range(3):
        for name, true in (("inertia", INERTIA), ("gravity", GRAVITY)):
            line = found[f"{name}[arrays run {run + 1}]"]
            assert abs(line.value - true[run]) < 4.0 * line.std + 1e-3 * true[run]
            assert line.std < 0.02 * true[run]
    for name in ("viscous_friction", "coulomb_friction.torque"):
        assert abs(found[name].value - TRUE[name]) < 4.0 * found[name].std + 1e-3 * TRUE[name]
    assert found.model.inertia == pytest.approx(INERTIA.mean(), rel=1e-3)
    assert not any("disagree" in text for text in found.log.warnings)
    with pytest.raises(BadParameter, match="'mass' is no parameter"):
        fit(log, start(), per_run=("mass",))
    with pytest.raises(BadParameter, match="'inertia' is fixed"):
        fit(log, start(), per_run=("inertia",), fixed=("inertia",))


def test_runs_that_disagree_are_reported_with_by_how_much(loaded):
    found = fit(Log.from_arrays(**loaded), start())
    (warning,) = (text for text in found.log.warnings if "disagree" in text)
    assert "standard errors apart" in warning
    assert "payload_mass" in warning
    assert "inertia" in warning.split(":")[0] or "gravity" in warning.split(":")[0]
    assert "viscous" not in warning


def test_a_diagnosis_reports_it_too_with_an_option_to_type(loaded):
    few = {name: values[(np.arange(values.size) % 2400 < 700)] for name, values in loaded.items()}
    log = Log.from_arrays(**few)
    found = diagnose(log, base=start(), candidates=["torque_offset"])
    (warning,) = (text for text in found.warnings if "disagree" in text)
    assert "payload_mass" in warning
    assert "antidrive identify --per-run" in warning


@pytest.mark.long
def test_runs_that_agree_raise_no_warning_under_model_error():
    for seed, effects in enumerate(
        (PLAIN, {"coulomb_friction": {"torque": 0.3}}, {"cogging": {"amplitude": 0.2, "order": 6.0, "phase": 0.5}})
    ):
        log = made(Machine(effects=effects), seed=10 * seed).log_of_runs()
        rigid = ServoModel(inertia=1.0, gravity=0.0, viscous_friction=0.1)
        assert between_run_differences(fit(log, rigid)) is None, effects


def test_a_few_per_cent_between_runs_are_detected():
    machine = Machine(inertia=np.array([2.0, 2.0, 2.06]), effects=PLAIN)
    rigid = ServoModel(inertia=1.0, gravity=0.0, viscous_friction=0.1)
    differences = between_run_differences(fit(made(machine).log_of_runs(), rigid))
    assert differences is not None
    assert differences.startswith("The runs disagree about inertia (")
    assert "machine 2 run 2 2.06" in differences
    assert " and " not in differences.split(")")[0]


def test_one_log_of_somebody_elses_kind():
    if not CASE.exists():
        pytest.skip("the case of several payloads is not here")
    log = Log.read(CASE)
    found = fit(log)
    assert any("disagree about inertia" in text and "kg m^2" in text for text in found.log.warnings)
    apart = fit(log, start(), per_run=("inertia", "gravity"))
    inertia = [apart[f"inertia[payloads.csv run {run}]"].value for run in (1, 2, 3)]
    gravity = [apart[f"gravity[payloads.csv run {run}]"].value for run in (1, 2, 3)]
    assert inertia == pytest.approx([2.0, 3.0, 4.0], rel=1e-3)
    assert gravity == pytest.approx([0.5, 1.0, 1.5], rel=1e-2)


def test_a_flexible_drivetrain_keeps_its_motor_under_a_payload():
    model = ServoModel(
        inertia=0.5,
        gravity=1.0,
        viscous_friction=0.3,
        effects=(Compliance(frequency=40.0, damping=0.05, motor_share=0.4),),
    )
    time = np.arange(400) * 0.005
    given = {"time": time, "torque": np.sin(5 * time), "angle": 0.1 * np.cos(3 * time)}
    log = Log.from_arrays(**given, payload_inertia=np.full(400, 0.3), payload_gravity=np.full(400, 0.7))
    (run,) = log.runs
    assert own_values(run, model, model.values) == pytest.approx(model.with_payload(inertia=0.3, gravity=0.7).values)
    free = tuple(range(len(model.names)))
    predictor = Predictor(model=model, runs=(run,), free=free, substeps=4)
    begin = np.array([[0.1, 0.0]])

    def output(values):
        return predictor.predict(values, begin, bandwidth=0.0, width=0.0)[0]

    jacobian = output(model.values).jacobian
    for place in free:
        aside = np.zeros(len(free))
        aside[place] = 1e-5 * abs(model.values[place])
        slope = (output(model.values + aside).errors - output(model.values - aside).errors) / (2 * aside[place])
        assert jacobian[:, place] == pytest.approx(slope, rel=1e-3, abs=1e-4 * np.abs(slope).max())


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"payload_mass": np.full(400, 2.0)}, "needs its payload_radius"),
        ({"payload_inertia": np.linspace(0, 1, 400)}, "changes within a run"),
    ],
)
def test_a_payload_that_cannot_be_used_is_refused(columns, message):
    time = np.arange(400) * 0.005
    with pytest.raises(MalformedLog, match=message):
        Log.from_arrays(time=time, torque=np.sin(5 * time), angle=np.cos(3 * time), **columns)


def test_the_places_of_a_point():
    assert point_size(4, 3, ()) == 10
    assert places(4, 1, 3).tolist() == [0, 1, 2, 3, 6, 7]
    assert point_size(4, 3, (0, 2)) == 14
    assert places(4, 1, 3, (0, 2)).tolist() == [4, 0, 5, 1, 10, 11]


def test_the_runs_shown_are_those_that_differ_surely():
    """A run that hardly determines a parameter has its extreme value, and says nothing."""
    values, std = np.array([-2386.0, 0.38, 1.5, 0.40]), np.array([2000.0, 0.01, 0.02, 0.01])
    assert list(farthest_apart(values, std)) == [1, 2]


def test_coefficients_of_a_curve_are_no_parameters_of_runs():
    model = ServoModel.paper().with_effect(CurveOverVelocity(low=-3.0, high=3.0))
    coefficients = [name for name in model.names if is_coefficient(model, name)]
    assert coefficients
    assert all(name.startswith("curve_over_velocity.") for name in coefficients)
    assert not any(is_coefficient(model, name) for name in ServoModel.paper().names)
