"""Identified models in other simulators: error on validation logs, compared with our own simulation.

    python benchmarks/other_simulators.py [FOLDER OF THE DATA SETS]

A model is identified on one part of the data and simulated over the other part from the command alone, without a
restart. Writes results/other_simulators.txt.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "tests"))

from machine import Machine, excitation, record  # noqa: E402
from simulators import in_fmu, in_modelica, in_mujoco, in_state_space, in_urdf  # noqa: E402

from identification import Log, fit  # noqa: E402
from identification.datasets import load_dataset  # noqa: E402
from identification.simulation import free_simulation  # noqa: E402
from plant import ServoModel  # noqa: E402
from plant.effects import AsymmetricFriction, Cogging, DeadZone, InputDelay, StribeckFriction  # noqa: E402

DATA = HERE.parent.parent / "shared" / "data"
START = ServoModel(
    effects=(
        InputDelay(time=0.01),
        DeadZone(half_width=0.2),
        StribeckFriction(coulomb=0.2, excess=0.1, velocity=0.2),
        Cogging(amplitude=0.2, order=12.0, phase=0.3),
    )
)


def cases(data: Path) -> dict[str, tuple[Log, Log, ServoModel, tuple[str, ...]]]:
    """Estimation log, validation log, start of the fit, and its fixed parameters."""
    hidden = {
        "input_delay": {"time": 0.01},
        "stribeck_friction": {"coulomb": 0.25, "excess": 0.1, "velocity": 0.2},
        "cogging": {"amplitude": 0.2, "order": 12.0, "phase": 0.3},
    }
    machine = Machine().hiding(**hidden)
    logs = [record(machine, excitation(7 + k, duration=20.0), seed=11 + k).log() for k in range(2)]
    found = {"synthetic": (logs[0], logs[1], START, ())}
    if data.exists():
        joint = load_dataset("ur10e", data / "ur10e", joint=1)
        effects = (AsymmetricFriction(forward=1.0, backward=1.0),)
        start = ServoModel(inertia=1.0, gravity=0.0, viscous_friction=1.0, effects=effects)
        found["UR10e, joint 1, torque in A"] = (joint.estimation, joint.holdout, start, ("gravity",))
    return found


def line(name: str, learnt: Log, judged: Log, start: ServoModel, fixed: tuple[str, ...]) -> list[str]:
    """Errors of one case."""
    identified = fit(learnt, start, fixed=fixed).model
    run, ours = judged.runs[0], free_simulation(judged, identified)[0]
    model = replace(identified, torque_unit=None)  # the simulators use N m; the actual unit does not matter
    steps = np.diff(run.time)
    even = np.ptp(steps) < 1e-3 * np.median(steps)
    dt = float(np.median(steps)) / (1 if even else 5)  # irregular times are resolved by a finer grid
    grid = run.time[0] + dt * np.arange(int(np.ceil((run.time[-1] - run.time[0]) / dt - 1e-6)) + 1)
    command = run.command[np.searchsorted(run.time, grid + 1e-6, side="right") - 1]
    slope = float(np.gradient(ours[:3], run.time[:3], edge_order=2)[0])
    speed = np.sqrt(np.mean(np.gradient(run.measured[run.valid], run.time[run.valid]) ** 2))
    begun = {"angle": float(ours[0]), "velocity": slope}
    with tempfile.TemporaryDirectory() as folder:
        outputs = {
            "MuJoCo": in_mujoco(model, command, dt, Path(folder) / "mujoco", **begun),
            "FMU in FMPy": in_fmu(model, command, dt, Path(folder) / "fmu", **begun),
            "URDF in MuJoCo": in_urdf(model, command, dt, **begun),
            "Modelica, pymoca": in_modelica(model, command, dt, **begun),
            "linear, control": in_state_space(
                model, command, dt, around=float(np.mean(run.measured)), width=float(speed), **begun
            ),
        }
    outputs = {"here": ours, **{tool: np.interp(run.time, grid, output) for tool, output in outputs.items()}}

    def rms(output: np.ndarray) -> float:
        return float(np.sqrt(np.mean((output - run.measured)[run.valid] ** 2)))

    spread = float(np.std(run.measured[run.valid]))
    cells = [
        f"{name}: {len(run)} samples in {run.duration:.0f} s; the angle has a spread of {spread:.4g} rad",
        f"  {model}",
    ]
    return cells + [f"  {tool:16} {rms(output):10.4g} rad rms" for tool, output in outputs.items()]


def main() -> None:
    data = Path(sys.argv[1]) if len(sys.argv) > 1 else DATA
    head = f"Validation logs in other simulators (MuJoCo {version('mujoco')}, FMPy {version('fmpy')}, "
    head += f"pymoca {version('pymoca')}, python-control {version('control')})"
    lines = [head, *(text for name, case in cases(data).items() for text in line(name, *case))]
    print("\n".join(lines))
    (HERE / "results" / "other_simulators.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
