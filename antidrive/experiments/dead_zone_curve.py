"""Figure 6 of the paper: the dead zone as an input-output curve on the rig, compared with the true backlash.

One drive slowly pushes and pulls against a load whose brake is on. Torque over twist, the motor's angle less the
load's, is flat across the backlash and rises on either flank. The transmitted torque is below the commanded torque by
the motor's friction, for any backlash; the backlash itself causes a delay at each reversal, while the rotor crosses it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from antidrive.chart import AFTER, BEFORE, MEASURED, SECOND
from antidrive.experiments.outcome import Array, Curve, Outcome, Picture
from antidrive.experiments.settings import need_positive, need_samples
from plant.errors import BadParameter
from plant.fleet import Fleet
from plant.rig import Rig
from plant.signals import triangle

ON_A_FLANK = 0.3  # fraction of the greatest torque from which the teeth are certainly in contact
COLOURS = (BEFORE, AFTER, SECOND, MEASURED)


@dataclass(frozen=True, kw_only=True)
class DeadZoneSettings:
    """The triangular torque and the machines.

    Attributes:
        title: for users.
        amplitude: of the commanded torque, at the output gear [N m].
        frequency: of its triangle [Hz].
        duration, sample_time: [s].
        brake: dry friction that holds the load [N m].
        gaps: backlashes to measure [rad].
        rig: fields of `plant.rig.Rig` that differ from the paper-like machine.
    """

    title: str
    amplitude: float
    frequency: float
    duration: float
    sample_time: float
    brake: float
    gaps: tuple[float, ...]
    rig: Mapping[str, float]

    def __post_init__(self) -> None:
        """Check the settings that the rig does not check."""
        need_positive(self, "amplitude", "frequency", "duration", "sample_time", "gaps")
        need_samples(self.duration, self.sample_time)
        if self.duration * self.frequency < 1.0:
            raise BadParameter(f"duration = {self.duration:g} s must hold at least one period.")
        for rig in self.machines():
            if rig.motor_encoder_counts == 0:
                raise BadParameter("rig.motor_encoder_counts must be above zero here.")
            if self.brake <= self.amplitude + abs(rig.gravity):
                raise BadParameter(f"brake = {self.brake:g} N m does not hold the load against amplitude and gravity.")

    def machines(self) -> list[Rig]:
        """A rig for each backlash, with drive 2 alone."""
        held = {**self.rig, "coulomb_friction": self.brake, "drives": (2,)}
        return [Rig.paper_like(**{**held, "backlash": backlash}) for backlash in self.gaps]


@dataclass(frozen=True, kw_only=True, eq=False)
class DeadZoneCurves:
    """Curves of B machines over T samples, and values measured from them.

    Attributes:
        time, commanded: (T,) [s], commanded torque of the drive, at the output gear [N m].
        twist: (T, B) motor angle at the load side less load angle, by the encoders [rad].
        passed: (T, B) torque transmitted by the teeth [N m].
        actual, backlash: (B,) backlash [rad].
        true_friction, friction: (B,) half width of the dead zone in torque [N m].
        stiffness: (B,) of the gear contact [N m/rad].
        rate: of the torque [N m/s].
        crossing: (B,) time without transmitted torque at a reversal [s].
        flight: (B,) time of a free rotor to cross the backlash while the torque grows at that rate [s].
    """

    time: Array
    commanded: Array
    twist: Array
    passed: Array
    actual: Array
    backlash: Array
    true_friction: Array
    friction: Array
    stiffness: Array
    rate: float
    crossing: Array
    flight: Array


def experiment(settings: DeadZoneSettings, seed: int) -> DeadZoneCurves:
    """Apply the triangle to all machines and estimate backlash, stiffness and friction from the encoders.

    On the flanks, with torque D and the direction s of its change, twist = offset + sign(D) gap/2 + (D - s f)/k.
    """
    rigs = settings.machines()
    commanded = triangle(
        amplitude=settings.amplitude,
        frequency=settings.frequency,
        duration=settings.duration,
        sample_time=settings.sample_time,
    )
    pinion = np.repeat(commanded[:, None, None] / rigs[0].torque_map, len(rigs), axis=1)
    played = Fleet(rigs).run(pinion, settings.sample_time, range(seed, seed + len(rigs)))
    to_load = rigs[0].gears.pre_reductions[0] * rigs[0].torque_map[0]
    twist = played.motor_angles[:, :, 0] / to_load - played.angle
    # a measurement at a sample corresponds to the torque held until then
    before, direction = np.roll(commanded, 1), np.sign(np.roll(commanded, 1) - np.roll(commanded, 2))
    settled = np.arange(commanded.size) * settings.sample_time > 0.25 / settings.frequency
    use = settled & (np.abs(before) > ON_A_FLANK * settings.amplitude) & (direction != 0.0)
    columns = np.column_stack((np.ones(commanded.size), 0.5 * np.sign(before), before, -direction))[use]
    _, backlash, give, lag = np.linalg.lstsq(columns, twist[use], rcond=None)[0]
    passed, rate = played.contact_torques[:, :, 0], 4.0 * settings.amplitude * settings.frequency
    backlashes = np.array(settings.gaps)
    return DeadZoneCurves(
        time=played.time,
        commanded=before,
        twist=twist,
        passed=passed,
        actual=backlashes,
        backlash=backlash,
        true_friction=np.array([rig.motor_coulomb * rig.motor_ratios[0] for rig in rigs]),
        friction=lag / give,
        stiffness=1.0 / give,
        rate=rate,
        crossing=settings.sample_time * np.array([_empty_samples(column[settled]) for column in passed.T]),
        flight=np.cbrt(6.0 * rigs[0].rotor_inertias[0] * backlashes / rate),
    )


def _empty_samples(passed: Array) -> float:
    """Mean number of samples without torque between one flank and the other; bounces on one flank do not count."""
    touching = np.flatnonzero(passed != 0.0)
    crossings = np.sign(passed[touching[1:]]) != np.sign(passed[touching[:-1]])
    return float(np.mean(np.diff(touching)[crossings] - 1.0))


def run(settings: DeadZoneSettings, seed: int) -> Outcome:
    """Measure figure 6, and report it."""
    found = experiment(settings, seed)
    error = found.backlash / found.actual - 1.0
    cycle = found.time >= found.time[-1] - 1.0 / settings.frequency
    names = [f"backlash {1e3 * backlash:g} mrad" for backlash in found.actual]
    coloured = [(k, name, COLOURS[k % len(COLOURS)]) for k, name in enumerate(names)]
    rig = settings.machines()[0]
    count = 2.0 * np.pi / rig.motor_encoder_counts / rig.motor_ratios[0] * rig.flank_stiffness
    reversal = found.time[-1] - 0.5 / settings.frequency
    near = np.abs(found.time - reversal) < max(0.15, 3.0 * np.max(found.flight))
    return Outcome(
        title=settings.title,
        results=(
            f"Backlash of {_list(1e3 * found.actual, '.4g')} mrad is measured as {_list(1e3 * found.backlash, '.4g')} "
            f"mrad, from the encoders alone: the largest error is {100 * np.max(np.abs(error)):.2g} %.",
            "Equation (6) puts the dead zone into the torque. The simulated torque is smaller as well, by "
            f"{found.true_friction[0]:.3f} N m, but that is the motor's friction and does not grow with the backlash "
            f"(by the encoders {_list(found.friction)} N m; one count of the motor's is {count:.2g} N m of wind-up).",
            f"Backlash costs time: where the torque reverses at {found.rate:.3g} N m/s, no torque is transmitted for "
            f"{_list(1e3 * found.crossing, '.0f')} ms; a free rotor needs (6 J backlash/rate)^(1/3) = "
            f"{_list(1e3 * found.flight, '.0f')} ms.",
        ),
        comparison=(
            ("half width gamma [N m]", "0.5 (put into the model)", f"{found.true_friction[0]:.4f} (motor friction)"),
            *(
                (f"backlash of {1e3 * true:g} mrad [mrad]", "", f"{1e3 * backlash:.4f} ({100 * off:+.2f} %)")
                for true, backlash, off in zip(found.actual, found.backlash, error, strict=True)
            ),
            ("time without torque at a reversal [ms]", "", _list(1e3 * found.crossing, ".0f")),
            ("mesh stiffness [N m/rad]", "", _list(found.stiffness, ".4g")),
        ),
        found={
            "true_gaps": found.actual.tolist(),
            "gaps": found.backlash.tolist(),
            "largest_relative_error": float(np.max(np.abs(error))),
            "torque_dead_zones": found.friction.tolist(),
            "true_torque_dead_zone": float(found.true_friction[0]),
            "crossing_times": found.crossing.tolist(),
            "flight_times": found.flight.tolist(),
            "stiffnesses": found.stiffness.tolist(),
        },
        columns={
            "time": found.time,
            "torque": found.commanded,
            **{f"twist_{k + 1}": found.twist[:, k] for k in range(len(names))},
            **{f"passed_torque_{k + 1}": found.passed[:, k] for k in range(len(names))},
        },
        pictures=(
            Picture(
                caption="Commanded torque over twist, by the encoders: the dead zone is the backlash.",
                x="motor angle less load angle [rad]",
                y="torque [N m]",
                curves=[
                    *(_true_curve(found, k, settings.amplitude) for k in range(len(names))),
                    *(
                        Curve(name=n, colour=c, x=found.twist[cycle, k], y=found.commanded[cycle])
                        for k, n, c in coloured
                    ),
                ],
            ),
            Picture(
                caption="A reversal: torque transmitted while the rotor crosses the backlash, and at the impact.",
                x="time [s]",
                y="transmitted torque [N m]",
                curves=[Curve(name=n, colour=c, x=found.time[near], y=found.passed[near, k]) for k, n, c in coloured],
            ),
        ),
    )


def _true_curve(found: DeadZoneCurves, machine: int, amplitude: float) -> Curve:
    half, reach = found.actual[machine] / 2, amplitude / found.stiffness[machine]
    return Curve(
        name="true",
        colour=MEASURED,
        x=np.array([-half - reach, -half, half, half + reach]),
        y=amplitude * np.array([-1.0, 0.0, 0.0, 1.0]),
    )


def _list(values: Array, form: str = ".3f") -> str:
    return ", ".join(format(value, form) for value in values)
