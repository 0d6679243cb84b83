"""Fit a servo model to a log: maximum likelihood of the one-step prediction errors, output error as its limit."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace

import numpy as np

from identification.colour import with_its_colour
from identification.fit_result import Fit
from identification.log import Log
from identification.problem import Problem
from identification.side_by_side import without_blas_threads
from identification.stamps import with_its_clock
from plant.effects import DeadZone
from plant.effects.effect import parameters_of
from plant.servo import ServoModel

_ROUNDING = 1e-12  # of an angle, that is no motion


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
        The fit; parameters that the data cannot tell are marked, not guessed. One that did not come to an end, or that
        moved nothing, says so in `failed`.

    Raises:
        BadParameter: a name in `fixed` is not a parameter of the model, or the model's axis is not the log's.
    """
    model = base_model(log) if model is None else model
    found, traded = _beside_traded(log, model, tuple(fixed), progress)
    if found.converged:
        found = Problem.of(found.log, found.model, fixed=found.fixed).polished(found)
    begun = [replace(line, start=float(start)) for line, start in zip(found.parameters, model.values, strict=True)]
    return replace(found, parameters=tuple(replace(p, value=None) if p.name in traded else p for p in begun))


def _beside_traded(
    log: Log, model: ServoModel, fixed: tuple[str, ...], progress: Callable[[str], None] | None
) -> tuple[Fit, tuple[str, ...]]:
    """The fit with its clock and colour, and the parameters that it kept because they traded places with others."""
    kept: tuple[str, ...] = ()
    while True:
        found = Problem.of(log, model, fixed=(*fixed, *kept)).solve(progress=progress)
        traded = _traded(found)
        if not traded:
            found = with_its_colour(with_its_clock(found))
            traded = _traded(found)
        if not traded:
            return found, kept
        kept += traded


def _traded(found: Fit) -> tuple[str, ...]:
    """Parameters of effects that a log cannot tell from the rigid body: they are kept, so that it can be told.

    Where the torque has one level only, a dead zone is worth the same as more of everything else.
    """
    rigid = {spec.name for spec in parameters_of(type(found.model))}
    lost = set(found.unidentifiable) - set(found.fixed)
    effects = tuple(name for name in found.unidentifiable if name in lost - rigid)
    return effects if lost & rigid else ()


def base_model(log: Log) -> ServoModel:
    """Where a fit starts that was told nothing: eqs. (4) and (6), without gravity on a linear axis.

    Inertia and friction are of the size that half the torque of the log would move as it moved.
    """
    torque, angle, speed = (
        float(np.sqrt(np.mean(np.concatenate(values) ** 2)))
        for values in (
            [run.command - run.servo_gain * run.output for run in log.runs],
            [run.output - run.output.mean() for run in log.runs],
            [np.gradient(run.output, run.time) for run in log.runs],
        )
    )
    moves = torque > 0.0 and angle > _ROUNDING * max(float(np.max(np.abs(run.output))) for run in log.runs)
    viscous = 0.5 * torque / speed if moves else 1.0
    return ServoModel(
        inertia=viscous * angle / speed if moves else 1.0,
        gravity=0.0,
        viscous_friction=viscous,
        effects=(DeadZone(half_width=0.0),),
        axis=log.axis,
    )
