"""Faults of a log that look like physics are named as faults; logs of sound and of faulty machines are left alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from machine import Follower, Machine, excitation, load_fluctuation, record, wandering_reference
from sample_logs import motion

from identification.datasets import load_dataset
from identification.errors import MalformedLog
from identification.log import Log

DATA = Path(__file__).parents[1].parent / "shared" / "data"
SECONDS = 15.0


def columns(machine, *, sample_time=0.005, loop=None, noise=1e-3, bits=17, load=0.0, seed=1, seconds=SECONDS):
    """A log of a machine as columns: an excitation in the open, or moves in a closed loop."""
    plan = {"duration": seconds, "sample_time": sample_time}
    if loop is None:
        command = excitation(seed, **plan)
    else:
        command = Follower(reference=wandering_reference(seed, **plan), stiffness=loop[0], damping=loop[1])
    if load:
        load = load_fluctuation(seed, load, (round(seconds / sample_time), 1), sample_time=sample_time)
    options = {"sample_time": sample_time, "noise": noise, "bits": bits, "load_torque": load, "steps": 2}
    out = record(machine, command, seed=seed, **options)
    return {"time": out.time, "torque": out.command[:, 0], "angle": out.measured[:, 0]}


HEAVY = (80.0, 20.0)
LIGHT = Machine(inertia=0.1, viscous_friction=0.1)
RUBBING = Machine(effects={"stribeck_friction": {"coulomb": 1.0, "excess": 0.5, "velocity": 0.1}})
LATE = Machine().hiding(input_delay={"time": 0.03})
SLOW = Machine().hiding(actuator_lag={"time_constant": 0.03})
GAP = Machine().hiding(backlash={"gap": 0.05, "motor_share": 0.3})
SPRING = Machine().hiding(compliance={"frequency": 40.0, "damping": 0.05, "motor_share": 0.4})
CLEAN = {
    "open loop": (Machine(), {}),
    "open loop, no noise": (Machine(), {"noise": 0.0, "bits": None}),
    "open loop, coarse encoder": (Machine(), {"noise": 1e-4, "bits": 10}),
    "open loop, fast sampling": (Machine(), {"sample_time": 0.002}),
    "open loop, slow sampling": (Machine(), {"sample_time": 0.02}),
    "closed loop": (Machine(), {"loop": HEAVY}),
    "closed loop, slow sampling": (Machine(), {"loop": HEAVY, "sample_time": 0.02}),
    "closed loop, coarse encoder": (Machine(), {"loop": (40.0, 10.0), "bits": 10}),
    "closed loop, load that fluctuates": (Machine(), {"loop": HEAVY, "load": 1.0}),
    "light load": (LIGHT, {"loop": (8.0, 1.0)}),
    "friction": (RUBBING, {}),
    "friction, closed loop": (RUBBING, {"loop": HEAVY}),
    "delay": (LATE, {}),
    "delay, closed loop": (LATE, {"loop": (40.0, 15.0)}),
    "lag": (SLOW, {}),
    "play": (GAP, {"seconds": 4.0}),
    "play, closed loop": (GAP, {"loop": (40.0, 15.0), "seconds": 4.0}),
    "spring": (SPRING, {}),
}


@pytest.fixture(scope="module")
def clean():
    made = {}

    def get(name):
        if name not in made:
            machine, options = CLEAN[name]
            made[name] = columns(machine, **options)
        return {column: values.copy() for column, values in made[name].items()}

    return get


@pytest.mark.parametrize("name", CLEAN)
def test_nothing_is_reported_of_a_clean_log(clean, name):
    log = Log.from_arrays(**clean(name))
    assert log.repairs == ()
    assert [text for text in log.warnings if "is clipped" not in text] == []
    assert len(log.runs) == 1


def only(texts, *parts):
    """The one sentence, which says all of this."""
    (text,) = texts
    assert "\n" not in text
    assert not text.endswith(".")
    for part in parts:
        assert part in text, text
    return text


# A lag between the columns


def test_a_feedforward_of_a_servo_is_no_late_set_point():
    """A servo that pushes with the speed of its set-point, too, follows as if the set-point had been logged late."""
    time = np.arange(0.0, SECONDS, 0.005)
    goal = wandering_reference(3, duration=SECONDS, sample_time=0.005)[: len(time)]
    ahead = goal + 0.06 * np.gradient(goal, time)
    angle, speed = np.empty_like(goal), 0.0
    position = goal[0]
    for k in range(len(time)):
        angle[k] = position
        for _ in range(5):
            speed += 0.001 * (60.0 * (ahead[k] - position) - 12.0 * speed)
            position += 0.001 * speed
    text = only(
        Log.from_arrays(time=time, setpoint=goal, angle=angle).warnings, "before 'setpoint' acts", "feedforward"
    )
    assert "impossible" not in text


@pytest.mark.parametrize("name", ["open loop", "open loop, coarse encoder", "open loop, slow sampling", "closed loop",
                                  "closed loop, load that fluctuates", "light load", "friction", "spring"])  # fmt: skip
@pytest.mark.parametrize("late", [5, 9])
def test_an_angle_that_answers_before_its_torque(clean, name, late):
    spoilt = clean(name)
    spoilt["torque"] = np.append(np.full(late, spoilt["torque"][0]), spoilt["torque"][:-late])
    log = Log.from_arrays(**spoilt)
    text = only([t for t in log.warnings if "clipped" not in t], "'angle' answers about", "before 'torque' acts")
    samples = int(text.split("about ")[1].split(" samples")[0])
    assert abs(samples - late) <= 2
    np.testing.assert_array_equal(log.runs[0].command, spoilt["torque"])  # warned of, not moved


@pytest.mark.parametrize("late", [5, 9])
def test_an_angle_that_answers_late_may_be_a_delay(clean, late):
    """The fit names a delay; which of both it is nobody can tell from two columns."""
    spoilt = clean("open loop")
    spoilt["angle"] = np.append(np.full(late, spoilt["angle"][0]), spoilt["angle"][:-late])
    assert Log.from_arrays(**spoilt).warnings == ()


def test_a_delay_that_no_drive_has_is_mentioned(clean):
    spoilt = clean("open loop, slow sampling")
    spoilt["angle"] = np.append(np.full(12, spoilt["angle"][0]), spoilt["angle"][:-12])
    only(Log.from_arrays(**spoilt).warnings, "after 'torque'", "one clock")


def test_a_goal_that_is_logged_late(clean):
    """A position servo: the goal is the command, and the drive's torque follows from both."""
    spoilt = clean("closed loop")
    loop = Follower(reference=wandering_reference(3, duration=SECONDS), stiffness=60.0, damping=0.0, limit=100.0)
    machine = Machine(inertia=1.0, viscous_friction=12.0, effects={})
    out = record(machine, loop, steps=2)
    spoilt = {"time": out.time, "goal": out.reference, "angle": out.measured[:, 0]}
    assert Log.from_arrays(**spoilt).warnings == ()
    spoilt["goal"] = np.append(np.full(8, spoilt["goal"][0]), spoilt["goal"][:-8])
    only(Log.from_arrays(**spoilt).warnings, "before 'goal' acts")


# Clocks


def test_a_clock_that_drifts():
    spoilt = motion(samples=4000)
    steps = 0.005 * (1 + 0.01 * np.linspace(0, 1, 3999)) + 2e-5 * np.random.default_rng(0).standard_normal(3999)
    spoilt["time"] = np.append(0.0, np.cumsum(steps))
    del spoilt["velocity"]
    log = Log.from_arrays(**spoilt)
    text = only(log.warnings, "changes steadily from", "drifts")
    assert "(+0.9" in text or "(+1.0" in text
    np.testing.assert_array_equal(log.runs[0].time, spoilt["time"])


@pytest.mark.parametrize("kind", ["jitter", "wander", "bursts"])
def test_a_clock_that_is_only_uneven_does_not_drift(kind):
    spoilt = motion(samples=4000)
    rng = np.random.default_rng(1)
    steps = {
        "jitter": 0.005 + 2e-4 * rng.standard_normal(3999),
        "wander": 0.005 * (1 + 0.005 * np.sin(np.linspace(0, 9, 3999))),
        "bursts": np.where(rng.random(3999) < 0.01, 0.01, 0.005),
    }[kind]
    spoilt["time"] = np.append(0.0, np.cumsum(steps))
    del spoilt["velocity"]
    assert not any("drifts" in text for text in Log.from_arrays(**spoilt).warnings)


def test_times_that_are_written_with_too_few_digits():
    spoilt = motion(samples=2000, dt=0.0025)
    spoilt["time"] = np.round(spoilt["time"], 3)
    only(Log.from_arrays(**spoilt).warnings, "2.5 ms is written in steps of 1 ms", "more digits")


# A part that occurs twice


@pytest.mark.parametrize("name", ["open loop", "closed loop", "open loop, slow sampling", "friction"])
@pytest.mark.parametrize("length", [60, 150])
def test_a_buffer_that_was_written_twice_is_left_out(clean, name, length):
    spoilt = clean(name)
    count = len(spoilt["time"])
    first, second = count // 5, count // 2
    for column in ("torque", "angle"):
        spoilt[column][second : second + length] = spoilt[column][first : first + length]
    log = Log.from_arrays(**spoilt)
    expected = f"{length} samples of 'angle' are an exact copy of those from row {first + 1} on"
    assert any(expected in text for text in log.repairs)
    assert [len(run) for run in log.runs] == [second, count - second - length]


def test_a_buffer_that_was_put_in_twice(clean):
    part = slice(400, 500)
    spoilt = {k: np.concatenate((v[:500], v[part], v[500:])) for k, v in clean("open loop").items()}
    spoilt["time"] = 0.005 * np.arange(len(spoilt["time"]))
    log = Log.from_arrays(**spoilt)
    assert any("100 samples of 'angle' are an exact copy of those from row 401 on" in text for text in log.repairs)
    np.testing.assert_array_equal(np.concatenate([run.output for run in log.runs]), clean("open loop")["angle"])


def test_a_copy_ends_where_the_command_is_another_one(clean):
    """The encoder has the same value before and behind the copy by chance."""
    spoilt = clean("open loop")
    spoilt["angle"][699:801] = spoilt["angle"][99:201]
    spoilt["torque"][700:800] = spoilt["torque"][100:200]
    log = Log.from_arrays(**spoilt)
    assert any("100 samples of 'angle' are an exact copy of those from row 101 on" in text for text in log.repairs)


def test_a_motion_that_repeats_under_another_torque_is_no_copy(clean):
    spoilt = clean("open loop")
    spoilt["angle"][700:850] = spoilt["angle"][100:250]
    log = Log.from_arrays(**spoilt)
    assert not any("exact copy" in text for text in log.repairs)


@pytest.mark.parametrize(("noise", "bits"), [(0.0, None), (0.0, 12), (0.0, 17), (1e-4, 10), (1e-3, 17), (1e-3, 12)])
def test_the_same_command_again_is_no_repeat(noise, bits):
    """A periodic command and a load at rest in between: the same readings may come again where noise is absent."""
    period = np.concatenate((np.zeros(200), np.full(100, 4.0), np.full(100, -4.0), np.zeros(200)))
    machine = Machine(gravity=0.0, viscous_friction=20.0)
    out = record(machine, np.tile(period, 5), noise=noise, bits=bits, steps=2)
    log = Log.from_arrays(time=out.time, torque=out.command[:, 0], angle=out.measured[:, 0])
    assert log.repairs == ()


# Two experiments glued together


@pytest.mark.parametrize("name", ["open loop", "open loop, coarse encoder", "open loop, fast sampling", "closed loop",
                                  "friction", "light load"])  # fmt: skip
def test_experiments_glued_together_are_split(clean, name):
    machine, options = CLEAN[name]
    first, second = clean(name), columns(machine, seed=2, **options)
    count = len(first["time"])
    cut = count // 2
    other = int(cut * 0.3)
    distance = abs(second["angle"][other] - first["angle"][cut - 1])
    glued = {k: np.concatenate((first[k][:cut], second[k][other:])) for k in ("torque", "angle")}
    if distance < 0.3:
        glued["angle"][cut:] += 0.5
    glued["time"] = first["time"][1] * np.arange(len(glued["angle"]))
    log = Log.from_arrays(**glued)
    text = only([t for t in log.repairs if "jumps" in t], "glued together", "split into 2 pieces")
    assert f"row {cut + 1}," in text
    assert [len(run) for run in log.runs] == [cut, count - other]


def test_a_slow_slip_is_motion(clean):
    """The same way in forty samples: fast, but a load may do that."""
    spoilt = clean("open loop")
    spoilt["angle"] += 0.5 * np.clip((np.arange(len(spoilt["angle"])) - 1000) / 40, 0, 1)
    assert not any("jumps" in text for text in Log.from_arrays(**spoilt).repairs)


@pytest.mark.parametrize("length", [8, 60])
def test_a_reading_that_drops_out_is_masked(clean, length):
    spoilt = clean("open loop")
    start = 1000
    spoilt["angle"][start : start + length] = -3.0
    log = Log.from_arrays(**spoilt)
    only(log.repairs, "drops out to -3 rad", f"{length} samples masked")
    np.testing.assert_array_equal(np.flatnonzero(~log.runs[0].valid), np.arange(start, start + length))


# Channels that contradict each other


@pytest.mark.parametrize(
    ("column", "factor", "message"),
    [
        ("reference", 180 / np.pi, "--unit reference=deg"),
        ("reference", 1e3, "--unit reference=mrad"),
        ("reference", -1.0, "--scale reference=-1"),
        ("angle_1", -1.0, "has the wrong sign"),
        ("angle_2", 180 / np.pi, "--unit angle_2=deg"),
        ("angle_1", 180 / np.pi, "--unit angle_1=deg"),
        ("torque_1", -1.0, "one torque has the wrong sign"),
        ("torque_2", 1e3, "no two gears differ so much"),
    ],
)
def test_channels_that_contradict_each_other(clean, column, factor, message):
    log = channels(clean, **{column: factor})
    only(log.warnings, message)


def channels(clean, **factors):
    sound = clean("closed loop")
    angle, torque = sound["angle"], sound["torque"]
    share = 0.2 + 0.1 * np.sin(sound["time"])
    sound |= {
        "reference": wandering_reference(1, duration=SECONDS),
        "angle_1": -3.75 * angle,
        "angle_2": -3.0 * angle,
        "torque_1": -(torque / 3.75) * share,
        "torque_2": -(torque / 3.0) * (1 - share),
    }
    return Log.from_arrays(**{name: values * factors.get(name, 1.0) for name, values in sound.items()})


def test_channels_that_agree(clean):
    assert channels(clean).warnings == ()


def test_a_load_faster_than_its_motor(clean):
    log = channels(clean, angle_1=np.pi / 180, angle_2=np.pi / 180)
    assert all("but a gear reduces" in text for text in log.warnings)
    assert len(log.warnings) == 2


@pytest.mark.parametrize(("factor", "option"), [(180 / np.pi, "setpoint=deg"), (1 / (2 * np.pi), "setpoint=turn")])
def test_a_goal_of_another_unit_is_refused(clean, factor, option):
    sound = clean("closed loop")
    goal = wandering_reference(1, duration=SECONDS)
    with pytest.raises(MalformedLog, match=f"--unit {option}"):
        Log.from_arrays(time=sound["time"], goal=factor * goal, angle=sound["angle"])
    log = Log.from_arrays(
        time=sound["time"], goal=factor * goal, angle=sound["angle"], units={"goal": option.split("=")[1]}
    )
    assert log.warnings == ()


@pytest.mark.parametrize(("factor", "option"), [(180 / np.pi, "setpoint=deg"), (4096 / (2 * np.pi), "setpoint=turn/")])
def test_a_goal_of_another_unit_that_is_followed_late_is_refused(factor, option):
    time = 0.005 * np.arange(1600)
    goal = 0.8 * np.sin(2 * np.pi * (1.0 + 0.05 * time) * time)
    angle = np.interp(time - 0.1, time, goal)
    assert np.corrcoef(goal, angle)[0, 1] < 0.9
    with pytest.raises(MalformedLog, match=f"--unit {option}"):
        Log.from_arrays(time=time, setpoint=factor * goal, angle=angle)
    assert Log.from_arrays(time=time, setpoint=goal, angle=angle).warnings == ()


@pytest.mark.parametrize("name", ["open loop", "open loop, slow sampling", "friction", "light load", "delay"])
def test_a_torque_of_the_other_sign(clean, name):
    spoilt = clean(name)
    spoilt["torque"] = -spoilt["torque"]
    only(Log.from_arrays(**spoilt).faults, "accelerates against", "--scale torque=-1 turns it")


def motor_on_current_steps(levels):
    """A free motor at a constant current in each run; the current loop gives way to the cogging, as real ones do."""
    time = 0.001 * np.arange(1000)
    runs = []
    for level in levels:
        speed, angle, current, angles = 0.0, 0.0, [], []
        for _ in time:
            cogging = 0.3 * np.sin(12 * angle) - 0.2 * np.sign(speed)
            current.append(level - 0.5 * cogging)
            speed += 0.001 * (level + cogging - 0.02 * speed) / 0.02
            angle += 0.001 * speed
            angles.append(angle)
        runs.append({"time": time, "current": np.array(current), "angle": np.array(angles)})
    return {key: np.concatenate([run[key] for run in runs]) for key in runs[0]} | {
        "run": np.repeat(np.arange(len(levels)), time.size)
    }


@pytest.mark.parametrize("levels", [[0.6], [-0.7], [0.6, 0.8, 1.0, 1.2, -0.7, -0.9, -1.1]])
def test_a_current_that_gives_way_to_cogging_is_no_wrong_sign(levels):
    """Nothing but cogging changes within a run, and the current falls where the load speeds up."""
    log = Log.from_arrays(**motor_on_current_steps(levels))
    assert log.faults == ()
    assert not any("opposes" in text for text in log.warnings)


def test_a_wrong_sign_in_several_runs_is_told_once(clean):
    spoilt = clean("open loop")
    spoilt["torque"] = -spoilt["torque"]
    half = spoilt["time"].size // 2
    spoilt["run"] = np.repeat([1, 2], [half, spoilt["time"].size - half])
    only(Log.from_arrays(**spoilt).faults, "the 2 runs together", "--scale torque=-1 turns it")


def test_a_loop_that_holds_against_a_load_is_no_wrong_sign():
    """There the torque answers the motion, so the load does turn against it."""
    push = load_fluctuation(1, 2.0, (3000, 1), correlation_time=0.3)
    out = record(Machine(), Follower(reference=np.zeros(3000)), load_torque=push, steps=2)
    assert Log.from_arrays(time=out.time, torque=out.command[:, 0], angle=out.measured[:, 0]).warnings == ()


# Measured logs


@pytest.mark.parametrize(
    ("name", "folder", "joint"),
    [
        ("emps", "emps", None),
        ("kscale", "kscale_sts3215", None),
        ("bam", "bam_xl330", None),
        ("hsm150", "hsm150", None),
        ("ur10e", "ur10e", 1),
        ("ur10e", "ur10e", 2),
        ("ur10e", "ur10e", 3),
    ],
)
def test_measured_logs_raise_no_false_alarm(name, folder, joint):
    """Spikes of a bus and irregular sampling are there; a lag, a repeat, a jump, a drift are not."""
    place = DATA / folder
    if not place.exists():
        pytest.skip(f"the data set {name} is not on this machine")
    dataset = load_dataset(name, place, joint=joint)
    for log in (dataset.estimation, dataset.holdout):
        findings = [*log.faults, *log.warnings, *log.repairs]
        assert [text for text in findings if "spike" not in text and "true times are used" not in text] == []


@pytest.mark.parametrize("late", [10, 40])
def test_a_lag_planted_in_a_measured_log(late):
    """24 s of a cart on a ball screw at 1 kHz, in a closed loop, with all that its friction does."""
    place = DATA / "emps"
    if not place.exists():
        pytest.skip("the data set emps is not on this machine")
    (run,) = load_dataset("emps", place).estimation.runs
    force = np.append(np.full(late, run.command[0]), run.command[:-late])
    log = Log.from_arrays(time=run.time, force=force, position=run.output)
    text = only(log.warnings, "'position' answers about", "before 'force' acts")
    assert abs(int(text.split("about ")[1].split(" samples")[0]) - late) <= 2


# A command without its sign


def driven(command, *, weight=0.0):
    """A load with dry friction that a command (T,) drives against a weight."""
    time = 0.005 * np.arange(len(command))
    angle, position, speed = np.empty(len(command)), 0.0, 0.0
    for k in range(len(command)):
        angle[k] = position
        for _ in range(5):
            push = command[k] - weight - 0.5 * speed
            held = abs(speed) < 1e-3 and abs(push) < 0.4
            speed = 0.0 if held else speed + 0.001 * (push - 0.4 * np.sign(speed or push))
            position += 0.001 * speed
    return time, angle + 1e-4 * np.random.default_rng(5).standard_normal(len(angle))


MOVES = np.repeat([0.0, 1.0, 0.0, -1.0, 0.0, 0.7, 0.0, -0.7, 0.0], 300)


def test_a_duty_without_its_sign_is_mentioned():
    time, angle = driven(MOVES)
    log = Log.from_arrays(time=time, duty=np.abs(MOVES), angle=angle)
    (text,) = (text for text in log.warnings if "only its size was logged" in text)
    assert "'duty' is never below zero, but 'angle' moves both ways" in text
    assert "or name another command, for example --map setpoint=NAME" in text
    assert not any("size was logged" in text for text in Log.from_arrays(time=time, duty=MOVES, angle=angle).warnings)


def test_a_hoist_that_lowers_its_load_has_its_sign():
    lifting = 2.0 + MOVES
    time, angle = driven(lifting, weight=2.0)
    log = Log.from_arrays(time=time, torque=lifting, angle=angle)
    assert not any("size was logged" in text for text in log.warnings)


def test_a_set_point_between_the_samples_of_its_angle_is_kept():
    """Each row has one of both, as a recorder of events writes them."""
    time = np.arange(0.0, 8.0, 0.00125)
    goal, angle, speed, position = np.sin(2 * time) + 0.3 * np.sin(5 * time), np.empty(len(time)), 0.0, 0.0
    for k in range(len(time)):
        angle[k] = position
        speed += 0.00125 * (60.0 * (goal[k] - position) - 12.0 * speed)
        position += 0.00125 * speed
    seen = np.arange(len(time)) % 4 == 3
    log = Log.from_arrays(time=time, setpoint=np.where(seen, np.nan, goal), angle=np.where(seen, angle, np.nan))
    (run,) = log.runs
    np.testing.assert_allclose(run.setpoint, np.interp(run.time + run.zero, time, goal), atol=0.02)
    assert not any("not used" in text for text in log.repairs)
