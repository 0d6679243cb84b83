"""Identification in differential and in common mode: parameters of two opposed drives, and of their load.

Differential mode sweeps the preload at standstill: backlash, contact stiffness and friction of each drive. Common mode
moves the load under a constant preload: inertia, gravity, viscous friction, and a dry friction that grows with the
preload as predicted from the differential mode.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from antidrive.experiments.outcome import Array
from antidrive.experiments.preload_sweep import Sweep, logs_of
from antidrive.experiments.settings import need_positive, need_samples
from antidrive.remaining_time import Parts, Tell
from identification.fit import fit
from identification.fit_result import Fit
from identification.log import Log
from identification.lost_motion import LostMotion, lost_motion
from plant.effects import CoulombFriction
from plant.errors import BadParameter
from plant.fleet import Fleet
from plant.rig import Rig
from plant.servo import ServoModel
from plant.signals import chirp


@dataclass(frozen=True, kw_only=True)
class DifferentialSettings:
    """Machines, sweep of the preload, and the common mode.

    Attributes:
        title: for users.
        gaps: backlashes to measure [rad].
        bits: of the encoders at load and motors.
        least_preload, greatest_preload: of each drive, at the load side [N m].
        visit: duration of the preload in one direction [s].
        visits: number of visits, in alternating directions.
        sample_time: [s].
        stiffness, damping: of the loop that holds the load [N m/rad], [N m s/rad].
        load_speed: speed of the load meanwhile [rad/s].
        amplitude, start, stop, duration: of the output torque in common mode [N m], [Hz], [Hz], [s].
        preloads: of each drive in common mode, at the load side [N m].
        rig: fields of `plant.rig.Rig` that differ from the paper-like machine.
    """

    title: str
    gaps: tuple[float, ...]
    bits: tuple[float, ...]
    least_preload: float
    greatest_preload: float
    visit: float
    visits: int
    sample_time: float
    stiffness: float
    damping: float
    load_speed: float
    amplitude: float
    start: float
    stop: float
    duration: float
    preloads: tuple[float, ...]
    rig: Mapping[str, float]

    def __post_init__(self) -> None:
        """Check the settings that the rig does not check."""
        need_positive(self, "gaps", "least_preload", "visit", "sample_time", "stiffness", "amplitude", "duration")
        need_samples(self.visit * self.visits, self.sample_time)
        need_samples(self.duration, self.sample_time)
        if any(each != round(each) or not 4 <= each <= 32 for each in self.bits):
            raise BadParameter(f"bits must be whole numbers from 4 to 32, not {self.bits!r}.")
        if self.visits < 4:
            raise BadParameter(f"visits = {self.visits} must be 4 or more, so that both flanks are visited twice.")
        if self.greatest_preload < 2.0 * self.least_preload:
            raise BadParameter("greatest_preload must be twice least_preload or more, or the stiffness does not show.")
        if min(self.preloads) <= 0.5 * self.amplitude:
            raise BadParameter("preloads must be above half the amplitude, or contact is lost in common mode.")
        named = {"backlash", "encoder_counts", "motor_encoder_counts"} & set(self.rig)
        if named:
            raise BadParameter(f"rig.{min(named)} is given by gaps and bits here.")
        self.machine(self.gaps[0], int(self.bits[0]))

    def machine(self, backlash: float, bits: int) -> Rig:
        """A rig with a backlash [rad] and encoders of some bits."""
        changes = {**self.rig, "backlash": backlash, "encoder_counts": 2**bits, "motor_encoder_counts": 2**bits}
        return Rig.paper_like(**changes)

    def sweep(self) -> Sweep:
        """The sweep of the preload."""
        return Sweep(
            least=self.least_preload,
            greatest=self.greatest_preload,
            visit=self.visit,
            visits=self.visits,
            sample_time=self.sample_time,
            stiffness=self.stiffness,
            damping=self.damping,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """One machine: its bits and backlash [rad], and the estimates."""

    bits: int
    gap: float
    found: LostMotion

    @property
    def error(self) -> float:
        """Relative error of the estimated backlash, of the drive with the larger error."""
        return max((drive.gap.value / self.gap - 1.0 for drive in self.found.drives), key=abs)

    @property
    def std(self) -> float:
        """Its relative standard error."""
        return max(drive.gap.std for drive in self.found.drives) / self.gap


@dataclass(frozen=True, kw_only=True, eq=False)
class Differential:
    """Results of both modes.

    Attributes:
        rig: one of the machines.
        cases: of every backlash and encoder, with a slowly moving load.
        standing: of the smallest backlash and every encoder, with a load at rest.
        log: of one machine, in the form of a measured log.
        common: fits under each preload of the common mode.
    """

    rig: Rig
    cases: list[Case]
    standing: list[Case]
    log: Log
    common: list[Fit]

    def friction(self, preload: Array) -> Array:
        """Dry friction of both drives [N m] under preloads (P,), from the best case of the differential mode."""
        drives = self.best.found.drives
        return sum((d.friction.value + d.friction_coefficient.value * preload for d in drives), np.zeros(preload.size))

    @property
    def best(self) -> Case:
        """The case with the least standard error of friction."""
        return min(self.cases, key=lambda case: case.found.drives[0].friction.std)


def experiment(settings: DifferentialSettings, seed: int, tell: Tell | None = None) -> Differential:
    """Sweep the preload of all machines, then move one of them in common mode."""
    plans = [(int(bits), backlash, settings.load_speed) for backlash in settings.gaps for bits in settings.bits]
    plans += [(int(bits), min(settings.gaps), 0.0) for bits in settings.bits]
    rigs = [settings.machine(backlash, bits) for bits, backlash, _ in plans]
    sweep = settings.sweep().preload().size  # in samples of the sweep; a fit takes as long as 100 to 700 of them
    parts = Parts(sweep * (1.0 + len(plans) / 60 + len(settings.preloads) / 9), tell)
    load_speed = [speed for *_, speed in plans]
    logs = logs_of(Fleet(rigs), settings.sweep(), load_speed=load_speed, seed=seed, parts=parts)
    cases = [
        Case(bits=bits, gap=backlash, found=lost_motion(log, rig.gears))
        for (bits, backlash, _), log, rig in zip(plans, logs, rigs, strict=True)
    ]
    moving = len(cases) - len(settings.bits)
    return Differential(
        rig=rigs[0],
        cases=cases[:moving],
        standing=cases[moving:],
        log=logs[moving // 2],
        common=[_common(settings, rigs[moving // 2], preload, seed) for preload in settings.preloads],
    )


def _common(settings: DifferentialSettings, rig: Rig, preload: float, seed: int) -> Fit:
    """Fit of eq. (4) with dry friction to a chirp under a preload of each drive [N m], at the load side."""
    torque = chirp(
        amplitude=settings.amplitude,
        start=settings.start,
        stop=settings.stop,
        duration=settings.duration,
        sample_time=5.0 * settings.sample_time,
    )
    pinions = rig.gears.pinion_torques(
        torque, np.full(torque.size, preload / (rig.gears.mesh_ratios * rig.gears.null_vector)[0])
    )
    played = rig.run(pinions, 5.0 * settings.sample_time, seed, start=rig.rest(torques=pinions[0]))
    log = Log.from_arrays(time=played.time, torque=torque, angle=played.angle, label=f"preload {preload:g} N m")
    start = ServoModel(inertia=1.0, gravity=0.0, viscous_friction=0.1, effects=(CoulombFriction(torque=0.1),))
    return fit(log, start)
