"""Fit a servo model to a log: maximum likelihood of the one-step prediction errors, output error as its limit."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

from identification.colour import with_its_colour
from identification.disagreement import disagreement
from identification.fit_result import Fit
from identification.log import Log
from identification.per_run import fit_apart
from identification.problem import Problem
from identification.side_by_side import without_blas_threads
from identification.stamps import with_its_clock
from plant.effects import DeadZone
from plant.errors import BadParameter
from plant.servo import ServoModel


@without_blas_threads
def fit(
    log: Log,
    model: ServoModel | None = None,
    *,
    fixed: Collection[str] = (),
    per_run: Sequence[str] = (),
    progress: Callable[[str], None] | None = None,
) -> Fit:
    """Estimate the parameters of a model from a log.

    Args:
        log: one or more runs; a run's initial state is estimated. Where runs disagree about a parameter, the log of the
            result has a warning that says so.
        model: structure and start; by default eqs. (4) and (6) of the paper, J, alpha, K and gamma.
        fixed: names of parameters to keep.
        per_run: names of parameters that have a value of their own in each run; the others are fitted to all of them.
            The result has a line for each run, such as "inertia[log.csv run 3]", and in its model the mean.
        progress: called with a line of text at each stage.

    Returns:
        The fit; parameters that the data cannot tell are marked, not guessed.

    Raises:
        BadParameter: a name is not a parameter of the model, or the model's axis is not the log's.
    """
    model = base_model(log) if model is None else model
    problem = Problem.of(log, model, fixed=fixed)
    _check(problem, per_run, fixed)
    if per_run and len(log.runs) > 1:
        return fit_apart(problem.solve(progress=progress), tuple(dict.fromkeys(per_run)))
    found = with_its_colour(with_its_clock(problem.solve(progress=progress)))
    said = disagreement(found)
    return found if said is None else replace(found, log=replace(found.log, warnings=(*found.log.warnings, said)))


def _check(problem: Problem, per_run: Sequence[str], fixed: Collection[str]) -> None:
    moving = [problem.model.names[place] for place in problem.free]
    for name in per_run:
        if name not in moving:
            why = "is fixed" if name in fixed else "is no parameter that is fitted"
            raise BadParameter(f"per_run: {name!r} {why}; they are {', '.join(moving)}.")


def base_model(log: Log) -> ServoModel:
    """Where a fit starts that was told nothing: eqs. (4) and (6), without gravity on a linear axis."""
    effects = (DeadZone(half_width=0.0),)
    friction = 1.0 if log.axis == "linear" else 0.1
    return ServoModel(inertia=1.0, gravity=0.0, viscous_friction=friction, effects=effects, axis=log.axis)
