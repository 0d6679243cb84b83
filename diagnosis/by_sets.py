"""Diagnose by sets of effects: one evidence for all of them, with the unnamed taking part in each."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from diagnosis.candidates import Choice, chosen
from diagnosis.evidence.explore import explore
from diagnosis.evidence.posterior import Posterior
from diagnosis.holdout import parts
from diagnosis.identifiability import standstill
from diagnosis.refit import estimates
from diagnosis.residual_torque import residual_torque
from diagnosis.result import Cause, Unexplained, Verdict
from identification.errors import Unidentifiable
from identification.fit import base_model, fit_with_prior, known_of
from identification.fit_result import Fit
from identification.log_like import LogLike, log_of
from identification.prior_knowledge import Fixed, Pairs
from identification.threads import without_blas_threads
from plant.servo import ServoModel

_SURE, _LIKELY = 0.9, 0.5  # probabilities from which a name stands alone, and from which one is told
_MATERIAL = 0.5  # probability of an unmodelled torque from which it is told
_CARRIES = 0.8  # of what the most telling variable explains, from which another is told too
_NOISE = 0.1  # share of the torque up to which a random load may pass for noise
_TELLING = 0.2  # share of the discrepancy from which a variable is said to carry it
_LISTED = 0.01  # ... and a set
_MENTION = 1e-4  # probability from which a rival is listed


@dataclass(frozen=True, kw_only=True, eq=False)
class SetDiagnosis:
    """What the log says of sets of effects.

    Attributes:
        verdict: "named", "nothing_missing", "ambiguous" or "unknown".
        causes: probable, and larger than the discrepancy.
        minor: probable, and smaller: name -> probability.
        unexplained: what the discrepancy depends on.
        posterior: over the sets.
        base, extended: fits of the base model and of the likeliest set.
    """

    verdict: Verdict
    causes: tuple[Cause, ...]
    minor: Mapping[str, float]
    unexplained: Unexplained
    posterior: Posterior
    base: Fit
    extended: Fit

    @property
    def model(self) -> ServoModel:
        """The extended model."""
        return self.extended.model

    def to_dict(self) -> dict[str, Any]:
        """What a script reads of it."""
        return {
            "verdict": self.verdict,
            "causes": [
                {
                    "effect": cause.effect,
                    "probability": cause.probability,
                    "alternatives": [{"effect": name, "probability": p} for name, p in cause.alternatives],
                }
                for cause in self.causes
            ],
            "minor": [{"effect": name, "probability": p} for name, p in self.minor.items()],
            "sets": [
                {"effects": sorted(names), "probability": p}
                for names, p in self.posterior.believed.items()
                if p >= _LISTED
            ],
            "unknown": {
                "probability": self.posterior.best.discrepancy.posterior.material,
                "depends_on": list(self.unexplained.depends_on),
                "amplitude": self.posterior.best.weighed.share,
            },
            "by_evidence": dict(self.posterior.names()),
        }


@without_blas_threads
def diagnose(
    log: LogLike,
    base: ServoModel | None = None,
    holdout: LogLike | None = None,
    *,
    fixed: Fixed = (),
    bounds: Pairs | None = None,
    prior: Pairs | None = None,
    candidates: Sequence[Choice] | None = None,
    exclude: Collection[str] = (),
    force: bool = False,
    progress: Callable[[str], None] | None = None,
) -> SetDiagnosis:
    """Find out what a model misses in a log; arguments as in `diagnosis.diagnose`."""
    log, effects = log_of(log).usable(force=force), chosen(candidates, exclude)
    start = base_model(log) if base is None else base
    known = known_of(fixed, bounds, prior, start, effects.values(), stated=base is not None)
    log, _, _ = parts(log, None if holdout is None else log_of(holdout).usable(force=force))
    null = fit_with_prior(log, start, known, progress)
    if (still := standstill(null)) is not None:
        raise Unidentifiable(still)
    if null.failed is not None:
        raise Unidentifiable(f"The fit of the base model failed: {null.failed}")
    posterior = Posterior.over(explore(null, effects, progress).known.values())
    best = posterior.best
    beside = best.discrepancy.posterior
    told = {
        name: posterior.told(name) for name, p in posterior.names().items() if max(p, posterior.told(name)) > _LIKELY
    }
    found = {name: p for name, p in told.items() if p > _LIKELY}
    explained = best.discrepancy.explained_by()
    depends_on = tuple(v for v, share in explained.items() if share >= _CARRIES * max(explained.values()))
    missing = residual_torque(best.fit)  # that an observer has to follow
    unnamed = beside.material > _MATERIAL or missing.excess > _NOISE
    depends_on = depends_on or tuple(curve.variable for curve in missing.curves if curve.share > _TELLING)
    causes = tuple(
        Cause(
            effect=name,
            probability=found[name],
            alternatives=_rivals(posterior, name),
            parameters=estimates(best.fit, name),
            gain=0.0,
            evidence=0.0,
        )
        for name in found
    )
    return SetDiagnosis(
        verdict=_verdict(posterior, causes, unnamed),
        causes=causes,
        minor={name: p for name, p in told.items() if name not in found},
        unexplained=Unexplained(share=0.0, depends_on=depends_on if unnamed else ()),
        posterior=posterior,
        base=null,
        extended=best.fit,
    )


def _verdict(posterior: Posterior, causes: Sequence[Cause], unnamed: bool) -> Verdict:
    if causes:
        return "named" if all(cause.probability > _SURE for cause in causes) else "ambiguous"
    if unnamed:
        return "unknown"
    nothing = posterior.believed.get(frozenset(), 0.0)
    return "nothing_missing" if nothing > 1.0 - _SURE or posterior.names() == {} else "ambiguous"


def _rivals(posterior: Posterior, name: str) -> tuple[tuple[str, float], ...]:
    """Names that the sets without it have in its place, with the probability of those sets."""
    found: dict[str, float] = {}
    for names, p in posterior.believed.items():
        if name not in names:
            for other in names - posterior.best.names:
                found[other] = found.get(other, 0.0) + p
    return tuple(sorted(((n, p) for n, p in found.items() if p >= _MENTION), key=lambda item: -item[1]))
