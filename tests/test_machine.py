"""The machine that hides effects is itself held against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from machine import Follower, Machine, excitation, load_fluctuation, record, wandering_reference

SAMPLE = 0.005


def plain(**effects: dict[str, float]) -> Machine:
    return Machine(inertia=1.5, gravity=0.0, viscous_friction=0.0, effects=effects)


def exact(machine: Machine, command: np.ndarray, **kwargs: float):
    return record(machine, command, noise=0.0, bits=None, **kwargs)


def test_a_constant_torque_against_viscous_friction_has_its_closed_form() -> None:
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


def test_a_lag_loses_its_time_constant_of_impulse() -> None:
    command = np.where(np.arange(1000) < 100, 0.0, 2.0)
    out = exact(plain(actuator_lag={"time_constant": 0.04}), command)
    assert out.velocity[-1, 0] == pytest.approx(2.0 / 1.5 * (out.time[-1] - 100 * SAMPLE - 0.04), abs=1e-9)


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
    coarse, fine = (exact(machine, command, steps=steps).angle for steps in (4, 16))
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
