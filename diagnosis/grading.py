"""Causes and minor effects: an effect is a cause if it is larger than what no effect explains.

Significance does not tell a true effect from a part of the unmodelled torque; its size does. The found effects are
weighed together beside the discrepancy, a smooth torque (and error of the measurement) of a size that the log itself
decides. An effect keeps r^2 / (1 + r^2) of its probability, with r what it changes in the innovations over what the
discrepancy changes (`diagnosis.evidence.posterior`). A probable effect that is smaller is *minor*.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

from diagnosis.evidence.explore import with_slower_observers
from diagnosis.evidence.marginal import Explanation, families_along, weigh
from diagnosis.evidence.posterior import kept_share
from diagnosis.residual_torque import torque_of
from diagnosis.result import LISTED, MENTIONED, Cause, EffectSet, Minor, Unknown
from identification.fit_result import Fit

LONGEST = 200_000
"""Samples of a log that are weighed at most: each takes about 5 kB."""
_LIKELY = 0.5  # probability from which an effect is a cause and not a minor effect
_MATERIAL = 0.5  # probability from which the unmodelled torque is said to depend on something


@dataclass(frozen=True, kw_only=True, eq=False)
class Graded:
    """Effects by their size beside what no effect explains.

    Attributes:
        causes: larger than that.
        minor: probable, but smaller.
        unknown: the unmodelled torque.
        warning: why they were not compared with it; None where they were.
    """

    causes: tuple[Cause, ...]
    minor: tuple[Minor, ...]
    unknown: Unknown
    warning: str | None = None

    @property
    def sets(self) -> tuple[EffectSet, ...]:
        """The joint posterior over sets of effects, the likeliest first, down to 0.01."""
        choices = [_choices(cause) for cause in self.causes]
        depends_on = self.unknown.depends_on if self.unknown.likelier_than(_MATERIAL) else ()
        found: dict[tuple[str, ...], float] = {}
        for chosen in product(*choices):
            effects, probability = tuple(sorted({name for name, _ in chosen if name is not None})), 1.0
            for _, share in chosen:
                probability *= share
            found[effects] = found.get(effects, 0.0) + probability
        ranked = sorted(found.items(), key=lambda item: -item[1])
        return tuple(
            EffectSet(effects=effects, unknown=depends_on, probability=p) for effects, p in ranked if p >= LISTED
        )


def graded(causes: Sequence[Cause], fit: Fit, base: Fit, *, catalogue: int, depends_on: tuple[str, ...]) -> Graded:
    """The effects that were found, as causes and minor effects.

    Args:
        causes: with their probabilities among effects alone.
        fit: of the model with all of them.
        base: of the base model.
        catalogue: number of effects that were asked.
        depends_on: variables of the unmodelled torque.
    """
    explanation = _beside_the_discrepancy(fit, base, catalogue)
    if explanation is None:
        why = f"the log has more than {LONGEST:,} samples" if fit.samples > LONGEST else "a motion grows without bound"
        return Graded(
            causes=tuple(_with_torque(cause, fit) for cause in causes),
            minor=(),
            unknown=Unknown(probability=None, depends_on=depends_on, share=None),
            warning=f"Effects were not compared with what no effect explains: {why}.",
        )
    weighed = [_with_torque(_weighed(cause, explanation), fit) for cause in causes]
    small = [cause.effect for cause in weighed if cause.missing <= _LIKELY]
    return Graded(
        causes=tuple(cause for cause in weighed if cause.effect not in small),
        minor=tuple(
            Minor(effect=each.effect, probability=each.probability, share=each.share, rms=each.rms)
            for each in weighed
            if each.effect in small
        ),
        unknown=Unknown(
            probability=explanation.discrepancy.posterior.material,
            depends_on=depends_on,
            share=explanation.weighed.share,
        ),
    )


def _beside_the_discrepancy(fit: Fit, base: Fit, catalogue: int) -> Explanation | None:
    """None where the motion of either model grows without bound, and for a log that is too long.

    An observer that follows the unmodelled torque hides it, so slower ones are asked; not where they lose the motion.
    """
    families = families_along(base) if fit.samples <= LONGEST else None
    if families is None:
        return None
    weighed = partial(
        weigh,
        base=[effect.name for effect in base.model.effects],
        families=families,
        catalogue=catalogue,
        observer=base.bandwidth,
    )
    begun = weighed(fit)
    if begun is None or fit.model.chaotic:
        return begun
    ways = (begun, *with_slower_observers(begun, base.bandwidth, weighed))
    return max(ways, key=lambda each: each.log_marginal)


def _weighed(cause: Cause, explanation: Explanation) -> Cause:
    """A cause with what is left of its probability. Its special case keeps what only its wider form loses."""
    whole = kept_share(explanation, explanation.sizes.effects[cause.effect])
    special, beyond = explanation.sizes.beyond_special.get(cause.effect, (None, float("inf")))
    wide = kept_share(explanation, beyond)
    rivals = {name: whole * p for name, p in cause.alternatives}
    if special is not None:
        rivals[special] = rivals.get(special, 0.0) + cause.probability * whole * (1.0 - wide)
    ranked = tuple(sorted(((n, p) for n, p in rivals.items() if p >= MENTIONED), key=lambda item: -item[1]))
    return replace(cause, probability=cause.probability * whole * wide, alternatives=ranked)


def _with_torque(cause: Cause, fit: Fit) -> Cause:
    rms, share = torque_of(fit, cause.effect)
    return replace(cause, rms=rms, share=share)


def _choices(cause: Cause) -> list[tuple[str | None, float]]:
    """What may stand at the place of a cause: itself, an alternative, or nothing."""
    named: list[tuple[str | None, float]] = [(cause.effect, cause.probability), *cause.alternatives]
    return [*named, (None, max(1.0 - sum(share for _, share in named), 0.0))]
