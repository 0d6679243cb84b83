"""Figures of results. Each function draws a finished result; nothing is computed here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from allocation import CapabilityMap
from antidrive.capability import ROTARY, Units
from antidrive.chart import AFTER, BEFORE, MEASURED, SECOND, Array, Bar, Bars, Curve, Figure, Row, Style
from antidrive.downsampling import downsample
from diagnosis.explanation.cumulative_evidence import CumulativeEvidence, ResidualOverVariable
from diagnosis.explanation.wording import measured, torque_or_force
from diagnosis.holdout import GainErrors
from diagnosis.residual_torque import Curve as ResidualCurve
from diagnosis.residual_torque import ResidualTorque
from diagnosis.result import Gain, Replay

if TYPE_CHECKING:
    from antidrive.signature import Signature

_SMALL = 700  # points of a curve of the gallery
_WIDE = 3.5  # width of measured curves, which lie under those of models [px]


def replay_figure(replay: Replay, quantity: str, unit: str, *, extended: bool) -> Figure:
    """Measured and simulated output, and below them the error of the simulation.

    Args:
        replay: one run.
        quantity, unit: of the measurement.
        extended: draw the extended model too.
    """
    seen = np.where(replay.valid, replay.measured, np.nan)
    models = [("base model", BEFORE, replay.before)]
    if extended:
        models.append(("extended model", AFTER, replay.after))
    outputs = [Curve(name="measured", colour=MEASURED, x=replay.time, y=seen, width=_WIDE)]
    outputs += [Curve(name=name, colour=colour, x=replay.time, y=y) for name, colour, y in models]
    errors = [Curve(name=name, colour=colour, x=replay.time, y=seen - y) for name, colour, y in models]
    return Figure(
        x="time [s]",
        height=400,
        rows=[
            Row(title=f"{quantity} [{unit}]", curves=outputs, share=0.58),
            Row(title=f"error [{unit}]", curves=errors, share=0.42),
        ],
    )


def residual_figure(residual: ResidualTorque) -> Figure:
    """The residual torque of a model over the log, with its 95 % band."""
    curves: list[Curve] = []
    for run in np.unique(residual.run):
        rows = residual.run == run
        time, torque, band = residual.time[rows], residual.torque[rows], residual.band[rows]
        curves.append(_band(time, torque - band, torque + band))
        curves.append(Curve(name=f"residual {torque_or_force(residual.unit)}", colour=BEFORE, x=time, y=torque))
    title = f"residual {torque_or_force(residual.unit)} [{residual.unit}]"
    return Figure(x="time [s]", height=250, rows=[Row(title=title, curves=curves)])


def curve_figure(before: ResidualCurve, after: ResidualCurve | None, unit: str) -> Figure:
    """Residual torque over one variable, as means with 95 % error bars, for the base and the extended model."""
    pairs = [("base model", BEFORE, before)] + ([("extended model", AFTER, after)] if after is not None else [])
    curves = [
        Curve(name=name, colour=colour, x=curve.centre, y=curve.mean, error=curve.band, style="rings")
        for name, colour, curve in pairs
    ]
    title = f"residual {torque_or_force(unit)} [{unit}]"
    return Figure(
        x=f"{before.variable} [{before.unit}]", height=220, rows=[Row(title=title, curves=curves, levels=(0.0,))]
    )


def probability_bars(shares: Sequence[tuple[str, float, str]]) -> Bars:
    """Posterior probabilities, the largest first: name, probability, and printed text."""
    return Bars(bars=[Bar(name=name, length=share, label=label) for name, share, label in shares], full=1.0)


def evidence_figure(grown: CumulativeEvidence) -> Figure:
    """Evidence accumulated along the log, compared with a linear growth."""
    ends = [0, grown.time.size - 1]
    even = np.array([0.0, grown.evidence[-1]])
    return Figure(
        x="time along the runs [s]",
        height=220,
        rows=[
            Row(
                title="log-likelihood with it, less without it",
                curves=[
                    Curve(name="if it grew evenly", colour=MEASURED, x=grown.time[ends], y=even),
                    Curve(name="along the log", colour=AFTER, x=grown.time, y=grown.evidence),
                ],
            )
        ],
    )


def cause_figure(seen: ResidualOverVariable) -> Figure:
    """Measured residual torque without and with an effect, and the extended model's prediction of it."""
    quantity = torque_or_force(seen.torque_unit)
    return Figure(
        x=f"{seen.variable} [{seen.unit}]",
        height=240,
        rows=[
            Row(
                title=f"residual {quantity} [{seen.torque_unit}]",
                levels=(0.0,),
                curves=[
                    Curve(
                        name="predicted by the extended model",
                        colour=SECOND,
                        x=seen.centre,
                        y=seen.predicted,
                        width=2.4,
                    ),
                    Curve(
                        name="measured, without it",
                        colour=BEFORE,
                        x=seen.centre,
                        y=seen.before,
                        error=seen.band,
                        style="rings",
                    ),
                    Curve(name="measured, with it", colour=AFTER, x=seen.centre, y=seen.after, style="points"),
                ],
            )
        ],
    )


def gain_bars(gain: Gain, error: GainErrors, *, extended: bool) -> Bars:
    """Validation error of both models with standard errors; the dotted line is the noise floor."""
    rows = [("base model", gain.held_out_rms_before, error.before, BEFORE)]
    if extended:
        rows.append(("extended model", gain.held_out_rms_after, error.after, AFTER))
    bars = [
        Bar(name=name, length=size, label=measured(size, std, gain.unit), colour=colour, error=std)
        for name, size, std, colour in rows
    ]
    return Bars(bars=bars, full=max(size + std for _, size, std, _ in rows), marker=gain.noise_floor)


def signature_figure(found: Signature, variable: str, lacking: str) -> Figure:
    """Missing torque or measurement error of a model without an effect, over its most informative variable.

    It is drawn as a line over time and where it has loops.

    Args:
        found: the effect's signature.
        variable, lacking: titles of the axes.
    """
    style: Style = "line" if found.loops or found.variable == "time" else "points"
    curve = Curve(name="", colour=AFTER, x=found.variables[found.variable], y=found.lacking, style=style)
    return Figure(x=variable, height=260, rows=[Row(title=lacking, curves=[curve])])


def change_figure(found: Signature) -> Figure:
    """Measurement without and with an effect, and the difference; of few points, as it is one of many figures."""

    def curve(name: str, colour: str, y: Array, width: float = 1.6) -> Curve:
        kept = downsample(y, _SMALL)
        return Curve(name=name, colour=colour, x=found.variables["time"][kept], y=y[kept], width=width)

    shown = [curve("without it", MEASURED, found.without, _WIDE), curve("with it", AFTER, found.seen)]
    difference = [curve("difference", BEFORE, found.change)]
    rows = [
        Row(title="measurement [rad]", curves=shown, share=0.55),
        Row(title="difference [rad]", curves=difference, share=0.45),
    ]
    return Figure(x="time [s]", height=280, rows=rows)


def fit_figure(time: Array, measured: Array, simulated: Array, quantity: str, unit: str) -> Figure:
    """One run, measured (NaN where masked) and simulated, with the error below; `quantity` is what was measured."""
    shown = [
        Curve(name="measured", colour=MEASURED, x=time, y=measured, width=_WIDE),
        Curve(name="simulated", colour=AFTER, x=time, y=simulated),
    ]
    error = [Curve(name="", colour=BEFORE, x=time, y=measured - simulated)]
    rows = [
        Row(title=f"{quantity} [{unit}]", curves=shown, share=0.62),
        Row(title=f"measured less simulated [{unit}]", curves=error, share=0.38),
    ]
    return Figure(x="time [s]", height=360, rows=rows)


def traces_figure(
    time: Array, rows: Sequence[tuple[str, Sequence[tuple[str, str, Array]]]], *, bounds: Mapping[int, Sequence[float]]
) -> Figure:
    """Curves over one time axis, in rows.

    Args:
        time: (T,) [s].
        rows: title of the axis, and its curves: name, colour, values (T,).
        bounds: by row, from 1: levels to draw as dotted lines.
    """
    drawn = [
        Row(
            title=title,
            levels=bounds.get(place, ()),
            curves=[
                Curve(name=name, colour=colour, x=time, y=y, width=_WIDE if colour == MEASURED else 1.6)
                for name, colour, y in curves
            ],
        )
        for place, (title, curves) in enumerate(rows, start=1)
    ]
    return Figure(x="time [s]", height=150 * len(rows), rows=drawn)


def capability_figure(found: CapabilityMap, units: Units = ROTARY) -> Figure:
    """Minimum preload, margin and copper-loss index over acceleration and load torque, where contact can be kept."""
    parts = (
        (f"least preload [{units.preload}]", found.least_preload),
        ("margin [N m]", np.where(found.reachable, found.margin, np.nan)),
        ("copper-loss index [N² m²]", found.copper_loss),
    )
    rows = [
        Row(title=f"load torque [{units.torque}]", what=title, map=(found.acceleration, found.load_torque, values))
        for title, values in parts
    ]
    return Figure(x=f"acceleration [{units.acceleration}]", height=750, rows=rows)


def _band(x: Array, low: Array, high: Array) -> Curve:
    return Curve(name="95 % band", colour=BEFORE, x=x, y=low, high=high, style="band")
