"""Exports of the controller: C99 for a target, FMUs for Simulink and Modelica tools."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from antidrive.remaining_time import Parts, Tell
from mpc import Controller, controller_fmu
from mpc import export as target_code
from plant import Fmu, ServoModel, servo_fmu


def c99(
    controller: Controller, single: bool, folder: Path, *, name: str = "antidrive"
) -> tuple[list[str], dict[str, Any]]:
    """Write the C files; return descriptions for users and for scripts."""
    made = target_code(controller, single=single, name=name)
    for file, text in made.files.items():
        (folder / file).write_text(text, encoding="utf-8")
    return made.sentences(), made.summary()


def fmu_entry(fmu: Fmu) -> tuple[str, dict[str, Any]]:
    """Inputs and outputs of an FMU, for users and for scripts."""
    inputs, outputs, parameters = (
        [variable.name for variable in fmu.variables if variable.causality == kind]
        for kind in ("input", "output", "parameter")
    )
    line = f"{fmu.name}: {', '.join(inputs)} in, {', '.join(outputs)} out."
    return line, {"name": fmu.name, "inputs": inputs, "outputs": outputs, "parameters": parameters}


def fmus(
    controller: Controller,
    model: ServoModel,
    folder: Path,
    tell: Tell | None = None,
    *,
    name: str = "antidrive",
) -> tuple[list[str], dict[str, Any]]:
    """Write the controller and its plant as FMUs; return descriptions for users and for scripts."""
    plant = servo_fmu(model, sample_time=controller.sample_time, gears=controller.gears, name=name)
    lines, entries, made = [], [], (controller_fmu(controller, name=name), plant)
    done = Parts(sum(len(fmu.compilers()) for fmu in made), tell, doing="compiling the FMUs").done
    for fmu in made:
        fmu.write(folder / f"{fmu.name}.fmu", after=done)
        line, entry = fmu_entry(fmu)
        lines.append(line)
        entries.append(entry)
    lines.append(f"FMI 2.0 for co-simulation, sampled at {controller.sample_time:g} s.")
    files = [f"{entry['name']}.fmu" for entry in entries]
    return lines, {"schema": 1, "files": files, "sample_time": controller.sample_time, "fmus": entries}
