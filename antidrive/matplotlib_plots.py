"""Figures of results with matplotlib, for scripts and notebooks."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Callable
from importlib.util import find_spec
from io import BytesIO
from typing import Any

import numpy as np

from allocation import Allocation, CapabilityMap
from antidrive.chart import AFTER, BEFORE, MEASURED, SECOND, THIRD
from antidrive.closed_loop_run import ClosedLoopRun
from antidrive.experiments.outcome import Outcome
from antidrive.model_comparison import Comparison
from antidrive.prediction import Prediction, quantity
from diagnosis.diagnosis import Diagnosis
from diagnosis.experiment import Experiment
from identification.fit_result import Fit
from identification.friction_test import FrictionTest
from identification.log import Log
from identification.lost_motion import LostMotion
from identification.simulation import free_simulation
from mpc.analysis import LoopAnalysis
from mpc.bode import draw_bode
from mpc.closed_loop import ClosedLoopResult
from mpc.monte_carlo import Sweep
from mpc.trajectory import Trajectory
from plant.drive_table import DriveTable
from plant.errors import BadParameter
from plant.rig_record import RigRecord
from plant.units import axis_quantities


def plot(result: Any, axes: Any = None) -> Any:
    """See `plant.result_display.Drawn.plot`."""
    rows, draw = _picture_of(result)
    if axes is None:
        from matplotlib import pyplot

        axes = pyplot.subplots(rows, 1, sharex=rows > 1, layout="constrained", squeeze=False)[1][:, 0]
    given = np.atleast_1d(np.asarray(axes, dtype=object))
    if given.size != rows:
        raise BadParameter(f"This picture needs {rows} axes, not {given.size}.")
    draw(result, given)
    return given if rows > 1 else given[0]


def png(result: Any) -> str:
    """The figure as a PNG in base64; no window is opened, and none that is open changes."""
    rows, draw = _picture_of(result)
    from matplotlib.figure import Figure

    figure, image = Figure(figsize=(9.0, 1.5 + 2.2 * rows), layout="constrained"), BytesIO()
    draw(result, figure.subplots(rows, 1, sharex=rows > 1, squeeze=False)[:, 0])
    figure.savefig(image, format="png", dpi=130)
    return b64encode(image.getvalue()).decode()


def _picture_of(result: Any) -> tuple[int, Callable[[Any, Any], None]]:
    """Number of axes for the figure of a result, and the function that draws in them."""
    if find_spec("matplotlib") is None:
        raise BadParameter("A picture needs matplotlib: pip install matplotlib.")
    for kind, picture in _PICTURES.items():
        if isinstance(result, kind):
            return picture
    raise BadParameter(f"A {type(result).__name__} has no picture.")


def _draw_log(log: Log, axes: Any) -> None:
    for run in log.runs:
        axes[0].plot(run.time, run.command, color=MEASURED, lw=0.8)
        axes[1].plot(run.time, np.where(run.valid, run.measured, np.nan), color=AFTER, lw=1.0)
    _label(axes[0], y=f"command [{log.command_unit}]")
    _label(axes[1], y=f"{log.response} [{log.measured_unit}]", x="time [s]")


def _draw_fit(fit: Fit, axes: Any) -> None:
    _draw_prediction(Prediction(log=fit.log, simulated=tuple(free_simulation(fit.log, fit.model))), axes)


def _draw_prediction(found: Prediction, axes: Any) -> None:
    """Measured and simulated, and the error."""
    for run, simulated in zip(found.log.runs, found.simulated, strict=True):
        seen, first = np.where(run.valid, run.measured, np.nan), run is found.log.runs[0]
        axes[0].plot(run.time, seen, color=MEASURED, lw=2.5, label="measured" if first else None)
        axes[0].plot(run.time, simulated, color=AFTER, lw=1.0, label="simulated" if first else None)
        axes[1].plot(run.time, seen - simulated, color=BEFORE, lw=0.8)
    axes[0].legend(frameon=False)
    _label(axes[0], y=f"{quantity(found.log)} [{found.log.measured_unit}]")
    _label(axes[1], y=f"error [{found.log.measured_unit}]", x="time [s]")


def _draw_diagnosis(found: Diagnosis, axes: Any) -> None:
    """The validation runs: measured and simulated with the base and the extended model, and both errors."""
    unit, extended = found.base.log.measured_unit, found.extended is not found.base
    for replay in found.replays:
        seen, first = np.where(replay.valid, replay.measured, np.nan), replay is found.replays[0]
        curves = [("base model", BEFORE, replay.before)]
        curves += [("extended model", AFTER, replay.after)] if extended else []
        axes[0].plot(replay.time, seen, color=MEASURED, lw=2.5, label="measured" if first else None)
        for name, colour, simulated in curves:
            axes[0].plot(replay.time, simulated, color=colour, lw=1.0, label=name if first else None)
            axes[1].plot(replay.time, seen - simulated, color=colour, lw=0.8)
    if found.replays:
        axes[0].legend(frameon=False)
    _label(axes[0], y=f"{quantity(found.base.log)} [{unit}]")
    _label(axes[1], y=f"error [{unit}]", x="time [s]")


def _draw_friction(found: FrictionTest, axes: Any) -> None:
    axes[0].errorbar(found.velocity, found.torque, found.error, fmt="o", ms=4, color=BEFORE, label="measured")
    for speeds in (found.velocity[found.velocity < 0.0], found.velocity[found.velocity > 0.0]):
        if speeds.size:
            course = np.linspace(speeds.min(), speeds.max(), 300)
            axes[0].plot(course, found.curve(course), color=AFTER)
    _label(axes[0], x=f"velocity [{found.units['speed']}]", y=f"friction and offset [{found.log.command_unit}]")


def _draw_changes(found: Comparison, axes: Any) -> None:
    shown = [change for change in found.changes if change.errors is not None][::-1]
    colours = [BEFORE if change.moved else MEASURED for change in shown]
    axes[0].barh([change.name for change in shown], [change.errors or 0.0 for change in shown], color=colours)
    _label(axes[0], x="change, in standard errors of the difference")


def _draw_table(table: DriveTable, axes: Any) -> None:
    first, last = table.ends
    for name, values in table.columns.items():
        if name != first:
            style = {"color": AFTER, "lw": 1.6} if name == last else {"lw": 0.8}
            axes[0].plot(table.columns[first], values, label=name, **style)
    axes[0].legend(frameon=False)
    _label(axes[0], x=f"{first} [{table.units[first]}]", y=f"{last} [{table.units[last]}]")


def _draw_capability(found: CapabilityMap, axes: Any) -> None:
    """The copper-loss index, and the limit of the reachable accelerations."""
    mesh = axes[0].pcolormesh(found.load_torque, found.acceleration, found.copper_loss, shading="nearest")
    axes[0].figure.colorbar(mesh, ax=axes[0], label="copper-loss index [N² m²]")
    axes[0].plot(found.load_torque, found.edge, color=BEFORE, lw=1.6)
    _label(axes[0], x="load torque [N m]", y="acceleration [rad/s²]")


def _draw_loop(found: ClosedLoopResult, axes: Any) -> None:
    """Reference and motion, error, drive torques, and contact torques."""
    angle, length, torque, newton = axis_quantities(found.axis)
    axes[0].plot(found.time, found.reference, color=MEASURED, lw=2.5, label="reference")
    axes[0].plot(found.time, found.angle, color=AFTER, lw=1.0, label=angle)
    axes[1].plot(found.time, found.angle - found.reference, color=AFTER, lw=0.8)
    for at, both in ((2, found.torques), (3, found.contact_torques)):
        for number, (colour, course) in enumerate(zip((SECOND, THIRD), both.T, strict=False), start=1):
            axes[at].plot(found.time, course, color=colour, lw=0.8, label=f"drive {number}")
    axes[3].axhline(0.0, color=MEASURED, ls=":", lw=0.8)
    for at in (0, 2):
        axes[at].legend(frameon=False)
    _label(axes[0], y=f"{angle} [{length}]")
    _label(axes[1], y=f"error [{length}]")
    _label(axes[2], y="drive torque [N m]")
    _label(axes[3], y=f"contact {torque} [{newton}]", x="time [s]")


def _draw_run(found: ClosedLoopRun, axes: Any) -> None:
    _draw_loop(found.result, axes)


def _draw_record(found: RigRecord, axes: Any) -> None:
    """Angle, motor torques, and contact torques of a run of the test-bench simulation."""
    axes[0].plot(found.time, found.angle, color=MEASURED, lw=2.5, label="measured")
    axes[0].plot(found.time, found.true_angle, color=AFTER, lw=1.0, label="true")
    axes[0].legend(frameon=False)
    for ax, both in ((axes[1], found.torques), (axes[2], found.minimum_contact_torques)):
        for number, (colour, course) in enumerate(zip((SECOND, THIRD), both.T, strict=False), start=1):
            ax.plot(found.time, course, color=colour, lw=0.8, label=f"drive {number}")
    axes[1].legend(frameon=False)
    axes[2].axhline(0.0, color=MEASURED, ls=":", lw=0.8)
    _label(axes[0], y="angle [rad]")
    _label(axes[1], y="drive torque [N m]")
    _label(axes[2], y="contact torque [N m]", x="time [s]")


def _draw_outcome(found: Outcome, axes: Any) -> None:
    """The first figure of an experiment of the paper."""
    picture = found.pictures[0]
    for curve in picture.curves:
        axes[0].plot(curve.x, curve.y, "o" if curve.points else "-", color=curve.colour, ms=4, label=curve.name)
    axes[0].legend(frameon=False)
    _label(axes[0], x=picture.x, y=picture.y)


def _draw_trajectory(found: Trajectory, axes: Any) -> None:
    """Angle, velocity, and the torques of the drives."""
    axes[0].plot(found.time, found.angle, color=AFTER)
    axes[1].plot(found.time, found.speed, color=AFTER)
    for number, (colour, course) in enumerate(zip((SECOND, THIRD), found.torques.T, strict=False), start=1):
        axes[2].stairs(course, found.time, baseline=None, color=colour, label=f"drive {number}")
    axes[2].legend(frameon=False)
    _label(axes[0], y="angle [rad]")
    _label(axes[1], y="velocity [rad/s]")
    _label(axes[2], y="drive torque [N m]", x="time [s]")


def _draw_sweep(found: Sweep, axes: Any) -> None:
    """One point for each loop: its contact torque over its error."""
    axes[0].plot(found.tracking_rms, found.minimum_contact_torque, ".", color=AFTER)
    axes[0].axhline(0.0, color=MEASURED, ls=":", lw=0.8)
    _label(axes[0], x="tracking error [rad rms]", y="minimum contact torque [N m]")


def _draw_allocation(found: Allocation, axes: Any) -> None:
    """The torque of each drive, and the least that keeps its teeth together."""
    drives = [f"drive {number}" for number in range(1, found.torques.size + 1)]
    axes[0].bar(drives, found.torques, color=AFTER, width=0.5, label="torque")
    least, places = np.copysign(found.floor, found.torques), np.arange(len(drives))
    axes[0].hlines(least, places - 0.35, places + 0.35, color=BEFORE, lw=2.0, label="minimum torque and friction")
    axes[0].axhline(0.0, color=MEASURED, lw=0.8)
    axes[0].legend(frameon=False)
    _label(axes[0], x=f"copper-loss index {found.copper_loss:.4g} N² m²", y="drive torque [N m]")


def _draw_lost_motion(found: LostMotion, axes: Any) -> None:
    """The backlash of each drive and of both, with standard errors."""
    gaps = {f"drive {number}": drive.gap for number, drive in enumerate(found.drives, start=1)}
    gaps["together"] = found.total_gap
    values, errors = [1e3 * each.value for each in gaps.values()], [1e3 * each.std for each in gaps.values()]
    axes[0].bar([*gaps], values, yerr=errors, color=AFTER, ecolor=BEFORE, width=0.5, capsize=6)
    _label(axes[0], x="with standard errors", y="backlash [mrad]")


def _draw_experiment(found: Experiment, axes: Any) -> None:
    """The command, and what each of the competing models predicts."""
    angle, length, torque, newton = axis_quantities(found.axis)
    axes[0].plot(found.time, found.torque, color=MEASURED)
    for name, colour, predicted in zip(found.competing, (SECOND, THIRD), found.predictions, strict=True):
        axes[1].plot(found.time, predicted, color=colour, label=name)
    axes[1].legend(frameon=False)
    _label(axes[0], y=f"{torque} [{newton}]")
    _label(axes[1], y=f"{angle} [{length}]", x="time [s]")


def _label(axes: Any, *, x: str = "", y: str = "") -> None:
    axes.set(xlabel=x, ylabel=y)
    axes.spines[["top", "right"]].set_visible(False)


_PICTURES: dict[type, tuple[int, Callable[[Any, Any], None]]] = {
    Log: (2, _draw_log),
    Fit: (2, _draw_fit),
    Prediction: (2, _draw_prediction),
    Diagnosis: (2, _draw_diagnosis),
    FrictionTest: (1, _draw_friction),
    Comparison: (1, _draw_changes),
    DriveTable: (1, _draw_table),
    CapabilityMap: (1, _draw_capability),
    ClosedLoopResult: (4, _draw_loop),
    ClosedLoopRun: (4, _draw_run),
    RigRecord: (3, _draw_record),
    Outcome: (1, _draw_outcome),
    Trajectory: (3, _draw_trajectory),
    Sweep: (1, _draw_sweep),
    Allocation: (1, _draw_allocation),
    LostMotion: (1, _draw_lost_motion),
    LoopAnalysis: (2, draw_bode),
    Experiment: (2, _draw_experiment),
}
"""Number of axes for the figure of a result, and the function that draws in them."""
