"""The figure of the changes since an identification, and its page."""

from __future__ import annotations

from antidrive.chart import BEFORE, MEASURED, Bar, Bars
from antidrive.html_page import page
from antidrive.model_comparison import Comparison, significant
from antidrive.provenance import Provenance


def change_bars(found: Comparison) -> Bars:
    """Change of each parameter in standard errors; significant changes are coloured."""
    shown = [change for change in found.changes if change.errors is not None]
    bars = [
        Bar(
            name=change.name,
            length=abs(change.errors),
            label=f"{change.errors:+.1f}".replace("-", "\N{MINUS SIGN}"),
            colour=BEFORE if change.moved else MEASURED,
        )
        for change in shown
        if change.errors is not None
    ]
    return Bars(bars=bars, full=max([significant(found.changes), *(bar.length for bar in bars)]))


def changes_page(found: Comparison, provenance: Provenance) -> str:
    """The page with sentences and figure."""
    log = found.diagnosis.base.log
    return page(
        "picture",
        provenance,
        found.headline(),
        kind="Comparison with a known model",
        sentences=found.sentences(),
        pictures=[
            (
                change_bars(found),
                "Change of each parameter, in standard errors of the difference. Coloured: significant (above "
                f"{significant(found.changes):.1f}) and more than 1 % of the parameter.",
            )
        ],
        data={"warnings": log.warnings, "repairs": log.repairs, "notes": log.notes},
    )
