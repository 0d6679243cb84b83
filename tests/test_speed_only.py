"""A log of the velocity alone: identified in velocity, what needs the angle left out and said."""

from pathlib import Path

import numpy as np
import pytest

from identification import fit
from identification.errors import MalformedLog
from identification.log import Log
from identification.observer_gain import speed_gain
from identification.simulation import free_simulation
from plant import ServoModel, catalogue
from plant.effects import CoulombFriction

J, K, COULOMB = 0.02, 0.01, 0.15
RPM = 2.0 * np.pi / 60.0
LOGS = Path(__file__).parents[1].parent / "shared" / "cases" / "logs"


def spun(seed=0, samples=2000, irregular=False, unlogged=0.0):
    """Time, torque and velocity of J v' = torque - K v - friction, which has a closed form while the torque is held.

    unlogged: standard deviation of a further torque of which the log knows nothing.
    """
    rng = np.random.default_rng(seed)
    dt = 0.005 * (rng.uniform(0.5, 1.5, samples) if irregular else np.ones(samples))
    time = np.concatenate(([0.0], np.cumsum(dt[:-1])))
    torque = 0.8 * np.repeat(rng.uniform(-1, 1, samples // 50 + 1), 50)[:samples]
    torque += 0.3 * np.sin(2 * np.pi * (0.3 + 0.1 * time) * time)
    given = torque + unlogged * rng.standard_normal(samples)
    v, velocity = 0.0, np.empty(samples)
    for k in range(samples):
        velocity[k], left = v, dt[k]
        for _ in range(3):  # at most: slide, stop, and slide on
            sense = np.sign(v) or (np.sign(given[k]) if abs(given[k]) > COULOMB else 0.0)
            if sense == 0.0:
                break
            end = (given[k] - sense * COULOMB) / K
            to_rest = J / K * np.log(1.0 - v / end) if v * end < 0.0 else np.inf
            if to_rest >= left:
                v = end + (v - end) * np.exp(-K / J * left)
                break
            v, left = 0.0, left - to_rest
    return time, torque, velocity


def base():
    return ServoModel(inertia=1.0, gravity=0.0, viscous_friction=0.1, effects=(CoulombFriction(torque=0.05),))


@pytest.mark.parametrize(
    ("noise", "step", "irregular"),
    [(0.3, 0.0, False), (0.0, RPM, False), (0.3, 0.0, True), (0.1, 10 * RPM, True)],
    ids=["noise", "tacho of 1 rpm", "irregular", "irregular tacho of 10 rpm"],
)
def test_a_velocity_log_gives_inertia_and_friction_within_errors(noise, step, irregular):
    time, torque, velocity = spun(irregular=irregular)
    shown = velocity + noise * np.random.default_rng(9).standard_normal(velocity.size)
    shown = np.round(shown / step) * step if step else shown
    found = fit(Log.from_arrays(time=time, torque=torque, velocity=shown), base())
    for name, true in (("inertia", J), ("viscous_friction", K), ("coulomb_friction.torque", COULOMB)):
        assert abs(found[name].value - true) < 3.5 * found[name].std, name
        assert found[name].std < 0.05 * true, name
    assert found["gravity"].fixed
    assert found.noise_std == pytest.approx(max(noise, 0.29 * step), rel=0.2)
    assert "rad/s" in str(found)


def test_standard_errors_are_the_scatter_over_repetitions():
    time, torque, velocity = spun(samples=800)
    values, claimed = [], []
    for seed in range(12):
        shown = velocity + 0.3 * np.random.default_rng(seed).standard_normal(velocity.size)
        found = fit(Log.from_arrays(time=time, torque=torque, velocity=shown), base())
        values.append([found[name].value for name in ("inertia", "viscous_friction", "coulomb_friction.torque")])
        claimed.append([found[name].std for name in ("inertia", "viscous_friction", "coulomb_friction.torque")])
    off = (np.array(values) - [J, K, COULOMB]) / np.array(claimed)
    rms = np.sqrt(np.mean(off**2, axis=0))
    assert np.all((rms > 0.5) & (rms < 1.6)), rms  # chi of twelve: beyond these once in a thousand


def test_a_torque_that_fluctuates_is_followed_in_velocity():
    time, torque, velocity = spun(unlogged=0.1)
    shown = velocity + 0.02 * np.random.default_rng(3).standard_normal(time.size)
    found = fit(Log.from_arrays(time=time, torque=torque, velocity=shown), base())
    assert found.bandwidth > 0.0
    assert abs(found["inertia"].value - J) < 4.0 * found["inertia"].std
    assert found["inertia"].std < 0.05 * J


def test_the_gain_is_that_of_the_stationary_filter():
    dt, bandwidth, variance = 0.01, 30.0, 1.0
    for _ in range(5000):  # Riccati: the velocity walks by bandwidth * dt of the reading's noise a step
        variance += (bandwidth * dt) ** 2
        gain = variance / (variance + 1.0)
        variance *= 1.0 - gain
    assert speed_gain(bandwidth, np.array([dt]))[:, 0] == pytest.approx([0.0, gain])
    assert speed_gain(0.0, np.array([dt]))[:, 0].tolist() == [0.0, 0.0]


def test_what_needs_the_angle_is_left_out_and_reported():
    time, torque, velocity = spun(samples=400)
    log = Log.from_arrays(time=time, torque=torque, velocity=velocity)
    assert log.response == "velocity"
    assert "no angle" in log.notes[0]
    for kind in catalogue.values():
        assert (kind.title in log.notes[0]) == kind.needs_angle
        assert log.shows(kind) != kind.needs_angle
    assert {name for name, kind in catalogue.items() if kind.needs_angle} >= {"cogging", "cable_stiffness", "end_stop"}
    (shown,) = free_simulation(log, ServoModel(inertia=J, gravity=0.0, viscous_friction=K))
    assert shown.shape == velocity.shape
    with_angle = Log.from_arrays(time=time, torque=torque, velocity=velocity, angle=np.cumsum(velocity) * 0.005)
    assert with_angle.response == "angle"
    with pytest.raises(MalformedLog, match="use separate commands"):
        Log.merge([log, with_angle])


def test_a_linear_axis_has_a_velocity_too():
    time, torque, velocity = spun(samples=400)
    log = Log.from_arrays(time=time, force=torque, velocity=velocity)
    assert (log.axis, log.measured_unit) == ("linear", "m/s")


def test_a_set_point_of_the_angle_needs_the_angle():
    time, torque, velocity = spun(samples=400)
    with pytest.raises(MalformedLog, match="needs the angle"):
        Log.from_arrays(time=time, setpoint=torque, velocity=velocity)


def test_a_log_of_one_sample_in_five_seconds_is_refused_for_that():
    path = LOGS / "12-speed-only" / "log.csv"
    if not path.exists():
        pytest.skip("the case of a speed without angle is not here")
    names = {"time": "Time (s)", "torque": "Torque (N·m)", "velocity": "Motor Optical Speed (RPM)"}
    with pytest.raises(MalformedLog, match=r"sample time of 5\.54 s is too slow"):
        Log.read(path, mapping=names, units={"velocity": "rpm"})


def test_a_velocity_that_may_be_in_rpm_is_asked_about():
    time, torque, velocity = spun()
    turning = {"time": time, "torque": torque}
    (text,) = Log.from_arrays(**turning, velocity=np.round(velocity)).warnings
    assert "'velocity' holds whole numbers only; if it is in rpm, say --unit velocity=rpm" in text
    (text,) = Log.from_arrays(**turning, velocity=100.0 * velocity).warnings
    assert "'velocity' reaches" in text
    assert Log.from_arrays(**turning, velocity=velocity).warnings == ()
    assert Log.from_arrays(**turning, velocity=np.round(velocity / RPM), units={"velocity": "rpm"}).warnings == ()


def test_a_constant_command_of_a_changing_velocity_is_told():
    time, _, velocity = spun()
    log = Log.from_arrays(time=time, torque=np.full(time.size, -9.0), velocity=velocity)
    assert any("'torque' is -9 throughout while the load moves" in text for text in log.warnings)
