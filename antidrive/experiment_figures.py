"""Figures of experiments: curves over any variable."""

from __future__ import annotations

import plotly.graph_objects as go

from antidrive.experiments.outcome import Picture
from antidrive.figures import finish, line


def picture_figure(picture: Picture) -> go.Figure:
    """Draw a picture; what was measured at single places as points."""
    figure = go.Figure()
    listed: set[str] = set()
    for curve in picture.curves:
        if curve.points:
            marks = {"color": curve.colour, "size": 8, "symbol": "circle-open", "line": {"width": 2}}
            figure.add_trace(go.Scatter(x=curve.x, y=curve.y, name=curve.name, mode="markers", marker=marks))
        else:
            figure.add_trace(line(curve.x, curve.y, curve.name, curve.colour, legend=curve.name not in listed))
        listed.add(curve.name)
    figure.update_xaxes(title_text=picture.x)
    figure.update_yaxes(title_text=picture.y)
    return finish(figure, 380)
