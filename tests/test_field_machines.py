"""The measure itself: drawn logs are the same for a seed, move as the plant says, and are scored by the rules."""

import importlib
import math
import sys
from pathlib import Path

import numpy as np
import pytest

from plant import ServoModel, catalogue, simulate

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

from drawn_machines import drawn
from drawn_machines.confounded import TABLE
from drawn_machines.motion import play
from drawn_machines.servo import Machine
from field_scoring import VARIABLES, score
from field_table import table
from sensitivity import CONSTANTS, RULES

DT, N = 0.005, 500
EFFECTS = {
    "stribeck_friction": {"coulomb": 0.08, "excess": 0.05, "velocity": 0.5},
    "asymmetric_friction": {"forward": 0.1, "backward": 0.05, "viscous_difference": 0.003},
    "presliding_hysteresis": {"torque": 0.1, "stiffness": 1.5},
    "cable_stiffness": {"stiffness": 0.1, "cubic": 0.02, "rest_angle": 0.3},
    "payload_change": {"time": 1.3, "inertia": 0.01, "gravity": 0.1},
    "input_delay": {"time": 0.0123},
    "actuator_lag": {"time_constant": 0.009},
    "sensor_lag": {"time_constant": 0.009},
    "rate_limit": {"rate": 30.0},
    "torque_saturation": {"limit": 0.8},
    "compliance": {"frequency": 90.0, "damping": 0.05, "motor_share": 0.3},
    "backlash": {"gap": 0.2, "motor_share": 0.3, "flank_frequency": 400.0, "flank_damping": 0.5},
    "friction_drift": {"viscous_rate": 0.02, "coulomb_rate": 0.02},
}


@pytest.mark.parametrize("name", EFFECTS)
def test_an_effect_means_what_the_catalogue_means_by_it(name):
    time = DT * np.arange(N + 1)
    command = 1.2 * np.sin(2 * np.pi * 3.0 * time[:-1] ** 1.2)
    rigid = {"inertia": 0.02, "gravity": 0.3, "viscous_friction": 0.05}
    machine = Machine(**rigid, effects={name: EFFECTS[name]})
    values = command.tolist()
    moved = play(machine, lambda k, y, t: values[k], time, 0.0, noise=np.zeros(N), count=0.0, substeps=20)
    plain = play(
        Machine(**rigid, effects={}), lambda k, y, t: values[k], time, 0.0, noise=np.zeros(N), count=0.0, substeps=10
    )
    model = ServoModel(**rigid, effects=(catalogue[name](**EFFECTS[name]),))
    states = simulate(model, command=command, dt=DT, substeps=20)[:-1]
    expected = np.array([float(model.measurement(state)) for state in states])
    alike = slice(0, N if name != "backlash" else 200)  # knocks are chaotic: later on no two methods agree
    assert np.abs(moved.reading - expected)[alike].max() < 5e-3 * np.abs(moved.reading - plain.reading)[alike].max()


def test_the_torques_of_all_effects_balance_the_motion():
    machine = Machine(
        inertia=0.02,
        gravity=0.0,
        viscous_friction=0.05,
        effects={"coulomb_friction": {"torque": 0.1}, "cogging": {"amplitude": 0.1, "order": 5.0, "phase": 0.3}},
        rest=lambda x, v, t: 0.03 * math.sin(x + 0.1 * v),
    )
    time = DT * np.arange(N + 1)
    values = np.sin(2 * np.pi * 2.0 * time).tolist()
    moved = play(machine, lambda k, y, t: values[k], time, 0.0, noise=np.zeros(N), count=0.0, substeps=10)
    travel = np.diff(moved.angle) / DT
    needed = 0.02 * moved.acceleration[:-1] + 0.05 * travel
    given = moved.driving + sum(moved.torques.values())
    assert np.abs(needed - given[:-1]).max() < 1e-4
    assert np.abs(moved.torques["coulomb_friction"]).max() == pytest.approx(0.1)


@pytest.mark.parametrize("seed", [3, 200_007])
def test_a_seed_gives_the_same_log_again_also_from_a_folder(seed, tmp_path):
    first, kept, again = drawn(seed), drawn(seed, tmp_path), drawn(seed, tmp_path)
    for name, values in first.channels.items():
        assert values.tobytes() == kept.channels[name].tobytes() == again.channels[name].tobytes()
    assert first.facts() == kept.facts() == again.facts()
    assert sum(map(len, first.log.runs)) > 0.99 * first.channels["time"].size


def test_names_of_the_tables_are_those_of_the_catalogue():
    assert set(VARIABLES) | {"torque_offset", "dead_zone", "torque_measurement_lag"} == set(catalogue)
    assert {name for true, reported_names, _ in TABLE for name in (true, *reported_names)} <= set(catalogue)


def hidden(name, size=1.0, visible=1e4, alike=()):
    return {"name": name, "parameters": {}, "size": size, "rms": size, "visible": visible, "alike": alike}


def reported(effect, probability=0.99, rms=1.0, **more):
    return {"effect": effect, "probability": probability, "grade": "cause", "alternatives": [], "rms": rms, **more}


def outcome(truth, names, verdict="named", rest=0.1, left_out=None, depends_on=()):
    made = {"seed": 1, "kind": "chirp", "loop": "open", "clock": "even", "rest_share": 0.01, "samples": 3000}
    made |= {"rest": rest, "level": 10.0, "truth": truth, "left_out": left_out, "seconds": 1.0}
    return made | {"verdict": verdict, "names": names, "depends_on": list(depends_on)}


COULOMB, DRAG = hidden("coulomb_friction", alike=(("stribeck_friction",),)), hidden("quadratic_drag")
CASES = [
    ("right", outcome([COULOMB], [reported("coulomb_friction")])),
    ("right", outcome([COULOMB], [reported("stribeck_friction", wider=0.01)])),
    ("wrong", outcome([COULOMB], [reported("stribeck_friction", wider=0.5)])),
    ("missed", outcome([hidden("stribeck_friction")], [reported("coulomb_friction")])),
    ("right", outcome([], [], "nothing_missing")),
    ("right", outcome([], [], "unknown")),
    ("wrong", outcome([COULOMB], [reported("coulomb_friction"), reported("cogging", rms=0.2)])),
    ("right", outcome([COULOMB], [reported("coulomb_friction"), reported("cogging", rms=0.05)])),
    ("wrong", outcome([COULOMB], [reported("coulomb_friction"), reported("input_delay", rms=None)])),
    ("wrong", outcome([COULOMB], [reported("coulomb_friction"), reported("cogging", rms=None)])),
    ("honest", outcome([COULOMB, DRAG], [reported("coulomb_friction")], "unknown")),
    ("missed", outcome([COULOMB, DRAG], [reported("coulomb_friction")])),
    ("missed", outcome([COULOMB], [], "nothing_missing")),
    ("right", outcome([hidden("cogging", visible=20.0)], [], "nothing_missing")),
    ("right", outcome([hidden("cogging", size=0.05)], [], "nothing_missing")),
    ("honest", outcome([COULOMB], [], "unknown", left_out="coulomb_friction", depends_on=["velocity"])),
    ("missed", outcome([COULOMB, DRAG], [reported("quadratic_drag")], left_out="coulomb_friction")),
    ("crash", {**outcome([COULOMB], []), "failed": "no end"}),
]


@pytest.mark.parametrize(("category", "case"), CASES)
def test_an_outcome_is_scored_by_the_rules(category, case):
    assert score(case).category == category


def test_what_was_left_out_asks_for_the_right_variable():
    found = outcome([COULOMB], [], "unknown", left_out="coulomb_friction", depends_on=["angle"])
    assert (score(found).unreported, score(found).variable) == (False, False)
    found["depends_on"] = ["velocity", "angle"]
    assert score(found).variable is True
    found["verdict"] = "named"
    assert score(found).unreported is True


def test_probabilities_of_names_for_one_effect_count_together():
    lag = hidden("actuator_lag", alike=(("input_delay",), ("sensor_lag",)))
    found = outcome([lag, DRAG], [reported("input_delay", 0.6), reported("sensor_lag", 0.3), reported("cogging", 0.2)])
    assert sorted((round(p, 9), hit) for p, hit in score(found).events) == [(0.2, False), (0.9, True)]
    assert score(found).unmentioned == 1


def test_a_special_case_counts_with_the_effect_that_contains_it():
    name = reported("stribeck_friction", 0.9, alternatives=[("coulomb_friction", 0.06)])
    (told, hit), *others = score(outcome([hidden("stribeck_friction")], [name])).events
    assert (told, hit, others) == (pytest.approx(0.96), True, [])


def test_the_table_tells_how_much_miscalibration_is_chance():
    """One effect at 0.5 is off by 0.5, and a true share by sqrt(2/pi p (1 - p)) in the mean (a normal deviation)."""
    assert "0.5000, 0.3989 by chance" in table([outcome([COULOMB], [reported("coulomb_friction", 0.5)], "ambiguous")])


def test_the_table_counts_every_log_once():
    text = table([{**case, "seed": k} for k, (_, case) in enumerate(CASES)])
    assert f"{'all':28}{len(CASES):>6}{7:>9}{2:>9}{4:>9}{4:>9}{1:>9}" in text


@pytest.mark.parametrize(
    ("module", "name"),
    [
        *((home, constant.rpartition(".")[2]) for constant, (home, _) in CONSTANTS.items()),
        *((r[0], r[1]) for r in RULES.values()),
    ],
)
def test_what_the_sensitivity_table_changes_is_there(module, name):
    assert hasattr(importlib.import_module(module), name)
