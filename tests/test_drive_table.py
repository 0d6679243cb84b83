"""Tables for drives, and the curves of the effects behind them."""

from __future__ import annotations

import csv
import json
import re

import numpy as np
import pytest
from front_door import antidrive, listing, write_model

from antidrive.table_files import summary_line
from plant import BadParameter, ServoModel, drive_table
from plant.effects import (
    AsymmetricFriction,
    BackEmf,
    Backlash,
    CableStiffness,
    Cogging,
    Compliance,
    CoulombFriction,
    DeadZone,
    EncoderEccentricity,
    FrictionDrift,
    InputDelay,
    LoadDependentFriction,
    PreslidingHysteresis,
    StribeckFriction,
    TorqueOffset,
)
from plant.effects.ripple import RippleOverAngle

FULL = ServoModel(
    inertia=0.5,
    gravity=0.3,
    viscous_friction=0.2,
    effects=(
        InputDelay(time=0.004),
        DeadZone(half_width=0.1),
        LoadDependentFriction(coefficient=0.1),
        StribeckFriction(coulomb=0.2, excess=0.1, velocity=0.3),
        CableStiffness(stiffness=0.4),
        Cogging(amplitude=0.05, order=6.0, phase=0.4),
        EncoderEccentricity(amplitude=0.05, order=1.0, phase=0.2),
    ),
)


@pytest.mark.parametrize(
    ("effect", "over", "values", "wanted"),
    [
        (StribeckFriction(coulomb=1.0, excess=0.5, velocity=0.1), "velocity", [-1.0, 0.1], [-1.0, 1 + 0.5 / np.e]),
        (CoulombFriction(torque=0.2), "velocity", [-3.0, 0.0, 3.0], [-0.2, 0.0, 0.2]),
        (AsymmetricFriction(forward=0.3, backward=0.1), "velocity", [-1.0, 1.0], [-0.1, 0.3]),
        (BackEmf(constant=0.5), "velocity", [2.0], [1.0]),
        (Cogging(amplitude=2.0, order=4.0, phase=0.0), "angle", [np.pi / 8.0], [2.0]),
        (CableStiffness(stiffness=3.0), "angle", [0.5], [-1.5]),
        (EncoderEccentricity(amplitude=0.1, order=1.0, phase=0.0), "angle", [np.pi / 2.0], [0.1]),
        (DeadZone(half_width=0.1), "torque", [-1.0, 0.05, 1.0], [-0.9, 0.0, 0.9]),
        (LoadDependentFriction(coefficient=0.1), "torque", [-2.0], [0.2]),
    ],
    ids=lambda value: getattr(value, "name", ""),
)
def test_an_effect_draws_its_curve(effect, over, values, wanted):
    assert effect.curve_over == over
    assert effect.curve(values).tolist() == pytest.approx(wanted)
    assert effect.curve(values[0]).shape == ()


@pytest.mark.parametrize(
    "effect",
    [InputDelay(time=0.1), Compliance(frequency=50.0, damping=0.1, motor_share=0.2), FrictionDrift(viscous_rate=0.1)],
    ids=lambda effect: effect.name,
)
def test_an_effect_of_several_variables_has_no_curve(effect):
    assert effect.curve_over == ""
    with pytest.raises(BadParameter, match="no curve"):
        effect.curve([0.0])


def test_friction_is_what_steady_motion_takes():
    table = drive_table(FULL, "friction", points=41, reach=(-2.0, 2.0))
    velocity = table.columns["velocity"]
    wanted = FULL.without_effect("load_dependent_friction").inverse(0.0, velocity, 0.0)
    assert table.columns["torque"] == pytest.approx(
        (wanted["viscous_friction"] + wanted["stribeck_friction"]).to_list()
    )
    assert table.notes[0].endswith("load-dependent friction.")
    assert "jumps at zero" in table.notes[1]
    assert list(table.to_frame()) == ["velocity", "viscous_friction", "stribeck_friction", "torque"]


def test_presliding_is_in_the_table_as_steady_friction():
    model = ServoModel(viscous_friction=0.0, effects=(PreslidingHysteresis(torque=0.2, stiffness=5.0),))
    assert drive_table(model, "friction", points=4).columns["torque"].tolist() == pytest.approx([-0.2, -0.2, 0.2, 0.2])


def test_cogging_is_taken_away_and_has_its_harmonics():
    ripple = RippleOverAngle(rate=3.0, s1=0.3, c2=0.4)
    table = drive_table(FULL.with_effect(ripple), "cogging", points=96)
    angle = table.columns["angle"]
    wave = 0.05 * np.sin(6.0 * angle + 0.4) + 0.3 * np.sin(3.0 * angle) + 0.4 * np.cos(6.0 * angle)
    assert table.columns["torque"] == pytest.approx(-wave)
    assert angle[-1] == pytest.approx(2.0 * np.pi * 95 / 96)
    sines = sum(size * np.sin(order * angle + phase) for order, size, phase in table.harmonics)
    assert table.columns["torque"] == pytest.approx(sines)
    assert [size for order, size, _ in table.harmonics if order == 3.0] == [pytest.approx(0.3)]
    assert all(abs(phase) <= np.pi for *_, phase in table.harmonics)
    assert not table.notes


def test_a_position_error_has_the_sign_of_its_harmonic():
    (order, size, phase), *others = drive_table(FULL, "position-error").harmonics
    assert (order, size, phase, others) == (1.0, 0.05, 0.2, [])


def test_the_position_error_is_that_at_the_angle_shown():
    table = drive_table(FULL, "position-error", points=30)
    shown = table.columns["angle"]
    true = shown - table.columns["error"]
    assert true + 0.05 * np.sin(true + 0.2) == pytest.approx(shown, abs=1e-12)


def test_a_dead_zone_is_undone():
    table = drive_table(FULL, "dead-zone", points=11)
    assert DeadZone(half_width=0.1).curve(table.columns["command"]) == pytest.approx(table.columns["torque"])


def test_gravity_has_all_that_the_angle_takes():
    table = drive_table(FULL, "gravity", points=9, reach=(-1.0, 1.0))
    angle = table.columns["angle"]
    assert table.columns["torque"] == pytest.approx(0.3 * np.cos(angle) + 0.4 * angle)


def test_a_torque_offset_is_in_no_table_and_said():
    biased = FULL.with_effect(TorqueOffset(torque=0.03))
    for kind in ("friction", "gravity"):
        said = "Not in the table: the torque offset; the drive adds -0.03 N m against it."
        assert said in drive_table(biased, kind).notes
        assert "offset" not in " ".join(drive_table(FULL, kind).notes)
    assert biased.inverse(0.0, 0.0, 0.0)["torque_offset"].iloc[0] == pytest.approx(-0.03)


def test_a_model_without_gravity_has_no_table_of_it():
    """As that of a log of the speed alone: a table of zeros would pass for a result."""
    with pytest.raises(BadParameter, match="no torque over the angle; its effects: Coulomb friction"):
        drive_table(ServoModel(gravity=0.0, effects=(CoulombFriction(torque=0.2),)), "gravity")


def test_the_words_are_those_of_the_axis():
    linear = ServoModel(axis="linear", gravity=0.0, effects=(Cogging(amplitude=3.0, order=2513.0, phase=0.4),))
    assert drive_table(linear, "cogging").meaning == "what the drive adds against cogging at a position"
    assert drive_table(FULL, "cogging").meaning == "what the drive adds against cogging at an angle"
    assert summary_line(drive_table(linear, "cogging"))[0].startswith("Harmonic with 2513 rad/m: ")
    assert summary_line(drive_table(FULL, "position-error"))[0].startswith("Harmonic with 1 cycle/rev: ")
    meanings = {spec.name: spec.meaning for spec in linear.parameters}
    assert meanings["cogging.order"] == "phase per length n"
    assert meanings["cogging.phase"] == "phase at position zero"
    assert {spec.name: spec.meaning for spec in FULL.parameters}["cogging.order"] == "periods per turn n"


def test_a_dead_zone_of_zero_needs_no_table():
    with pytest.raises(BadParameter, match="The dead zone of the model is zero"):
        drive_table(ServoModel.paper().without_effect("dead_zone").with_effect(DeadZone(half_width=0.0)), "dead-zone")


@pytest.mark.parametrize("points", [8, 64])
def test_a_breakaway_peak_between_two_points_is_an_error(points):
    servo = ServoModel(viscous_friction=0.4, effects=(StribeckFriction(coulomb=0.2, excess=0.1, velocity=0.02),))
    assert drive_table(servo, "friction", points=points).largest_error == pytest.approx(0.1, rel=0.02)


@pytest.mark.parametrize("kind", ["friction", "cogging", "gravity", "position-error", "dead-zone"])
def test_the_error_of_straight_lines_is_as_stated(kind):
    table = drive_table(FULL, kind, points=40)
    finer = drive_table(FULL, kind, points=500, reach=tuple(table.columns[table.ends[0]][[0, -1]]))
    first, last = table.ends
    off = finer.columns[last] - np.interp(finer.columns[first], table.columns[first], table.columns[last])
    beyond = np.abs(finer.columns[first]) >= np.abs(table.columns[first]).min()  # of a jump at zero
    assert np.abs(off[beyond]).max() <= 1.01 * table.largest_error + 1e-12


def test_too_few_points_and_other_nonsense_are_refused():
    for words, text in (
        ({"kind": "cogging", "points": 12}, "12 points are too few for 6 periods"),
        ({"kind": "friction", "points": 1}, "between 2 and"),
        ({"kind": "friction", "reach": (1.0, 0.0)}, "from a lower to a higher"),
        ({"kind": "wobble"}, "There is no table 'wobble'"),
    ):
        with pytest.raises(BadParameter, match=text):
            drive_table(FULL, **words)
    with pytest.raises(BadParameter, match="no cogging; its effects: none"):
        drive_table(ServoModel(), "cogging")


def test_the_command_writes_csv_and_c_arrays(tmp_path):
    model, out = write_model(tmp_path / "model.json", FULL), tmp_path / "out"
    result = antidrive("table", "cogging", model, "--points", 64, "--single", "--out", out)
    assert result.code == 0, result.err
    assert sorted(listing(out)) == ["antidrive_cogging.h", "cogging.csv"]
    rows = list(csv.reader((out / "cogging.csv").read_text().splitlines()))
    assert rows[0] == ["angle [rad]", "torque [N m]"]
    table = drive_table(FULL, "cogging", points=64)
    assert np.array(rows[1:], dtype=float) == pytest.approx(np.column_stack(list(table.columns.values())), abs=1e-8)
    header = (out / "antidrive_cogging.h").read_text()
    arrays = re.findall(
        r"static const float antidrive_cogging_(\w+)\[ANTIDRIVE_COGGING_POINTS\] = \{.*?\n(.*?)\}", header, re.S
    )
    for name, body in arrays:
        numbers = [float(cell.strip().removesuffix("f")) for cell in body.split(",")]
        assert numbers == pytest.approx(table.columns[name], abs=1e-8)
    assert [name for name, _ in arrays] == ["angle", "torque"]
    reported = json.loads(antidrive("table", "cogging", model, "--out", out, "--json").out)
    assert reported["harmonics"] == [pytest.approx([6.0, 0.05, 0.4 - np.pi])]
    assert "Harmonic with 6 cycles/rev: amplitude 0.05 N m, phase -2.742 rad at zero." in result.out


def test_backlash_and_dead_time_are_numbers(tmp_path):
    model = write_model(tmp_path / "model.json", FULL.with_effect(Backlash(gap=0.01, motor_share=0.2)))
    for kind, line in (("backlash", "backlash_gap_arcmin = 34.3775 arcmin"), ("dead-time", "lead = 0.004 s")):
        result = antidrive("table", kind, model, "--out", tmp_path / "out")
        assert line in result.out.splitlines()
        assert line.split(" = ")[0] in (tmp_path / "out" / f"{kind}.csv").read_text()
    assert "#define ANTIDRIVE_LEAD 0.004 /* s */" in (tmp_path / "out" / "antidrive_dead_time.h").read_text()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("wobble",), "there are friction, cogging, gravity"),
        (("backlash",), "has no backlash"),
        (("friction", "--range", "3"), "write it as LOW:HIGH"),
        (("cogging", "--points", "10"), "too few"),
    ],
)
def test_the_command_reports_what_is_wrong(words, message, tmp_path):
    model = write_model(tmp_path / "model.json", FULL)
    result = antidrive("table", words[0], model, *words[1:], "--out", tmp_path / "out")
    assert (result.code, result.err.count("\n")) == (2, 1)
    assert message in result.err
    assert not (tmp_path / "out").exists()
