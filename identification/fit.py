"""Fit a servo model to a log: maximum likelihood of the one-step prediction errors, output error as its limit."""

from __future__ import annotations

from collections.abc import Callable, Collection

from identification.colour import with_its_colour
from identification.fit_result import Fit
from identification.log import Log
from identification.problem import Problem
from identification.side_by_side import without_blas_threads
from identification.stamps import with_its_clock
from plant.effects import DeadZone
from plant.servo import ServoModel


@without_blas_threads
def fit(
    log: Log,
    model: ServoModel | None = None,
    *,
    fixed: Collection[str] = (),
    progress: Callable[[str], None] | None = None,
) -> Fit:
    """Estimate the parameters of a model from a log.

    Args:
        log: one or more runs; a run's initial state is estimated.
        model: structure and start; by default eqs. (4) and (6) of the paper, J, alpha, K and gamma.
        fixed: names of parameters to keep.
        progress: called with a line of text at each stage.

    Returns:
        The fit; parameters that the data cannot tell are marked, not guessed.

    Raises:
        BadParameter: a name in `fixed` is not a parameter of the model, or the model's axis is not the log's.
    """
    model = base_model(log) if model is None else model
    problem = Problem.of(log, model, fixed=fixed)
    return with_its_colour(with_its_clock(problem.solve(progress=progress)))


def base_model(log: Log) -> ServoModel:
    """Where a fit starts that was told nothing: eqs. (4) and (6), without gravity on a linear axis."""
    effects = (DeadZone(half_width=0.0),)
    friction = 1.0 if log.axis == "linear" else 0.1
    return ServoModel(inertia=1.0, gravity=0.0, viscous_friction=friction, effects=effects, axis=log.axis)
