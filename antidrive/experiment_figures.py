"""Figures of experiments: curves over any variable."""

from __future__ import annotations

from antidrive import chart
from antidrive.experiments.outcome import Picture


def picture_figure(picture: Picture) -> chart.Figure:
    """Draw a figure of an experiment; values at single places as points."""
    curves = [
        chart.Curve(name=c.name, colour=c.colour, x=c.x, y=c.y, style="rings" if c.points else "line")
        for c in picture.curves
    ]
    return chart.Figure(x=picture.x, height=320, rows=[chart.Row(title=picture.y, curves=curves)])
