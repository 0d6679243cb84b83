"""The paper's three-step experiment: its table, its estimate of alpha, and why that is wrong by a factor of 100.

The paper reads three steady speeds off a simulation of eq. (6) and solves eq. (8) for alpha, K and gamma. What it calls
average angles in degrees are instantaneous angles in radians, and what it calls steady still accelerates.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from machine import Array, Machine, Record, record

from identification.fit import fit

TORQUES = np.array([5.0, 10.0, 15.0])
SPEEDS = np.array([5.65, 11.89, 18.12])  # the paper's omega_ss [rad/s]
ANGLES = np.array([111.5, 236.05, 360.48])  # the paper's theta_av, "deg"
INERTIA, ALPHA, FRICTION, GAP = 2.0, 0.5, 0.8, 0.5
INSTANT = 22.4  # [s] when the paper took its readings


@cache
def experiment(noise: float = 0.0, bits: int | None = None) -> Record:
    """Three runs from rest at angle zero, one for each torque, 30 s at 5 ms."""
    machine = Machine(
        inertia=INERTIA, gravity=ALPHA, viscous_friction=FRICTION, effects={"dead_zone": {"half_width": GAP}}
    )
    return record(machine, np.tile(TORQUES, (6000, 1)), noise=noise, bits=bits)


def at_the_instant() -> tuple[Array, Array]:
    """(3,) angles and speeds when the readings were taken [rad, rad/s]."""
    motion, row = experiment(), round(INSTANT / 0.005)
    return motion.angle[row], motion.velocity[row]


def three_equations(speed: Array, cosine: Array, inertia_torque: Array | float = 0.0) -> Array:
    """(alpha, K, gamma) of eq. (8), tau = J x'' + K omega + gamma + alpha cos x; the paper leaves J x'' out."""
    matrix = np.column_stack((cosine, speed, np.ones(3)))
    return np.asarray(np.linalg.solve(matrix, TORQUES - inertia_torque))


def test_the_papers_own_numbers_give_the_papers_answer() -> None:
    alpha, friction, gap = three_equations(SPEEDS, np.cos(np.radians(ANGLES)))
    assert alpha == pytest.approx(0.0047, abs=2e-4)  # the table's last digit is worth this much
    assert friction == pytest.approx(0.8, abs=0.005)
    assert gap == pytest.approx(0.47, abs=0.01)


def test_the_table_is_a_snapshot_in_radians() -> None:
    angle, speed = at_the_instant()
    assert angle == pytest.approx([111.531, 236.050, 360.482], abs=6e-4)
    assert speed == pytest.approx([5.6684, 11.8829, 18.1130], abs=6e-5)
    assert angle == pytest.approx(ANGLES, abs=0.035)  # the table, to the digits that it gives
    assert speed == pytest.approx(SPEEDS, abs=0.02)


def test_the_unit_alone_does_not_save_alpha() -> None:
    """With the angles in radians, as they were, the three torques still lack the inertia torque."""
    angle, speed = at_the_instant()
    assert abs(three_equations(speed, np.cos(angle))[0]) < 0.02
    assert abs(three_equations(SPEEDS, np.cos(ANGLES))[0]) < 0.02


def test_the_load_still_accelerates_and_that_carries_the_gravity() -> None:
    angle, speed = at_the_instant()
    inertia_torque = TORQUES - GAP - FRICTION * speed - ALPHA * np.cos(angle)  # eq. (6)
    assert inertia_torque == pytest.approx([-0.0368, 0.4481, 0.3574], abs=6e-5)
    motion, row = experiment(), round(INSTANT / 0.005)
    numeric = INERTIA * (motion.velocity[row + 1] - motion.velocity[row - 1]) / 0.01
    assert numeric == pytest.approx(inertia_torque, abs=5e-3)  # the same from the motion alone
    assert three_equations(speed, np.cos(angle), inertia_torque) == pytest.approx([ALPHA, FRICTION, GAP], abs=1e-9)


def test_averages_over_whole_turns_cancel_gravity() -> None:
    motion = experiment()
    mean_cosine = []
    for angle in motion.angle.T:
        first = round(20.0 / 0.005)
        turns = np.floor((angle[-1] - angle[first]) / (2 * np.pi))
        last = int(np.searchsorted(angle, angle[first] + 2 * np.pi * turns))
        time = motion.time[first : last + 1]
        mean_cosine.append(np.trapezoid(np.cos(angle[first : last + 1]), time) / (time[-1] - time[0]))
    assert np.abs(np.array(mean_cosine) * ALPHA).max() < 5e-3  # of 0.5 N m


def test_alpha_is_in_the_ripple_of_the_speed() -> None:
    late = experiment().velocity[4000:]
    assert np.sqrt(2.0) * np.std(late, axis=0) == pytest.approx([0.044, 0.021, 0.014], abs=6e-4)


def test_the_fit_of_the_trajectory_finds_alpha() -> None:
    found = fit(experiment(noise=1e-3, bits=17).log_of_runs())
    names = ("inertia", "gravity", "viscous_friction", "dead_zone.half_width")
    for name, true in zip(names, (INERTIA, ALPHA, FRICTION, GAP), strict=True):
        line = found[name]
        assert line.value == pytest.approx(true, rel=0.05)
        assert abs(line.value - true) < 5 * line.std  # type: ignore[operator]
