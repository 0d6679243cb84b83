"""Run a scenario: the controller of `mpc` in closed loop with the rig."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from antidrive.closed_loop_run import ClosedLoopRun
from antidrive.drive_loss import loop_with_drive_loss
from antidrive.remaining_time import Parts, Tell
from antidrive.scenario import Scenario
from antidrive.test_bench import is_built, on_the_bench, test_bench
from mpc import Controller, closed_loop
from plant.drive_train import DriveTrain
from plant.errors import BadParameter
from plant.gears import GearTrain
from plant.rig import Rig
from plant.servo import ServoModel

MAX_TORQUE = 0.3  # default of a controller's maximum torque [N m]
NOTHING: Mapping[str, Any] = MappingProxyType({})

REPETITIONS = 5
"""Number of repetitions of a reported loop, to give the scatter of its numbers."""


def run_scenario(
    scenario: Scenario,
    *,
    model: ServoModel | None = None,
    train: DriveTrain | None = None,
    options: Mapping[str, Any] = NOTHING,
    seed: int = 0,
    repetitions: int = 0,
    tell: Tell | None = None,
) -> ClosedLoopRun:
    """Close the loop on the rig of a scenario.

    Args:
        scenario: the scenario.
        model: design model of the controller, and of the test bench unless the scenario gives the inertia of its own
            machine; by default eq. (4) with the rig's inertia, gravity and viscous friction.
        train: drives of the machine; by default those of the paper.
        options: attributes of the controller that override those of the scenario.
        seed: of the encoder's noise.
        repetitions: number of further runs with other noise, to give the scatter of the numbers.
        tell: called with a line of text at each hundredth.

    Raises:
        BadParameter: a number of the scenario that the rig or the controller cannot use.
    """
    numbers = {"sample_time": scenario.sample_time, **scenario.controller, **options}
    scenario = replace(scenario, sample_time=numbers.pop("sample_time"), controller=numbers)
    rig, design, notes = _machine(scenario, model, train)
    if rig.gears.drives == 1 and (scenario.drive_loss is not None or scenario.compare_single_drive):
        raise BadParameter(f"{scenario.name}: is about two drives; leave --one-drive out.")
    samples = scenario.pushes().size * (1 + (scenario.drive_loss is not None) + scenario.compare_single_drive)
    done = Parts((1 + repetitions) * samples, tell).done
    trial = _played(scenario, rig, design, seed, done)
    again = (_played(scenario, rig, design, seed + 1 + number, done) for number in range(repetitions))
    return replace(trial, again=tuple(other.summary() for other in again), notes=tuple(notes))


def _machine(
    scenario: Scenario, model: ServoModel | None, train: DriveTrain | None
) -> tuple[Rig, ServoModel, list[str]]:
    """The rig, the design model of its controller, and remarks on them."""
    if model is not None and is_built(scenario.rig):
        limits = np.max(np.asarray(scenario.controller.get("max_torque", MAX_TORQUE)))
        rig, notes = test_bench(
            model, train or GearTrain.paper(), scenario.rig, max_torque=float(limits), attributes=scenario.controller
        )
        return rig, on_the_bench(model), notes
    rig = scenario.machine()
    if train is not None:
        rig = replace(rig, gears=train, drives=tuple(range(1, train.drives + 1)))
    if model is None:
        return rig, rigid_model(rig), []
    return rig, model, [f"The test bench is that of the scenario, {rig.total_inertia:.4g} kg m^2."]


def _played(scenario: Scenario, rig: Rig, design: ServoModel, seed: int, done: Callable[[], None]) -> ClosedLoopRun:
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
        raise BadParameter(
            f"{scenario.name}: the simulated machine diverged; give the controller a model that fits it."
        )
    return ClosedLoopRun(
        title=scenario.title,
        scenario=scenario,
        result=result,
        min_torque=float(np.min(first.bounds.least)),
        max_torque=float(np.max(first.bounds.greatest)),
        single=single,
        intact=intact,
    )


def rigid_model(rig: Rig) -> ServoModel:
    """Eq. (4) with the rig's own parameters, rotors in mesh."""
    motors = float(np.sum(rig.motor_viscous * rig.motor_ratios**2))
    return ServoModel(inertia=rig.total_inertia, gravity=rig.gravity, viscous_friction=rig.viscous_friction + motors)
