"""Run a scenario: the controller of `mpc` in closed loop around the rig."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from antidrive.drive_loss import loop_with_drive_loss
from antidrive.scenario import Scenario
from antidrive.time_left import Parts, Tell
from antidrive.trial import Trial
from mpc import Controller, closed_loop
from plant.errors import BadParameter
from plant.rig import Rig
from plant.servo import ServoModel

REPETITIONS = 5
"""How often a loop that is reported is run again, to say how much its numbers scatter."""


def run_scenario(
    scenario: Scenario,
    *,
    model: ServoModel | None = None,
    seed: int = 0,
    repetitions: int = 0,
    tell: Tell | None = None,
) -> Trial:
    """Close the loop on the rig of a scenario.

    Args:
        scenario: what to do.
        model: design model of the controller; by default eq. (4) with the rig's inertia, gravity and viscous friction.
        seed: of the encoder's noise.
        repetitions: how often it is run again with other noise, to say how much the numbers scatter.
        tell: called with a line of text at each hundredth.

    Raises:
        BadParameter: a number of the scenario that the rig or the controller cannot use.
    """
    rig = scenario.machine()
    design = rigid_model(rig) if model is None else model
    samples = scenario.pushes().size * (1 + (scenario.drive_loss is not None) + scenario.compare_single_drive)
    done = Parts((1 + repetitions) * samples, tell).done
    trial = _played(scenario, rig, design, seed, done)
    again = (_played(scenario, rig, design, seed + 1 + number, done) for number in range(repetitions))
    return replace(trial, again=tuple(other.summary() for other in again))


def _played(scenario: Scenario, rig: Rig, design: ServoModel, seed: int, done: Callable[[], None]) -> Trial:
    """One run."""

    def controller() -> Controller:
        return Controller(design, rig.gears, sample_time=scenario.sample_time, **scenario.controller)

    pushes, loss = scenario.pushes(), scenario.drive_loss
    wanted = scenario.wanted(np.arange(pushes.size, dtype=np.float64) * scenario.sample_time)
    first = controller()
    result = closed_loop(first, rig, scenario.wanted, scenario.duration, seed, disturbance=pushes, after_sample=done)
    single = intact = None
    if loss is not None:
        intact = result
        result = loop_with_drive_loss(
            controller(),
            rig,
            wanted,
            pushes,
            drive=loss.drive,
            time=loss.time,
            detection=loss.detection,
            seed=seed,
            after_sample=done,
        )
    if scenario.compare_single_drive:
        single = loop_with_drive_loss(
            controller(), rig, wanted, pushes, drive=2, time=0.0, seed=seed, after_sample=done
        )
    if not np.all(np.isfinite(result.angle)):
        raise BadParameter(f"{scenario.name}: the rig ran away; give the controller a model that fits the rig.")
    return Trial(
        title=scenario.title,
        scenario=scenario,
        result=result,
        min_torque=float(np.min(first.bounds.least)),
        max_torque=float(np.max(first.bounds.greatest)),
        single=single,
        intact=intact,
    )


def rigid_model(rig: Rig) -> ServoModel:
    """Eq. (4) with the rig's own numbers, rotors in mesh: what a careful engineer knows from the drawings."""
    motors = float(np.sum(rig.motor_viscous * rig.motor_ratios**2))
    return ServoModel(inertia=rig.total_inertia, gravity=rig.gravity, viscous_friction=rig.viscous_friction + motors)
