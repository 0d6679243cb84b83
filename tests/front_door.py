"""A small synthetic log on disk, and the command line as a function: what the tests of the front door share."""

from __future__ import annotations

import contextlib
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from antidrive.cli import main
from plant import ServoModel, simulate
from plant.effects import CoulombFriction, DeadZone
from plant.model_file import ModelFile
from plant.signals import chirp, steps

DT = 0.01
TRUTH = ServoModel(
    inertia=0.8, gravity=0.6, viscous_friction=0.5, effects=(DeadZone(half_width=0.1), CoulombFriction(torque=0.4))
)
PLAIN = ServoModel(inertia=0.8, gravity=0.6, viscous_friction=0.5, effects=(DeadZone(half_width=0.1),))


@dataclass(frozen=True, kw_only=True)
class CommandResult:
    """What one command left behind."""

    code: int
    out: str
    err: str


def antidrive(*words: object) -> CommandResult:
    """Run the command line in this process."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main([str(word) for word in words])
    return CommandResult(code=code, out=out.getvalue(), err=err.getvalue())


def columns(model: ServoModel = TRUTH, *, seed: int = 0, duration: float = 12.0) -> dict[str, np.ndarray]:
    """time, torque, angle of a chirp and steps, with 1e-4 rad of white noise."""
    levels = (1.5, -1.2, 1.0, -1.8, 0.7, -0.6)
    torque = np.concatenate(
        (
            chirp(amplitude=2.0, start=0.1, stop=2.0, duration=duration / 2, sample_time=DT),
            steps(levels=levels, hold=duration / 2 / len(levels), sample_time=DT),
        )
    )
    path = simulate(model, command=torque, dt=DT, substeps=4)
    noise = 1e-4 * np.random.default_rng(seed).standard_normal(torque.size)
    return {"time": np.arange(torque.size) * DT, "torque": torque, "angle": path[:-1, 0] + noise}


def write_csv(path: Path, table: dict[str, np.ndarray]) -> Path:
    """A CSV file with one header line."""
    rows = np.column_stack(list(table.values()))
    np.savetxt(path, rows, delimiter=",", header=",".join(table), comments="", fmt="%.12g")
    return path


def write_model(path: Path, model: ServoModel = PLAIN) -> Path:
    """A model file without standard errors."""
    ModelFile(model=model, std={}).write(path)
    return path


def listing(folder: Path) -> dict[str, bytes]:
    """Every file below a folder, hidden ones too, with its content."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}
