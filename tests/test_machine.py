"""The machine that hides effects is itself held against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from machine import KNOWN, Follower, Machine, excitation, load_fluctuation, record, wandering_reference
from scipy.optimize import brentq

SAMPLE = 0.005


HIDDEN = {
    "input_delay": {"time": 0.0033},
    "actuator_lag": {"time_constant": 0.004},
    "dead_zone": {"half_width": 0.2},
    "torque_offset": {"torque": 0.2},
    "coulomb_friction": {"torque": 0.3},
    "asymmetric_friction": {"forward": 0.3, "backward": 0.2, "viscous_difference": 0.05},
    "stribeck_friction": {"coulomb": 0.3, "excess": 0.2, "velocity": 0.1},
    "quadratic_drag": {"drag": 0.1},
    "gravity_offset": {"beta": 0.2},
    "cogging": {"amplitude": 0.2, "order": 11.0, "phase": 0.7},
    "torque_saturation": {"limit": 3.0},
    "rate_limit": {"rate": 60.0},
    "setpoint_rate_limit": {"rate": 5.0},
    "back_emf": {"constant": 0.3},
    "compliance": {"frequency": 60.0, "damping": 0.1, "motor_share": 0.3},
    "backlash": {"gap": 0.02, "motor_share": 0.2},
    "load_dependent_friction": {"coefficient": 0.2},
    "presliding_hysteresis": {"torque": 0.3, "stiffness": 300.0},
    "cable_stiffness": {"stiffness": 0.5, "cubic": 0.02, "rest_angle": 0.3},
    "end_stop": {"angle": 0.3, "stiffness": 3000.0},
    "payload_change": {"time": 0.2013, "inertia": 0.5, "gravity": 0.2},
    "periodic_disturbance": {"amplitude": 0.2, "frequency": 3.0, "phase": 0.4},
    "friction_drift": {"viscous_rate": 0.2, "coulomb_rate": 0.1},
    "encoder_eccentricity": {"amplitude": 0.01, "order": 2.0, "phase": 0.3},
    "sensor_lag": {"time_constant": 0.004},
    "torque_measurement_lag": {"time_constant": 0.004},
}
DRIVE = {"setpoint_rate_limit": {"servo_gain": 40.0, "command_limit": 60.0}}  # what only a position servo can have


def plain(**effects: dict[str, float]) -> Machine:
    return Machine(inertia=1.5, gravity=0.0, viscous_friction=0.0, effects=effects)


def exact(machine: Machine, command: np.ndarray, **kwargs: float):
    return record(machine, command, noise=0.0, bits=None, **kwargs)


def test_torque_with_viscous_friction_has_its_closed_form() -> None:
    machine = Machine(inertia=2.0, gravity=0.0, viscous_friction=0.8, effects={"dead_zone": {"half_width": 0.5}})
    out = exact(machine, np.full(2000, 3.5))
    assert out.velocity[:, 0] == pytest.approx(3.0 / 0.8 * (1 - np.exp(-0.4 * out.time)), abs=1e-10)


def test_a_sliding_load_stops_where_energy_says_and_stays_there() -> None:
    out = exact(plain(coulomb_friction={"torque": 0.3}), np.zeros(1500), velocity=1.0)
    assert out.angle[-1, 0] == pytest.approx(0.5 * 1.5 / 0.3, abs=1e-12)  # J v^2 / 2 = Fc x
    assert out.velocity[-1, 0] == 0.0
    stop = round(1.5 / 0.3 / SAMPLE) + 1
    assert np.ptp(out.angle[stop:, 0]) == 0.0


def test_friction_holds_below_breakaway_and_lets_go_above() -> None:
    friction = {"coulomb": 0.3, "excess": 0.2, "velocity": 0.05}
    ramp = np.linspace(0.0, 1.0, 1001)
    out = exact(plain(stribeck_friction=friction), ramp)
    first = np.flatnonzero(out.velocity[:, 0])[0]
    assert ramp[first - 1] == pytest.approx(0.5, abs=1.1e-3)


def test_directions_have_their_own_friction() -> None:
    sides = {"forward": 0.4, "backward": 0.2, "viscous_difference": 0.0}
    machine = plain(asymmetric_friction=sides)
    speed = [exact(machine, np.full(200, torque)).velocity[-1, 0] for torque in (1.0, -1.0)]
    assert speed == pytest.approx([0.6 / 1.5 * 199 * SAMPLE, -0.8 / 1.5 * 199 * SAMPLE], abs=1e-12)


@pytest.mark.parametrize("delay", [0.0, 0.0017, 0.005, 0.0123])
def test_a_delay_moves_the_response_by_itself(delay: float) -> None:
    command = np.where(np.arange(400) < 100, 0.0, 2.0)
    out = exact(plain(input_delay={"time": delay}), command)
    arrival = 100 * SAMPLE + delay
    assert out.velocity[:, 0] == pytest.approx(2.0 / 1.5 * np.maximum(out.time - arrival, 0.0), abs=1e-12)


@pytest.mark.parametrize("lag", [1e-5, 4e-4, 0.04])
def test_a_lag_shorter_than_a_step_loses_the_right_impulse(lag: float) -> None:
    command = np.where(np.arange(1000) < 100, 0.0, 2.0)
    out = exact(plain(actuator_lag={"time_constant": lag}), command)
    assert out.velocity[-1, 0] == pytest.approx(2.0 / 1.5 * (out.time[-1] - 100 * SAMPLE - lag), abs=1e-9)


def test_conservative_torques_keep_the_energy() -> None:
    machine = Machine(
        inertia=1.5,
        gravity=0.7,
        viscous_friction=0.0,
        effects={"gravity_offset": {"beta": 0.3}, "cogging": {"amplitude": 0.2, "order": 9.0, "phase": 0.4}},
    )
    out = exact(machine, np.zeros(1500), velocity=1.2)
    x, v = out.angle[:, 0], out.velocity[:, 0]
    energy = 0.75 * v**2 + 0.7 * np.sin(x) - 0.3 * np.cos(x) + 0.2 / 9.0 * np.cos(9.0 * x + 0.4)
    assert np.ptp(energy) < 1e-9


def test_drag_slows_as_its_closed_form() -> None:
    out = exact(plain(quadratic_drag={"drag": 0.1}), np.zeros(1000), velocity=-3.0)
    assert out.velocity[:, 0] == pytest.approx(-3.0 / (1 + 0.1 * 3.0 * out.time / 1.5), abs=1e-10)


def test_a_batch_is_its_machines_one_by_one() -> None:
    command = excitation(3, duration=4.0)
    sizes = np.array([0.1, 0.3, 0.8])
    batch = exact(Machine().hiding(coulomb_friction={"torque": sizes}), command)
    for b, size in enumerate(sizes):
        alone = exact(Machine().hiding(coulomb_friction={"torque": size}), command)
        assert batch.angle[:, b] == pytest.approx(alone.angle[:, 0], abs=1e-12)


def test_finer_steps_change_nothing_that_an_encoder_sees() -> None:
    command = excitation(4, duration=4.0)
    machine = Machine().hiding(
        stribeck_friction={"coulomb": 0.3, "excess": 0.2, "velocity": 0.1}, input_delay={"time": 0.0033}
    )
    coarse, fine = (exact(machine, command, steps=steps).angle for steps in (2, 16))
    assert np.abs(coarse - fine).max() < 1e-6


def test_the_loop_follows_its_reference() -> None:
    loop = Follower(reference=wandering_reference(0, duration=10.0))
    out = record(Machine(), loop)
    assert np.std(out.angle[:, 0] - loop.reference) < 0.4 * np.std(loop.reference)
    assert np.abs(out.command).max() <= loop.limit


def test_the_fluctuation_has_its_size() -> None:
    path = load_fluctuation(0, 0.05, (4000, 20))
    assert np.std(path) == pytest.approx(0.05, rel=0.05)


def test_the_records_are_logs_without_faults() -> None:
    from identification.log import Log

    out = record(Machine(), excitation(0))
    log = Log.from_arrays(time=out.time, torque=out.command[:, 0], angle=out.measured[:, 0])
    assert (log.warnings, log.repairs) == ((), ())
    assert np.std(out.measured - out.angle) == pytest.approx(1e-3, rel=0.05)


# The rest of the catalogue, each effect against its closed form or what it must conserve.


def test_every_effect_can_be_hidden_and_shows() -> None:
    assert set(HIDDEN) == set(KNOWN)
    command = excitation(3, duration=1.0)
    for name, values in HIDDEN.items():
        drive = DRIVE.get(name, {})
        hiding, bare = (exact(Machine(effects=effects, **drive), command) for effects in ({name: values}, {}))
        shown, without = (np.hstack((each.measured, each.command)) for each in (hiding, bare))
        assert np.abs(shown - without).max() > 1e-3, name


@pytest.mark.parametrize("name", KNOWN)
def test_batches_and_step_sizes_do_not_change_what_is_hidden(name: str) -> None:
    command = excitation(4, duration=0.4)
    finer = 40 if name == "backlash" else 16
    sizes = (1.0, 0.6)
    values = {key: np.array([s * value for s in sizes]) for key, value in HIDDEN[name].items()}
    drive = DRIVE.get(name, {})
    batch = exact(Machine(effects={name: values}, **drive), command)
    for b, s in enumerate(sizes):
        smaller = {k: s * v for k, v in HIDDEN[name].items()}
        alone = exact(Machine(effects={name: smaller}, **drive), command, steps=finer)
        assert np.abs(batch.measured[:, b] - alone.measured[:, 0]).max() < 1e-5


def test_effects_that_exclude_or_misname_are_refused() -> None:
    with pytest.raises(ValueError, match="one drivetrain"):
        Machine(effects={name: HIDDEN[name] for name in ("compliance", "backlash")})
    with pytest.raises(ValueError, match="takes"):
        Machine(effects={"end_stop": {"angle": 1.0}})
    with pytest.raises(ValueError, match="servo gain"):
        Machine(effects={"setpoint_rate_limit": {"rate": 1.0}})
    with pytest.raises(ValueError, match="no lag"):
        Machine(effects={"actuator_lag": {"time_constant": 0.1}}, servo_gain=1.0)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_saturation_clips_behind_the_lag(side: float) -> None:
    """4 (1 - exp(-t / T)) meets the limit of 1 at T ln(4/3), and has lost 4 T (1 - 1/4) of impulse until then."""
    command = side * np.where(np.arange(600) < 100, 0.0, 4.0)
    machine = plain(torque_saturation={"limit": 1.0}, actuator_lag={"time_constant": 0.2})
    out = exact(machine, command)
    meets = 0.2 * np.log(4 / 3)
    impulse = 4.0 * (meets - 0.2 / 4) + (out.time[-1] - 100 * SAMPLE - meets)
    assert out.velocity[-1, 0] == pytest.approx(side * impulse / 1.5, abs=1e-5)


@pytest.mark.parametrize(("rate", "lag"), [(7.0, 0.0), (450.0, 0.0), (3000.0, 0.0), (7.0, 0.03), (450.0, 0.03)])
def test_a_rate_limit_costs_a_triangle_of_impulse(rate: float, lag: float) -> None:
    command = np.where(np.arange(600) < 100, 1.0, 3.0)
    effects = {"rate_limit": {"rate": rate}} | ({"actuator_lag": {"time_constant": lag}} if lag else {})
    out = exact(plain(**effects), command)
    impulse = out.time[-1] + 2.0 * (out.time[-1] - 100 * SAMPLE) - 2.0**2 / (2 * rate) - 2.0 * lag
    assert out.velocity[-1, 0] == pytest.approx(impulse / 1.5, abs=1e-6)


def test_a_rate_limited_torque_is_a_ramp_inside_the_samples() -> None:
    out = exact(plain(rate_limit={"rate": 7.0}), np.where(np.arange(150) < 100, 0.0, -2.0))
    since = np.maximum(out.time - 100 * SAMPLE, 0.0)
    assert out.velocity[:, 0] == pytest.approx(-7.0 * since**2 / 2 / 1.5, abs=1e-12)


@pytest.mark.parametrize("gain", [6.0, 24.0])
def test_a_servo_swings_behind_a_goal_that_moves_at_its_rate(gain: float) -> None:
    """Without friction: r (t - sin(w t) / w) up to the end of the ramp, from there about the goal."""
    rate, w, goal = 0.9, np.sqrt(gain / 1.5), 0.7
    machine = Machine(
        inertia=1.5, gravity=0.0, viscous_friction=0.0, effects={"setpoint_rate_limit": {"rate": rate}}, servo_gain=gain
    )
    out = exact(machine, np.where(np.arange(500) < 100, 0.0, goal), steps=16)
    t, end = np.maximum(out.time - 100 * SAMPLE, 0.0), goal / rate

    def ramp(t: np.ndarray) -> np.ndarray:
        return rate * (t - np.sin(w * t) / w)

    assert out.angle[:, 0] == pytest.approx(ramp(t) - np.where(t > end, ramp(t - end), 0.0), abs=1e-9)


def test_a_servo_gives_no_more_than_its_limit() -> None:
    machine = Machine(inertia=1.5, gravity=0.0, viscous_friction=0.0, effects={}, servo_gain=20.0, command_limit=3.0)
    out = exact(machine, np.full(60, 5.0))
    assert out.velocity[:, 0] == pytest.approx(3.0 / 1.5 * out.time, abs=1e-12)


def test_back_emf_is_felt_in_front_of_the_dead_zone() -> None:
    """Behind saturation at 2: the speed tends to (2 - gamma) / c; coasting below gamma / c it costs nothing."""
    machine = plain(back_emf={"constant": 0.5}, dead_zone={"half_width": 0.3}, torque_saturation={"limit": 2.0})
    out = exact(machine, np.full(1000, 5.0))
    assert out.velocity[:, 0] == pytest.approx(3.4 * (1 - np.exp(-0.5 * out.time / 1.5)), abs=1e-9)
    assert exact(machine, np.zeros(400), velocity=0.55).velocity == pytest.approx(0.55, abs=1e-12)


def test_two_masses_oscillate_and_keep_their_momentum() -> None:
    """Under a constant torque on the motor: J_r twist'' = torque J_r / J_m - k twist - d twist'."""
    swing, zeta, share, torque = 80.0, 0.05, 0.3, 2.0
    machine = plain(compliance={"frequency": swing, "damping": zeta, "motor_share": share})
    out = exact(machine, np.full(400, torque))
    x, motor, t = out.angle[:, 0], out.motor_angle[:, 0], out.time
    assert share * motor + (1 - share) * x == pytest.approx(torque / 1.5 * t**2 / 2, abs=1e-9)
    static = torque / (share * 1.5 * swing**2)
    damped = swing * np.sqrt(1 - zeta**2)
    ring = np.cos(damped * t) + zeta * swing / damped * np.sin(damped * t)
    assert motor - x == pytest.approx(static * (1 - np.exp(-zeta * swing * t) * ring), abs=1e-4 * static)


def test_a_motor_oscillates_on_its_spring_while_the_load_sticks() -> None:
    """The anti-resonance: k = w^2 J_r lets the motor swing at w sqrt(1 - share); the load lets go at breakaway."""
    swing, share = 60.0, 0.4
    drivetrain = {"frequency": swing, "damping": 0.0, "motor_share": share}
    out = exact(plain(compliance=drivetrain, coulomb_friction={"torque": 1.0}), np.full(400, 0.4))
    assert np.ptp(out.angle) == 0.0
    alone = swing * np.sqrt(1 - share)
    static = 0.4 / (share * 1.5 * alone**2)
    assert out.motor_angle[:, 0] == pytest.approx(static * (1 - np.cos(alone * out.time)), abs=1e-3 * static)
    louder = exact(plain(compliance=drivetrain, coulomb_friction={"torque": 1.0}), np.full(400, 0.55))
    assert np.ptp(louder.angle) > 0.0  # the swing doubles the torque


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_motor_crosses_backlash_alone_and_then_pushes_only(side: float) -> None:
    gap, share, torque = 0.06, 0.3, 0.6
    machine = plain(backlash={"gap": gap, "motor_share": share})
    out = exact(machine, np.full(400, side * torque))
    x, motor, t = side * out.angle[:, 0], side * out.motor_angle[:, 0], out.time
    contact = np.sqrt(gap * share * 1.5 / torque)
    free = t <= contact
    assert np.all(x[free] == 0.0)
    assert motor[free] == pytest.approx(torque / (share * 1.5) * t[free] ** 2 / 2, abs=1e-12)
    assert x[t > contact + SAMPLE][0] > 0.0
    assert share * motor + (1 - share) * x == pytest.approx(torque / 1.5 * t**2 / 2, abs=1e-9)
    assert np.diff(side * out.velocity[:, 0]).min() > -1e-12  # nothing ever pulls the load back
    inside = np.abs(motor - x) < gap / 2
    coasts = inside[1:] & inside[:-1] & (np.abs(np.diff(motor - x)) < 1e-4)
    assert np.diff(out.velocity[:, 0])[coasts] == pytest.approx(0.0, abs=1e-12)
    press = torque * (1 - share) / (400.0**2 * share * (1 - share) * 1.5)
    assert (motor - x)[-1] - gap / 2 == pytest.approx(press, rel=1e-3)


def test_friction_grows_with_the_torque_that_arrives() -> None:
    machine = plain(load_dependent_friction={"coefficient": 0.3}, dead_zone={"half_width": 0.5})
    out = exact(machine, np.column_stack([np.full(200, 2.5), np.full(200, -2.5)]))
    assert out.velocity == pytest.approx(np.outer(0.7 * 2.0 / 1.5 * out.time, [1.0, -1.0]), abs=1e-12)
    assert exact(machine, np.zeros(200), velocity=1.0).velocity == pytest.approx(1.0, abs=1e-12)
    held, slips = (exact(machine, np.full(200, 1.5), load_torque=np.full(200, load)) for load in (-1.25, -1.4))
    assert np.ptp(held.angle) == 0.0
    assert slips.velocity[:, 0] == pytest.approx(-0.1 / 1.5 * slips.time, abs=1e-12)


def test_friction_behind_a_drivetrain_follows_its_torque() -> None:
    """torque = J_m a + T and (1 - mu) T = J_l a, once the ringing has gone."""
    drivetrain = {"frequency": 60.0, "damping": 0.5, "motor_share": 0.4}
    out = exact(plain(compliance=drivetrain, load_dependent_friction={"coefficient": 0.3}), np.full(600, 2.0))
    acceleration = 2.0 / (0.4 * 1.5 + 0.6 * 1.5 / 0.7)
    assert np.diff(out.velocity[300:, 0]) / SAMPLE == pytest.approx(acceleration, abs=1e-9)


@pytest.mark.parametrize("v", [0.04, 0.6])
def test_bristles_bend_in_the_closed_form_of_dahl(v: float) -> None:
    """Energy: a travel x takes T x - (T - F0) (T / sigma) (1 - exp(-sigma x / T)), and again after the turn."""
    level, stiffness = 0.3, 60.0
    machine = plain(presliding_hysteresis={"torque": level, "stiffness": stiffness})
    out = exact(machine, np.zeros(900), velocity=v, steps=4)
    x, speed = out.angle[:, 0], out.velocity[:, 0]
    soft = level / stiffness

    def work(travel: np.ndarray, start: float) -> np.ndarray:
        return level * travel - (level - start) * soft * (1 - np.exp(-travel / soft))

    turn = int(np.argmax(speed < 0.0))
    ahead = slice(0, turn)
    assert 0.75 * speed[ahead] ** 2 == pytest.approx(0.75 * v**2 - work(x[ahead], 0.0), abs=1e-9)
    furthest = brentq(lambda far: 0.75 * v**2 - work(far, 0.0), 0.0, 10.0, xtol=1e-14)
    assert x.max() == pytest.approx(furthest, abs=1e-5)
    deflection = level * (1 - np.exp(-furthest / soft))
    back = slice(turn, turn + int(np.argmax(speed[turn:] >= 0.0)))
    assert back.stop - back.start > 20  # it springs back
    assert 0.75 * speed[back] ** 2 == pytest.approx(-work(furthest - x[back], -deflection), abs=1e-9)


def test_bristles_stay_bent_by_what_a_loop_leaves_over() -> None:
    """Pressed by F0 the load creeps to F(x) = F0; let go it creeps back to F = 0, which is not where it began."""
    level, stiffness, press = 0.3, 60.0, 0.2
    machine = Machine(inertia=0.05, gravity=0.0, viscous_friction=4.0, effects={}).hiding(
        presliding_hysteresis={"torque": level, "stiffness": stiffness}
    )
    out = exact(machine, np.where(np.arange(1000) < 600, press, 0.0))
    forward = -level / stiffness * np.log(1 - press / level)
    back = level / stiffness * np.log(1 + press / level)
    assert out.angle[[600, -1], 0] == pytest.approx([forward, forward - back], abs=1e-6)


def test_a_cable_and_its_rest_angle_keep_the_energy() -> None:
    cable = {"stiffness": 2.0, "cubic": 1.5, "rest_angle": 0.4}
    out = exact(plain(cable_stiffness=cable), np.zeros(1500), velocity=1.5)
    deflection = out.angle[:, 0] - 0.4
    energy = 0.75 * out.velocity[:, 0] ** 2 + deflection**2 + 1.5 * deflection**4 / 4
    assert np.ptp(energy) < 1e-9
    assert deflection.min() < -0.5
    assert deflection.max() > 0.5


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_an_end_stop_throws_back_after_half_a_swing(side: float) -> None:
    v, stiffness, angle = 0.7, 900.0, 0.35
    out = exact(
        plain(end_stop={"angle": side * angle, "stiffness": side * stiffness}), np.zeros(300), velocity=side * v
    )
    arrives, contact = angle / v, np.pi * np.sqrt(1.5 / stiffness)
    t = out.time
    deep = v * np.sqrt(1.5 / stiffness) * np.sin(np.clip(t - arrives, 0, contact) / np.sqrt(1.5 / stiffness))
    free = np.where(t < arrives, v * t, angle - v * np.maximum(t - arrives - contact, 0.0))
    assert side * out.angle[:, 0] == pytest.approx(free + deep, abs=1e-6)


def test_a_payload_changes_between_two_samples() -> None:
    """Forces act on, speed does not jump, and energy is kept before and after, each with its own J and alpha."""
    change = 1.0013
    out = exact(plain(payload_change={"time": change, "inertia": 0.5, "gravity": 0.0}), np.full(400, 3.0))
    t = out.time
    velocity = 3.0 / 1.5 * np.minimum(t, change) + 3.0 / 2.0 * np.maximum(t - change, 0.0)
    assert out.velocity[:, 0] == pytest.approx(velocity, abs=1e-12)
    machine = Machine(inertia=1.5, gravity=0.7, viscous_friction=0.0, effects={})
    swing = exact(machine.hiding(payload_change={"time": change, "inertia": -0.5, "gravity": 0.4}), np.zeros(600))
    x, v = swing.angle[:, 0], swing.velocity[:, 0]
    before = swing.time < change
    assert np.ptp((0.75 * v**2 + 0.7 * np.sin(x))[before]) < 1e-9
    assert np.ptp((0.5 * v**2 + 1.1 * np.sin(x))[~before]) < 1e-9


def test_a_payload_hangs_on_the_load_behind_the_drivetrain() -> None:
    drivetrain = {"frequency": 60.0, "damping": 0.3, "motor_share": 0.4}
    payload = {"time": 0.5013, "inertia": 0.7, "gravity": 0.0}
    out = exact(plain(compliance=drivetrain, payload_change=payload), np.full(800, 2.0))
    assert np.diff(out.velocity[700:, 0]) / SAMPLE == pytest.approx(2.0 / 2.2, abs=1e-9)
    apart = np.where(out.time > 0.5013, 0.7, 0.0)
    motor, load = (np.gradient(a[:, 0], SAMPLE) for a in (out.motor_angle, out.angle))
    momentum = 0.6 * motor + (0.9 + apart) * load
    late = out.time > 0.52  # the payload comes with the speed of the load
    assert np.diff(momentum[late][:-1]) == pytest.approx(2.0 * SAMPLE, abs=1e-6)


@pytest.mark.parametrize("delay", [0.0, 0.0021])
def test_a_periodic_disturbance_is_a_wave_in_time(delay: float) -> None:
    wave = {"amplitude": 0.4, "frequency": 7.0, "phase": 0.6}
    out = exact(plain(periodic_disturbance=wave, input_delay={"time": delay}), np.zeros(800))
    w = 2 * np.pi * 7.0
    expected = 0.4 / (1.5 * w) * (np.cos(0.6) - np.cos(w * out.time + 0.6))
    assert out.velocity[:, 0] == pytest.approx(expected, abs=1e-9)


def test_friction_drifts_with_time() -> None:
    viscous = exact(plain(friction_drift={"viscous_rate": 0.3, "coulomb_rate": 0.0}), np.zeros(800), velocity=1.0)
    assert viscous.velocity[:, 0] == pytest.approx(np.exp(-0.3 * viscous.time**2 / 2 / 1.5), abs=1e-9)
    dry = exact(plain(friction_drift={"viscous_rate": 0.0, "coulomb_rate": 0.3}), np.zeros(800), velocity=-1.0)
    assert dry.velocity[:, 0] == pytest.approx(np.minimum(0.3 * dry.time**2 / 2 / 1.5 - 1.0, 0.0), abs=1e-9)
    assert np.ptp(dry.angle[dry.time > np.sqrt(10.0)]) == 0.0
    less = exact(plain(friction_drift={"viscous_rate": 0.0, "coulomb_rate": -0.3}), np.zeros(100), velocity=-1.0)
    assert less.velocity == pytest.approx(-1.0, abs=1e-12)


def test_an_eccentric_encoder_reads_its_own_angle() -> None:
    command = excitation(2, duration=4.0)
    effect = {"amplitude": 0.02, "order": 3.0, "phase": 0.5}
    out = exact(plain(encoder_eccentricity=effect), command)
    assert out.measured - out.angle == pytest.approx(0.02 * np.sin(3.0 * out.angle + 0.5), abs=1e-12)
    assert np.array_equal(out.angle, exact(plain(), command).angle)


@pytest.mark.parametrize("time_constant", [0.0003, 0.004, 0.03])
def test_a_lagging_sensor_falls_behind_a_ramp(time_constant: float) -> None:
    out = exact(plain(sensor_lag={"time_constant": time_constant}), np.zeros(200), angle=0.8, velocity=2.0)
    behind = 2.0 * time_constant * (1 - np.exp(-out.time / time_constant))
    assert (out.angle - out.measured)[:, 0] == pytest.approx(behind, abs=1e-9)


def test_sensor_lag_acts_before_the_noise() -> None:
    wave, time_constant, v = {"amplitude": 0.02, "order": 9.0, "phase": 0.0}, 0.02, 3.0
    machine = plain(encoder_eccentricity=wave, sensor_lag={"time_constant": time_constant})
    out = exact(machine, np.zeros(600), velocity=v)
    ripple = (out.measured - out.angle)[300:, 0] + v * time_constant
    late = np.arctan(9.0 * v * time_constant)
    expected = 0.02 * np.cos(late) * np.sin(9.0 * out.angle[300:, 0] - late)
    assert ripple == pytest.approx(expected, abs=1e-5)
    noisy = record(machine, np.zeros(2000), velocity=v, bits=None)
    clean = exact(machine, np.zeros(2000), velocity=v)
    shake = (noisy.measured - clean.measured)[:, 0]
    assert np.std(shake) == pytest.approx(1e-3, rel=0.06)
    assert abs(np.corrcoef(shake[1:], shake[:-1])[0, 1]) < 0.1


@pytest.mark.parametrize("lag", [1e-4, 0.0015])
def test_a_lag_decaying_through_the_dead_zone_is_exact(lag: float) -> None:
    command = excitation(14002, duration=1.0)
    machine = Machine().hiding(actuator_lag={"time_constant": lag}, torque_saturation={"limit": 2.0})
    usual, fine = (record(machine, command, noise=0.0, bits=None, steps=steps).angle for steps in (2, 64))
    np.testing.assert_allclose(usual, fine, atol=1e-7)


@pytest.mark.parametrize("rate", [300.0, 2800.0])
def test_a_ramp_through_the_dead_zone_is_followed_closely(rate: float) -> None:
    command = excitation(14002, duration=1.0)
    machine = Machine().hiding(rate_limit={"rate": rate}, torque_saturation={"limit": 2.0})
    usual, fine = (record(machine, command, noise=0.0, bits=None, steps=steps).angle for steps in (2, 64))
    np.testing.assert_allclose(usual, fine, atol=1e-7)
