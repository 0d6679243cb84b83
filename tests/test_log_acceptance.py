"""What makes a log unusable stops at the door with one sentence; right logs of all kinds pass."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from front_door import antidrive, columns, write_csv
from valid_logs import KINDS, Drawn, Ratio, draw

from diagnosis import diagnose
from identification import Log, Unidentifiable, UnusableLog, fit
from plant.gears import GearTrain

CASES = Path(__file__).parents[1].parent / "shared" / "cases"
TELLING = ("noise", "binary", "staircase")  # logs in which acceleration shows


@pytest.fixture(scope="module")
def drawn() -> Drawn:
    return draw(40, 5)


def read(drawn: Drawn, place: int, *, sign=(1.0, 1.0), turn: float = 1.0) -> Log:
    return Log.from_arrays(**drawn.columns(place, sign=sign, turn=turn), gears=Ratio(float(drawn.ratio[place])))


@pytest.mark.parametrize("kind", KINDS)
def test_right_logs_pass(drawn, kind):
    for place in np.flatnonzero(drawn.kind == kind):
        assert read(drawn, place).faults == ()


@pytest.mark.parametrize("kind", TELLING)
def test_a_torque_of_the_other_sign(drawn, kind):
    for place in np.flatnonzero((drawn.kind == kind) & ~drawn.pair):
        (fault,) = read(drawn, place, sign=(-1.0, -1.0)).faults
        assert fault.endswith("so one of them has the wrong sign: --scale torque=-1 turns it")


def two_motors(**signs: float) -> Log:
    """Two motors that push against each other, each on its own flank."""
    log = columns()
    rng = np.random.default_rng(1)
    push, ratio = log.pop("torque"), 8.05
    first = np.maximum(push, 0.0) + 0.3 + 0.01 * rng.standard_normal(push.size)
    pinions = {"torque_1": -first / ratio, "torque_2": -(push - first) / ratio}
    pinions = {name: signs.get(name, 1.0) * values for name, values in pinions.items()}
    return Log.from_arrays(**log, **pinions, gears=GearTrain.paper())


@pytest.mark.parametrize("turned", [(), ("torque_1",), ("torque_2",), ("torque_1", "torque_2")])
def test_which_of_two_torques_has_another_sign(turned):
    faults = two_motors(**dict.fromkeys(turned, -1.0)).faults
    assert len(faults) == bool(turned)
    assert all(" ".join(f"--scale {name}=-1" for name in turned) + " turns it" in fault for fault in faults)


def test_a_torque_that_only_brakes_is_warned_of_and_not_refused():
    """A generator and a reversed sign look alike where no acceleration shows."""
    time = 0.01 * np.arange(3000)
    angle = np.cumsum(3.0 + np.sin(0.5 * time)) * 0.01 + 1e-3 * np.random.default_rng(0).standard_normal(3000)
    log = Log.from_arrays(time=time, torque=-0.2 - 0.1 * np.gradient(angle, 0.01), angle=angle)
    assert log.faults == ()
    assert any("opposes the motion almost all the time" in text for text in log.warnings)


def chattering(seed: int) -> dict[str, np.ndarray]:
    """A pendulum under torques that the log lacks; its controller chatters in bursts, logged half a period late."""
    rng, count, period = np.random.default_rng(seed), 8000, 8
    sample = np.arange(count)
    bursts = np.repeat(rng.random(count // 100) > 0.5, 100)
    chatter = np.sin(2 * np.pi * sample / period) * bursts
    slow = 0.05 * np.repeat(rng.uniform(-1, 1, count // 80 + 1), 80)[:count]
    places = np.arange(0, count + 50, 50)
    unlogged = 0.5 * np.interp(sample, places, rng.standard_normal(len(places)))
    x, v, angle = 1.0, 0.0, np.empty(count)
    for k, torque in enumerate((slow + chatter + unlogged).tolist()):
        angle[k] = x
        for _ in range(10):
            v += (torque - 1.25 * np.sin(x) - 0.02 * v) / 0.0626 * 5e-4
            x += v * 5e-4
    return {
        "time": 0.005 * sample,
        "torque": slow + np.roll(chatter, period // 2),
        "angle": 0.003 * np.round(angle / 0.003),
    }


@pytest.mark.parametrize("seed", [0, 1, 3])
def test_a_torque_that_hardly_drives_the_load_has_no_wrong_sign(seed):
    assert Log.from_arrays(**chattering(seed)).faults == ()


def test_an_angle_in_counts_is_no_angle_in_radians():
    log = columns()
    counts = np.round(log["angle"] * 4096 / (2 * np.pi))
    (fault,) = Log.from_arrays(**log | {"angle": counts}).faults
    assert "whole numbers only" in fault
    assert "--unit angle=turn/4096" in fault
    assert Log.from_arrays(**log | {"angle": counts}, units={"angle": "turn/4096"}).faults == ()
    linear = {"time": log["time"], "force": log["torque"], "position": counts}
    assert "--unit position=mm/1000" in Log.from_arrays(**linear).faults[0]
    few = np.round(3.0 * log["angle"] / np.ptp(log["angle"]))  # a short way on a coarse encoder
    assert len(np.unique(few)) < 6
    assert "whole numbers only" in Log.from_arrays(**log | {"angle": few}).faults[0]


def test_a_torque_of_zero_is_reported_and_shows_nothing():
    time = 0.005 * np.arange(600)
    swings = 1e-4 * np.random.default_rng(0).standard_normal(600) + np.sin(3.0 * time) * np.exp(-0.2 * time)
    log = Log.from_arrays(time=time, torque=np.zeros(600), angle=swings)
    assert any("'torque' is zero throughout while the load moves" in text for text in log.warnings)
    assert fit(log).failed is not None


def test_a_constant_torque_is_reported_and_refused(recwarn):
    time = 0.005 * np.arange(2000)
    swings = 1e-4 * np.random.default_rng(0).standard_normal(2000) + np.sin(3.0 * time)
    log = Log.from_arrays(time=time, torque=np.full(2000, 0.5), angle=swings)
    assert any("'torque' is 0.5 throughout while the load moves" in text for text in log.warnings)
    with pytest.raises(Unidentifiable):
        diagnose(log)
    assert not [each for each in recwarn if each.category is RuntimeWarning]
    with pytest.raises(Unidentifiable, match="never changes"):
        diagnose(log, inverse=True)


def test_a_constant_command_is_doubted_unless_it_is_one_step():
    time = 0.005 * np.arange(600)
    noise = 1e-4 * np.random.default_rng(0).standard_normal(600)
    told = []
    for name, path in (
        ("setpoint", np.sin(3.0 * time)),
        ("voltage", np.sin(3.0 * time)),
        ("voltage", time - np.tanh(time)),
    ):
        log = Log.from_arrays(**{"time": time, name: np.full(600, 2.0), "angle": path + noise})
        told.append(any(f"'{name}' is 2 throughout while the load moves" in text for text in log.warnings))
    assert told == [True, True, False]


def test_degrees_by_the_encoder_by_the_wraps_and_by_gravity():
    log = columns()
    degrees = np.rad2deg(log["angle"])
    coarse = np.round(np.round(degrees * 2048 / 360) * 360 / 2048, 4)  # as a file has them
    (fault,) = Log.from_arrays(**log | {"angle": coarse}).faults
    assert "has steps of 360/2048" in fault
    assert fault.endswith("--unit angle=deg")
    turning = np.mod(degrees + 200.0 * log["time"], 360.0)
    assert any("wraps around by 360" in text for text in Log.from_arrays(**log | {"angle": turning}).faults)
    time = 0.005 * np.arange(4000)
    far = 8.0 * np.sin(0.9 * time) + 3.0 * np.sin(2.3 * time)
    torque = 0.3 * np.gradient(np.gradient(far, time), time) + 0.6 * np.cos(far)
    assert Log.from_arrays(time=time, torque=torque, angle=far).faults == ()
    (fault,) = Log.from_arrays(time=time, torque=torque, angle=np.rad2deg(far)).faults
    assert "is under a gravity torque that repeats every 360" in fault
    assert Log.from_arrays(**log | {"angle": coarse}, units={"angle": "deg"}).faults == ()


@pytest.mark.parametrize("stop", [4.0, 6.0, 8.0])
def test_a_soft_stop_is_no_gravity_in_degrees(stop):
    """Over two turns and more in radians its kink is a bend, as the sine of so many degrees is one."""
    time, rng = 0.02 * np.arange(2000), np.random.default_rng(3)
    for stiffness in (0.5, 2.65, 8.0):
        far = sum(rng.uniform(1, 4) * np.sin(w * time + rng.uniform(0, 6)) for w in (0.3, 0.7, 1.3, 2.1))
        far *= 12.0 / np.abs(far).max()
        speed = np.gradient(far, time)
        torque = 0.01 * np.gradient(speed, time) + 0.04 * speed + stiffness * np.maximum(far - stop, 0.0)
        assert Log.from_arrays(time=time, torque=torque, angle=far).faults == ()


@pytest.mark.parametrize("factor", [1.0, 30 / np.pi])
def test_a_speed_in_place_of_a_torque(factor):
    log = columns()
    log["torque"] = factor * np.gradient(log["angle"], log["time"])
    assert any("a speed or its set-point was taken" in fault for fault in Log.from_arrays(**log).faults)


def test_a_speed_in_no_unit_may_be_a_viscous_load():
    columns_ = columns()
    log = Log.from_arrays(**columns_ | {"torque": 7.3 * np.gradient(columns_["angle"], columns_["time"])})
    assert log.faults == ()
    sentence = "so the load has neither inertia nor dry friction, or a speed was taken for the torque"
    assert any(sentence in line for line in log.warnings)


def test_the_torque_of_a_viscous_load_is_no_speed():
    """Held for 2 s against a time constant of 20 ms, it is the speed times 34 but for 0.1 %, and leads it."""
    time = 0.02 * np.arange(4000)
    torque = np.repeat(np.random.default_rng(2).normal(size=40), 100) * np.minimum(1.0, (time % 2.0) / 0.3)
    speed = np.zeros(4000)
    for k in range(1, 4000):
        speed[k] = torque[k - 1] / 34.0 + (speed[k - 1] - torque[k - 1] / 34.0) * np.exp(-0.02 / 0.02)
    angle = np.cumsum(speed) * 0.02
    assert Log.from_arrays(time=time, torque=torque, angle=angle).faults == ()
    warnings = Log.from_arrays(time=time, torque=34.0 * np.gradient(angle, time), angle=angle).warnings
    assert any("or a speed was taken for the torque" in line for line in warnings)


def test_a_set_point_of_the_speed_is_known_by_its_unit():
    time, wanted = 0.005 * np.arange(4000), np.repeat([10.0, 30.0, -20.0, 15.0, 40.0, -35.0, 5.0, 25.0], 500)
    speed = np.zeros(4000)
    for k in range(1, 4000):
        speed[k] = speed[k - 1] + 0.005 / 0.04 * (wanted[k - 1] - speed[k - 1])
    log = Log.from_arrays(time=time, torque=wanted * 30 / np.pi, angle=np.cumsum(speed) * 0.005)
    assert any("in rpm, so a speed or its set-point" in fault for fault in log.faults)


def test_an_unusable_log_is_fitted_only_with_force():
    log = columns()
    faulty = Log.from_arrays(**log | {"torque": -log["torque"]})
    for use in (fit, diagnose):
        with pytest.raises(UnusableLog, match=r"--scale torque=-1 turns it \(--force"):
            use(faulty)
    with pytest.raises(UnusableLog):
        diagnose(Log.from_arrays(**log), None, faulty)
    assert fit(faulty, force=True).log.warnings[0] == faulty.faults[0]
    assert Log.merge([Log.from_arrays(**log), faulty]).faults == faulty.faults
    several = replace(faulty, faults=("First", "second", "third"))
    with pytest.raises(UnusableLog, match="First, and 2 faults more"):
        several.usable()


def test_a_forced_result_is_not_exported(tmp_path):
    log = columns()
    file = write_csv(tmp_path / "log.csv", log | {"torque": -log["torque"]})
    for command in ("identify", "diagnose"):
        result = antidrive(command, file, "--out", tmp_path / command)
        assert (result.code, result.out) == (2, "")
        assert "--scale torque=-1 turns it" in result.err
        assert not (tmp_path / command).exists()
    forced = antidrive("identify", file, "--force", "--out", tmp_path / "forced")
    assert forced.code == 0
    assert "warning: log.csv: 'angle' accelerates against 'torque'" in forced.out
    model = json.loads((tmp_path / "forced" / "model.json").read_text())
    assert {entry["std"] for entry in model["parameters"].values()} == {None}
    refused = antidrive("export", tmp_path / "forced" / "model.json", "--out", tmp_path / "c")
    assert refused.code == 2
    assert "no parameter of this model was identified" in refused.err
    assert not (tmp_path / "c").exists()


@pytest.mark.parametrize(
    ("file", "options", "message"),
    [
        ("use/03-reversed-sign-named/torque_neg.csv", (), "--scale torque=-1 turns it"),
        ("logs/06-fast-motor-refused/log.csv", (), "--unit angle=deg"),
        ("logs/14-prbs-lab-kit/log.csv", (), "--unit angle=deg"),
        ("logs/14-prbs-lab-kit/log_first_4.35s.csv", (), "--unit angle=deg"),
        ("logs/14-prbs-lab-kit/log.csv", ("--unit", "angle=deg", "--scale", "torque=-1"), "--scale torque=-1 turns it"),
    ],
)
def test_logs_of_other_people_that_stop_at_the_door(tmp_path, file, options, message):
    result = antidrive("identify", case(file), *options, "--out", tmp_path / "out")
    assert result.code == 2
    assert message in result.err
    assert not (tmp_path / "out").exists()


def test_motor_torques_get_the_stated_signs():
    options = {"units": {"angle": "deg"}, "gears": GearTrain.paper()}
    file = case("logs/01-two-pinion-crash/log.csv")
    (fault,) = Log.read(file, **options).faults
    column = fault.split("--scale ")[1].split("=")[0]
    assert column in ("torque_1", "torque_2")
    assert Log.read(file, **options, scales={column: -1.0}).faults == ()


@pytest.mark.parametrize(
    ("file", "options"),
    [
        ("logs/05-staircase-idle-tail/log.csv", {}),
        ("logs/06-fast-motor-refused/log_spindle_synthetic.csv", {}),
        ("logs/14-prbs-lab-kit/log.csv", {"units": {"angle": "deg"}}),
        ("use/18-offset-plus-friction/bias.csv", {}),
    ],
)
def test_right_logs_of_other_people_pass(file, options):
    assert Log.read(case(file), **options).faults == ()


def case(file: str) -> Path:
    place = CASES / file
    if not place.exists():
        pytest.skip(f"the case {file} is not on this machine")
    return place
