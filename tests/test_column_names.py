"""Columns are known by what their names mean, and a heading may carry the unit."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np
import pytest
from sample_logs import motion, text

from identification import Log, MalformedLog, MissingColumns
from identification.reading.column_meaning import AMONG_OTHERS, COMMANDED, OWN, SYNONYM, meaning
from identification.reading.headings import heading
from identification.reading.units import kind_of

CASES = Path(__file__).parents[1].parent / "shared" / "cases"
SOUND = motion(samples=600)
TIME, TORQUE, ANGLE = SOUND["time"], SOUND["torque"], SOUND["angle"]


@pytest.fixture
def csv(tmp_path):
    def write(columns):
        path = tmp_path / "log.csv"
        path.write_text(text(columns), encoding="utf-8")
        return path

    return write


def same(log):
    """Whether it is the sound log, in SI."""
    (run,) = log.runs
    np.testing.assert_allclose(run.time - run.time[0], TIME - TIME[0], rtol=0, atol=1e-7)
    np.testing.assert_allclose(run.command, TORQUE, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(run.output, ANGLE, rtol=1e-7, atol=1e-7)
    return True


@pytest.mark.parametrize(
    ("name", "words", "unit"),
    [
        ("Time (s)", "time", "s"),
        ("time_ms", "time", "ms"),
        ("Torque [mNm]", "torque", "mNm"),
        ("Torque (N·m)", "torque", "N·m"),
        ("\ufeffAngle (deg)", "angle", "deg"),
        ("velocity_rad_s", "velocity", "rad/s"),
        ("ENC1Position", "enc 1 position", ""),
        ("knee[DephyActpack]:output_position", "knee dephy actpack output position", ""),
        ("θ", "theta", ""),
        ("Torque (filtered)", "torque filtered", ""),
        ("I_A", "i", "A"),
        ("encoder_ticks", "encoder", "count"),
        ("encoder_steps", "encoder", "count"),
        ("micros", "micros", "us"),
        ("rpm", "rpm", "rpm"),
        ("leftSpeedRpm", "left speed", "rpm"),
        ("timeMs", "time", "ms"),
        ("PositionRad", "position", "rad"),
        ("VelocityRadPerSec", "velocity", "rad/s"),
        ("AppliedVolts", "applied", "volts"),
        ("Grad", "grad", ""),
        ("Vitesse (tr/min)", "vitesse", "tr/min"),
    ],
)
def test_a_heading_is_words_and_a_unit(name, words, unit):
    found = heading(name)
    assert (" ".join(found.words), found.unit) == (words, unit)


@pytest.mark.parametrize(
    ("name", "column", "grade"),
    [
        ("Torque [mNm]", "torque", OWN),
        ("effort", "torque", SYNONYM),
        ("tau_meas", "torque", SYNONYM),
        ("i_q", "current", SYNONYM),
        ("u [V]", "voltage", AMONG_OTHERS),
        ("pos_estimate", "position", SYNONYM),
        ("q_d", "setpoint", SYNONYM),
        ("Position (rotations)", "angle", OWN),
        ("duty_cycle", "duty", SYNONYM),
        ("theta", "angle", SYNONYM),
        ("q3", "angle", AMONG_OTHERS),
        ("dq3", "velocity", AMONG_OTHERS),
        ("ENC1Position [deg]", "angle", AMONG_OTHERS),
        ("pos_mm", "position", SYNONYM),
        ("theta_m", "angle", AMONG_OTHERS),
        ("Motor Optical Speed (RPM)", "velocity", AMONG_OTHERS),
        ("target_position", "setpoint", SYNONYM),
        ("episode_index", "run", SYNONYM),
        ("q_axis_current", "current", SYNONYM),
        ("Current q", "current", SYNONYM),
        ("Voltage q", "voltage", SYNONYM),
        ("Iq_setpoint", "current", COMMANDED),
        ("u_nm", "torque", AMONG_OTHERS),
        ("T_reg [s]", "time", AMONG_OTHERS),
        ("Position angulaire (°)", "angle", SYNONYM),
        ("Consigne_position", "setpoint", SYNONYM),
        ("ms_today", "time", SYNONYM),
        ("leftSpeedRpm", "velocity", AMONG_OTHERS),
        ("AppliedVolts", "voltage", AMONG_OTHERS),
        ("Measured Current [Amps]", "current", SYNONYM),
    ],
)
def test_a_name_means_a_quantity(name, column, grade):
    found = meaning(name)
    assert (found.column, found.grade) == (column, grade)


@pytest.mark.parametrize(
    "name",
    [
        "ddq3",
        "MaxTorque",
        "batteryVoltage",
        "SupplyCurrentAmps",
        "SpeedRef",
        "position error",
        "TestIndex",
        "x",
        "temperature",
        "i_d",
        "dq_d",
        "d_axis_current",
        "dt_ms",
        "phase_A",
    ],
)
def test_a_name_of_something_else_means_nothing(name):
    assert meaning(name) is None


@pytest.mark.parametrize(
    "names",
    [
        ("Time (s)", "Torque [N m]", "Angle (rad)"),
        ("timestamp", "effort", "position"),
        ("t", "tau", "q"),
        ("Zeit [s]", "Drehmoment [Nm]", "Winkel [rad]"),
        ("OSL:timestamp", "a1 torque [Nm]", "a1 position [rad]"),
        ("TIME", "Joint_Torque", "ENC1Position"),
        ("Temps (s)", "Couple (N.m)", "Angle"),
        ("tiempo", "par", "posición"),
        ("时间(s)", "扭矩(Nm)", "角度(rad)"),
    ],
)
def test_logs_of_other_names_are_read(csv, names):
    assert same(Log.read(csv(dict(zip(names, (TIME, TORQUE, ANGLE), strict=True)))))


def test_a_unit_of_a_heading_is_used_and_reported(csv):
    columns = {"time_ms": 1e3 * TIME, "Torque [mNm]": 1e3 * TORQUE, "Angle (deg)": np.degrees(ANGLE)}
    log = Log.read(csv(columns))
    assert same(log)
    assert any("'Angle (deg)' in deg" in reported and "'Torque [mNm]' in mNm" in reported for reported in log.warnings)


def test_a_unit_that_nobody_gave_is_reported(csv):
    log = Log.read(csv({"t": TIME, "tau": TORQUE, "pos": ANGLE}))
    assert any(
        "'pos' as angle in rad" in reported and "'tau' as torque in N m" in reported for reported in log.warnings
    )
    given = Log.read(csv({"t": TIME, "tau": TORQUE, "pos": ANGLE}), units={"angle": "turn"}, scales={"torque": 2.0})
    assert not any("angle in" in reported or "torque in" in reported for reported in given.warnings)


def test_measured_columns_have_priority_over_commanded_ones(csv):
    columns_given = {"time": TIME, "drive.Iq_setpoint": 0 * TORQUE, "drive.Iq_measured": TORQUE, "theta": ANGLE}
    assert same(Log.read(csv(columns_given)))


def test_shafts_of_two_motors_are_not_the_load(csv):
    torques = {"M1_torque": TORQUE / 2, "M2_torque": TORQUE / 2}
    angles = {"M1_angle": 8 * ANGLE, "M2_angle": 8 * ANGLE, "load angle": ANGLE}
    log = Log.read(csv({"time": TIME, **torques, **angles}))
    assert same(log)
    assert any("'M2_angle' as angle_2" in reported for reported in log.warnings)


def test_a_position_in_counts_is_an_angle_where_a_torque_drives(csv):
    path = csv({"time": TIME, "Torque (Nm)": TORQUE, "Position (counts)": np.round(1e6 * ANGLE)})
    with pytest.raises(MalformedLog, match="--unit angle=turn"):
        Log.read(path)
    assert Log.read(path, units={"angle": "rad/1000000"}).axis == "rotary"


def test_speed_of_the_field_asks_for_the_pole_pairs(csv):
    speed = np.gradient(ANGLE, TIME)
    path = csv({"ms_today": 1e3 * TIME, "q_axis_current": TORQUE, "d_axis_current": 0 * TIME, "erpm": speed})
    with pytest.raises(MalformedLog, match="--unit velocity=rpm/7"):
        Log.read(path)
    (run,) = Log.read(path, units={"velocity": "rpm/7"}).runs
    turned = np.trapezoid(speed, TIME) * np.pi / 30 / 7
    assert run.output[-1] - run.output[0] == pytest.approx(turned, rel=1e-6)


def test_the_command_to_type_names_what_the_file_has(csv):
    path = csv({"t": TIME, "i_1": TORQUE, "i_2": TORQUE, "omega a": ANGLE, "omega b": ANGLE})
    with pytest.raises(MissingColumns) as refused:
        Log.read(path)
    assert refused.value.options == "--map current=i_1 --map 'velocity=omega a'"
    np.savetxt(path, np.column_stack((np.arange(600), TORQUE, ANGLE)), fmt="%.12g")  # numbers of the rows are no time
    with pytest.raises(MissingColumns, match="--rate HZ --map torque=NAME"):
        Log.read(path)
    labels = "".join(f"slow,{a},{b}\n" for a, b in zip(TORQUE, ANGLE, strict=True))
    path.write_text(f"part,torque,angle\n{labels}")
    with pytest.raises(MissingColumns, match="--rate HZ"):  # a label is no time
        Log.read(path)
    path.write_text("when,torque,angle\n" + labels.replace("slow", "10:12:03"))
    with pytest.raises(MissingColumns, match="--map time=when"):
        Log.read(path)


@pytest.mark.parametrize(
    ("column", "unit", "size"),
    [
        ("angle", "rev", 2 * np.pi),
        ("Winkel", "Grad", np.pi / 180),
        ("angle", "DEG", np.pi / 180),
        ("velocity", "RPM", np.pi / 30),
        ("velocity", "rev/s", 2 * np.pi),
        ("velocity", "Grad/s", np.pi / 180),
        ("velocity", "rps", 2 * np.pi),
        ("torque", "oz-in", 0.0070615518),
        ("torque", "in-lbf", 0.1129848290),
        ("torque", "ft-lbs", 1.3558179483),
        ("torque", "kg.cm", 0.0980665),
        ("torque", "nm", 1.0),
        ("torque", "NM", 1.0),
        ("torque", "mNm", 1e-3),
    ],
)
def test_units_as_the_trade_writes_them(csv, column, unit, size):
    """None is passed over: the log would be read in another unit without a word."""
    measured = {"angle": ANGLE, "Winkel": ANGLE, "velocity": np.gradient(ANGLE, TIME), "torque": TORQUE}
    columns = {"time": TIME, "torque": TORQUE, "angle": ANGLE} | {f"{column} [{unit}]": measured[column] / size}
    if column == "velocity":
        columns.pop("angle")
    columns.pop("torque" if column == "torque" else "angle", None)
    log = Log.read(csv(columns))
    assert any(f"'{column} [{unit}]' in {unit}" in reported for reported in log.warnings)
    (run,) = log.runs
    np.testing.assert_allclose(run.command, TORQUE, rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(
        run.output - run.output[0], ANGLE - ANGLE[0], atol=1e-3 if column == "velocity" else 1e-6
    )


@pytest.mark.parametrize(
    ("unit", "kind"),
    [("A", "A"), ("V", "V"), ("Nm", "N m"), ("NM", "N m"), ("nm", "m"), ("2.4Nm/1000", "N m"), ("m", "m")],
)
def test_capitals_count_where_they_mean_something(unit, kind):
    assert kind_of(unit) == kind


def test_nanometres_are_no_newton_metres(csv):
    log = Log.read(csv({"time": TIME, "force": TORQUE, "position [nm]": 1e9 * ANGLE}))
    np.testing.assert_allclose(log.runs[0].output, ANGLE, atol=1e-7)


def test_counts_are_no_radians(csv):
    path = csv({"time": TIME, "torque": TORQUE, "encoder_ticks": np.round(1e3 * ANGLE)})
    with pytest.raises(MalformedLog, match="the size of one step"):
        Log.read(path)
    assert Log.read(path, units={"angle": "mrad"}).axis == "rotary"


def test_the_users_unit_overrides_the_heading(csv):
    columns = {"time": TIME, "torque": TORQUE, "Angle (deg)": 1e3 * ANGLE}
    assert same(Log.read(csv(columns), units={"angle": "mrad"}))


def test_a_column_that_is_mapped_is_no_longer_its_own(csv):
    path = csv({"time": TIME, "torque": TORQUE, "angle": 0 * ANGLE, "position": ANGLE})
    assert same(Log.read(path, mapping={"angle": "position"}))
    assert Log.read(csv({"time": TIME, "force": TORQUE, "position": ANGLE})).axis == "linear"


def test_columns_may_be_counted(csv):
    path = csv({"a": TIME, "b": ANGLE, "c": TORQUE})
    assert same(Log.read(path, mapping={"time": "1", "angle": "2", "torque": "3"}))
    named = csv({"2": TIME, "b": TORQUE, "c": ANGLE})  # a name comes before a place
    assert same(Log.read(named, mapping={"time": "2", "torque": "b", "angle": "3"}))


def test_a_matrix_without_names_and_time(tmp_path):
    path = tmp_path / "dump.dat"
    np.savetxt(path, np.column_stack((TORQUE, ANGLE)), fmt="%.12g")
    rate = 1.0 / float(TIME[1] - TIME[0])
    assert same(Log.read(path, mapping={"torque": "1", "angle": "2"}, rate=rate))
    with pytest.raises(MissingColumns, match="--rate HZ"):
        Log.read(path, mapping={"torque": "1", "angle": "2"})


def test_a_torque_like_the_speed_needs_a_stated_unit(csv):
    speed = motion(samples=3000)
    columns = {"time": speed["time"], "angle": speed["angle"]}
    (fault,) = Log.read(csv(columns | {"torque": speed["velocity"]})).faults
    assert "a speed or its set-point was taken" in fault
    for log in (
        Log.read(csv(columns | {"torque [Nm]": speed["velocity"]})),
        Log.read(csv(columns | {"torque": speed["velocity"]}), units={"torque": "N*m"}),
    ):
        assert not log.faults
        assert any("neither inertia nor dry friction" in reported for reported in log.warnings)


def test_all_that_is_missing_is_reported_at_once(csv):
    torques = ("FC1Torque", "FC2Torque", "FC3Torque")
    with pytest.raises(MissingColumns) as caught:
        Log.read(csv({"b c": TIME, **dict.fromkeys(torques, TORQUE), "angle a": ANGLE, "b": TIME, "angle d": ANGLE}))
    sentence, *table = str(caught.value).splitlines()
    assert all(f"'{name}'" in sentence for name in ("time", "torque", "angle"))
    assert [line.split()[0] for line in table[1:-1]] == [
        "b",
        "FC1Torque",
        "FC2Torque",
        "FC3Torque",
        "angle",
        "b",
        "angle",
    ]
    assert "torque?" in table[2]
    assert f"{TORQUE.min():.4g} .. {TORQUE.max():.4g}" in table[2]
    assert caught.value.options == "--map time=NAME --map torque=FC1Torque --map 'angle=angle a'"
    assert shlex.split(caught.value.options)[-1] == "angle=angle a"


def test_two_equally_sure_effects_exclude_a_less_sure_one(csv):
    with pytest.raises(MissingColumns, match="the command"):
        Log.read(csv({"time": TIME, "tau": TORQUE, "trq": TORQUE, "Load torque": TORQUE, "angle": ANGLE}))


def test_two_torques_of_two_motors_are_a_pair(csv):
    log = Log.read(csv({"time": TIME, "FC1Torque": TORQUE, "FC2Torque": 0 * TORQUE, "angle": ANGLE}), gears=Plain())
    assert same(log)


class Plain:
    """Two motors right on the load."""

    torque_map = np.array([1.0, 1.0])


def test_a_speed_does_not_replace_an_ambiguous_angle(csv):
    path = csv({"time": TIME, "torque": TORQUE, "angle a": ANGLE, "angle b": ANGLE, "velocity": SOUND["velocity"]})
    with pytest.raises(MissingColumns, match="the response"):
        Log.read(path)


@pytest.mark.parametrize("name", ["log_a", "log_b", "log_c"])
def test_public_headings_with_units(name):
    path = CASES / "logs" / "09-units-in-headings" / f"{name}.csv"
    if not path.exists():
        pytest.skip("the case is not on this machine")
    log = Log.read(path)
    assert log.runs[0].sample_time == pytest.approx(0.01)
    assert not log.faults  # the torque of a load of viscous friction alone is as its speed
    (run,), (in_si,) = log.runs, Log.read(path.with_name("log_b.csv")).runs  # the same experiment
    np.testing.assert_allclose(run.output, in_si.output, atol=2e-4)
    np.testing.assert_allclose(run.command, in_si.command, atol=2e-3)


@pytest.mark.parametrize("mapping", [{}, {"torque": "effort", "angle": "position"}], ids=["as it is", "mapped"])
def test_ros_joint_states(mapping):
    path = CASES / "use" / "02-ros-joint-states" / "joint_states.csv"
    if not path.exists():
        pytest.skip("the case is not on this machine")
    log = Log.read(path, mapping=mapping)
    assert (log.axis, log.command_unit, len(log.runs[0])) == ("rotary", "N m", 1600)


def test_headings_of_mnm_and_degrees():
    path = CASES / "use" / "01-csv-header-units" / "header_units.csv"
    if not path.exists():
        pytest.skip("the case is not on this machine")
    (run,) = Log.read(path).runs
    assert np.abs(run.command).max() < 10.0  # N m, and not mN m
    assert np.ptp(run.output) < 10.0


def test_a_public_file_of_many_columns():
    path = CASES / "logs" / "08-hint-by-spelling" / "log.csv"
    if not path.exists():
        pytest.skip("the case is not on this machine")
    with pytest.raises(MissingColumns) as caught:
        Log.read(path)
    assert "GainTorque" not in caught.value.options
    assert caught.value.options == "--map torque=FC1Torque --map angle=ENC1Position"
    assert len(str(caught.value).splitlines()) == 29  # a sentence, 26 columns below their headings, what to type


def test_a_public_file_with_one_column_of_each_kind():
    path = CASES / "logs" / "08-hint-by-spelling" / "log2.csv"
    if not path.exists():
        pytest.skip("the case is not on this machine")
    with pytest.raises(MalformedLog, match="too short"):  # q3 and q3_tau_J are known
        Log.read(path)


@pytest.mark.parametrize(
    ("name", "words", "unit"),
    [
        ("act_pos_deg:2", ("act", "pos", "2"), "deg"),
        ("act_torque_nm:1", ("act", "torque", "1"), "N*m"),
        ("vel_deg_per_s", ("vel",), "deg/s"),
        ("act_vel_deg_per_s:2", ("act", "vel", "2"), "deg/s"),
        ("Efficiency (kgf/W)", ("efficiency",), ""),
    ],
)
def test_units_of_a_matrix_and_of_a_rate(name, words, unit):
    assert (heading(name).words, heading(name).unit) == (words, unit)


def test_an_unknown_unit_is_no_quantity():
    assert meaning("Efficiency (kgf/W)") is None


def test_the_unit_of_a_matrix_is_that_of_its_columns(tmp_path):
    degrees = np.column_stack((0 * ANGLE, np.degrees(ANGLE)))
    np.savez(tmp_path / "log.npz", time=TIME, torque=TORQUE, pos_deg=degrees)
    assert same(Log.read(tmp_path / "log.npz", mapping={"angle": "pos_deg:2"}))


def test_a_channel_that_is_not_connected_is_not_used(csv):
    idle = {"time": TIME, "torque": TORQUE, "position left": 0 * ANGLE, "position right": ANGLE}
    assert same(Log.read(csv(idle)))
    with pytest.raises(MissingColumns):
        Log.read(csv(idle | {"position left": 2 * ANGLE}))


def test_a_motor_that_rests_is_one_of_two(csv):
    log = Log.read(csv({"time": TIME, "tau_1": TORQUE, "tau_2": 0 * TORQUE, "angle": ANGLE}))
    assert any("'tau_1' as torque_1" in warning and "'tau_2' as torque_2" in warning for warning in log.warnings)


def test_numbers_of_columns_are_no_drive_objects(tmp_path):
    np.save(tmp_path / "wide.npy", np.zeros((60, 6100)))
    np.savetxt(tmp_path / "wide.txt", np.random.default_rng(0).standard_normal((3, 6100)), fmt="%.3f")
    for name in ("wide.npy", "wide.txt"):
        with pytest.raises(MalformedLog) as caught:
            Log.read(tmp_path / name, rate=100)
        assert "6077" not in str(caught.value).partition("\n")[0]


@pytest.mark.parametrize("force", [0.0 * TIME, np.sin(TIME)])
def test_a_load_cell_beside_the_current_is_left_out(csv, force):
    log = Log.read(csv({"time": TIME, "current": TORQUE, "angle": ANGLE, "force": force}))
    np.testing.assert_allclose(log.runs[0].command, TORQUE, rtol=1e-7, atol=1e-7)
    assert log.axis == "rotary"


def test_a_torque_that_is_always_zero_is_left_out(csv):
    log = Log.read(csv({"time": TIME, "torque": 0 * TIME, "current": TORQUE, "angle": ANGLE}))
    assert log.command_unit == "A"


def test_a_force_alone_still_needs_a_position(csv):
    with pytest.raises(MalformedLog, match="'force' does not go with 'angle'"):
        Log.read(csv({"time": TIME, "force": TORQUE, "angle": ANGLE}))


def test_a_joint_that_rests_is_not_passed_over(csv):
    with pytest.raises(MissingColumns):
        Log.read(csv({"time": TIME, "torque": TORQUE, "q1": 0 * ANGLE, "q2": ANGLE}))


@pytest.mark.parametrize("name", ["i2t", "motor_i2t [%]", "I2T"])
def test_the_load_of_a_motor_winding_is_no_time(name) -> None:
    assert meaning(name) is None


def test_a_refusal_of_a_wide_table_lists_what_may_be_used(csv) -> None:
    wide = {f"trace_{place:03}": SOUND["torque"] for place in range(200)} | {"Torque": TORQUE, "time": TIME}
    with pytest.raises(MissingColumns) as refused:
        Log.read(csv(wide))
    listed = str(refused.value).splitlines()
    assert len(listed) < 70
    assert any(line.split()[:1] == ["time"] for line in listed)
    assert any(line.strip() == "and 142 other columns" for line in listed)
