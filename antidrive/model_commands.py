"""Exports of a model for drives and simulators: feedforward, MuJoCo, URDF, Modelica, FMU."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from antidrive.console import Console
from antidrive.output import whole_folder, written
from antidrive.own_effects import read_identified
from plant.errors import BadParameter
from plant.model_file import ModelFile

_OPTIONS = {"plant": ("sample_time",)}
"""Controller options that apply to an export of the model, by its form."""

Made = tuple[dict[str, str | bytes], list[str], dict[str, Any]]
"""Files with their content, sentences on them, and data for scripts."""


def chosen(given: Mapping[str, bool], *, fmu: bool) -> str:
    """The chosen form; empty for the controller.

    Raises:
        BadParameter: more than one form.
    """
    found = [name for name, wanted in given.items() if wanted]
    if len(found) + fmu > 1:
        raise BadParameter(f"--{found[0]} and --{found[1] if len(found) > 1 else 'fmu'} are two exports; give one.")
    return found[0] if found else ""


def export_model(
    model: Path,
    form: str,
    options: Mapping[str, Any],
    *,
    name: str,
    single: bool,
    effects: Path | None,
    out: Path,
    console: Console,
) -> None:
    """Write a model in one form.

    Args:
        model: file of the model.
        form: "feedforward", "mujoco", "urdf", "modelica" or "plant".
        options: options of the command line; only the sample time applies, for an FMU.
        name: prefix of the files and of the symbols in them.
        single: whether a feedforward calculates in single precision.
        effects: file with custom effects.
        out: folder for the files.
        console: prints the results.
    """
    _check(form, options, name, single=single)
    read = read_identified(model, effects)
    with whole_folder(out) as draft, console.progress(f"writing {form}") as progress:
        made = _plant(read, draft, options, name, progress) if form == "plant" else _TEXTS[form](read, name, single)
        files, lines, content = made
        for name, text in files.items():
            (draft / name).write_bytes(text if isinstance(text, bytes) else text.encode())
        names = sorted(path.name for path in draft.iterdir())
    console.result("\n".join([*lines, written(out, ", ".join(names))]), {"schema": 1, "files": names, **content})


def _check(form: str, options: Mapping[str, Any], name: str, *, single: bool) -> None:
    """Raise for options that do not apply to this form, and for names that are unusable in its files."""
    useless = [word for word in options if word not in _OPTIONS.get(form, ())]
    useless += ["single"] if single and form != "feedforward" else []
    if useless:
        option = f"--{useless[0].replace('_', '-')}"
        raise BadParameter(f"{option} changes nothing in an export with --{form}; leave it out.")
    if not re.fullmatch(r"[A-Za-z]\w{0,39}", name, re.ASCII):
        shown = name if len(name) <= 40 else f"{name[:40]}..."
        raise BadParameter(
            f"--name {shown!r}: write up to 40 letters, digits and underscores, beginning with a letter."
        )


def _feedforward(read: ModelFile, name: str, single: bool) -> Made:
    from plant.feedforward import feedforward_code

    made = feedforward_code(read.model, single=single, name=name)
    return dict(made.files), made.sentences(), made.summary()


def _mujoco(read: ModelFile, name: str, single: bool) -> Made:
    from plant.mujoco_model import mujoco_model

    made = mujoco_model(read.model, sample_time=read.sample_time, name=name)
    content = {key: list(getattr(made, key)) for key in ("native", "called", "left_out")}
    return dict(made.files), made.sentences(), content | {"timestep": made.timestep}


def _urdf(read: ModelFile, name: str, single: bool) -> Made:
    from plant.urdf import urdf

    made = urdf(read.model, name=name)
    lines = ["One joint between a base and a link, with damping, friction and limit."]
    return {f"{name}.urdf": made.text}, [*lines, *made.left_out], {"left_out": list(made.left_out)}


def _plant(read: ModelFile, draft: Path, options: Mapping[str, Any], name: str, progress: Any) -> Made:
    from antidrive.drives import sample_time
    from antidrive.exports import fmu_entry
    from antidrive.remaining_time import Parts
    from plant.servo_fmu import servo_fmu

    seconds, assumed = sample_time(options, read)
    fmu = servo_fmu(read.model, sample_time=seconds, name=name)
    done = Parts(len(fmu.compilers()), progress, doing="compiling the FMU").done
    fmu.write(draft / f"{fmu.name}.fmu", after=done)
    lines, entry = fmu_entry(fmu)
    rhythm = f"FMI 2.0 for co-simulation, sampled at {seconds:g} s."
    return {}, [lines, rhythm, *assumed], {"fmus": [entry], "sample_time": seconds, "assumed": assumed}


def _modelica(read: ModelFile, name: str, single: bool) -> Made:
    from plant.modelica_class import modelica_class

    title = name.capitalize()
    made = modelica_class(read.model, name=title)
    lines = ["A class that needs no library. Dry friction rises over the velocity friction_width."]
    return {f"{title}.mo": made.text}, [*lines, *made.left_out], {"left_out": list(made.left_out)}


_TEXTS: dict[str, Callable[[ModelFile, str, bool], Made]] = {
    "feedforward": _feedforward,
    "mujoco": _mujoco,
    "urdf": _urdf,
    "modelica": _modelica,
}
