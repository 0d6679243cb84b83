"""A wave that returns with a repeated motion is no disturbance in time."""

from types import SimpleNamespace

import numpy as np
import pytest
from machine import Machine, record

from diagnosis import diagnose
from identification.log import Log
from plant.effects.recurrence import returns_to_its_states

TIME = np.arange(0.0, 40.0, 0.01)
STRIBECK = {"coulomb": 0.4, "excess": 0.4, "velocity": 0.3}


def swing(rate: float) -> SimpleNamespace:
    return SimpleNamespace(angle=np.sin(rate * TIME), velocity=rate * np.cos(rate * TIME), time=TIME)


@pytest.mark.parametrize(
    ("multiple", "low", "high"), [(1, 0.95, 1.0), (3, 0.9, 1.0), (2.5, -0.2, 0.2), (0.77, -0.2, 0.2)]
)
def test_harmonics_of_the_motion_return_and_other_waves_do_not(multiple, low, high):
    rate = 2.0 * np.pi * 0.25
    assert low <= returns_to_its_states(swing(rate), np.exp(1j * multiple * rate * TIME)) <= high


def test_states_that_are_visited_once_give_no_estimate():
    once = SimpleNamespace(angle=TIME**2, velocity=2.0 * TIME, time=TIME)
    assert returns_to_its_states(once, np.exp(1j * TIME)) == 0.0


def test_the_mean_is_over_all_pairs_of_visits_to_a_cell():
    """Written out, on a walk from cell to cell that stays for a while in each and comes back to some."""
    rng = np.random.default_rng(3)
    places = rng.integers(0, 2, (60, 2)) * 23.5 + 0.25
    stays = rng.integers(1, 6, 60)
    angle, velocity = np.repeat(np.vstack(([0.0, 0.0], [24.0, 24.0], places)), [1, 1, *stays], axis=0).T
    phasor = np.exp(2j * np.pi * rng.random(angle.size))
    visits: dict[tuple[int, int], list[list[complex]]] = {}
    before = None
    for x, v, z in zip(angle, velocity, phasor, strict=True):
        cell = (min(int(x), 23), min(int(v), 23))
        if cell != before:
            visits.setdefault(cell, []).append([])
        visits[cell][-1].append(z)
        before = cell
    means = [[np.mean(visit) for visit in cell] for cell in visits.values()]
    pairs = [a * np.conj(b) for cell in means for i, a in enumerate(cell) for j, b in enumerate(cell) if i != j]
    expected = float(np.mean(pairs).real)
    assert returns_to_its_states(SimpleNamespace(angle=angle, velocity=velocity), phasor) == pytest.approx(
        expected, rel=1e-12
    )


def swung(disturbance: dict[str, float] | None, **hidden: dict[str, float]) -> Log:
    """The machine swung by a sine of 0.2 Hz, over and over."""
    machine = Machine().hiding(**hidden, **({"periodic_disturbance": disturbance} if disturbance else {}))
    time = np.arange(0.0, 30.0, 0.005)
    return record(machine, 4.0 * np.sin(2.0 * np.pi * 0.2 * time), seed=1, noise=2e-4).log()


@pytest.mark.long
def test_friction_in_a_repeated_motion_is_not_called_a_wave():
    candidates = ["periodic_disturbance", "friction_drift"]
    found = diagnose(swung(None, stribeck_friction=STRIBECK), candidates=candidates)
    assert found.verdict == "unknown"
    assert "velocity" in found.unexplained.depends_on


@pytest.mark.long
def test_a_wave_beside_the_motion_is_named():
    wave = {"amplitude": 0.1, "frequency": 0.93, "phase": 0.3}
    (cause,) = diagnose(swung(wave)).causes
    assert cause.effect == "periodic_disturbance"
