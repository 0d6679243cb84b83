"""What the commands about the drives do: share torques, map what can be held, export the controller."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any

from antidrive import report
from antidrive.output import whole_folder, written
from antidrive.own_effects import read_own_model
from antidrive.provenance import Provenance
from antidrive.voice import Voice
from identification.errors import Unidentifiable
from plant.errors import BadParameter

if TYPE_CHECKING:
    from plant.gears import GearTrain


def allocate(torques: list[float], *, min_torque: float, max_torque: float, voice: Voice) -> None:
    """Print how follower torques are shared between the drives of the paper's gear train."""
    from allocation import Allocator
    from plant.gears import GearTrain

    allocator = Allocator(GearTrain.paper(), min_torque=min_torque, max_torque=max_torque)
    splits = [(torque, allocator.allocate(torque)) for torque in torques]
    content = [
        {
            "torque": torque,
            "torques": split.torques,
            "preload": split.preload,
            "margin": split.margin,
            "heat": split.heat,
            "missing_torque": split.missing_torque,
            "binding": split.binding,
            "status": split.status,
        }
        for torque, split in splits
    ]
    columns = ("torque", "pinion 1", "pinion 2", "margin", "heat", "status")
    rows = [
        (f"{torque:.4g}", *(f"{t:+.5f}" for t in s.torques), f"{s.margin:.5f}", f"{s.heat:.6f}", s.status.split(":")[0])
        for torque, s in splits
    ]
    units = ("N m", "N m", "N m", "N m", "N² m²", "")
    widths = [max(len(row[place]) for row in (columns, units, *rows)) for place in range(len(columns))]
    lines = ["  ".join(f"{cell:>{w}}" for cell, w in zip(row, widths, strict=True)) for row in (columns, units, *rows)]
    why = [f"{torque:.4g} N m is {s.status}." for torque, s in splits if ":" in s.status]
    lines += [textwrap.fill(line, 80, subsequent_indent="  ") for line in why]
    voice.result("\n".join(lines), {"unit": "N m", "splits": content})


def capability(
    *,
    inertia: float,
    min_torque: float,
    max_torque: float,
    rotor_inertia: float,
    motor_friction: float,
    out: Path,
    voice: Voice,
) -> None:
    """Map what the drives of the paper's gear train can do, and write capability.csv and report.html."""
    from allocation import Allocator
    from antidrive import capability as told
    from plant.gears import GearTrain

    allocator = Allocator(
        GearTrain.paper(),
        min_torque=min_torque,
        max_torque=max_torque,
        rotor_inertia=rotor_inertia,
        motor_friction=motor_friction,
    )
    with whole_folder(out) as draft:
        found = told.whole_map(allocator, inertia)
        told.table(found).to_csv(draft / "capability.csv", index=False, float_format="%.10g")
        page = report.capability_page(found, told.sentences(found), Provenance.now(voice.words))
        (draft / "report.html").write_text(page, encoding="utf-8")
    lines = [*told.sentences(found), written(out, "capability.csv, report.html")]
    voice.result("\n".join(lines), told.summary(found))


def export(
    model: Path,
    gears: GearTrain,
    *,
    single: bool,
    fmu: bool,
    effects: Path | None,
    out: Path,
    voice: Voice,
    **numbers: Any,
) -> None:
    """Write the controller of a model, with these numbers of `mpc.Controller`, as C99 for a target, or as FMUs."""
    from antidrive import exports
    from mpc import Controller

    if fmu and single:
        raise BadParameter("An FMU calculates in double precision; leave --single or --fmu out.")
    read = read_own_model(model, effects)
    if not read.identified:
        raise Unidentifiable(
            f"{model}: no parameter of this model was identified, its values are those that the fit began with; "
            "identify it from a log that shows them, or write a model by hand."
        )
    servo = read.model
    with whole_folder(out) as draft, voice.progress("compiling the controller") as progress:
        if read.friction_std is not None:
            numbers["friction_std"] = read.friction_std
        controller = Controller(servo, gears, **numbers)
        told, content = (
            exports.fmus(controller, servo, draft, progress) if fmu else exports.c99(controller, single, draft)
        )
    voice.result("\n".join([*told, written(out, ", ".join(content["files"]))]), content)
