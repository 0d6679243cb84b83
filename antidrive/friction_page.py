"""The figure of a friction test, and its page."""

from __future__ import annotations

import numpy as np

from antidrive.chart import AFTER, BEFORE, Curve, Figure, Row
from antidrive.html_page import page
from antidrive.provenance import Provenance
from identification.friction_test import FrictionTest


def friction_figure(found: FrictionTest) -> Figure:
    """Torque over speed with its standard errors, and the curve through it."""
    curves = []
    for speeds in (found.velocity[found.velocity < 0.0], found.velocity[found.velocity > 0.0]):
        if speeds.size:
            course = np.linspace(speeds.min(), speeds.max(), 300)
            curves.append(Curve(name="fitted", colour=AFTER, x=course, y=found.curve(course)))
    x, y, error = found.velocity, found.torque, found.error
    curves.append(Curve(name="measured", colour=BEFORE, x=x, y=y, error=error, style="rings"))
    title = f"friction and offset [{found.log.command_unit}]"
    return Figure(x=f"velocity [{found.units['speed']}]", height=320, rows=[Row(title=title, curves=curves)])


def friction_page(found: FrictionTest, provenance: Provenance) -> str:
    """The page with sentences and figure."""
    caption = "Each point is the mean torque at one speed with its standard error, without inertia and gravity torque."
    log = found.log
    return page(
        "picture",
        provenance,
        "Friction over speed",
        kind="Friction test",
        sentences=found.sentences(),
        pictures=[(friction_figure(found), caption)],
        data={"warnings": log.warnings, "repairs": log.repairs, "notes": log.notes},
    )
