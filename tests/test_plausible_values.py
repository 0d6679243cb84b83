"""Values that a cause hardly ever has are paid for: a spring that is soft over half of the travel is seldom a stop."""

from __future__ import annotations

import numpy as np
import pytest
from machine import Machine, excitation, record

from diagnosis import diagnose
from plant.effects import (
    CableStiffness,
    Cogging,
    Compliance,
    Effect,
    EncoderEccentricity,
    EndStop,
    PayloadChange,
    PeriodicDisturbance,
)
from plant.effects.effect import TURN, Covered


def covered(low: float, high: float, turn: float = TURN) -> Covered:
    """Of a log of 20 s, in which the load goes forth and back at 2 rad/s."""

    def ways(instant: float) -> tuple[float, float]:
        return 2.0 * instant, 2.0 * (20.0 - instant)

    return Covered(low=low, high=high, speed=2.0, duration=20.0, inertia=2.0, turn=turn, travelled=ways)


@pytest.mark.parametrize(
    ("effect", "plausible"),
    [
        (EndStop(angle=3.0, stiffness=90.0), True),
        (EndStop(angle=-1.0, stiffness=-2.0), True),
        (EndStop(angle=3.0, stiffness=0.003), False),
        (EndStop(angle=3.0, stiffness=0.0), False),
        (CableStiffness(stiffness=0.01), True),
        (CableStiffness(stiffness=0.01, rest_angle=-12.0), True),
        (CableStiffness(stiffness=0.01, rest_angle=-30.0), False),
        (CableStiffness(stiffness=-0.01, cubic=0.02), False),
        (Compliance(frequency=40.0, damping=0.2, motor_share=0.3), True),
        (Compliance(frequency=40.0, damping=0.4, motor_share=0.97), False),  # hardly anything swings
        (Cogging(amplitude=0.1, order=1.01, phase=0.3), False),  # gravity with its offset
        (Cogging(amplitude=0.1, order=2.0, phase=0.3), True),
        (Cogging(amplitude=0.1, order=0.7, phase=0.3), False),
        (EncoderEccentricity(amplitude=0.001, order=0.97, phase=0.3), True),
        (EncoderEccentricity(amplitude=0.001, order=0.7, phase=0.3), False),
        (EncoderEccentricity(amplitude=0.001, order=1.5, phase=0.3), True),
        (PeriodicDisturbance(amplitude=0.1, frequency=0.1, phase=0.3), True),
        (PeriodicDisturbance(amplitude=0.1, frequency=0.09, phase=0.3), False),  # no two periods: a drift
        (PayloadChange(time=5.0, inertia=0.1, gravity=0.2), True),
        (PayloadChange(time=0.1, inertia=0.1, gravity=0.2), False),  # the first load hardly moves
        (PayloadChange(time=19.9, inertia=0.1, gravity=0.2), False),
        (EncoderEccentricity(amplitude=0.7, order=1.5, phase=0.3), False),  # the reading would go back on the way
        (EncoderEccentricity(amplitude=0.3, order=1.5, phase=0.3), True),
        (EncoderEccentricity(amplitude=0.4, order=1.5, phase=0.3), False),  # by 0.6 of the radius of its disc
    ],
    ids=lambda value: " ".join(map(str, (value.name, *value.values))) if isinstance(value, Effect) else "",
)
def test_what_a_cause_can_be(effect: Effect, plausible: bool) -> None:
    assert effect.plausible(covered(-4.0, 5.0)) is plausible


def test_a_ripple_has_to_repeat_in_the_log() -> None:
    """Of the drawn logs with cogging none that covered less than two periods had that name; a sum of others had."""
    ripple = Cogging(amplitude=0.1, order=5.0, phase=0.3)
    assert ripple.plausible(covered(0.0, 2.6))
    assert not ripple.plausible(covered(0.0, 2.4))
    assert EncoderEccentricity(amplitude=0.001, order=1.0, phase=0.3).plausible(covered(0.0, 2.4))  # a disc is known


def test_a_spring_without_visible_oscillation_is_no_spring() -> None:
    """It fits a lag, by its damping over its frequency."""
    log = record(Machine().hiding(actuator_lag={"time_constant": 0.02}), excitation(6, duration=20.0), seed=6).log()
    found = diagnose(log, candidates=["compliance"])
    assert found.causes == ()
    assert found.verdict == "unknown"


@pytest.mark.long
def test_a_soft_spring_over_the_travel_is_no_end_stop() -> None:
    """The stop fits as well, and pays for two parameters where the cable pays for three."""
    cable = Machine().hiding(cable_stiffness={"stiffness": 5.54e-6, "cubic": 1.108e-7, "rest_angle": 0.4})
    log, validation = (record(cable, excitation(24000 + k, duration=30.0), seed=12000 + k).log() for k in (0, 1))
    near = ["cable_stiffness", "end_stop", "torque_offset", "cogging"]
    found = diagnose(log, holdout=validation, candidates=near)
    assert [cause.effect for cause in found.causes] == ["cable_stiffness"]
    (stop,) = (each for each in found.rejected if each.effect == "end_stop")
    assert stop.reason == "the fitted values are implausible for this effect"


def test_a_slow_wave_needs_two_periods_in_the_log() -> None:
    geared = EncoderEccentricity(amplitude=0.001, order=0.25, phase=0.3)
    assert not geared.plausible(covered(0.0, 40.0))
    assert geared.plausible(covered(-20.0, 40.0))


def test_on_a_linear_axis_nothing_comes_once_a_turn() -> None:
    """One metre is no measure of a screw or a scale: only what was seen twice is a wave."""
    pitch = EncoderEccentricity(amplitude=1e-5, order=5.0, phase=0.3)
    assert not pitch.plausible(covered(0.0, 1.0, turn=0.0))
    assert pitch.plausible(covered(0.0, 3.0, turn=0.0))


@pytest.mark.long
def test_an_unknown_offset_is_not_reported_as_a_distant_cable() -> None:
    """It would fit, from 70 rad away; a curve without a name says as much."""
    offset = Machine().hiding(torque_offset={"torque": 0.15})
    log, validation = (record(offset, excitation(24000 + k, duration=30.0), seed=12000 + k).log() for k in (0, 1))
    near = ["cable_stiffness", "asymmetric_friction", "gravity_offset", "cogging"]
    found = diagnose(log, holdout=validation, candidates=near)
    assert "cable_stiffness" not in {cause.effect for cause in found.causes}
    assert found.gain.cut > 0.95


@pytest.mark.long
def test_an_end_stop_at_the_edge_of_the_travel_is_identified() -> None:
    """After the hit a free simulation goes elsewhere; behind the observer that holds it a soft stop shows nothing."""
    command = excitation(32000, duration=30.0)
    (free,) = record(Machine(), command, seed=16000, noise=0.0).log().runs
    angle = free.output.max() - 0.00093 * np.ptp(free.output)
    stop = Machine().hiding(end_stop={"angle": angle, "stiffness": 30.0})
    near = ["end_stop", "cable_stiffness", "payload_change", "cogging"]
    (cause,) = diagnose(record(stop, command, seed=16000).log(), candidates=near).causes
    assert cause.effect == "end_stop"
    assert cause.parameters["angle"].value == pytest.approx(angle, abs=0.01)


def test_friction_in_one_direction_only_is_none() -> None:
    """It is an offset in part, and stands for one that may not be named."""
    log = record(Machine().hiding(torque_offset={"torque": 0.5}), excitation(24000, duration=20.0), seed=12000).log()
    found = diagnose(log, candidates=["asymmetric_friction"])
    assert not found.causes
    assert found.verdict == "unknown"
    (why,) = (each.reason for each in found.rejected if each.effect == "asymmetric_friction")
    assert why.endswith("is zero, at a bound") or why.endswith("are zero, at a bound")


def test_a_size_that_a_given_bound_holds_is_not_nothing() -> None:
    """Friction of 0.6 N m backward, of which a person says that it is 0.59 at most."""
    machine = Machine().hiding(asymmetric_friction={"forward": 0.2, "backward": 0.6, "viscous_difference": 0.0})
    log = record(machine, excitation(24000, duration=20.0), seed=12000).log()
    bounds = {"asymmetric_friction.backward": (0.0, 0.59)}
    found = diagnose(log, candidates=["asymmetric_friction"], bounds=bounds)
    (cause,) = found.causes
    assert cause.parameters["backward"].value == pytest.approx(0.59)
