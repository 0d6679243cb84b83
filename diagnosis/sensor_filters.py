"""Whether a filter of the reading is a cause, where an observer follows anything: then it may only mend the observer.

Where a model fails now and then, as at a stop that it lacks, one gain serves for all the log: it is too small there and
too large elsewhere, and what it leaves has a colour. A lag of the sensor mends that, and explains no motion. So the
innovations with it and without it are each whitened by an autoregression of their own (Box and Jenkins 1970), which is
what a better observer would do, and what is left of the evidence counts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.special import expit

from diagnosis.hypothesis import Hypothesis
from diagnosis.model_probability import CLEAR
from diagnosis.random_walk_load import refitted_path
from diagnosis.refit import evidence_of, fitted_near, follows_anything
from diagnosis.stepwise_round import Addition
from identification.fit_result import Fit
from identification.noise import colouring
from plant.effects.effect import Stage


def without_sensor_filters(
    base: Fit, additions: Sequence[Addition], progress: Callable[[str], None] | None = None
) -> list[Addition]:
    """The additions to a base without filters of the reading that only mend an observer, fitted anew if one went."""
    kept = list(additions)
    final = at = additions[-1].fit if additions else base
    filters = [(addition, own) for addition in additions if (own := _as_filter(addition)) is not None]
    if not filters or not follows_anything(final):
        return kept
    if progress is not None:
        progress("or does it take a better observer only?")
    for addition, own in filters:
        less = fitted_near(at, at.model.without_effect(addition.effect))
        evidence = min(evidence_of(at, less), whitened_rise(at, less))
        if expit(own.visible(at, less, evidence)) < CLEAR:
            at = less
            kept.remove(addition)
    return kept if len(kept) == len(additions) else refitted_path(base, kept, at)


def _as_filter(addition: Addition) -> Hypothesis | None:
    """The added effect as it was refitted, if it is a filter of the reading."""
    own = next((rival for rival in addition.contest if rival.effect.name == addition.effect), None)
    return own if own is not None and own.effect.stage is Stage.SENSOR and own.effect.states else None


def whitened_rise(fit: Fit, than: Fit) -> float:
    """By how much a fit is likelier than another, the innovations of each whitened by an autoregression of its own."""
    (_, with_it), (_, without) = colouring(fit.innovations), colouring(than.innovations)
    return 0.5 * fit.samples * float(np.log(without / with_it))
