"""Text in the files of an exported controller: the machine and its units."""

from __future__ import annotations

from mpc.controller import Controller
from plant.drive_train import DriveTrain
from plant.gears import GearTrain
from plant.units import axis_quantities


def what(controller: Controller) -> str:
    """The type of machine in words."""
    return "a preloaded pair of drives" if controller.gears.drives > 1 else "a single drive"


def ranges(controller: Controller) -> list[tuple[float, float]]:
    """Lowest and highest torque of each drive [N m], signs included."""
    bounds, gears = controller.bounds, controller.gears
    if gears.drives == 1:
        return [(-float(bounds.greatest[0]), float(bounds.greatest[0]))]
    ends = zip(bounds.least.tolist(), bounds.greatest.tolist(), gears.directions, strict=True)
    return [(least, most) if sense > 0 else (-most, -least) for least, most, sense in ends]


def words_of(controller: Controller) -> dict[str, str]:
    """The words of the template files for this machine and axis."""
    (angle, length, torque, newton), gears = axis_quantities(controller.model.axis), controller.gears
    pair, title = gears.drives > 1, f"Predictive controller of {what(controller)}, in C99"
    each = "torques 1 and 2" if pair else "torques back and forth, whose sum is that of the drive,"
    backward, forward = (
        "positive" if sense > 0 else "negative" for sense in (gears.directions[0], gears.directions[-1])
    )
    directions = (
        f"A {backward} torque of drive 1 pushes the load backward, a {forward} one of drive 2 forward."
        if pair
        else f"A {forward} torque pushes the load forward."
    )
    return {
        "machine": what(controller),
        "torque_count": "two torques" if pair else "a torque",
        "of_torques": f"{each} of each sample of the horizon [N m]",
        "turns": ", put on the nearest turn" if controller.encoder_range else ", that goes on over turns",
        "title": title,
        "line": "=" * len(title),
        "gears": _drives(gears, newton),
        "torque_ranges": ", ".join(f"{low:g} to {high:g} N m" for low, high in ranges(controller)),
        "directions": f"Units are SI: {angle}s of the load in {length}, torques of the drives in N m. {directions}",
        "angle": angle,
        "length": length,
        "torque": torque,
        "newton": newton,
    }


def _drives(gears: DriveTrain, newton: str) -> str:
    if isinstance(gears, GearTrain):
        teeth = " and ".join(map(str, gears.pinion_teeth))
        return f"pinions of {teeth} teeth on an output gear of {gears.output_teeth}"
    return " and ".join(f"{ratio:g}" for ratio in gears.torque_map) + f" {newton} on the load for one N m"
