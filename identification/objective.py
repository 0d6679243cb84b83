"""The least-squares objective on a log: what may move, and the sum of squares with its slopes at any point."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from identification.least_squares import NormalEquations
from identification.log import Log
from identification.predictor import Predictor, steps_in_a_sample
from identification.prior import Prior, prior
from identification.prior_knowledge import PriorKnowledge
from identification.sums_over_runs import normal_equations
from plant.effects.effect import Array
from plant.effects.nonparametric_curve import Nonparametric
from plant.errors import BadParameter
from plant.servo import ServoModel

_MOST = 100.0  # log of the factor by which a cost may rise, beyond which it would overflow


def same_unit(log: Log, model: ServoModel) -> None:
    """Raise `BadParameter` where a model counts the torque in another unit than a log."""
    if model.torque_unit != log.torque_unit:
        usual = "N" if model.axis == "linear" else "N m"
        raise BadParameter(
            f"The model is in {model.torque_unit or usual}, the log's command in {log.command_unit}, and the factor "
            "between them is unknown; use a model that was identified from a log of the same command."
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Objective:
    """A log, a model's structure and what may move.

    Attributes:
        log: to be explained.
        model: the structure; its numbers are those of what is fixed, and one start.
        predictor: of the log's runs by the structure.
        lower, upper: (F + 2R,) bounds of a point.
        prior: of what moves before the log is seen, None where nothing is known of it.
        known: what a person said of it.
    """

    log: Log
    model: ServoModel
    predictor: Predictor
    lower: Array
    upper: Array
    prior: Prior | None
    known: PriorKnowledge

    @classmethod
    def of(
        cls, log: Log, model: ServoModel, *, fixed: Collection[str] = (), known: PriorKnowledge | None = None
    ) -> Self:
        """Of a model's parameters all move but the fixed ones; gravity is zero where no angle is known or has a part.

        The shape of what has no name is fixed, and what of the model it could be.

        A model in N m is a mere start where the log's torque is counted in another unit; the fit is in that of the log.

        Args:
            log: to be explained.
            model: its structure.
            fixed: parameters that keep their value.
            known: what a person knows of any parameters, also of such as the model does not have.
        """
        known = PriorKnowledge() if known is None else known
        model = known.held(model)
        unknown = set(fixed) - set(model.names)
        if unknown:
            raise BadParameter(f"fixed: {min(unknown)!r} is not a parameter; they are {', '.join(model.names)}.")
        if log.axis != model.axis:
            raise BadParameter(f"The log is of a {log.axis} axis, the model of a {model.axis} one.")
        if model.torque_unit is not None:
            same_unit(log, model)
        model = replace(model, torque_unit=log.torque_unit)
        if log.response == "velocity":
            model = replace(model, gravity=0.0)
        grounded = model.axis == "linear" or log.response == "velocity"
        shaped = {
            name for effect in model.effects if isinstance(effect, Nonparametric) for name in effect.shape()
        } - known.fixed.keys()
        kept = {*fixed, *known.fixed, *shaped, *(("gravity",) if grounded else ())}
        free = tuple(place for place, spec in enumerate(model.parameters) if spec.fitted and spec.name not in kept)
        specs = [model.parameters[place] for place in free]
        moving = {spec.name for spec in specs}
        substeps = steps_in_a_sample(model, log)
        first, last = min(run.time[0] for run in log.runs), max(run.time[-1] for run in log.runs)
        limits = [
            _within(spec.bounds(first, last, log.sample_time), known.bounds.get(spec.name, (-np.inf, np.inf)))
            for spec in specs
        ]
        lower, upper = np.array(limits).reshape(-1, 2).T
        unbounded = np.full(2 * len(log.runs), np.inf)
        return cls(
            log=log,
            model=model,
            predictor=Predictor(model=model, runs=log.runs, free=free, substeps=substeps, colour=log.colour),
            lower=np.concatenate((lower, -unbounded)),
            upper=np.concatenate((upper, unbounded)),
            prior=prior(log, model, free, known),
            known=known.keeping([name for name in model.names if name not in moving | shaped], model.names),
        )

    @property
    def free(self) -> tuple[int, ...]:
        """Places of the parameters that move."""
        return self.predictor.free

    @property
    def samples(self) -> int:
        """Number of samples that count."""
        return int(sum(run.valid.sum() for run in self.log.runs))

    def unpack(self, point: Array) -> tuple[Array, Array]:
        """Parameters (P,) and initial states (R, 2) of a point (F + 2R,)."""
        values = self.model.values
        values[list(self.free)] = point[: len(self.free)]
        return values, point[len(self.free) :].reshape(-1, 2)

    def pack(self, values: Array, initial: Array) -> Array:
        """The point (F + 2R,) of parameters (P,) and initial states (R, 2)."""
        return np.concatenate((values[list(self.free)], initial.ravel()))

    def linearise(self, point: Array, bandwidth: float, width: float) -> NormalEquations:
        """The normal equations at a point."""
        values, initial = self.unpack(point)
        pieces = self.predictor.pieces(values, initial, bandwidth=bandwidth, width=width)
        return self.with_prior(normal_equations(pieces, len(self.log.runs)), point)

    def cost(self, point: Array, bandwidth: float, width: float) -> float:
        """Sum of squared innovations at a point, times `loss`; infinite where the prediction overflows."""
        values, initial = self.unpack(point)
        pieces = self.predictor.pieces(values, initial, bandwidth=bandwidth, width=width, sensitivities=False)
        with np.errstate(over="ignore", invalid="ignore"):
            total = float(sum(piece.innovations @ piece.innovations for _, piece in pieces))
        return total * self.loss(point) if np.isfinite(total) else np.inf

    def loss(self, point: Array) -> float:
        """Factor by which a prior raises the cost, so much that the log-likelihood falls as the Gaussian's does."""
        if self.prior is None:
            return 1.0
        return float(np.exp(min(self.prior.distance(point[: len(self.free)]) / self.samples, _MOST)))

    def with_prior(self, found: NormalEquations, point: Array) -> NormalEquations:
        """The same with what was known before."""
        if self.prior is None or not np.isfinite(found.cost):
            return found
        own, weight, loss = slice(len(self.free)), found.cost / self.samples, self.loss(point)
        gradient, information = found.gradient.copy(), found.information.copy()
        gradient[own] += weight * self.prior.pull(point[own])
        information[own, own] += weight * self.prior.precision
        return NormalEquations(cost=loss * found.cost, gradient=loss * gradient, information=loss * information)


def _within(own: tuple[float, float], said: tuple[float, float]) -> tuple[float, float]:
    """The bounds that a person gave, as far as the log can tell such values at all."""
    lower, upper = np.clip(said, *own)
    return (float(lower), float(upper)) if lower < upper else said
