"""Objects of CiA 402 are known by name and index, and their increments and per mille are never taken for SI."""

from __future__ import annotations

import numpy as np
import pytest
from front_door import antidrive, write_csv
from front_door import columns as recorded
from sample_logs import motion
from test_malformed_logs import check_sentence

from identification.errors import MalformedLog
from identification.log import Log
from identification.reading.cia402 import drive_object
from identification.reading.units import si_factor
from plant.errors import BadParameter

COUNTS, RATED = 131072, 2.4
SOUND = motion(counts=COUNTS)
INCREMENTS = np.round(SOUND["angle"] * COUNTS / (2 * np.pi))
PER_MILLE = np.round(1e3 * SOUND["torque"] / RATED)
UNITS = {"angle": "turn/131072", "torque": "2.4Nm/1000"}


def read(folder, position="Position actual value", torque="Torque actual value", other=None, **options):
    table = {"time": SOUND["time"], position: INCREMENTS, torque: PER_MILLE, **(other or {})}
    return Log.read(write_csv(folder / "drive.csv", table), **options)


@pytest.mark.parametrize(
    "names",
    [
        ("Position actual value", "Torque actual value"),
        ("position_actual_value", "torque_actual_value"),
        ("PositionActualValue", "TorqueActualValue"),
        ("Axis 1.Position actual value [inc]", "Axis 1.Torque actual value"),
        ("6064", "6077"),
        ("0x6064", "0x6077"),
        ("6064h", "6077h"),
        ("6064:00", "0x6077:00"),
        ("16#6064", "16#6077"),
        ("TxPDO/0x6064.0", "TxPDO/0x6077.0"),
        ("Position actual value", "Target torque"),
        ("0x6064", "6071h"),
    ],
)
def test_names_and_indices(tmp_path, names):
    log = read(tmp_path, *names, units=UNITS)
    np.testing.assert_allclose(log.runs[0].output, SOUND["angle"], atol=1e-6)
    np.testing.assert_allclose(log.runs[0].command, PER_MILLE * RATED / 1000, rtol=1e-12)
    (warning,) = log.warnings
    assert "CiA 402" in warning
    assert f"'{names[0]}' as angle, '{names[1]}' as torque" in warning


@pytest.mark.parametrize(
    "name",
    ["60640", "0x60641", "A6064h", "position", "actual position", "x6064", "torque", "6064.5", "sum6077"],
)
def test_other_names_are_no_objects(name):
    assert drive_object(name) is None


def test_the_other_options_for_the_size_of_a_count(tmp_path):
    scaled = read(tmp_path, scales={"angle": 2 * np.pi / COUNTS, "torque": RATED / 1000})
    np.testing.assert_allclose(scaled.runs[0].output, SOUND["angle"], atol=1e-6)
    both = read(tmp_path, scales={"angle": 360 / COUNTS}, units={"angle": "deg", "torque": "permille*2.4*N*m"})
    np.testing.assert_allclose(both.runs[0].output, SOUND["angle"], atol=1e-6)
    np.testing.assert_allclose(both.runs[0].command, scaled.runs[0].command, rtol=1e-12)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, ["'Position actual value' (6064h)", "increments", "--unit angle=turn/131072"]),
        ({"units": {"angle": "turn/131072"}}, ["'Torque actual value' (6077h)", "per mille", "2.4Nm/1000"]),
        ({"units": {"torque": "2.4Nm/1000"}, "mapping": {"angle": "Position actual value"}}, ["(6064h)", "'rad'"]),
        ({"units": {"force": "120N/1000"}}, ["(6064h)", "--unit position=mm/10000"]),
        ({"units": {"position": "um"}}, ["(6077h)", "--unit force=120N/1000"]),
        (
            {"units": UNITS, "other": {"6064h": INCREMENTS}},
            ["both 'Position actual value' and", "--map angle="],
        ),
        ({"units": UNITS, "other": {"Target torque": PER_MILLE}}, ["both", "'Target torque'", "--map torque="]),
    ],
)
def test_nothing_is_guessed(tmp_path, options, message):
    with pytest.raises(MalformedLog) as caught:
        read(tmp_path, **options)
    check_sentence(str(caught.value))
    assert str(caught.value).startswith("drive.csv: ")
    for part in message:
        assert part in str(caught.value)


def test_a_choice_among_two(tmp_path):
    log = read(tmp_path, other={"Target torque": 0 * PER_MILLE}, units=UNITS, mapping={"torque": "Torque actual value"})
    np.testing.assert_allclose(log.runs[0].command, PER_MILLE * RATED / 1000, rtol=1e-12)


def test_the_contracts_own_names_come_first(tmp_path):
    log = read(tmp_path, other={"angle": SOUND["angle"], "torque": SOUND["torque"]})
    np.testing.assert_allclose(log.runs[0].output, SOUND["angle"], atol=1e-9)
    assert log.warnings == ()


def test_a_mapped_object_that_was_converted_is_in_si(tmp_path):
    """A number with a fraction is no count."""
    table = {"time": SOUND["time"], "Position actual value": SOUND["angle"], "target_torque": SOUND["torque"]}
    path = write_csv(tmp_path / "drive.csv", table)
    log = Log.read(path, mapping={"angle": "Position actual value", "torque": "target_torque"})
    np.testing.assert_allclose(log.runs[0].output, SOUND["angle"], atol=1e-9)


def test_a_velocity_is_left_out_unless_its_unit_is_given(tmp_path):
    speed = np.round(SOUND["velocity"] * 30 / np.pi * 10)  # tenths of a revolution per minute
    log = read(tmp_path, other={"606Ch": speed}, units=UNITS)
    assert log.runs[0].velocity is None
    assert any("'606Ch' is left out" in warning for warning in log.warnings)
    given = read(tmp_path, other={"606Ch": speed}, units=UNITS | {"velocity": "rpm/10"})
    np.testing.assert_allclose(given.runs[0].velocity, SOUND["velocity"], atol=0.006)


def test_a_linear_axis(tmp_path):
    table = {"time": SOUND["time"], "6064h": np.round(1e6 * SOUND["angle"]), "6077h": PER_MILLE}
    path = write_csv(tmp_path / "drive.csv", table)
    log = Log.read(path, units={"position": "um", "force": "120N/1000"})
    assert log.axis == "linear"
    np.testing.assert_allclose(log.runs[0].output, SOUND["angle"], atol=1e-6)
    np.testing.assert_allclose(log.runs[0].command, 0.12 * PER_MILLE)


def test_through_the_command_line(tmp_path):
    table = recorded(duration=8.0)
    drive = {
        "time": table["time"],
        "Position actual value": np.round(table["angle"] * COUNTS / (2 * np.pi)),
        "Torque actual value": np.round(1e3 * table["torque"] / RATED),
    }
    path = write_csv(tmp_path / "drive.csv", drive)
    words = ("identify", path, "--out", tmp_path / "out", "--quiet")
    refused = antidrive(*words)
    assert refused.code == 2
    assert refused.err.count("\n") == 1
    assert "--unit angle=turn/131072" in refused.err
    result = antidrive(*words, "--unit", "angle=turn/131072", "--unit", "torque=2.4Nm/1000")
    assert (result.code, result.err) == (0, "")


FACTORS = {
    ("angle", "turn/131072"): 2 * np.pi / 131072,
    ("angle", "°"): np.pi / 180,
    ("torque", "2.4 N m/1000"): 0.0024,
    ("torque", "permille*2.4*N*m"): 0.0024,
    ("torque", "N·m"): 1.0,
    ("torque", "mNm"): 1e-3,
    ("torque", "kg*m^2/s^2"): 1.0,
    ("velocity", "1/min"): np.pi / 30,  # of a shaft, it is turns that are counted
    ("velocity", "min^-1"): np.pi / 30,
    ("velocity", "U/min"): np.pi / 30,
    ("velocity", "turn/131072/s"): 2 * np.pi / 131072,
}


@pytest.mark.parametrize(("column", "unit"), FACTORS)
def test_units_with_a_factor(column, unit):
    assert si_factor(column, unit, "rotary") == pytest.approx(FACTORS[column, unit], rel=1e-12)


@pytest.mark.parametrize(
    ("column", "unit"),
    [
        ("angle", "counts"),
        ("angle", "counts/131072"),
        ("angle", "2.4"),
        ("velocity", "counts/s"),
        ("velocity", "Hz"),
        ("velocity", "1/s"),
        ("torque", "permille"),
        ("torque", "%"),
        ("angle", "0*rad"),
        ("angle", "-1*rad"),
        ("angle", "9**9**9**9"),
        ("angle", "rad**9**9**9**9"),
        ("angle", "9⁹⁹⁹⁹⁹⁹⁹⁹⁹"),
        ("angle", "rad" * 20),
    ],
)
def test_units_of_no_size(column, unit):
    with pytest.raises(BadParameter) as caught:
        si_factor(column, unit, "rotary")
    check_sentence(str(caught.value))
