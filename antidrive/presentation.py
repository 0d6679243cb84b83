"""Display of results in Python as a figure, a table, a page, or in a notebook; called by `plant.result_display`."""

from __future__ import annotations

import re
from functools import singledispatch
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from allocation import Allocation, CapabilityMap
from antidrive.capability import sentences, table
from antidrive.closed_loop_run import ClosedLoopRun
from antidrive.experiments.outcome import Outcome
from antidrive.html_page import page
from antidrive.matplotlib_plots import plot as plot
from antidrive.matplotlib_plots import png
from antidrive.model_comparison import Comparison
from antidrive.output import PAGES, whole_file
from antidrive.prediction import Prediction
from antidrive.prediction import table as predicted_table
from antidrive.provenance import Provenance
from diagnosis.diagnosis import Diagnosis
from diagnosis.experiment import Experiment
from identification.fit_result import Fit
from identification.friction_test import FrictionTest
from identification.log import Log, Source
from identification.lost_motion import LostMotion
from identification.simulation import free_simulation
from mpc.analysis import LoopAnalysis
from mpc.closed_loop import ClosedLoopResult
from mpc.monte_carlo import MonteCarlo, Sweep
from mpc.trajectory import Trajectory
from plant.drive_table import DriveTable
from plant.errors import BadParameter
from plant.result_display import Drawn
from plant.rig_record import RigRecord
from plant.servo import ServoModel
from plant.units import axis_quantities, printed

if TYPE_CHECKING:
    import pandas as pd

_ROWS = 12  # rows of a table in a notebook


@singledispatch
def to_frame(result: Any) -> pd.DataFrame:
    """See `plant.result_display.Tabled.to_frame`."""
    raise BadParameter(f"A {type(result).__name__} is no table.")


@to_frame.register
def _(result: Log) -> Any:
    import pandas as pd

    parts = [
        pd.DataFrame(
            {"run": run.run, "time": run.zero + run.time, "command": run.command, result.response: run.measured}
        )
        for run in result.runs
    ]
    frame = pd.concat([part.assign(valid=run.valid) for part, run in zip(parts, result.runs, strict=True)])
    frame.attrs["units"] = {"time": "s", "command": result.command_unit, result.response: result.measured_unit}
    return frame.reset_index(drop=True)


@to_frame.register
def _(result: ServoModel) -> Any:
    import pandas as pd

    rows = [
        (spec.name, value, printed(spec.unit), spec.meaning)
        for spec, value in zip(result.parameters, result.values, strict=True)
    ]
    return pd.DataFrame(rows, columns=["name", "value", "unit", "meaning"]).set_index("name")


@to_frame.register
def _(result: CapabilityMap) -> Any:
    return table(result)


@to_frame.register
def _(result: ClosedLoopResult) -> Any:
    """One row per sample, SI units."""
    import pandas as pd

    angle, length, _, newton = axis_quantities(result.axis)
    drives = range(1, result.torques.shape[1] + 1)
    columns: dict[str, Any] = {
        "time": result.time,
        "reference": result.reference,
        angle: result.angle,
        f"measured_{angle}": result.measured_angle,
        "velocity": result.velocity,
        **{f"torque_{i}": torque for i, torque in zip(drives, result.torques.T, strict=True)},
        **{f"contact_torque_{i}": torque for i, torque in zip(drives, result.contact_torques.T, strict=True)},
        "disturbance_estimate": result.disturbance,
        "status": result.status,
    }
    frame = pd.DataFrame(columns)
    frame.attrs["units"] = {
        "time": "s",
        **dict.fromkeys(("reference", angle, f"measured_{angle}"), length),
        "velocity": f"{length}/s",
        **{f"torque_{i}": "N m" for i in drives},
        **{f"contact_torque_{i}": newton for i in drives},
        "disturbance_estimate": newton,
    }
    return frame


@to_frame.register(ClosedLoopRun)
@to_frame.register(Outcome)
def _(result: ClosedLoopRun | Outcome) -> Any:
    """The trajectory, SI units."""
    return result.table()


@to_frame.register
def _(result: RigRecord) -> Any:
    """One row per sample, SI units."""
    import pandas as pd

    alone = {name: getattr(result, name) for name in ("time", "angle", "true_angle", "velocity")}
    drives = {
        f"{name}_{number}": column
        for name in ("torque", "contact_torque", "minimum_contact_torque")
        for number, column in enumerate(getattr(result, f"{name}s").T, start=1)
    }
    frame = pd.DataFrame({**alone, **drives})
    frame.attrs["units"] = {"time": "s", "angle": "rad", "true_angle": "rad", "velocity": "rad/s"}
    frame.attrs["units"] |= dict.fromkeys(drives, "N m")
    return frame


@to_frame.register
def _(result: Allocation) -> Any:
    """One row per drive."""
    import pandas as pd

    drives = pd.RangeIndex(1, result.torques.size + 1, name="drive")
    frame = pd.DataFrame({"torque": result.torques, "least_torque": result.floor}, index=drives)
    frame.attrs["units"] = dict.fromkeys(frame.columns, "N m")
    return frame


@to_frame.register
def _(result: Trajectory) -> Any:
    """One row per instant; the torques act from there to the next, and are empty at the end."""
    import pandas as pd

    torques = np.vstack((result.torques, np.full((1, result.torques.shape[1]), np.nan)))
    columns = {"time": result.time, "angle": result.angle, "velocity": result.speed}
    columns |= {f"torque_{drive}": values for drive, values in enumerate(torques.T, start=1)}
    frame = pd.DataFrame(columns)
    frame.attrs["units"] = {"time": "s", "angle": "rad", "velocity": "rad/s"}
    frame.attrs["units"] |= dict.fromkeys(frame.columns[3:], "N m")
    return frame


@to_frame.register
def _(result: Sweep) -> Any:
    """One row per loop, with the factors of the machine that were drawn."""
    import pandas as pd

    names = ("tracking_rms", "minimum_contact_torque", "degraded", "copper_loss")
    drawn = dict(zip(result.names, result.factors.T, strict=True)) if isinstance(result, MonteCarlo) else {}
    frame = pd.DataFrame({**{name: getattr(result, name) for name in names}, **drawn})
    frame.attrs["units"] = dict(zip(names, ("rad", "N m", "samples", "N^2 m^2"), strict=True))
    return frame


@to_frame.register
def _(result: LoopAnalysis) -> Any:
    """The frequency response: magnitudes of L, S and T, and the phase of L."""
    import pandas as pd

    systems = {"gain": result.gain, "sensitivity": result.sensitivity, "complementary": result.complementary}
    responses = {name: result.response(system, result.frequencies) for name, system in systems.items()}
    phase = np.degrees(np.unwrap(np.angle(responses["gain"])))
    magnitudes = {name: np.abs(response) for name, response in responses.items()}
    frame = pd.DataFrame({"frequency": result.frequencies, **magnitudes, "phase": phase})
    frame.attrs["units"] = {"frequency": "Hz", "phase": "deg"}
    return frame


@to_frame.register
def _(result: LostMotion) -> Any:
    """Backlash, stiffness and friction of each drive, and the total backlash."""
    import pandas as pd

    units = {"gap": "rad", "stiffness": "N m/rad", "friction": "N m", "friction_coefficient": ""}
    found = [
        (f"{name}_{number}", getattr(drive, name), unit)
        for number, drive in enumerate(result.drives, start=1)
        for name, unit in units.items()
    ]
    rows = [(name, each.value, each.std, unit) for name, each, unit in [*found, ("total_gap", result.total_gap, "rad")]]
    return pd.DataFrame(rows, columns=["name", "value", "std", "unit"]).set_index("name")


@to_frame.register
def _(result: Experiment) -> Any:
    """One row per sample: the command, and what each of the competing models predicts."""
    import pandas as pd

    angle, length, torque, newton = axis_quantities(result.axis)
    predicted = [f"{angle}_with_{name}" for name in result.competing]
    columns = {"time": result.time, torque: result.torque, **dict(zip(predicted, result.predictions, strict=True))}
    frame = pd.DataFrame(columns)
    frame.attrs["units"] = {"time": "s", torque: newton, **dict.fromkeys(predicted, length)}
    return frame


@to_frame.register
def _(result: Fit) -> Any:
    import pandas as pd

    columns = ("name", "value", "std", "unit", "start", "fixed", "at_bound")
    return pd.DataFrame([{c: getattr(p, c) for c in columns} for p in result.parameters]).set_index("name")


@to_frame.register
def _(result: Prediction) -> Any:
    """One row per sample, in the unit of the log."""
    import pandas as pd

    frame = pd.concat([predicted_table(result, run) for run in range(len(result.log.runs))], ignore_index=True)
    frame.attrs["units"] = {"time": "s", **dict.fromkeys(frame.columns[2:], result.log.measured_unit)}
    return frame


@to_frame.register
def _(result: Diagnosis) -> Any:
    """A row for each parameter of each reported effect, with the alternatives in the last column."""
    import pandas as pd

    columns = ["effect", "probability", "gain", "parameter", "value", "std", "unit", "alternatives"]
    rows = [
        (
            cause.effect,
            cause.probability,
            cause.gain,
            name,
            estimate.value,
            estimate.std,
            printed(estimate.unit),
            ", ".join(other for other, _ in cause.alternatives),
        )
        for cause in result.causes
        for name, estimate in cause.parameters.items()
    ]
    return pd.DataFrame(rows, columns=columns).set_index("effect")


def html(result: Any) -> str:
    """See `plant.result_display.Tabled`: the first line as text, and the table."""
    rows = result.to_frame().to_html(max_rows=_ROWS, notebook=True)
    return f"<p>{escape(_headline(result))}</p>{rows}"


def _headline(result: Any) -> str:
    if isinstance(result, DriveTable):
        return f"{result.ends[1]}: {result.meaning}"
    if isinstance(result, ServoModel):
        return f"Servo: {', '.join(('rigid body', *(effect.title for effect in result.effects)))}"
    in_one_line = isinstance(result, Log | ClosedLoopResult | Prediction | RigRecord)
    return repr(result) if in_one_line else str(result).splitlines()[0]


def report(result: Any, path: Path) -> Path:
    """See `plant.result_display.Tabled.report`."""
    with whole_file(path, option="report", suffixes=PAGES) as draft:
        draft.write_text(_page(result), encoding="utf-8")
    return path


@singledispatch
def _page(result: Any) -> str:
    """The page of a result without one of its own: its first line, its figure and its table."""
    figure = png(result) if isinstance(result, Drawn) else ""
    sources = result.sources if isinstance(result, Log) else ()
    title = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", type(result).__name__).capitalize()
    return page("result", _made(sources), title, figure=figure, result=Markup(html(result)))


def _made(sources: tuple[Source, ...]) -> Provenance:
    return Provenance.now(("python",), sources)


@_page.register
def _(result: Fit) -> str:
    from antidrive.report import fit_page
    from diagnosis import identifiability_warnings

    simulated = free_simulation(result.log, result.model)
    return fit_page(result, simulated, _made(result.log.sources), warnings=identifiability_warnings(result))


@_page.register
def _(result: Diagnosis) -> str:
    from antidrive.report import diagnosis_page

    return diagnosis_page(result, _made(result.base.log.sources))


@_page.register
def _(result: Prediction) -> str:
    from antidrive.prediction_page import prediction_page

    return prediction_page(result, _made(result.log.sources))


@_page.register
def _(result: CapabilityMap) -> str:
    from antidrive.report import capability_page

    return capability_page(result, sentences(result), _made(()))


@_page.register
def _(result: FrictionTest) -> str:
    from antidrive.friction_page import friction_page

    return friction_page(result, _made(result.log.sources))


@_page.register
def _(result: Comparison) -> str:
    from antidrive.comparison_page import changes_page

    return changes_page(result, _made(result.diagnosis.base.log.sources))


@_page.register
def _(result: ClosedLoopResult) -> str:
    from antidrive.report import loop_page

    return loop_page(result, Provenance.now(("python",)))


@_page.register
def _(result: ClosedLoopRun) -> str:
    from antidrive.report import closed_loop_page

    return closed_loop_page(result, _made(()))


@_page.register
def _(result: Outcome) -> str:
    from antidrive.report import experiment_page

    return experiment_page(result, _made(()))
