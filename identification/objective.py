"""The least-squares objective on a log: the free parameters, and the sum of squares with its gradient at any point."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from identification.inverse_predictor import InversePredictor
from identification.least_squares import Minimum, NormalEquations, minimise
from identification.log import Log
from identification.predictor import Prediction, Predictor, steps_in_a_sample
from identification.prior import Prior, prior
from identification.prior_knowledge import PriorKnowledge
from identification.sums_over_runs import normal_equations
from plant.effects.effect import Array
from plant.effects.nonparametric_curve import Nonparametric
from plant.errors import BadParameter
from plant.servo import ServoModel

_MOST = 100.0  # largest log of the factor by which a prior raises the cost: no overflow


def same_unit(log: Log, model: ServoModel) -> None:
    """Raise `BadParameter` if model and log have different units of torque."""
    if model.torque_unit != log.torque_unit:
        usual = "N" if model.axis == "linear" else "N m"
        raise BadParameter(
            f"The model is in {model.torque_unit or usual}, the log's command in {log.command_unit}, and the factor "
            "between them is unknown; use a model that was identified from a log of the same command."
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Objective:
    """A log, a model structure and its free parameters.

    Attributes:
        log: to be explained.
        model: the structure; its values are those of the fixed parameters and one starting point.
        predictor: predicts the log's runs with the structure.
        lower, upper: (F + R I,) bounds of a point.
        prior: of the free parameters, None without prior knowledge.
        known: the user's prior knowledge.
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
        """The objective in which all parameters of a model are free except the fixed ones.

        Gravity is not fitted on a linear axis; if only the velocity is measured, it is zero and not fitted. For a
        non-parametric effect its range and the parameters of the model that it absorbs are not fitted.

        A model in N m only gives the starting values if the torque of the log has another unit; the fit has that unit.

        Args:
            log: to be explained.
            model: its structure.
            fixed: parameters that keep their value.
            known: the user's knowledge of any parameters, also of some that the model does not have.
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
        kind = InversePredictor if log.response == "torque" else Predictor
        predictor = kind(
            model=model, runs=log.runs, free=free, substeps=substeps, colour=log.colour, unsettled=log.unsettled
        )
        unbounded = np.full(len(predictor.fitted_starts) * len(log.runs), np.inf)
        return cls(
            log=log,
            model=model,
            predictor=predictor,
            lower=np.concatenate((lower, -unbounded)),
            upper=np.concatenate((upper, unbounded)),
            prior=prior(log, model, free, known),
            known=known.keeping([name for name in model.names if name not in moving | shaped], model.names),
        )

    @property
    def free(self) -> tuple[int, ...]:
        """Indices of the free parameters."""
        return self.predictor.free

    @property
    def samples(self) -> int:
        """Number of valid samples."""
        return int(sum(run.valid.sum() for run in self.log.runs))

    def unpack(self, point: Array) -> tuple[Array, Array]:
        """Parameters (P,) and initial states (R, 2), hidden states settled, or (R, n) of a point (F + R I,)."""
        values, starts = self.model.values, self.predictor.fitted_starts
        values[list(self.free)] = point[: len(self.free)]
        initial = np.zeros((len(self.log.runs), len(self.model.states) if len(starts) > 2 else 2))
        initial[:, starts] = point[len(self.free) :].reshape(len(self.log.runs), -1)
        return values, initial

    def pack(self, values: Array, initial: Array) -> Array:
        """The point (F + R I,) of parameters (P,) and initial states (R, 2), hidden states settled, or (R, n)."""
        begun = np.zeros((len(initial), len(self.model.states)))
        begun[:, : initial.shape[1]] = initial
        return np.concatenate((values[list(self.free)], begun[:, self.predictor.fitted_starts].ravel()))

    def linearise(self, point: Array, bandwidth: float, width: float, most: float = np.inf) -> NormalEquations:
        """The normal equations at a point; with an infinite cost alone if the cost is not less than `most`.

        The sensitivities take three quarters of the time, so a step that is rejected costs only a quarter.
        """
        values, initial = self.unpack(point)
        followed: Iterable[tuple[int, Prediction]] = self.predictor.pieces(
            values, initial, bandwidth=bandwidth, width=width, sensitivities=False
        )
        if np.isfinite(most):
            kept = _if_below(followed, most / self.loss(point))
            if kept is None:
                return NormalEquations.overflowed()
            followed = kept
        pieces = self.predictor.with_sensitivities(followed, values, initial, bandwidth=bandwidth, width=width)
        return self.with_prior(normal_equations(pieces, len(self.log.runs)), point)

    def minimise(
        self,
        start: Array,
        bandwidth: float,
        width: float,
        iterations: int = 30,
        at_start: NormalEquations | None = None,
        tolerance: float = 0.01,
    ) -> Minimum:
        """The best point at a bandwidth and a width; arguments as in `least_squares.minimise`."""
        return minimise(
            lambda point, most: self.linearise(point, bandwidth, width, most),
            start,
            self.lower,
            self.upper,
            samples=self.samples,
            iterations=iterations,
            at_start=at_start,
            tolerance=tolerance,
        )

    def cost(self, point: Array, bandwidth: float, width: float) -> float:
        """Sum of squared innovations at a point, times `loss`; infinite where the prediction overflows."""
        values, initial = self.unpack(point)
        pieces = self.predictor.pieces(values, initial, bandwidth=bandwidth, width=width, sensitivities=False)
        with np.errstate(over="ignore", invalid="ignore"):
            total = float(sum(piece.innovations @ piece.innovations for _, piece in pieces))
        return total * self.loss(point) if np.isfinite(total) else np.inf

    def loss(self, point: Array) -> float:
        """Factor by which the prior raises the cost: it lowers the log-likelihood by half of `Prior.distance`."""
        if self.prior is None:
            return 1.0
        return float(np.exp(min(self.prior.distance(point[: len(self.free)]) / self.samples, _MOST)))

    def with_prior(self, found: NormalEquations, point: Array) -> NormalEquations:
        """The normal equations with the prior added."""
        if self.prior is None or not np.isfinite(found.cost):
            return found
        own, weight, loss = slice(len(self.free)), found.cost / self.samples, self.loss(point)
        gradient, information = found.gradient.copy(), found.information.copy()
        gradient[own] += weight * self.prior.pull(point[own])
        information[own, own] += weight * self.prior.precision
        return NormalEquations(cost=loss * found.cost, gradient=loss * gradient, information=loss * information)


def _if_below(pieces: Iterable[tuple[int, Prediction]], most: float) -> list[tuple[int, Prediction]] | None:
    """The pieces, if the sum of their squared innovations is less than `most`; None as soon as it is not."""
    cost, kept = 0.0, list[tuple[int, Prediction]]()
    for run, piece in pieces:
        with np.errstate(over="ignore", invalid="ignore"):
            cost += float(piece.innovations @ piece.innovations)
        if not cost < most:
            return None
        kept.append((run, piece))
    return kept


def _within(own: tuple[float, float], given: tuple[float, float]) -> tuple[float, float]:
    """The user's bounds `given`, clipped to the parameter's bounds `own` on the log; unchanged if nothing is left."""
    lower, upper = np.clip(given, *own)
    return (float(lower), float(upper)) if lower < upper else given
