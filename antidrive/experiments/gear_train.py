"""Section 3.1 of the paper: reduction, speed, and the speed-torque envelope of the motors at 36 V."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from antidrive.chart import AFTER, BEFORE, SECOND
from antidrive.experiments.outcome import Array, Curve, Outcome, Picture
from antidrive.experiments.settings import need_positive, need_samples
from plant.errors import BadParameter
from plant.fleet import Fleet
from plant.gears import GearTrain
from plant.rig import Rig

SAMPLE_TIME = 0.005  # of a run on the rig [s]
SETTLED = 20.0  # duration of a run, in time constants of inertia over back-EMF
PAPER_SPEEDS = np.array([5.65, 11.89, 18.12])  # section 4 [rad/s]


@dataclass(frozen=True, kw_only=True)
class GearTrainSettings:
    """Teeth, motors and loads.

    Attributes:
        title: for users.
        stages: driven and driving teeth of each stage in series: 46, 18, 41, 17, ...
        pinion_teeth, output_teeth: of the final mesh.
        motor_speed: without load, at the supply voltage [rpm].
        supply_voltage: [V].
        winding_resistance: of each motor [ohm]; the paper does not give it.
        holding_torque: preload torque at the pinion of the other drive [N m].
        loads: load torques at which the rig is measured [N m].
        rig: fields of `plant.rig.Rig` that differ from the paper-like machine.
    """

    title: str
    stages: tuple[float, ...]
    pinion_teeth: int
    output_teeth: int
    motor_speed: float
    supply_voltage: float
    winding_resistance: float
    holding_torque: float
    loads: tuple[float, ...]
    rig: Mapping[str, float]

    def __post_init__(self) -> None:
        """Check the settings that the rig does not check."""
        need_positive(self, "motor_speed", "supply_voltage", "winding_resistance")
        if len(self.stages) % 2 or any(count % 1 for count in self.stages):
            raise BadParameter(f"stages must be pairs of whole numbers, driven and driving, not {self.stages!r}.")
        self.machine()

    def gears(self) -> GearTrain:
        """The gear train."""
        teeth = [int(count) for count in self.stages]
        pairs = tuple(zip(teeth[::2], teeth[1::2], strict=True))
        return GearTrain(pinion_teeth=(self.pinion_teeth,) * 2, output_teeth=self.output_teeth, stages=pairs)

    def machine(self) -> Rig:
        """The rig, with a pure inertia as load."""
        motors = {
            "torque_constant": self.supply_voltage / (self.motor_speed * 2.0 * np.pi / 60.0),
            "supply_voltage": self.supply_voltage,
            "winding_resistance": self.winding_resistance,
        }
        return Rig(gears=self.gears(), **{"inertia": 2.0, **motors, **self.rig})  # type: ignore[arg-type]


@dataclass(frozen=True, kw_only=True, eq=False)
class Envelope:
    """Load speed over load torque at full voltage.

    Attributes:
        load: (B,) load torques [N m].
        formula: (B, 2) speed [rad/s] with both motors driving, and with one driving while the other preloads.
        measured: (B, 2) the same on the rig.
    """

    load: Array
    formula: Array
    measured: Array

    @property
    def largest_difference(self) -> float:
        """Largest difference between rig and formula [rad/s]."""
        return float(np.max(np.abs(self.measured - self.formula)))


def envelope(settings: GearTrainSettings) -> Envelope:
    """Measure the envelope on the rig and by formula: sum of stall_i - D_i w - friction = load, from U = R i + k w.

    Raises:
        BadParameter: a load that the motors cannot move.
    """
    rig, load = settings.machine(), np.array(settings.loads)
    ratios = rig.gears.motor_ratios
    friction, drag = rig.motor_coulomb * ratios[0], rig.motor_viscous * ratios[0] ** 2
    stall, slope = rig.stall_torques[0], rig.emf_damping[0]
    held = settings.holding_torque * rig.gears.mesh_ratios[0]
    both = (2.0 * (stall - friction) - load) / (2.0 * (slope + drag))
    one = (stall - 2.0 * friction - held - load) / (slope + 2.0 * drag)
    formula = np.column_stack((both, one))
    if np.min(formula) <= 0.0:
        raise BadParameter(f"loads: {np.max(load):g} N m stalls the motors; stay below {stall - held:.3g} N m.")
    full = -2.0 * stall / rig.gears.mesh_ratios[0]
    duration = SETTLED * rig.total_inertia / slope
    need_samples(duration, SAMPLE_TIME)
    count = round(duration / SAMPLE_TIME)
    measured = np.empty((load.size, 2))
    for place, command in enumerate(((full, full), (settings.holding_torque, full))):
        fleet = Fleet([rig] * load.size)
        played = fleet.run(np.tile(command, (count, load.size, 1)), SAMPLE_TIME, range(load.size), disturbance=-load)
        measured[:, place] = np.mean(played.velocity[-40:], axis=0)
    return Envelope(load=load, formula=formula, measured=measured)


def run(settings: GearTrainSettings, seed: int) -> Outcome:
    """Check the numbers of section 3.1 and measure the envelope."""
    gears, rig, found = settings.gears(), settings.machine(), envelope(settings)
    speed = settings.motor_speed * 2.0 * np.pi / 60.0 / gears.ratio
    factors = PAPER_SPEEDS / speed
    fine = np.linspace(0.0, 1.0, 50)
    names = ("both motors drive", "one drives, one preloads")
    curves = []
    for place, (name, colour) in enumerate(zip(names, (BEFORE, AFTER), strict=True)):
        line = np.polyfit(found.load, np.rad2deg(found.formula[:, place]), 1) if found.load.size > 1 else None
        if line is not None:
            over = fine * -line[1] / line[0]
            curves.append(Curve(name=name, colour=colour, x=over, y=np.polyval(line, over)))
        shown = np.rad2deg(found.measured[:, place])
        curves.append(Curve(name=f"{name}, simulated", colour=colour, x=found.load, y=shown, points=True))
    limit = np.rad2deg(speed)
    full = float(2.0 * rig.stall_torques[0])
    curves.append(Curve(name="no-load speed", colour=SECOND, x=np.array([0.0, full]), y=np.array([limit, limit])))
    holding = settings.holding_torque * rig.gears.mesh_ratios[0]
    return Outcome(
        title=settings.title,
        results=(
            f"The tooth counts give a reduction of {gears.ratio:.3f} to 1; {settings.motor_speed:g} rpm at the motor "
            f"are {np.rad2deg(speed):.1f} deg/s at the platform.",
            f"At {settings.supply_voltage:g} V both motors together stall at {2 * rig.stall_torques[0]:.3g} N m at the "
            f"platform. The winding resistance of {settings.winding_resistance:g} ohm is assumed; the paper does "
            f"not give it. To keep contact, one motor drives and the other preloads with {holding:.2g} N m against it. "
            f"The stall torque is then {rig.stall_torques[0] - holding:.3g} N m, about half. In the test-bench "
            f"simulation both lines agree within {100 * found.largest_difference / speed:.2g} % of the no-load speed.",
            f"The speeds of section 4, {', '.join(f'{v:g}' for v in PAPER_SPEEDS)} rad/s, are "
            f"{', '.join(f'{f:.1f}' for f in factors)} times the no-load speed of this machine, so that table must "
            "come from a simulation without the speed limit.",
        ),
        comparison=(
            ("reduction", "99.231", f"{gears.ratio:.3f}"),
            ("platform speed [deg/s]", "120.9", f"{np.rad2deg(speed):.1f}"),
            ("stall torque, both motors drive [N m]", "", f"{2 * rig.stall_torques[0]:.4g}"),
            ("stall torque, preloaded [N m]", "", f"{rig.stall_torques[0] - holding:.4g}"),
            ("largest difference, simulation and formula [rad/s]", "", f"{found.largest_difference:.2g}"),
        ),
        found={
            "ratio": gears.ratio,
            "no_load_speed": speed,
            "no_load_speed_deg": float(np.rad2deg(speed)),
            "stall_torque_both": full,
            "stall_torque_preloaded": float(rig.stall_torques[0] - holding),
            "largest_difference": found.largest_difference,
            "section4_speeds_over_limit": factors.tolist(),
        },
        columns={
            "load_torque": found.load,
            "speed_both_formula": found.formula[:, 0],
            "speed_both_rig": found.measured[:, 0],
            "speed_held_formula": found.formula[:, 1],
            "speed_held_rig": found.measured[:, 1],
        },
        pictures=(
            Picture(
                caption=f"Operating envelope at {settings.supply_voltage:g} V.",
                x="torque at the platform [N m]",
                y="speed of the platform [deg/s]",
                curves=curves,
            ),
        ),
    )
