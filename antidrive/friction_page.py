"""The picture of a friction test, and the page around it."""

from __future__ import annotations

from typing import Any

import numpy as np

from antidrive.html_page import figure_json, page
from antidrive.provenance import Provenance
from identification.friction_test import FrictionTest


def friction_figure(found: FrictionTest) -> Any:
    """Torque over speed with its standard errors, and the curve through it."""
    import plotly.graph_objects as go

    from antidrive.figures import AFTER, BEFORE, finish, line

    figure = go.Figure()
    shown = True
    for speeds in (found.velocity[found.velocity < 0.0], found.velocity[found.velocity > 0.0]):
        if speeds.size:
            course = np.linspace(speeds.min(), speeds.max(), 300)
            figure.add_trace(line(course, found.curve(course), "fitted", AFTER, legend=shown))
            shown = False
    figure.add_trace(
        go.Scatter(
            x=found.velocity,
            y=found.torque,
            error_y={"array": found.error, "color": BEFORE, "thickness": 1.2},
            mode="markers",
            marker={"color": BEFORE, "size": 6},
            name="measured",
        )
    )
    figure.update_xaxes(title_text=f"velocity [{found.units['speed']}]")
    figure.update_yaxes(title_text=f"friction and offset [{found.log.command_unit}]")
    return finish(figure, 380)


def friction_page(found: FrictionTest, provenance: Provenance) -> str:
    """Sentences and the picture."""
    caption = "Each point is the mean over a speed, with its standard error, less inertia and gravity."
    log = found.log
    return page(
        "picture",
        provenance,
        "Friction over speed",
        kind="Friction test",
        sentences=found.sentences(),
        pictures=[(figure_json(friction_figure(found)), caption)],
        data={"warnings": log.warnings, "repairs": log.repairs, "notes": log.notes},
    )
