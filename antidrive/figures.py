"""Figures of results. Each takes a finished result and only draws; nothing is computed here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from allocation import CapabilityMap
from antidrive.capability import ROTARY, Units
from antidrive.downsampling import downsample
from antidrive.html_page import printed
from diagnosis.explanation.cumulative_evidence import CumulativeEvidence, ResidualOverVariable
from diagnosis.explanation.hypothesis_comparison import HypothesisComparison
from diagnosis.explanation.wording import measured, torque_or_force
from diagnosis.holdout import GainErrors
from diagnosis.model_probability import CLEAR
from diagnosis.residual_torque import Curve, ResidualTorque
from diagnosis.result import Gain, Replay

if TYPE_CHECKING:
    from antidrive.signature import Signature

Array = NDArray[np.float64]

MEASURED, BEFORE, AFTER, SECOND, THIRD = "#8a929b", "#e07b27", "#2f7fd1", "#2a9d6f", "#b65fa0"
"""Told apart in light and dark and by readers who see no red: grey, orange, blue, green, purple."""

ALONE = float(np.log(CLEAR / (1.0 - CLEAR)))
"""Log odds from which a name stands without its rivals."""


def replay_figure(replay: Replay, unit: str, *, extended: bool) -> go.Figure:
    """Measured against simulated, and below it what the simulation misses.

    Args:
        replay: one run.
        unit: of the output.
        extended: draw the extended model too.
    """
    seen = np.where(replay.valid, replay.measured, np.nan)
    curves = [("base model", BEFORE, replay.before)]
    if extended:
        curves.append(("extended model", AFTER, replay.after))
    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.06, row_heights=[0.58, 0.42])
    figure.add_trace(line(replay.time, seen, "measured", MEASURED, width=3.5), 1, 1)
    for name, colour, simulated in curves:
        figure.add_trace(line(replay.time, simulated, name, colour), 1, 1)
        figure.add_trace(line(replay.time, seen - simulated, name, colour, legend=False), 2, 1)
    figure.update_yaxes(title_text=f"output [{unit}]", row=1, col=1)
    figure.update_yaxes(title_text=f"error [{unit}]", row=2, col=1)
    figure.update_xaxes(title_text="time [s]", row=2, col=1)
    return finish(figure, 460)


def residual_figure(missing: ResidualTorque) -> go.Figure:
    """The torque that a model lacks, over the log, with its 95 % band."""
    figure = go.Figure()
    for run in np.unique(missing.run):
        rows = missing.run == run
        time, torque, band = missing.time[rows], missing.torque[rows], missing.band[rows]
        first = bool(run == missing.run[0])
        figure.add_traces(_band(time, torque - band, torque + band, BEFORE, "95 % band", legend=first))
        figure.add_trace(line(time, torque, f"missing {torque_or_force(missing.unit)}", BEFORE, legend=first))
    figure.update_xaxes(title_text="time [s]")
    figure.update_yaxes(title_text=f"missing {torque_or_force(missing.unit)} [{missing.unit}]")
    return finish(figure, 300)


def curve_figure(before: Curve, after: Curve | None, unit: str) -> go.Figure:
    """The missing torque over one variable, with the band of its mean, before and after naming."""
    figure = go.Figure()
    pairs = [("before", BEFORE, before)] + ([("after naming", AFTER, after)] if after is not None else [])
    for name, colour, curve in pairs:
        low, high = curve.mean - curve.band, curve.mean + curve.band
        figure.add_traces(_band(curve.centre, low, high, colour, "95 % band", legend=False))
        figure.add_trace(line(curve.centre, curve.mean, name, colour))
    figure.update_xaxes(title_text=f"{before.variable} [{before.unit}]")
    figure.update_yaxes(title_text=f"missing {torque_or_force(unit)} [{unit}]")
    return finish(figure, 270)


def hypothesis_figure(contest: HypothesisComparison, names: Mapping[str, str], labels: Mapping[str, str]) -> go.Figure:
    """How far the rivals are behind the leader, in log odds; those far behind run out of the picture.

    Args:
        contest: with its rivals.
        names: of the contenders, by effect.
        labels: what stands at the end of each row, by effect.
    """
    rows = (contest.leader, *contest.rivals[:5])
    behind = [contest.leader.score - c.score for c in rows]
    bars = go.Bar(x=behind, y=[names[c.effect] for c in rows], orientation="h", marker_color=AFTER, hoverinfo="x")
    figure = go.Figure(bars)
    for place, c in enumerate(rows):
        text = {"text": labels[c.effect], "showarrow": False, "xanchor": "left", "xref": "paper", "x": 1.01}
        figure.add_annotation(y=place, yref="y", **text)
    figure.add_vline(x=ALONE, line_dash="dot", line_color=SECOND, line_width=1.5)
    figure.update_xaxes(range=[0.0, max(3.0 * ALONE, 2.0 * behind[1])])
    figure.update_xaxes(title_text="log odds behind (dotted: 9 to 1)")
    figure.update_yaxes(autorange="reversed", ticksuffix="  ")
    return finish(figure, 110 + 34 * len(rows), legend=False).update_layout(margin_r=64)


def evidence_figure(grown: CumulativeEvidence) -> go.Figure:
    """Evidence as it grew along the log, beside even growth."""
    figure = go.Figure()
    ends = [0, grown.time.size - 1]
    even = np.array([0.0, grown.evidence[-1]])
    figure.add_trace(line(grown.time[ends], even, "if it grew evenly", MEASURED, width=1.2))
    figure.add_trace(line(grown.time, grown.evidence, "log-likelihood gained", AFTER))
    figure.update_xaxes(title_text="time along the runs [s]")
    figure.update_yaxes(title_text="log-likelihood")
    return finish(figure, 270)


def cause_figure(seen: ResidualOverVariable) -> go.Figure:
    """Missing torque over the telling variable without and with a cause, and what the cause says is missing."""
    figure = go.Figure()
    low, high = seen.before - seen.band, seen.before + seen.band
    figure.add_traces(_band(seen.centre, low, high, BEFORE, "95 % band", legend=False))
    for name, colour, values in (("without it", BEFORE, seen.before), ("with it", AFTER, seen.after)):
        figure.add_trace(line(seen.centre, values, name, colour))
    said = line(seen.centre, seen.predicted, "what it predicts", SECOND, width=2.4)
    figure.add_trace(said.update(line_dash="dash"))
    figure.update_xaxes(title_text=f"{seen.variable} [{seen.unit}]")
    figure.update_yaxes(title_text=f"missing {torque_or_force(seen.torque_unit)} [{seen.torque_unit}]")
    return finish(figure, 270)


def gain_figure(gain: Gain, error: GainErrors, *, extended: bool) -> go.Figure:
    """Held-out error before and after, with standard errors, and the noise floor as a line."""
    rows = [("base model", gain.held_out_rms_before, error.before, BEFORE)]
    if extended:
        rows.append(("extended model", gain.held_out_rms_after, error.after, AFTER))
    unit, names, sizes, errors, colours = gain.unit, *(list(column) for column in zip(*rows, strict=True))
    bars = go.Bar(
        x=sizes,
        y=names,
        error_x={"array": errors, "thickness": 1.5, "width": 4},
        orientation="h",
        marker_color=colours,
        hoverinfo="skip",
    )
    figure = go.Figure(bars)
    for name, size, std, _ in rows:
        told = {"text": str(printed(measured(size, std, unit))), "showarrow": False, "xanchor": "left", "xshift": 6}
        figure.add_annotation(x=size + std, y=name, **told)
    floor = str(printed(measured(gain.noise_floor, error.noise_floor, unit)))
    note = {"text": f"{gain.floor_name} {floor}", "yanchor": "bottom", "xanchor": "left", "y": 1.0}
    figure.add_vline(x=gain.noise_floor, line_dash="dot", line_color=SECOND, annotation=note)
    figure.update_xaxes(
        title_text=f"rms error on held-out runs [{unit}]",
        range=[0.0, 1.35 * max(map(sum, zip(sizes, errors, strict=True)))],
    )
    figure.update_yaxes(autorange="reversed", ticksuffix="  ")
    return finish(figure, 130 + 40 * len(rows), legend=False)


def signature_figure(found: Signature, variable: str, lacking: str) -> go.Figure:
    """What a model lacks without an effect over the variable that tells; a line over time and where it makes loops.

    Args:
        found: the effect's signature.
        variable, lacking: titles of the axes.
    """
    over, values = found.variables[found.variable], found.lacking
    line = {"mode": "lines", "line": {"color": AFTER, "width": 1.4}}
    points = {"mode": "markers", "marker": {"color": AFTER, "size": 3.5, "opacity": 0.55}}
    style = line if found.loops or found.variable == "time" else points
    figure = go.Figure(go.Scatter(x=_short(over), y=_short(values), hoverinfo="skip", **style))
    figure.update_xaxes(title_text=variable)
    figure.update_yaxes(title_text=lacking)
    return finish(figure, 340, legend=False)


def change_figure(found: Signature) -> go.Figure:
    """What the sensor shows without and with an effect, and the difference below."""
    time = _short(found.variables["time"])
    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.07, row_heights=[0.55, 0.45])
    figure.add_trace(line(time, _short(found.without), "without it", MEASURED, width=3.5), 1, 1)
    figure.add_trace(line(time, _short(found.seen), "with it", AFTER), 1, 1)
    figure.add_trace(line(time, _short(found.change), "difference", BEFORE), 2, 1)
    figure.update_yaxes(title_text="reading [rad]", row=1, col=1)
    figure.update_yaxes(title_text="difference [rad]", row=2, col=1)
    figure.update_xaxes(title_text="time [s]", row=2, col=1)
    return finish(figure, 340)


def _short(values: Array) -> Any:
    """The values in single precision, which a drawing needs no more than."""
    return values.astype(np.float32)


def fit_figure(time: Array, measured: Array, simulated: Array, unit: str) -> go.Figure:
    """One run, measured (NaN where masked) and simulated, with the residual below."""
    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.06, row_heights=[0.62, 0.38])
    figure.add_trace(line(time, measured, "measured", MEASURED, width=3.5), 1, 1)
    figure.add_trace(line(time, simulated, "simulated", AFTER), 1, 1)
    figure.add_trace(line(time, measured - simulated, "residual", BEFORE, legend=False), 2, 1)
    figure.update_yaxes(title_text=f"output [{unit}]", row=1, col=1)
    figure.update_yaxes(title_text=f"residual [{unit}]", row=2, col=1)
    figure.update_xaxes(title_text="time [s]", row=2, col=1)
    return finish(figure, 430)


def traces_figure(
    time: Array, rows: Sequence[tuple[str, Sequence[tuple[str, str, Array]]]], *, bounds: dict[int, Sequence[float]]
) -> go.Figure:
    """Curves over one time axis, in rows.

    Args:
        time: (T,) [s].
        rows: title of the axis, and its curves: name, colour, values (T,).
        bounds: by row, from 1: levels to draw as dotted lines.
    """
    figure = make_subplots(rows=len(rows), cols=1, shared_xaxes=True, vertical_spacing=0.05)
    listed: set[str] = set()
    for row, (title, curves) in enumerate(rows, start=1):
        for name, colour, values in curves:
            width = 3.5 if colour == MEASURED else 1.6
            figure.add_trace(line(time, values, name, colour, width=width, legend=name not in listed), row, 1)
            listed.add(name)
        for level in bounds.get(row, ()):
            figure.add_hline(y=level, line_dash="dot", line_color=MEASURED, line_width=1, row=row, col=1)
        figure.update_yaxes(title_text=title, row=row, col=1)
    figure.update_xaxes(title_text="time [s]", row=len(rows), col=1)
    return finish(figure, 110 + 190 * len(rows))


def capability_figure(found: CapabilityMap, units: Units = ROTARY) -> go.Figure:
    """Least preload, margin and heat over acceleration and load torque, where the teeth stay together."""
    parts = (
        (f"least preload [{units.preload}]", found.least_preload),
        ("margin [N m]", np.where(found.reachable, found.margin, np.nan)),
        ("heat [N² m²]", found.heat),
    )
    figure = make_subplots(rows=len(parts), cols=1, shared_xaxes=True, vertical_spacing=0.06)
    for row, (title, values) in enumerate(parts, start=1):
        bar = {"title": {"text": title, "side": "right"}, "len": 0.3, "y": 1.0 - (row - 0.5) / len(parts)}
        shown = {"x": _short(found.acceleration), "y": _short(found.load_torque), "z": _short(values.T)}
        figure.add_trace(go.Heatmap(**shown, colorscale="Viridis", colorbar=bar), row, 1)
        figure.update_yaxes(title_text=f"load torque [{units.torque}]", row=row, col=1)
    figure.update_xaxes(title_text=f"acceleration [{units.acceleration}]", row=len(parts), col=1)
    return finish(figure, 960, legend=False)


def line(time: Array, values: Array, name: str, colour: str, *, width: float = 1.6, legend: bool = True) -> Any:
    """A curve, thinned to what a screen can show."""
    kept = downsample(values)
    return go.Scatter(
        x=time[kept],
        y=values[kept],
        name=name,
        mode="lines",
        line={"color": colour, "width": width},
        legendgroup=name,
        showlegend=legend,
    )


def _band(x: Array, low: Array, high: Array, colour: str, name: str, *, legend: bool) -> list[Any]:
    kept = np.union1d(downsample(low, 1000), downsample(high, 1000))
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    common = {"mode": "lines", "line": {"width": 0}, "hoverinfo": "skip", "legendgroup": name}
    return [
        go.Scatter(x=x[kept], y=low[kept], showlegend=False, **common),
        go.Scatter(
            x=x[kept],
            y=high[kept],
            fill="tonexty",
            fillcolor=f"rgba({red}, {green}, {blue}, 0.22)",
            name=name,
            showlegend=legend,
            **common,
        ),
    ]


def finish(figure: go.Figure, height: int, *, legend: bool = True) -> go.Figure:
    """The look that all figures share."""
    figure.update_layout(
        template="none",
        height=height,
        showlegend=legend,
        margin={"l": 62, "r": 20, "t": 34, "b": 46},
        legend={"orientation": "h", "yanchor": "bottom", "y": 1.0, "x": 0.0},
        paper_bgcolor="rgba(0,0,0,0)",
        plot_bgcolor="rgba(0,0,0,0)",
        hovermode="closest",
    )
    figure.update_xaxes(automargin=True, zeroline=False)
    figure.update_yaxes(automargin=True, zeroline=False, exponentformat="power")
    return figure
