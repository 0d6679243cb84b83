"""Names about which the parts of a log agree, where an observer is still at work.

A model that needs an observer to the end lacks something, or the load is random. What it lacks makes its parts disagree
by more than noise does, and what one of them says for a name then counts for less in the others. Where a simulation
leaves nothing to an observer, there is nothing of that kind.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from diagnosis.model_probability import CLEAR
from diagnosis.overdispersion import overdispersion
from diagnosis.random_walk_load import probability_needed, refitted_path
from diagnosis.refit import fitted_near
from diagnosis.stepwise_round import Addition
from identification.fit_result import Fit


def consistent_additions(
    base: Fit, additions: list[Addition], progress: Callable[[str], None] | None = None
) -> list[Addition]:
    """The additions to a base for which its log speaks discounted enough, fitted anew where one had to go."""
    final = additions[-1].fit if additions else base
    if not final.bandwidth or not additions:
        return additions
    if progress is not None:
        progress("do the parts of the log agree?")
    kept, at = still_needed(additions, final, surely=True)
    return additions if len(kept) == len(additions) else refitted_path(base, kept, at)


def inconsistent_effects(additions: Sequence[Addition], names: Sequence[str]) -> tuple[str, ...]:
    """Those of the names in the last fit about which the parts of its log disagree more than chance makes them."""
    return tuple(name for name in names if overdispersion(additions[-1].fit, name).least > 1.0)


def still_needed(additions: Sequence[Addition], at: Fit, *, surely: bool = False) -> tuple[list[Addition], Fit]:
    """Those of the additions to a fit's model that pay in it, and the fit without the others.

    Where an observer still follows something, the model may not be right, and a name counts as far as the parts of the
    log agree about it. With `surely` it may well be, and only what chance does not make them disagree by is counted.
    """
    kept = list(additions)
    for addition in sorted(additions, key=lambda addition: addition.evidence):
        less = fitted_near(at, at.model.without_effect(addition.effect))
        dispersion = overdispersion(at, addition.effect) if at.bandwidth else None
        over = None if dispersion is None else dispersion.least if surely else dispersion.factor
        if probability_needed(addition, at, less, dispersion=over) < CLEAR:
            at = less
            kept.remove(addition)
    return kept, at
