"""Starting values of a fit: J, alpha and K by linear regression of the measured motion on the torque, or vice versa.

All signals pass the same low pass. The model is then linear: J a + alpha cos x + K v = h(tau). Noise in a regressor
biases its coefficient towards zero. So the acceleration is regressed on the torque, if the torque is known exactly, and
the torque on the motion, which is right if the torque was measured in a tight loop. Friction, an offset and a delay
bias both; so each regression is done without and with regressors for them. No cutoff suits every log: several are
tried, from the sample time to the length of the log. The fit selects the best start by its likelihood.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from identification.inverse import FilteredMotion, filtered_motion, lowest_cutoff, mean_torque, smooth
from identification.least_squares import bounded_least_squares
from identification.log import Log
from identification.run import Run
from identification.threads import in_threads
from plant.effects import DeadZone
from plant.effects.effect import Array
from plant.effects.parameter import Axis
from plant.servo import ServoModel

_WIDEST, _APART = 0.2, 3.0  # highest cutoff, of the sampling rate; ratio of successive cutoffs
_FEWEST = 30  # samples that the low pass needs
_BESIDE = (3, 4, 5)  # columns that take up what the base model lacks: friction, an offset, gravity of another zero
_TORQUE, _SLOPE = 6, 7  # columns of the torque and of its slope
_ZONES = (0.0, 0.02, 0.05, 0.1, 0.2, 0.4)  # half widths of a dead zone, of the largest torque
_SAME_TORQUE = 0.02  # of the torque: two starts that differ by less are the same
_BETTER = 1e-6  # of the sum of squares: least improvement for which a wider dead zone is accepted
_ROUNDING = 1e-9  # of a torque: a smaller change is none


def starting_values(log: Log, model: ServoModel) -> list[Array]:
    """Parameter vectors (P,) to start from, with the effects of the model; none if nothing moves.

    A dead zone is not linear, and a fit that starts without one can stay there. So the regression is done for several
    half widths, and the best is used (variable projection).
    """
    runs = tuple(run for run in log.runs if len(run) >= _FEWEST)
    if not runs or log.response == "torque":  # then the problem is linear in all of them
        return []
    log = replace(log, runs=runs)
    found: list[Array] = []
    for values in [v for starts in in_threads(lambda c: _at_cutoff(log, model, c), _cutoffs(log)) for v in starts]:
        if not any(_same_start(log, values, other) for other in found):
            found.append(values)
    return found


@dataclass(frozen=True, kw_only=True)
class TorqueRegression:
    """Least squares of the torque on the measured motion, as robots are identified (Gautier 1997).

    Attributes:
        error: relative error, as `torque_error` has it [-].
        share: of the torque's variance that the motion explains [-].
        inertia, gravity, viscous_friction, coulomb_friction: coefficients of the acceleration, of the angle with any
            zero, of the velocity and of its sign, in the units of `plant.ServoModel`.
        coefficients: (6,) of all regressors.
        cutoff: of the low pass [Hz].
    """

    error: float
    share: float
    inertia: float
    gravity: float
    viscous_friction: float
    coulomb_friction: float
    coefficients: Array
    cutoff: float

    @classmethod
    def of(cls, log: Log, cutoff: float) -> TorqueRegression:
        """Of a log, after the low pass of `torque_error` [Hz]."""
        table, torque = _motion_and_torque(log, cutoff)
        sizes = np.linalg.norm(table, axis=0)
        sizes[sizes == 0.0] = 1.0
        scaled = table / sizes
        positive = (True, False, True, True, False, False)  # inertia and friction
        found = bounded_least_squares(scaled.T @ scaled, scaled.T @ torque, positive) / sizes
        level, varied = float(np.linalg.norm(torque)), float(np.linalg.norm(torque - torque.mean()))
        left = float(np.linalg.norm(torque - table @ found))
        return cls(
            error=left / level if level > 0.0 else 1.0,
            share=1.0 - (left / varied) ** 2 if varied > _ROUNDING * level else 0.0,
            inertia=float(found[0]),
            gravity=float(np.hypot(found[1], found[5])),
            viscous_friction=float(found[2]),
            coulomb_friction=float(found[3]),
            coefficients=found,
            cutoff=cutoff,
        )

    def factor_on(self, log: Log) -> float:
        """Factor of the torque of another log over that of the same motion here; 1 if no factor explains most of it."""
        table, torque = _motion_and_torque(log, self.cutoff)
        expected = table @ self.coefficients
        power = float(torque @ torque), float(expected @ expected)
        along = float(torque @ expected)
        known = min(power) > 0.0 and along > 0.0 and along**2 >= 0.5 * power[0] * power[1]
        return along / power[1] if known else 1.0


def _motion_and_torque(log: Log, cutoff: float) -> tuple[Array, Array]:
    """(T, 6) regressors and (T,) torque of a log, behind a low pass [Hz]."""
    columns, torques = [], []
    for run in log.runs:
        motion = filtered_motion(run, cutoff)
        moved, inner = _moved(log.axis, motion, cutoff), _inner(motion, cutoff)
        columns.append(moved[inner])
        torques.append(_driven(run, None, motion, moved, cutoff)[inner, 0])
    return np.vstack(columns), np.concatenate(torques)


def _cutoffs(log: Log) -> list[float]:
    """Cutoffs of the low pass, from high to low [Hz]."""
    found, lowest = [_WIDEST / log.sample_time], lowest_cutoff(log)
    while found[-1] / _APART > lowest:
        found.append(found[-1] / _APART)
    return found


def _same_start(log: Log, one: Array, other: Array) -> bool:
    """Whether the torques of two starts over a log's motion differ by a small share only."""
    speed = np.concatenate([np.gradient(run.output, run.time) for run in log.runs])
    torque = np.concatenate([run.drive for run in log.runs])
    level = float(np.sqrt(np.mean(torque**2)))
    weights = np.ones(one.size)
    weights[0], weights[2] = level / one[0], np.sqrt(np.mean(speed**2))
    return bool(np.all(weights * np.abs(one - other) <= _SAME_TORQUE * level))


def _solved(products: Array) -> Iterator[tuple[str, float, Array]]:
    """Name of each regression, its relative residual sum of squares, and J, alpha, K (3,), from products of columns."""
    for way, others in (("alone", ()), ("beside", (*_BESIDE, _SLOPE))):
        left, (torque, gravity, viscous, *_) = _regressed(products, 0, (_TORQUE, 1, 2, *others), signs=(1, -1, -1))
        if torque > 0.0:
            yield f"motion {way}", left, np.array([1.0, gravity, viscous]) / torque
        left, rigid = _regressed(products, _TORQUE, (0, 1, 2, *others[: len(_BESIDE)]), signs=(1, 1, 1))
        if rigid[0] > 0.0:
            yield f"torque {way}", left, rigid[:3]


def _regressed(
    products: Array, target: int, columns: tuple[int, ...], signs: tuple[int, int, int]
) -> tuple[float, Array]:
    """Relative residual sum of squares of a column, and the coefficients of the regressors.

    The first three regressors are multiplied by `signs`; the first and third coefficients are not negative.
    """
    sign = np.ones(len(columns))
    sign[:3] = signs
    information = products[np.ix_(columns, columns)] * np.outer(sign, sign)
    pull = products[list(columns), target] * sign
    found = bounded_least_squares(information, pull, (True, False, True, *(False for _ in columns[3:])))
    explained = float(2.0 * found @ pull - found @ information @ found)
    return 1.0 - explained / float(products[target, target]), found


def _at_cutoff(log: Log, model: ServoModel, cutoff: float) -> list[Array]:
    """The starts (P,) at one cutoff, for each regression with the best dead zone."""
    best: dict[str, tuple[float, Array]] = {}
    motions = [filtered_motion(run, cutoff, model) for run in log.runs]
    moved = [_moved(model.axis, motion, cutoff) for motion in motions]
    for half_width in _half_widths(log, model):
        variant = model.with_effect(DeadZone(half_width=half_width)) if model.effect("dead_zone") else model
        driven = [_driven(run, variant, m, by, cutoff) for run, m, by in zip(log.runs, motions, moved, strict=True)]
        table = np.vstack([np.hstack(both)[_inner(m, cutoff)] for *both, m in zip(moved, driven, motions, strict=True)])
        products = table.T @ table
        if not (np.isfinite(products).all() and (np.diag(products)[[0, 2, _TORQUE]] > 0.0).all()):
            continue
        for way, left, rigid in _solved(products):
            if way not in best or left < best[way][0] - _BETTER:
                values = variant.values
                values[:3] = np.maximum(rigid, [spec.lower for spec in model.parameters[:3]])
                best[way] = left, values
    return [values for _, values in best.values()]


def _half_widths(log: Log, model: ServoModel) -> list[float]:
    if model.effect("dead_zone") is None:
        return [0.0]
    largest = max(float(np.max(np.abs(run.command))) for run in log.runs)
    return [share * largest for share in _ZONES]


def _moved(axis: Axis, motion: FilteredMotion, cutoff: float) -> Array:
    """(T, 6) low-passed acceleration, cos x, velocity, sign of the velocity, ones and sin x."""
    dt = float(motion.time[1] - motion.time[0])
    acceleration = np.zeros_like(motion.angle)
    acceleration[1:-1] = np.diff(motion.angle, 2) / dt**2  # mean over the same two samples as the torque
    sign = np.where(motion.still, 0.0, np.sign(motion.velocity))
    turns = axis == "rotary"
    gravity = np.cos(motion.angle) if turns else np.zeros_like(motion.angle)
    quadrature = np.sin(motion.angle) if turns else np.zeros_like(motion.angle)
    signs = smooth(sign, cutoff, dt)
    columns = (acceleration, gravity, motion.velocity, signs, np.ones_like(sign), quadrature)
    return np.column_stack(columns)


def _driven(run: Run, model: ServoModel | None, motion: FilteredMotion, moved: Array, cutoff: float) -> Array:
    """(T, 2) low-passed torque less that of the run's payload, and the derivative of the low-passed torque."""
    payload = np.array([run.own.get("inertia", 0.0), run.own.get("gravity", 0.0)])
    dt = float(motion.time[1] - motion.time[0])
    torque = smooth(mean_torque(run, model, motion.velocity), cutoff, dt)
    return np.column_stack((torque - moved[:, :2] @ payload, np.gradient(torque, dt)))


def _inner(motion: FilteredMotion, cutoff: float) -> slice:
    """A run without its ends, where the low pass is not valid."""
    dt = float(motion.time[1] - motion.time[0])
    edge = max(1, min(motion.time.size // 10, round(1.0 / (cutoff * dt))))
    return slice(edge, -edge)
