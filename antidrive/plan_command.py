"""`antidrive plan`: the first experiment on a machine, before there is a log."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from antidrive.cli_options import Json, Quiet

_LONG = 3600.0  # duration from which a plan is called long [s]
_UNITS = {
    "setpoint": "Units: time s, setpoint rad, velocity rad/s, acceleration rad/s^2; on a linear axis m, not rad.",
    "torque": "Units: time s, torque N m; on a linear axis N.",
}


def plan(
    context: typer.Context,
    limits: Annotated[
        str,
        typer.Option(
            metavar="NAME=VALUE,...",
            help="Limits of the drive. With a position loop travel=-1:1,speed=5,acceleration=50, in rad, rad/s, "
            "rad/s^2; on a linear axis in m. Without one torque=2, in N m.",
        ),
    ],
    rate: Annotated[float, typer.Option(metavar="HZ", help="Samples per second.")] = 200.0,
    out: Annotated[Path, typer.Option(metavar="FILE.csv", help="File for the plan.")] = Path(
        "antidrive-out/experiment.csv"
    ),
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Plan the first experiment within the limits of a drive, before there is a log. Writes a CSV file."""
    from antidrive.console import Console
    from antidrive.output import whole_file
    from plant.first_experiment import first_experiment

    console = Console(quiet=quiet, json=json, words=context.obj)
    table = first_experiment(_limits(limits), rate=rate)
    with whole_file(out, suffixes=(".csv",)) as draft:
        table.to_csv(draft, index=False, float_format="%.9g")
    turns = (table["part"] != table["part"].shift()).cumsum()
    blocks = [(part["part"].iloc[0], float(part["time"].iloc[0]), len(part) / rate) for _, part in table.groupby(turns)]
    played = "setpoint" if "setpoint" in table else "torque"
    lines = [f"{name}: {length:.3g} s from {begin:.4g} s on" for name, begin, length in blocks if name != "rest"]
    seconds = len(table) / rate
    lines.append(f"Total: {_duration(seconds)}, in the column {played}.")
    lines.append(_UNITS[played])
    if seconds > _LONG:
        lines.append("Warning: this takes more than an hour; plan for a part of the travel, or a higher speed.")
    lines.append(
        f"Record torque (or current), angle and time at {rate:g} Hz or faster; stop the drive if it moves dangerously."
    )
    content: dict[str, Any] = {"schema": 1, "file": str(out), "rate": rate, "duration": len(table) / rate}
    content["parts"] = [{"part": name, "start": begin, "duration": length} for name, begin, length in blocks]
    console.result("\n".join([*lines, f"Written: {out}"]), content)


def _duration(seconds: float) -> str:
    return f"{seconds:.4g} s" if seconds <= _LONG else f"{seconds / 3600.0:.2g} h"


def _limits(typed: str) -> Any:
    from plant.errors import BadParameter
    from plant.first_experiment import DriveLimits

    given: dict[str, Any] = {}
    for entry in typed.split(","):
        name, _, text = (part.strip() for part in entry.partition("="))
        try:
            low_high = tuple(map(float, text.split(":")))
        except ValueError:
            low_high = ()
        if name not in ("travel", "speed", "acceleration", "torque") or len(low_high) != 1 + (name == "travel"):
            raise BadParameter(
                f"--limits {entry!r}: write travel=-1:1,speed=5,acceleration=50, or torque=2 of a drive that takes one."
            )
        if name in given:
            raise BadParameter(f"--limits names {name} twice; give it once.")
        given[name] = low_high if name == "travel" else low_high[0]
    return DriveLimits(**given)
