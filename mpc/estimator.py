"""What the controller believes: the state of the servo and a slowly changing torque that the model does not know."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mpc.prediction import Predictor
from plant.effects import State
from plant.errors import BadParameter
from plant.servo import ServoModel
from plant.simulation import beginning

Array = NDArray[np.float64]

_OUTLIER = 10.0
"""Innovations beyond so many standard deviations are not believed at once."""

_PATIENCE = 3
"""After so many of them in a row it is the estimate that is not believed."""

_ITERATIONS = 20
"""In search of the angle at which the sensor shows a reading; each one divides the error by ten and more."""


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
    """

    predictor: Predictor
    resolution: float
    noise: float
    torque_noise: float
    disturbance_rate: float
    state: Array | None = field(default=None, init=False)
    """(n,) state; None before the first reading."""
    disturbance: float = field(default=0.0, init=False)
    """d [N m]."""
    _covariance: Array = field(init=False, repr=False)
    _doubts: int = field(default=0, init=False, repr=False)

    def __post_init__(self) -> None:
        """Check the noise levels."""
        for name in ("resolution", "noise", "torque_noise", "disturbance_rate"):
            value = getattr(self, name)
            if not np.isfinite(value) or value < 0:
                raise BadParameter(f"{name} must be finite and not negative, not {value!r}.")
        if self._sensor_variance == 0.0:
            raise BadParameter("The sensor needs a resolution or a noise above zero: no filter can trust it fully.")

    @property
    def _sensor_variance(self) -> float:
        return self.resolution**2 / 12.0 + self.noise**2

    def start(self, reading: float, torque: float) -> None:
        """Begin anew at rest at a reading [rad], with actuators settled at a torque [N m] and no disturbance."""
        self.state = _at_rest(self.predictor.model, reading, torque)
        self.disturbance = 0.0
        level = self.torque_noise + self.disturbance_rate
        known = {State.ANGLE: np.sqrt(self._sensor_variance), State.VELOCITY: 1.0}
        spread = np.array([*(known.get(kind, level) for kind in self.predictor.model.kinds), level])
        self._covariance = np.diag(spread**2)
        self._doubts = 0

    def advance(self, reading: float, torque: float, previous_torque: float) -> str:
        """One sample on: the torque that acted since [N m] and the one before it, then the new reading [rad].

        Returns:
            An empty string, or what went wrong.
        """
        if self.state is None:
            if not np.isfinite(reading):
                return "the angle is not a number"
            self.start(reading, torque)
            return ""
        self.state, innovation, variance, row = self._predict(self.state, reading, torque, previous_torque)
        if not np.all(np.isfinite(self.state)) or not np.all(np.isfinite(self._covariance)):
            self.state = None
            return self.advance(reading, torque, previous_torque) or "the estimate diverged and began anew"
        if not np.isfinite(reading):
            return "the angle is not a number, the model's prediction stands in"
        if abs(innovation) > _OUTLIER * np.sqrt(variance):
            self._doubts += 1
            if self._doubts < _PATIENCE:
                return "the angle jumped, the model's prediction stands in"
            self.start(reading, torque)
            return "the angle stayed away from the prediction, the estimate began anew"
        self._doubts = 0
        self.state = self._correct(self.state, innovation, variance, row)
        return ""

    def _predict(
        self, state: Array, reading: float, torque: float, previous_torque: float
    ) -> tuple[Array, float, float, Array]:
        """Next state (n,), innovation [rad], its variance [rad^2], its derivative by state and d (n + 1,)."""
        model, dt, n = self.predictor.model, self.predictor.sample_time, state.size
        step = self.predictor.look_ahead(state, np.array([previous_torque, torque]), self.disturbance)
        F = np.eye(n + 1)
        F[:n, :n] = step.state_jacobians[0]
        F[:n, n] = step.torque_jacobians[0].sum(axis=1)
        kick = dt / model.inertia * self.torque_noise
        added = np.zeros(n + 1)
        added[0], added[1], added[n] = (kick * dt / 2) ** 2, kick**2, self.disturbance_rate**2 * dt
        self._covariance = F @ self._covariance @ F.T + np.diag(added)
        shown, row = step.readings[0, 0], np.append(step.readings[0, 1:], 0.0)
        variance = float(row @ self._covariance @ row) + self._sensor_variance
        return step.states[1], float(reading - shown), variance, row

    def _correct(self, state: Array, innovation: float, variance: float, row: Array) -> Array:
        """Kalman's update of the state (n,); the covariance in Joseph's form, which stays symmetric and positive."""
        n = state.size
        gain = self._covariance @ row / variance
        keep = np.eye(n + 1) - np.outer(gain, row)
        self.disturbance += float(gain[n] * innovation)
        self._covariance = keep @ self._covariance @ keep.T + np.outer(gain, gain) * self._sensor_variance
        return np.asarray(state + gain[:n] * innovation)


def _at_rest(model: ServoModel, reading: float, torque: float) -> Array:
    """(n,) state at rest in which the sensor has settled at a reading [rad], by fixed-point iteration.

    A sensor that errs by a part of a degree errs by many times its noise: to take its reading for the angle would be
    a contradiction that the filter never overcomes.
    """
    angle = reading
    for _ in range(_ITERATIONS):
        state, shown = beginning(model, angle=angle, torque=torque), angle
        place = 2
        for effect in model.effects:
            if State.ANGLE in effect.states and not effect.flexible:
                state[place] = shown
            shown = float(effect.reading(shown, shown))
            place += len(effect.states)
        angle += reading - shown
    return state
