"""What a log cannot show is said, with what to do next: each on a log that has the fault, nothing on a sound one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from front_door import DT, TRUTH, columns

from antidrive.demo import record
from diagnosis import diagnose, identifiability_warnings
from identification import Log, Unidentifiable, fit
from plant import ServoModel, simulate
from plant.effects import CoulombFriction
from plant.rig import Rig

TIME = DT * np.arange(1200)
WHEEL = ServoModel(inertia=0.8, gravity=0.0, viscous_friction=0.5, effects=(CoulombFriction(torque=0.4),))


def log(torque, angle) -> Log:
    noise = 1e-4 * np.random.default_rng(0).standard_normal(torque.size)
    return Log.from_arrays(time=DT * np.arange(torque.size), torque=torque, angle=angle + noise)


def played(model: ServoModel, torque, *, skip: int = 0) -> Log:
    """The log of a torque, without its first samples."""
    whole = log(torque, simulate(model, command=torque, dt=DT, substeps=4)[:-1, 0])
    return replace(whole, runs=tuple(run.slice(skip, len(run)) for run in whole.runs))


def swung(angle) -> Log:
    """The log of a motion, by the torque that makes it: with gravity, viscous and dry friction."""
    velocity = np.gradient(angle, DT)
    friction = 0.5 * velocity + 0.1 * np.sign(velocity)
    return log(0.8 * np.gradient(velocity, DT) + friction + 0.6 * np.cos(angle), angle)


def wave(size: float):
    return size * (np.sin(2 * np.pi * 0.6 * TIME) + np.sin(2 * np.pi * 1.5 * TIME))


def statements(of: Log) -> list[str]:
    return [sentence.split(":")[0] for sentence in identifiability_warnings(fit(of))]


GRAVITY = "Gravity is confounded with a torque offset"
DRY = "Dry friction is confounded with a torque offset"
ZONE = "The dead zone is confounded with a torque offset"
STICTION = "Stiction cannot be seen"


def test_an_informative_log_has_no_blind_spots():
    assert statements(Log.from_arrays(**columns(TRUTH))) == []
    assert statements(record(Rig.paper_like(coulomb_friction=0.25, encoder_noise=1e-4), seed=0)) == []
    assert statements(swung(wave(0.5))) == []


def test_a_load_that_turns_too_little_does_not_show_gravity():
    (sentence,) = identifiability_warnings(fit(swung(wave(0.05))))
    assert sentence == f"{GRAVITY}: the load turns by 11 degrees only; let it turn by more than 90 degrees."


def test_motion_without_reversal_hides_friction_and_dead_zone():
    one_way = 2.5 + 1.2 * np.sin(2 * np.pi * 0.7 * TIME) + 0.4 * np.sin(2 * np.pi * 2.3 * TIME)
    sentences = identifiability_warnings(fit(played(WHEEL, one_way, skip=300)))
    assert [sentence.split(":")[0] for sentence in sentences] == [DRY, STICTION, ZONE]
    assert "never turns back; let it move in both directions." in sentences[0]
    assert "is never slower than 3.4 rad/s; let it stop" in sentences[1]
    assert "never changes its sign; let it pass through zero slowly." in sentences[2]
    # from rest the start is in the log, and with it the breaking away
    assert STICTION not in statements(played(WHEEL, one_way))


def test_fast_reversals_show_dry_friction_but_no_stiction():
    square = np.where(np.sin(2 * np.pi * 0.25 * TIME) > 0, 1.0, -1.0)
    fast = np.cumsum(np.convolve(square, np.ones(2) / 2, "same")) * DT * 40
    assert statements(swung(fast)) == [STICTION]


def test_a_torque_within_the_dead_zone_is_to_be_raised():
    (sentence,) = identifiability_warnings(fit(played(WHEEL, 0.1 * np.sin(2 * np.pi * 0.5 * TIME))))
    assert sentence == (
        "The load does not move: a torque of at most 0.1 N m stays within the dead zone or the dry friction; raise it "
        "until the load moves."
    )


@pytest.mark.parametrize(("level", "noise"), [(0.0, 0.0), (0.7, 0.0), (0.7, 1.0)])
def test_a_load_that_never_moves_has_no_diagnosis_but_advice(level, noise):
    still = played(WHEEL, 0.1 * np.sin(2 * np.pi * 0.5 * TIME))
    constant = replace(still, runs=tuple(replace(run, output=level + noise * run.output) for run in still.runs))
    with pytest.raises(Unidentifiable, match=r"does not move: .*; raise it until the load moves"):
        diagnose(constant)


def test_a_steady_speed_shows_no_inertia_and_no_viscous_friction():
    expected = {"Inertia cannot be seen", "Viscous friction is confounded with dry friction"}
    assert expected <= set(statements(swung(3.0 * TIME)))
    assert not expected & set(statements(swung(wave(0.05))))


def test_a_linear_axis_has_no_gravity_to_show():
    torque = 2.0 * np.sin(2 * np.pi * TIME) + np.sin(2 * np.pi * 2.3 * TIME)
    still = 1e-3 * played(WHEEL, torque).runs[0].output
    axis = Log.from_arrays(time=TIME, force=torque, position=still)
    assert GRAVITY not in statements(axis)


@pytest.mark.parametrize(("size", "expected"), [(0.02, [GRAVITY]), (0.5, [])])
def test_a_diagnosis_warns_of_what_its_log_cannot_show(size, expected):
    warned = diagnose(swung(wave(size)), candidates=["coulomb_friction"]).warnings
    assert [text.split(":")[0] for text in warned if "cannot be" in text or "is confounded" in text] == expected
