"""Fit a servo model to a log: maximum likelihood of the one-step prediction errors, with output error as the limit."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from identification.between_run_differences import between_run_differences
from identification.coloured_noise import with_coloured_noise
from identification.fit_result import Fit
from identification.inverse_log import inverse_log
from identification.log import Log
from identification.log_like import LogLike, log_of
from identification.per_run import fit_apart
from identification.predictor import steps_in_a_sample
from identification.prior_knowledge import Fixed, Pairs, PriorKnowledge
from identification.problem import Problem
from identification.threads import without_blas_threads
from identification.time_stamp_jitter import with_its_clock
from plant.effects import DeadZone, Effect
from plant.effects.effect import parameters_of
from plant.errors import BadParameter
from plant.model_file import ModelLike, model_of
from plant.servo import ServoModel

_ROUNDING = 1e-12  # of an angle: a smaller change is rounding, not motion


@without_blas_threads
def fit(
    log: LogLike,
    model: ModelLike | None = None,
    *,
    fixed: Fixed = (),
    bounds: Pairs | None = None,
    prior: Pairs | None = None,
    per_run: Sequence[str] = (),
    inverse: bool = False,
    force: bool = False,
    progress: Callable[[str], None] | None = None,
) -> Fit:
    """Estimate the parameters of a model from a log.

    Args:
        log: one or more runs, also as a path, a DataFrame or arrays by name; a run's initial state is estimated. If
            runs disagree about a parameter, the log of the result has a warning.
        model: structure and starting values, also as the path of a model.json; by default eqs. (4) and (6) of the
            paper: J, alpha, K and gamma.
        fixed: names of parameters that keep the model's value, or values by name: `{"inertia": 0.2}`.
        bounds: least and greatest value by name: `{"inertia": (0.1, 0.3)}`.
        prior: mean and standard deviation by name, of a Gaussian: `{"inertia": (0.2, 0.05)}`.
        per_run: names of parameters that differ from run to run; the others are common to all runs. The result has a
            line for each run, such as "inertia[log.csv run 3]", and its model has the mean.
        inverse: predict the torque from the motion, as for a robot joint in a tight loop (`inverse_log`); without
            effects of actuator, flexible drivetrain and sensor.
        force: fit also a log that is unusable (`Log.faults`).
        progress: called with a line of text at each stage.

    Returns:
        The fit. A parameter that the data do not determine has the value None. `failed` gives the reason if the fit
        cannot be used.

    Raises:
        UnusableLog: the log has faults, so that no model can be fitted.
        Unidentifiable: as `inverse_log` does.
        BadParameter: a name is not a parameter of the model, a number is not allowed for it, or model and log differ
            in their axis.
    """
    log = log_of(log).usable(force=force)
    log = inverse_log(log) if inverse else log
    start = base_model(log) if model is None else model_of(model)
    start = start.on_the_load() if inverse else start
    known = known_of(fixed, bounds, prior, start, stated=model is not None)
    _check(Problem.of(log, known.begun(start), known=known), per_run, known.fixed)
    found = fit_with_prior(log, start, known, progress)
    if found.converged:
        found = _polished(found)
    if per_run and len(log.runs) > 1:
        return fit_apart(found, tuple(dict.fromkeys(per_run)))
    differences = between_run_differences(found)
    return (
        found
        if differences is None
        else replace(found, log=replace(found.log, warnings=(*found.log.warnings, differences)))
    )


def _polished(fit: Fit) -> Fit:
    """The fit refined to the exact maximum of its likelihood, so that the result is the same in any units."""
    kept = [p.name for p in fit.parameters if p.fixed]
    best = Problem.of(fit.log, fit.model, fixed=kept, known=fit.known).polished(fit)
    lines = zip(best.parameters, fit.parameters, strict=True)
    return replace(best, parameters=tuple(replace(p, start=was.start, value=was.value and p.value) for p, was in lines))


def _check(problem: Problem, per_run: Sequence[str], fixed: Collection[str]) -> None:
    moving = [problem.model.names[place] for place in problem.free]
    if isinstance(per_run, str):
        raise BadParameter(f"per_run is one text; give a list, as in [{per_run!r}].")
    for name in per_run:
        if name not in moving:
            why = "is fixed" if name in fixed else "is no parameter that is fitted"
            raise BadParameter(f"per_run: {name!r} {why}; they are {', '.join(moving)}.")


def fit_with_prior(
    log: Log,
    model: ServoModel,
    known: PriorKnowledge,
    progress: Callable[[str], None] | None = None,
    *,
    of_the_sensor: bool = False,
) -> Fit:
    """`fit` with `PriorKnowledge`, also of parameters that the model does not have.

    With `of_the_sensor` only coloured noise of the sensor is accepted, see `with_coloured_noise`.
    """
    start = known.begun(model)
    found, traded = _beside_traded(log, start, known, progress, of_the_sensor=of_the_sensor)
    begun = [replace(line, start=float(value)) for line, value in zip(found.parameters, start.values, strict=True)]
    return replace(found, parameters=tuple(replace(p, value=None) if p.name in traded else p for p in begun))


def _beside_traded(
    log: Log,
    model: ServoModel,
    known: PriorKnowledge,
    progress: Callable[[str], None] | None,
    *,
    of_the_sensor: bool,
) -> tuple[Fit, tuple[str, ...]]:
    """The fit with its clock and noise colour, and the parameters that were fixed because they are confounded."""
    kept: tuple[str, ...] = ()
    while True:
        found = Problem.of(log, model, fixed=kept, known=known).solve(progress=progress)
        if found.converged and steps_in_a_sample(found.model, log) > found.substeps:  # it needs smaller steps
            found = Problem.of(log, found.model, fixed=kept, known=known).solve(progress=progress)
        traded = _traded(found)
        if not traded and log.response != "torque":
            found = with_coloured_noise(with_its_clock(found), of_the_sensor=of_the_sensor)
            traded = _traded(found)
        if not traded:
            return found, kept
        kept += traded


def _traded(found: Fit) -> tuple[str, ...]:
    """Unidentifiable parameters of effects, confounded with the rigid body: they are fixed, so that it is identifiable.

    If the torque has only one level, a dead zone has the same effect as larger values of all rigid-body parameters.
    """
    rigid = {spec.name for spec in parameters_of(type(found.model))}
    lost = set(found.unidentifiable) - set(found.fixed)
    effects = tuple(name for name in found.unidentifiable if name in lost - rigid)
    return effects if lost & rigid else ()


def known_of(
    fixed: Fixed,
    bounds: Pairs | None,
    prior: Pairs | None,
    start: ServoModel,
    effects: Iterable[type[Effect]] = (),
    *,
    stated: bool,
) -> PriorKnowledge:
    """Prior knowledge of the parameters of a model, and of effects that may be added to it.

    Args:
        fixed, bounds, prior: as in `fit`.
        start: the model.
        effects: the effects.
        stated: whether the user gave the model; the starting values of the default model cannot be kept as fixed.

    Raises:
        BadParameter: as `fit` does.
    """
    more = [start.parameters_with(kind) for kind in effects if start.effect(kind.name) is None]
    known = PriorKnowledge.of(fixed, bounds, prior, (*start.parameters, *chain.from_iterable(more)))
    own = {} if stated else dict(zip(start.names, start.values, strict=True))
    for name, value in known.fixed.items():
        if value is None and (name not in start.names or own.get(name, 0.0) != 0.0):
            raise BadParameter(
                f"fixed: {name} has no value to keep; give one, as in {name}=0.2, or a model that has it."
            )
    return known


def base_model(log: Log) -> ServoModel:
    """The default start of a fit: eqs. (4) and (6), with zero gravity.

    Viscous friction and inertia each take half of the rms torque of the log at its rms motion.
    """
    torque, angle, speed = (
        float(np.sqrt(np.mean(np.concatenate(values) ** 2)))
        for values in (
            [run.drive for run in log.runs],
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
        effects=() if log.response == "torque" else (DeadZone(half_width=0.0),),
        axis=log.axis,
    )
