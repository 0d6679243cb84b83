"""Which effects a log cannot identify on any machine, and what to change in the experiment.

Each question is about the size of one torque along the fitted motion: cos x for gravity, sgn v for dry friction, and so
on. The torque passes through the linearised predictor, the regressors of confounded torques are projected out, and the
rest gives the Cramer-Rao bound of the size, with the noise of the fit. If three standard errors exceed the rms torque
of the log, the log does not identify the size. The reason is given from the measured motion, only if it applies.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from diagnosis.levels import SIGNIFICANT
from diagnosis.linear import response
from diagnosis.measured_motion import MeasuredMotion
from diagnosis.score_test import Screen
from identification.fit_result import Fit
from plant.effects import Motion
from plant.effects.effect import Array

_SLOW = 0.1  # share of the highest speed at which the modelled breakaway torque has fallen to 1/e


@dataclass(frozen=True, kw_only=True)
class _Question:
    """One size that a log may not identify, the torques it is confounded with, and advice for the experiment."""

    about: str
    confounded: tuple[str, ...]
    open: str
    advice: str


_RIGID = ("inertia", "viscous", "gravity", "zone")
_QUESTIONS = (
    _Question(
        about="gravity",
        confounded=("inertia", "viscous", "zone", "offset", "quadrature"),
        open="Gravity is confounded with a torque offset",
        advice="let it turn by more than 90 degrees",
    ),
    _Question(
        about="dry",
        confounded=(*_RIGID, "offset"),
        open="Dry friction is confounded with a torque offset",
        advice="let it move in both directions",
    ),
    _Question(
        about="breakaway",
        confounded=(*_RIGID, "dry"),
        open="Stiction cannot be seen",
        advice="let it stop and break away again",
    ),
    _Question(
        about="zone",
        confounded=("inertia", "viscous", "gravity", "offset"),
        open="The dead zone is confounded with a torque offset",
        advice="let it pass through zero slowly",
    ),
    _Question(
        about="viscous",
        confounded=("inertia", "gravity", "zone", "dry"),
        open="Viscous friction is confounded with dry friction",
        advice="let it move slowly and fast",
    ),
    _Question(
        about="inertia",
        confounded=("viscous", "gravity", "zone", "dry"),
        open="Inertia cannot be seen",
        advice="let it reverse faster",
    ),
)
_NOISE = "its part in this motion is smaller than the noise; record a longer log or a larger motion"


def identifiability_warnings(fit: Fit, extended: Fit | None = None) -> tuple[str, ...]:
    """One sentence with advice for each size that the log of a fit does not identify; empty if there is none.

    A size that the fit of an `extended` model to the same log determines is left out: in the base fit, errors of the
    model count as noise.
    """
    still = standstill(fit)
    if still is not None:
        return (still,)
    screen = Screen.of(fit)
    motion, columns = screen.motion, _columns(screen.motion, fit)
    shown = response(screen.filters, np.column_stack(list(columns.values())), on_measurement=False)
    seen = dict(zip(columns, screen.nuisance.beyond_initial_states(shown).T, strict=True))
    weights = {"inertia": _rms(motion.acceleration), "viscous": _rms(motion.velocity)}
    limit, reasons = _rms(motion.torque) / (SIGNIFICANT * fit.noise_std), _reasons(fit)
    hidden = [
        question
        for question in _QUESTIONS
        if question.about in seen
        and not _is_determined(question, extended or fit)
        and not (question.about == "gravity" and reasons["gravity"] is None)
        and weights.get(question.about, 1.0) * _standard_error(seen, question) > limit
    ]
    return tuple(
        f"{q.open}: {_NOISE if reasons[q.about] is None else f'{reasons[q.about]}; {q.advice}'}." for q in hidden
    )


def standstill(fit: Fit) -> str | None:
    """A sentence with advice if the load does not move: noise alone explains the spread of the measurement. Else None.

    The noise is the smaller of that of the fit and that from second differences; errors of a model are not noise.
    """
    if fit.log.response == "torque":  # samples at rest are masked
        return None
    seen = [run.measured[run.valid] for run in fit.log.runs]
    spread = _rms(np.concatenate([each - each.mean() for each in seen]))
    second_difference = _rms(np.concatenate([np.diff(each, 2) for each in seen])) / np.sqrt(6.0)
    resolution = 1e-9 * max(float(np.max(np.abs(each))) for each in seen)
    if spread > max(2.0 * min(fit.noise_std, second_difference), resolution):
        return None
    what = {"N m": "torque", "N": "force"}.get(fit.log.command_unit, "command")
    highest = max(float(np.nanmax(np.abs(run.drive))) for run in fit.log.runs)
    return (
        f"The load does not move: a {what} of at most {highest:.3g} {fit.log.command_unit} stays within the "
        "dead zone or the dry friction; raise it until the load moves."
    )


def _columns(motion: Motion, fit: Fit) -> dict[str, Array]:
    """(T,) torque on the load per unit of each size [N m/unit]."""
    fastest = max(float(np.quantile(np.abs(motion.velocity), 0.99)), 1e-300)
    columns = {
        "inertia": -motion.acceleration,
        "viscous": -motion.velocity,
        "dry": -motion.sign,
        "breakaway": -motion.sign * np.exp(-((motion.velocity / (_SLOW * fastest)) ** 2)),
        "offset": np.ones_like(motion.angle),
    }
    zone = fit.model.effect("dead_zone")
    if zone is not None:
        columns["zone"] = -np.sign(motion.torque) * (np.abs(motion.torque) > zone.values[0])
    if fit.model.axis == "rotary" and fit.log.response != "velocity":
        columns |= {"gravity": -np.cos(motion.angle), "quadrature": -np.sin(motion.angle)}
    return columns


def _standard_error(seen: dict[str, Array], question: _Question) -> float:
    """Standard error of a size beyond its confounded torques, in its unit, for noise of unit size."""
    own = seen[question.about]
    others = np.column_stack([seen[name] for name in question.confounded if name in seen])
    others = others / np.maximum(np.linalg.norm(others, axis=0), 1e-300)
    beyond = own - others @ np.linalg.lstsq(others, own, rcond=1e-10)[0]
    return 1.0 / max(float(np.linalg.norm(beyond)), 1e-12 * float(np.linalg.norm(own)), 1e-300)


def _is_determined(question: _Question, fit: Fit) -> bool:
    """Whether a fit determines a size; viscous friction only if the model has an effect beyond the dead zone."""
    if question.about == "viscous" and {effect.name for effect in fit.model.effects} <= {"dead_zone"}:
        return False
    name = {"inertia": "inertia", "viscous": "viscous_friction"}.get(question.about)
    if name is None:
        return False
    lines = [p for p in fit.parameters if p.name.split("[")[0] == name]  # one per run if it differs between runs
    return all(p.value is not None and p.std is not None and abs(p.value) > SIGNIFICANT * p.std for p in lines)


def _reasons(fit: Fit) -> dict[str, str | None]:
    """For each size, what the measured motion lacks to identify it; None if nothing."""
    moved = MeasuredMotion.of(fit.log)
    return {
        "gravity": moved.gravity(),
        "dry": moved.dry(),
        "breakaway": moved.breakaway("rad/s" if fit.model.axis == "rotary" else "m/s"),
        "zone": moved.zone(),
        "viscous": moved.viscous(),
        "inertia": moved.inertia(),
    }


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
