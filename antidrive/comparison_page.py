"""The picture of what has changed, and the page around it."""

from __future__ import annotations

from typing import Any

from antidrive.html_page import figure_json, page
from antidrive.model_comparison import Comparison
from antidrive.provenance import Provenance


def changes_figure(found: Comparison) -> Any:
    """By how many standard errors each parameter moved; those that moved beyond chance in another colour."""
    import plotly.graph_objects as go

    from antidrive.figures import BEFORE, MEASURED, finish

    told = [change for change in found.changes if change.errors is not None]
    bars = go.Bar(
        x=[change.errors for change in told],
        y=[change.name for change in told],
        orientation="h",
        marker_color=[BEFORE if change.moved else MEASURED for change in told],
    )
    figure = go.Figure(bars)
    figure.update_xaxes(title_text="change, in standard errors of the difference")
    figure.update_yaxes(autorange="reversed", ticksuffix="  ")
    return finish(figure, 110 + 34 * len(told), legend=False)


def changes_page(found: Comparison, provenance: Provenance) -> str:
    """Sentences and the picture."""
    log = found.diagnosis.base.log
    return page(
        "picture",
        provenance,
        found.sentences()[0].rstrip("."),
        kind="Comparison with a known model",
        sentences=found.sentences(),
        pictures=[(figure_json(changes_figure(found)), "In colour: more than chance allows among so many parameters.")],
        data={"warnings": log.warnings, "repairs": log.repairs, "notes": log.notes},
    )
