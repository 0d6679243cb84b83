"""The work of the drive commands: allocate torques, map the capability, export the controller."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from antidrive import report
from antidrive.cli_drive_options import controller_numbers
from antidrive.console import Console
from antidrive.drives import drives, sample_time
from antidrive.output import whole_folder, written
from antidrive.own_effects import read_identified, read_own_model
from antidrive.provenance import Provenance
from plant.errors import BadParameter

LIMITS = {"min_torque": 0.02, "max_torque": 0.3}  # of the paper's drives [N m]
INERTIA = 2.0  # of its load [kg m^2]


def allocate(
    torques: list[float], options: Mapping[str, Any], *, model: Path | None, effects: Path | None, console: Console
) -> None:
    """Print the allocation of load torques to the drives."""
    from allocation import Allocator

    known = None if model is None else read_own_model(model, effects)
    unit = "N" if known is not None and known.model.axis == "linear" else "N m"
    train, assumed = drives(options, known)
    allocator = Allocator(train, **{**LIMITS, **controller_numbers(options)})
    allocations = [(torque, allocator.allocate(torque)) for torque in torques]
    content = [
        {
            "torque": torque,
            "torques": found.torques,
            "preload": found.preload,
            "margin": found.margin,
            "copper_loss": found.copper_loss,
            "missing_torque": found.missing_torque,
            "binding": found.binding,
            "status": found.status,
        }
        for torque, found in allocations
    ]
    pinions = [f"drive {number}" for number in range(1, train.drives + 1)]
    columns = ("torque", *pinions, "margin", "copper loss", "status")
    rows = [
        (
            f"{torque:.4g}",
            *(f"{t:+.5f}" for t in s.torques),
            f"{s.margin:.5f}",
            f"{s.copper_loss:.6f}",
            s.status.split(":")[0],
        )
        for torque, s in allocations
    ]
    units = (unit, *("N m" for _ in pinions), "N m", "N² m²", "")
    widths = [max(len(row[place]) for row in (columns, units, *rows)) for place in range(len(columns))]
    lines = ["  ".join(f"{cell:>{w}}" for cell, w in zip(row, widths, strict=True)) for row in (columns, units, *rows)]
    why = [f"{torque:.4g} {unit} is {s.status}." for torque, s in allocations if ":" in s.status]
    lines += [textwrap.fill(line, 80, subsequent_indent="  ") for line in why]
    console.result("\n".join([*lines, *assumed]), {"unit": unit, "allocations": content, "gears": str(train)})


def capability(
    options: Mapping[str, Any],
    *,
    inertia: float | None,
    model: Path | None,
    effects: Path | None,
    out: Path,
    console: Console,
) -> None:
    """Map the torques of two drives without loss of contact, and write capability.csv and report.html."""
    from allocation import Allocator
    from antidrive import capability as maps

    known = None if model is None else read_own_model(model, effects)
    train, assumed = drives(options, known)
    if inertia is None:
        inertia = INERTIA if known is None else float(known.model.inertia)
        if known is None:
            assumed.append(f"Assumed: an inertia of {INERTIA:g} kg m^2; give --inertia or --model.")
    if train.drives == 1:
        raise BadParameter("The map is of the preload, and a single drive has none; leave --one-drive out.")
    units = maps.Units.of(train, "rotary" if known is None else known.model.axis)
    allocator = Allocator(train, **{**LIMITS, **controller_numbers(options)})
    with whole_folder(out) as draft:
        found = maps.whole_map(allocator, inertia)
        maps.table(found).to_csv(draft / "capability.csv", index=False, float_format="%.10g")
        page = report.capability_page(found, maps.sentences(found, units), Provenance.now(console.words), units)
        (draft / "report.html").write_text(page, encoding="utf-8")
    lines = [*maps.sentences(found, units), *assumed, written(out, "capability.csv, report.html")]
    console.result("\n".join(lines), maps.summary(found, units))


def export(
    model: Path,
    options: Mapping[str, Any],
    *,
    name: str,
    single: bool,
    fmu: bool,
    effects: Path | None,
    out: Path,
    console: Console,
) -> None:
    """Write the controller of a model as C99 for a target, or as FMUs."""
    from antidrive import exports
    from mpc import Controller
    from mpc.export import check_name

    check_name(name)
    if fmu and single:
        raise BadParameter("An FMU calculates in double precision; leave --single or --fmu out.")
    read = read_identified(model, effects)
    servo, (train, assumed), (seconds, more) = read.model, drives(options, read), sample_time(options, read)
    friction = {} if read.friction_std is None else {"friction_std": read.friction_std}
    numbers = {**friction, **controller_numbers(options), "sample_time": seconds}
    with whole_folder(out) as draft, console.progress("compiling the controller") as progress:
        controller = Controller(servo, train, **numbers)
        lines, content = (
            exports.fmus(controller, servo, draft, progress, name=name)
            if fmu
            else exports.c99(controller, single, draft, name=name)
        )
    content |= {"gears": str(train), "sample_time": seconds, "assumed": [*assumed, *more]}
    console.result("\n".join([*lines, *assumed, *more, written(out, ", ".join(content["files"]))]), content)
