"""What drives the load is a torque, or what stands in its place: a current, a voltage, a duty, a set-point."""

import json
from math import cos
from pathlib import Path

import numpy as np
import pytest

from identification import fit
from identification.errors import MalformedLog, MissingColumns, UnusableLog
from identification.log import Log
from identification.simulation import free_simulation
from mpc import Controller
from plant import ServoModel, read_model
from plant.errors import BadParameter
from plant.gears import GearTrain, Ratios
from plant.model_file import ModelFile
from plant.simulation import simulate

DT = 0.005
TIME = np.arange(3000) * DT
J, ALPHA, K = 0.05, 0.4, 0.08
LOGS = Path(__file__).parents[1].parent / "shared" / "cases" / "logs"


def moved(torque, kp=0.0, kd=0.0, limit=np.inf, noise=2e-4, fine=20):
    """Angle of J v' = drive - alpha cos x - K v by small steps, with the drive's law inside the sample."""
    torque, x, v, h, angle = np.asarray(torque), -np.pi / 2, 0.0, DT / fine, np.empty(torque.size)
    kp, kd = (np.broadcast_to(gain, torque.shape).tolist() for gain in (kp, kd))
    for k, held in enumerate(torque.tolist()):
        angle[k] = x
        for _ in range(fine):
            half, mid = x + h / 2 * v, v
            for _ in range(2):
                drive = max(min(held - kp[k] * half - kd[k] * mid, limit), -limit)
                mid = v + h / 2 * (drive - ALPHA * cos(half) - K * mid) / J
            x, v = x + h * mid, 2 * mid - v
    return angle + noise * np.random.default_rng(1).standard_normal(torque.size)


def excited(size):
    """A staircase and a sweep, of that size."""
    steps = np.repeat(np.random.default_rng(5).uniform(-1, 1, 30), 100)
    return size * (0.6 * steps + 0.4 * np.sin(2 * np.pi * (0.2 + 0.1 * TIME) * TIME))


TORQUE = excited(1.0)
ANGLE = moved(TORQUE)


@pytest.fixture(scope="module")
def in_torque():
    return fit(Log.from_arrays(time=TIME, torque=TORQUE, angle=ANGLE))


def test_a_current_with_its_torque_constant_is_a_torque(in_torque):
    log = Log.from_arrays(time=TIME, current=TORQUE / 0.11, angle=ANGLE, torque_constant=0.11)
    assert (log.command_unit, log.notes) == ("N m", ())
    np.testing.assert_allclose(log.runs[0].command, TORQUE)
    beside = Log.from_arrays(time=TIME, torque=TIME, current=TORQUE / 0.11, angle=ANGLE, torque_constant=0.11)
    np.testing.assert_allclose(beside.runs[0].command, TORQUE)  # what has a constant was meant
    with pytest.raises(BadParameter, match="no column 'current'"):
        Log.from_arrays(time=TIME, torque=TORQUE, angle=ANGLE, torque_constant=0.11)


@pytest.mark.parametrize(
    ("column", "unit", "message"),
    [("current", "A", "per ampere"), ("voltage", "V", "per volt"), ("duty", "duty", "per unit of duty")],
)
def test_parameters_are_per_unit_of_an_unscaled_command(in_torque, column, unit, message, tmp_path):
    log = Log.from_arrays(**{"time": TIME, column: 8.0 * TORQUE, "angle": ANGLE})
    assert message in log.notes[0]
    assert log.command_unit == unit
    found = fit(log)
    assert [p.unit for p in found.parameters[:3]] == [f"{unit} s^2/rad", unit, f"{unit} s/rad"]
    for name in ("inertia", "gravity", "viscous_friction"):
        assert found[name].value == pytest.approx(8.0 * in_torque[name].value, rel=1e-3)
    assert "N m" not in str(found)
    assert "kg" not in str(found)
    ModelFile(model=found.model, std={}).write(tmp_path / "model.json")
    text = (tmp_path / "model.json").read_text()
    assert "N m" not in text
    assert "kg" not in text
    assert json.loads(text)["torque_unit"] == unit
    again = read_model(tmp_path / "model.json").model
    assert again == found.model
    with pytest.raises(BadParameter, match=f"model is in {unit}, the log's command in N m"):
        free_simulation(in_torque.log, again)
    with pytest.raises(BadParameter, match=f"model is in {unit}, the log's command in N m"):
        fit(in_torque.log, again)
    with pytest.raises(BadParameter, match=f"model is in N m, the log's command in {unit}"):
        free_simulation(log, in_torque.model)


def test_a_controller_in_newton_metres_takes_no_model_in_volts():
    with pytest.raises(BadParameter, match="the model is in V"):
        Controller(ServoModel(torque_unit="V"), GearTrain.paper())


def test_a_duty_may_be_in_per_cent():
    share = Log.from_arrays(time=TIME, duty=TORQUE, angle=ANGLE).runs[0].command
    percent = Log.from_arrays(time=TIME, duty=100 * TORQUE, angle=ANGLE, units={"duty": "%"}).runs[0].command
    np.testing.assert_allclose(percent, share)
    counted = Log.from_arrays(time=TIME, duty=255 * TORQUE, angle=ANGLE, units={"duty": "1/255"}).runs[0].command
    np.testing.assert_allclose(counted, share)
    with pytest.raises(BadParameter, match="--unit duty=1/255"):
        Log.from_arrays(time=TIME, duty=255 * TORQUE, angle=ANGLE, units={"duty": "count"})


@pytest.mark.parametrize("unit", ["Nms/rad", "N m s/rad", "Nm*s/rad"])
def test_units_of_gains_as_people_write_them(unit):
    given = {"time": TIME, "angle": ANGLE, "setpoint": TORQUE, "kp": TIME + 1.0, "kd": 0.1 * TIME}
    run = Log.from_arrays(**given, units={"kp": "Nm/deg", "kd": unit}).runs[0]
    np.testing.assert_allclose(run.servo_gain, np.rad2deg(TIME + 1.0))
    np.testing.assert_allclose(run.servo_damping, 0.1 * TIME)


def test_what_is_mapped_comes_before_what_has_the_right_name(tmp_path):
    table = np.column_stack((TIME, TORQUE, 5 * TORQUE, ANGLE))
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header="time,torque,U,angle", comments="")
    assert Log.read(tmp_path / "log.csv").command_unit == "N m"
    assert Log.read(tmp_path / "log.csv", mapping={"voltage": "U"}).command_unit == "V"


def test_a_model_file_of_before_is_in_newton_metres(tmp_path):
    content = ModelFile(model=ServoModel(), std={}).to_dict()
    assert content.pop("torque_unit") == "N m"
    (tmp_path / "model.json").write_text(json.dumps(content))
    assert read_model(tmp_path / "model.json").model.torque_unit is None


def test_a_position_servo_is_identified_from_its_set_point():
    kp, kd, setpoint = 6.0, 0.3, -np.pi / 2 + excited(1.0)
    angle = moved(kp * setpoint, kp, kd)
    log = Log.from_arrays(time=TIME, setpoint=setpoint, angle=angle, kp=kp, kd=kd)
    assert (log.command_unit, log.notes) == ("N m", ())
    found = fit(log)
    for name, true in (("inertia", J), ("gravity", ALPHA), ("viscous_friction", K)):
        assert abs(found[name].value - true) < 4.0 * found[name].std + 2e-3 * true, name
        assert found[name].std < 0.05 * true
    unknown = fit(Log.from_arrays(time=TIME, setpoint=setpoint, angle=angle))
    assert [p.unit for p in unknown.parameters[:3]] == ["s^2", "rad", "s"]
    assert "viscous friction includes the damping by the servo's kd" in unknown.log.notes[0]
    for name, true in (("inertia", J), ("gravity", ALPHA), ("viscous_friction", K + kd)):
        assert unknown[name].value == pytest.approx(true / kp, rel=0.02), name


def test_gains_are_columns_that_change_within_the_log():
    """At a limit the damping is not viscous friction: what the drive cannot give does not brake."""
    kp, kd, setpoint = np.where(TIME < 7.0, 6.0, 3.0), np.where(TIME < 5.0, 0.3, 0.6), -np.pi / 2 + excited(1.0)
    angle = moved(kp * setpoint, kp, kd)
    found = fit(Log.from_arrays(time=TIME, setpoint=setpoint, angle=angle, kp=kp, kd=kd))
    for name, true in (("inertia", J), ("gravity", ALPHA), ("viscous_friction", K)):
        assert abs(found[name].value - true) < 4.0 * found[name].std + 2e-3 * true, name


def test_the_drives_damping_acts_within_its_limit():
    setpoint = -np.pi / 2 + excited(1.0)
    model = ServoModel(inertia=J, gravity=ALPHA, viscous_friction=K)
    begin = np.array([-np.pi / 2, 0.0])
    for limit in (np.inf, 1.0):
        given = {"command": 6.0 * setpoint, "servo_gain": 6.0, "servo_damping": 0.3, "command_limit": limit}
        played = simulate(model, dt=DT, state=begin, substeps=4, **given)
        exact = moved(6.0 * setpoint, 6.0, 0.3, limit, noise=0.0, fine=40)
        assert np.abs(played[:-1, 0] - exact).max() < 2e-4


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"setpoint": ANGLE, "kd": 0.5}, "kd is given without kp"),
        ({"torque": TORQUE, "kp": 20.0}, "no column 'setpoint'"),
        ({"setpoint": ANGLE, "units": {"setpoint": "rad/s"}}, "set-point of the speed"),
        ({"setpoint": ANGLE, "units": {"setpoint": "rpm"}}, "set-point of the speed"),
        ({"voltage": TORQUE, "units": {"voltage": "N m"}}, "cannot be converted to V"),
    ],
)
def test_what_makes_no_command_is_refused(given, message):
    with pytest.raises((BadParameter, MalformedLog), match=message):
        Log.from_arrays(time=TIME, angle=ANGLE, **given)


def test_gear_trains_and_ratios_are_read():
    assert GearTrain.parse("20,20:161") == GearTrain(pinion_teeth=(20, 20), output_teeth=161)
    assert GearTrain.parse(" 20 : 161") == GearTrain.parse("20,20:161")
    assert Ratios.parse("8.05").torque_map.tolist() == [8.05, 8.05]
    assert Ratios.parse(-8.05).torque_map.tolist() == [-8.05, -8.05]
    assert Ratios.parse("8.05, -8.05").torque_map.tolist() == [8.05, -8.05]
    for text in ("20,20", "20,20,20:161", "20.5:161", "", "0:161"):
        with pytest.raises(BadParameter, match=r"tooth count|write the teeth"):
            GearTrain.parse(text)
    for text in ("", "8.05,1,2", "0", "nan", "8:1"):
        with pytest.raises(BadParameter, match="ratio"):
            Ratios.parse(text)


def test_gears_of_a_log_of_one_torque_are_reported_to_do_nothing():
    log = Log.from_arrays(time=TIME, torque=TORQUE, angle=ANGLE, gears=Ratios.parse("50"))
    np.testing.assert_allclose(log.runs[0].command, TORQUE)
    assert any("not applied to 'torque'" in note and "--scale torque=RATIO" in note for note in log.notes)
    pair = Log.from_arrays(time=TIME, torque_1=TORQUE, torque_2=TORQUE, angle=ANGLE, gears=Ratios.parse("50"))
    assert pair.notes == ()


def test_the_torques_of_two_motors_are_added_and_reported():
    path = LOGS / "03-hidden-gears" / "log.csv"
    if not path.exists():
        pytest.skip("the case of hidden gears is not here")
    options = {"units": {"angle": "deg"}, "scales": {"torque_2": -1.0}}
    log = Log.read(path, **options)
    assert any("no gear train is given" in note for note in log.notes)
    first, second = log.runs[0].torques.T
    np.testing.assert_allclose(log.runs[0].command, first + second)
    geared = Log.read(path, gears=Ratios.parse("8.05"), **options)
    np.testing.assert_allclose(geared.runs[0].command, 8.05 * (first + second))
    assert not any("gear train" in note for note in geared.notes)


FIRST, SECOND = 0.4 + np.maximum(TORQUE, 0.0), 0.4 - np.minimum(TORQUE, 0.0)  # each pushes in its own direction


def test_currents_of_two_motors_are_torques_at_their_pinions():
    currents = {"current_1": FIRST / 0.11, "current_2": SECOND / 0.11}
    how = {"time": TIME, "angle": ANGLE, "gears": Ratios(ratios=(1.0, -1.0))}
    log = Log.from_arrays(**currents, **how, torque_constant=0.11)
    assert (log.command_unit, log.notes) == ("N m", ())
    np.testing.assert_allclose(log.runs[0].command, TORQUE, atol=1e-12)
    np.testing.assert_allclose(log.runs[0].torques, np.column_stack((FIRST, SECOND)))
    without = Log.from_arrays(**currents, **how)
    assert without.command_unit == "A"
    assert any("per ampere; give the motor's" in note for note in without.notes)
    np.testing.assert_allclose(without.runs[0].command, TORQUE / 0.11, atol=1e-12)
    assert without.runs[0].torques is None
    with pytest.raises(MissingColumns, match="'current_1' and 'current_2'"):  # one of two is no command
        Log.from_arrays(time=TIME, angle=ANGLE, current_1=FIRST)


def test_the_sign_of_one_of_two_currents_is_told():
    with pytest.raises(UnusableLog, match="--scale current_2=-1 turns it"):
        Log.from_arrays(time=TIME, angle=ANGLE, current_1=FIRST, current_2=SECOND).usable()


def test_two_motors_push_a_linear_axis():
    torques = {"torque_1": 0.3 + TORQUE, "torque_2": 0.3 - TORQUE}
    how = {"units": {"position": "mm"}, "gears": Ratios(ratios=(40.0, -40.0))}
    log = Log.from_arrays(time=TIME, position=1e3 * ANGLE, **torques, **how)
    assert (log.axis, log.command_unit) == ("linear", "N")
    np.testing.assert_allclose(log.runs[0].command, 80.0 * TORQUE, atol=1e-12)
