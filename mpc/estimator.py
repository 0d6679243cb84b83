"""What the controller believes: the state of the servo and a slowly changing torque that the model does not know."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from mpc.kernel import Kernel
from mpc.prediction import Predictor
from mpc.trouble import Trouble, sentence
from plant.effects import State
from plant.errors import BadParameter
from plant.servo import ServoModel

Array = NDArray[np.float64]

_OUTLIER = 10.0
"""Innovations beyond so many standard deviations are not believed at once."""

_PATIENCE = 3
"""After so many of them in a row it is the estimate that is not believed."""

_ITERATIONS = 20
"""In search of the angle at which the sensor shows a reading; each one divides the error by ten and more."""

_LARGEST = float(np.finfo(np.float64).max)


@dataclass(eq=False, kw_only=True)
class Estimator:
    """Extended Kalman filter on the servo model with a disturbing torque d as a further state.

        z[k+1] = step(z[k], tau[k] + d[k], tau[k-1] + d[k]) + w,    d[k+1] = d[k] + v,    y[k] = reading(z[k]) + e

    The disturbance is what removes the steady error under a torque that the model does not have (offset-free control,
    Pannocchia and Rawlings 2003). The sensor's steps count as noise of variance resolution^2/12.

    Attributes:
        predictor: the sampled model.
        resolution: step of the sensor [rad].
        noise: standard deviation of the sensor beside its steps [rad].
        torque_noise: standard deviation of what the model misses from sample to sample [N m].
        disturbance_rate: how fast the disturbance may wander [N m/sqrt(s)].
        belief: all that is remembered: whether there is an estimate, wild readings in a row, d, state (n,), and the
            upper triangle of the covariance of state and d, column by column.
        levels: variance of the sensor, torque_noise, disturbance_rate.
    """

    predictor: Predictor
    resolution: float
    noise: float
    torque_noise: float
    disturbance_rate: float
    belief: Array = field(init=False, repr=False)
    levels: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Check the noise levels."""
        for name in ("resolution", "noise", "torque_noise", "disturbance_rate"):
            value = getattr(self, name)
            if not np.isfinite(value) or value < 0:
                raise BadParameter(f"{name} must be finite and not negative, not {value!r}.")
        variance = self.resolution**2 / 12.0 + self.noise**2
        if variance == 0.0:
            raise BadParameter("The sensor needs a resolution or a noise above zero: no filter can trust it fully.")
        self.levels = np.array([variance, self.torque_noise, self.disturbance_rate])
        self.belief = np.zeros(_belief(len(self.predictor.model.states)).shape[0])

    @property
    def state(self) -> Array | None:
        """(n,) state; None before the first reading."""
        n = len(self.predictor.model.states)
        return self.belief[3 : 3 + n].copy() if self.belief[0] else None

    @state.setter
    def state(self, state: Array | None) -> None:
        self.belief[0] = state is not None
        if state is not None:
            self.belief[3 : 3 + state.size] = state

    @property
    def disturbance(self) -> float:
        """Estimate of d [N m]."""
        return float(self.belief[2])

    @disturbance.setter
    def disturbance(self, torque: float) -> None:
        self.belief[2] = torque

    def start(self, reading: float, torque: float) -> None:
        """Begin anew at rest at a reading [rad], with actuators settled at a torque [N m] and no disturbance."""
        begin = self._begin
        begin.inputs[0][0], begin.inputs[1][0] = reading, torque
        begin()
        self.belief[:] = begin.outputs[0]

    def advance(self, reading: float, torque: float, previous_torque: float) -> str:
        """One sample on: the torque that acted since [N m] and the one before it, then the new reading [rad].

        Returns:
            An empty string, or what went wrong.
        """
        return sentence(self.update(reading, torque, previous_torque))

    def update(self, reading: float, torque: float, previous_torque: float) -> int:
        """As `advance`, but what went wrong as a number, see `Trouble`."""
        estimate = self._estimate
        estimate.inputs[1][0] = reading
        estimate.inputs[2][:] = torque, previous_torque
        belief, trouble, anew = estimate()
        self.belief[:] = belief
        if anew[0]:
            self.start(reading, torque)
        return int(trouble[0])

    @cached_property
    def _begin(self) -> Kernel:
        return Kernel(beginning(self.predictor), {2: self.predictor.parameters, 3: self.levels})

    @cached_property
    def _estimate(self) -> Kernel:
        return Kernel(estimation(self.predictor), {0: self.belief, 3: self.predictor.parameters, 4: self.levels})


def _belief(n: int) -> Any:
    return ca.SX.sym("belief", 3 + n + (n + 1) * (n + 2) // 2)


def _triangle(n: int) -> Any:
    return ca.Sparsity.upper(n)


def estimation(predictor: Predictor) -> Any:
    """One sample of the filter, as a `casadi.Function`.

    (belief, reading, torques (2,) since the last sample and before, parameters, levels) -> belief, trouble (see
    `Trouble`), and whether to begin anew.
    """
    model = predictor.model
    n, p = len(model.states), ca.SX.sym("parameters", predictor.parameters.size)
    belief, reading, torques = _belief(n), ca.SX.sym("reading"), ca.SX.sym("torques", 2)
    levels = ca.SX.sym("levels", 3)
    known, doubts, d, z = belief[0], belief[1], belief[2], belief[3 : 3 + n]
    variance, torque_noise, wander = ca.vertsplit(levels)
    covariance = ca.triu2symm(ca.SX(_triangle(n + 1), belief[3 + n :]))

    # Predict.
    ahead, by_state, by_torque = predictor.stage(z, torques + d, p)
    F = ca.vertcat(ca.horzcat(by_state, ca.sum2(by_torque)), ca.horzcat(ca.SX(1, n), 1))
    dt, kick = p[-2], p[-2] / p[0] * torque_noise
    added = ca.vertcat((kick * dt / 2) ** 2, kick**2, ca.SX(n - 2, 1), wander**2 * dt)
    spread = ca.mtimes(ca.mtimes(F, covariance), F.T) + ca.diag(added)
    shown, slope = predictor.sensor(ahead, p)
    row = ca.vertcat(slope, 0)
    expected = ca.mtimes(row.T, ca.mtimes(spread, row)) + variance
    innovation = reading - shown

    # Correct: the covariance in Joseph's form, which stays symmetric and positive.
    gain = ca.mtimes(spread, row) / expected
    keep = ca.SX.eye(n + 1) - ca.mtimes(gain, row.T)
    sharper = ca.mtimes(ca.mtimes(keep, spread), keep.T) + ca.mtimes(gain, gain.T) * variance

    # What to believe.
    sound, heard = _finite(ca.vertcat(ahead, ca.triu(spread).nz[:])), _finite(reading)
    wild = ca.fabs(innovation) > _OUTLIER * ca.sqrt(expected)
    wilder = doubts + 1
    cases = [
        (ca.logic_and(ca.logic_not(ca.logic_and(known, sound)), ca.logic_not(heard)), Trouble.LOST, False),
        (ca.logic_not(known), Trouble.NONE, True),
        (ca.logic_not(sound), Trouble.DIVERGED, True),
        (ca.logic_not(heard), Trouble.BRIDGED, False),
        (ca.logic_and(wild, wilder >= _PATIENCE), Trouble.STAYED, True),
        (wild, Trouble.JUMPED, False),
    ]
    trouble, anew = ca.SX(Trouble.NONE), ca.SX(0)
    for holds, name, begins in reversed(cases):
        trouble, anew = ca.if_else(holds, int(name), trouble), ca.if_else(holds, int(begins), anew)
    believed = ca.logic_and(heard, ca.logic_not(wild))
    doubts = ca.if_else(heard, ca.if_else(wild, wilder, 0), doubts)
    after = ca.vertcat(d, ahead, ca.triu(spread).nz[:])
    corrected = ca.vertcat(d + gain[n] * innovation, ahead + gain[:n] * innovation, ca.triu(sharper).nz[:])
    there = ca.logic_and(known, sound)
    after = ca.vertcat(there, doubts, ca.if_else(believed, corrected, after))
    inputs = [belief, reading, torques, p, levels]
    return ca.Function("estimate", inputs, [ca.densify(after), trouble, anew], {"cse": True})


def beginning(predictor: Predictor) -> Any:
    """Rest at a reading, as a `casadi.Function`: (reading, torque, parameters, levels) -> belief."""
    model = predictor.model
    n, p = len(model.states), ca.SX.sym("parameters", predictor.parameters.size)
    reading, torque, levels = ca.SX.sym("reading"), ca.SX.sym("torque"), ca.SX.sym("levels", 3)
    state = _at_rest(model.bound(p[:-2]), reading, torque)
    level = levels[1] + levels[2]
    known: dict[State, Any] = {State.ANGLE: ca.sqrt(levels[0]), State.VELOCITY: 1.0}
    spread = ca.vertcat(*(known.get(kind, level) for kind in model.kinds), level)
    covariance = ca.densify(ca.diag(spread**2))
    belief = ca.vertcat(1, 0, 0, state, covariance[_triangle(n + 1)].nz[:])
    return ca.Function("begin", [reading, torque, p, levels], [ca.densify(belief)], {"cse": True})


def _at_rest(model: ServoModel, reading: Any, torque: Any) -> Any:
    """(n,) state at rest in which the sensor has settled at a reading [rad], by fixed-point iteration.

    A sensor that errs by a part of a degree errs by many times its noise: to take its reading for the angle would be
    a contradiction that the filter never overcomes.
    """
    angle = reading
    for _ in range(_ITERATIONS):
        values = {State.ANGLE: angle, State.TORQUE: torque, State.COMMAND: torque}
        state = [values.get(kind, 0.0) for kind in model.kinds]
        shown, place = angle, 2
        for effect in model.effects:
            if State.ANGLE in effect.states and not effect.flexible:
                state[place] = shown
            shown = effect.reading(shown, shown)
            place += len(effect.states)
        if ca.is_equal(ca.SX(shown), ca.SX(angle)):
            break
        angle = angle + (reading - shown)
    return ca.vertcat(*state)


def _finite(values: Any) -> Any:
    """Whether all of (m,) expressions are finite numbers: NaN fails every comparison."""
    return ca.sum1(ca.fabs(values)) <= _LARGEST
