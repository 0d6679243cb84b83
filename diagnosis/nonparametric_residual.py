"""What has no name: curves and ripples compete on the catalogue's footing, and carry the gain without a name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain

import numpy as np

from diagnosis.model_probability import parameter_cost, schwarz_cost, search_charge
from diagnosis.parts_consistency import still_needed
from diagnosis.random_walk_load import may_be_random_walk, refitted_path, with_random_walk
from diagnosis.refit import evidence_of, follows_anything, refit, widening
from diagnosis.score_test import Screen, excess_of_neighbouring_peaks
from diagnosis.stepwise_round import Addition
from diagnosis.validation import passes_validation
from identification.fit_result import Fit
from identification.threads import in_threads
from plant.effects.nonparametric import plain, unnamed
from plant.effects.nonparametric_curve import Nonparametric

_CLEARS = float(np.log(1000.0))  # score that a curve needs before it is believed
CLEARLY = 0.1  # share by which what is richer, or has no name, must explain more than what is not to be preferred
_MOST = 2  # curves that a model may carry
_PROMISING = -5.0  # score from which a refit may still clear the bar, where an observer hides what it would bring
_TRIES = 4  # refits in search of one that pays and holds up
_PAIRED = 2  # of them beside which another is tried, where none pays alone, and of the others
_KNOTS_LEAVE = 0.2  # share of what the first brought that a second must bring: less may be how coarse the first is


def unnamed_dependence(
    fit: Fit, kinds: Mapping[str, type[Nonparametric]] = plain, *, bar: float = _CLEARS
) -> tuple[tuple[Nonparametric, float], ...]:
    """What without a name would explain more than chance, the best of each kind with its score, the highest first."""
    if fit.runs_off:  # nothing says what it lacks
        return ()
    asked = [kind for kind in kinds.values() if kind.beside(fit.model) and fit.log.shows(kind)]
    found: dict[str, tuple[Nonparametric, float]] = {}
    for screen, loss in Screen.views(fit):
        if screen.runs_off:
            continue
        for start, value in chain(*in_threads(partial(_asked, screen), asked)):
            score = value - loss - search_charge(searched=1, catalogue=len(asked))
            if score > max(bar, found[start.name][1] if start.name in found else bar):
                found[start.name] = start, score
    return tuple(sorted(found.values(), key=lambda item: -item[1]))


def _asked(screen: Screen, kind: type[Nonparametric]) -> list[tuple[Nonparametric, float]]:
    """What one kind suggests, with its evidence less the charge for the search along it."""
    return [
        (start, evidence - search_charge(searched=trace.searched, catalogue=1))
        for trace, evidence, coefficients in screen.regress(kind.traces(screen.motion), discounted=True)
        if isinstance(start := trace.start(coefficients), Nonparametric)
    ]


@dataclass(frozen=True, kw_only=True, eq=False)
class ResidualModel:
    """What a fit is given without a name.

    Attributes:
        path: the fit with something unnamed more, and with another; empty if nothing pays and holds up unseen.
        seen: curves over one variable that would explain more than chance, paying or not.
    """

    path: tuple[Fit, ...]
    seen: tuple[Nonparametric, ...]

    @property
    def rich(self) -> bool:
        """Whether it takes more than curves over one variable."""
        effects = self.path[-1].model.effects if self.path else ()
        return any(isinstance(effect, Nonparametric) and effect.name not in plain for effect in effects)


def residual_model(fit: Fit) -> ResidualModel:
    """What a fit may carry: a curve over one variable, unless what is richer says clearly more.

    As a name has to, each says more than a load torque that wanders at random; and what is richer leaves no work for a
    fast observer. Where none does alone, two may together.
    """
    seen, known = unnamed_dependence(fit), dict[str, Fit | None]()
    simple = _path(fit, plain, seen, known)
    hides = _hides_something(simple[-1] if simple else fit)
    rich = _path(fit, unnamed, _promising(fit, unnamed), known) if hides else ()
    if not simple and not rich and may_be_random_walk(fit):
        rich = _two_together(fit)
    better = rich and not follows_anything(rich[-1]) and is_clearly_likelier(rich, simple, fit, times=1.0 + CLEARLY)
    return ResidualModel(path=rich if better else simple, seen=tuple(curve for curve, _ in seen))


def curve_path(fit: Fit) -> tuple[Fit, ...]:
    """The fit with a curve over one variable more, and another, as long as they pay and hold up unseen."""
    return _path(fit, plain, unnamed_dependence(fit), {})


def best_curve_score(fit: Fit) -> float:
    """The highest score that the screen gives to what has no name, of any kind; a refit may bring much more."""
    return max((score for _, score in _promising(fit, unnamed)), default=0.0)


def charged_evidence(path: tuple[Fit, ...], than: Fit, *, over: float | None = None) -> float:
    """Evidence of the end of a path of fits over a simpler one, less the cost of its parameters; `over` as there."""
    return evidence_of(path[-1], than, over=over) - parameter_cost(path[-1], than) if path else 0.0


def is_clearly_likelier(one: tuple[Fit, ...], other: tuple[Fit, ...], than: Fit, *, times: float) -> bool:
    """Whether the end of one path of fits is worth more than so many times another's, both over a simpler fit.

    The likelier one's colour counts for both, as among names.
    """
    over = _colour(one + other, than)
    return charged_evidence(one, than, over=over) > times * charged_evidence(other, than, over=over)


def evidence_lead(one: tuple[Fit, ...], other: tuple[Fit, ...], than: Fit) -> float:
    """By how much the end of one path of fits is worth more than another's, likewise."""
    over = _colour(one + other, than)
    return charged_evidence(one, than, over=over) - charged_evidence(other, than, over=over)


def _colour(fits: tuple[Fit, ...], than: Fit) -> float:
    return widening(max(fits, key=lambda fit: fit.log_likelihood), than)


def _hides_something(fit: Fit) -> bool:
    """Whether an observer, or a colour of the noise, had to take something over."""
    return bool(fit.bandwidth or fit.log.colour)


def _promising(fit: Fit, kinds: Mapping[str, type[Nonparametric]]) -> tuple[tuple[Nonparametric, float], ...]:
    return unnamed_dependence(fit, kinds, bar=_PROMISING if fit.bandwidth and kinds is not plain else _CLEARS)


def _path(
    fit: Fit,
    kinds: Mapping[str, type[Nonparametric]],
    found: tuple[tuple[Nonparametric, float], ...],
    known: dict[str, Fit | None],
) -> tuple[Fit, ...]:
    """The fit with one of those found more, and another; `known` are the first steps that were tried before."""
    path: list[Fit] = []
    while (longer := _one_more(path[-1] if path else fit, found, known)) is not None:
        if path and evidence_of(longer, path[-1]) < _KNOTS_LEAVE * evidence_of(path[0], fit):
            break
        path.append(longer)
        if len(path) == _MOST:
            break
        found, known = _promising(longer, kinds), {}
    return tuple(path)


def _one_more(fit: Fit, found: tuple[tuple[Nonparametric, float], ...], known: dict[str, Fit | None]) -> Fit | None:
    """The fit with the first of those found more that pays, or with the best, if each leaves work for an observer."""
    tried = [start for start, _ in found[:_TRIES]]
    random = max(evidence_of(with_random_walk(fit), fit), 0.0) if tried and may_be_random_walk(fit) else 0.0
    best: Fit | None = None
    for start in tried:
        if start.name not in known:
            after = refit(fit, start.begun(), fixed=start.shape())
            cost = schwarz_cost(len(after.free) - len(fit.free), fit.samples)
            over = evidence_of(after, fit) - random - _CLEARS - cost
            pays = over > 0.0 and over > _line_charge(after, start) and passes_validation(fit, after, must_show=True)
            known[start.name] = after if pays else None
        longer = known[start.name]
        if longer is not None and (best is None or is_clearly_likelier((longer,), (best,), fit, times=1.0)):
            best = longer
        if best is not None and not may_be_random_walk(best):
            break
    return best


def _two_together(fit: Fit) -> tuple[Fit, ...]:
    """The fit with two more that leave nothing to an observer; each alone would leave what the other explains to it."""
    best: tuple[Fit, ...] = ()
    for first in _closest(fit, _TRIES)[:_PAIRED]:
        for second in _closest(first, _PAIRED):
            if not second.bandwidth and is_clearly_likelier((second,), best, fit, times=1.0):
                best = first, second
    over = (
        charged_evidence(best, fit) - max(evidence_of(with_random_walk(fit), fit), 0.0) - _MOST * _CLEARS
        if best
        else 0.0
    )
    return best if over > 0.0 and passes_validation(fit, best[-1], must_show=True) else ()


def _closest(fit: Fit, tries: int) -> list[Fit]:
    """A fit with one more of those that the screen puts first, the one that says most first."""
    starts = [start for start, _ in _promising(fit, unnamed)[:tries]]
    fits = [refit(fit, start.begun(), fixed=start.shape()) for start in starts]
    return sorted(
        (one for one in fits if not one.runs_off), key=lambda one: charged_evidence((one,), fit), reverse=True
    )


def _line_charge(fit: Fit, start: Nonparametric) -> float:
    """What a fitted ripple pays for the search among lines: the more, the more the lines beside it explain too."""
    if not start.of_lines:
        return 0.0
    (screen, _), *_ = Screen.views(fit)
    searched = next((trace.searched for trace in start.traces(screen.motion)), 1)
    return search_charge(searched=searched, catalogue=1, peaks=excess_of_neighbouring_peaks(fit, start.name))


def beside_unnamed(base: Fit, additions: tuple[Addition, ...]) -> tuple[tuple[Addition, ...], ResidualModel]:
    """Additions to a base that still pay beside what is carried without a name, and that.

    A law that varies over the turn passes for the nearest that does not, and a ripple of any shape for a sine and a
    stop: such names only stood near the cause.
    """
    more = residual_model(additions[-1].fit if additions else base)
    if not more.path:
        return additions, more
    kept, at = still_needed(additions, more.path[-1])
    if len(kept) == len(additions):
        return additions, more
    if not kept:
        return (), residual_model(base)
    return tuple(refitted_path(base, kept, at)), replace(more, path=(at,))
