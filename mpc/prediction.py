"""The model looking ahead: states over a horizon and how they answer to the torques."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from plant.discrete import integration_steps, sample_reading, sample_step
from plant.servo import ServoModel

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """States over M samples and their derivatives.

    Attributes:
        states: (M + 1, n) states, the first one given [rad, rad/s, effect states].
        state_jacobians: (M, n, n) of each next state by its state.
        torque_jacobians: (M, n, 2) of each next state by the torque during the sample and the one before it.
        readings: (M, 1 + n) what the sensor shows at each next state [rad], and its derivative by the state.
    """

    states: Array
    state_jacobians: Array
    torque_jacobians: Array
    readings: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Predictor:
    """A servo model, sampled, with a constant disturbing torque beside the command.

        z[k+1] = step(z[k], tau[k] + d, tau[k-1] + d)

    The second torque acts until a delay of less than a sample has passed; whole samples of delay are the caller's.

    Attributes:
        model: the servo.
        sample_time: [s].
        switch: part of the input delay inside a sample [s].
        width: velocity over which dry friction is smoothed [rad/s].
    """

    model: ServoModel
    sample_time: float
    switch: float
    width: float

    @cached_property
    def parameters(self) -> Array:
        """(P,) parameter values, the delay reduced to its part inside a sample."""
        values = self.model.values.copy()
        if "input_delay.time" in self.model.names:
            values[self.model.names.index("input_delay.time")] = self.switch
        return values

    @cached_property
    def _stage(self) -> Any:
        n = len(self.model.states)
        z, torques, p = ca.SX.sym("z", n), ca.SX.sym("torques", 2), ca.SX.sym("p", self.parameters.size)
        inputs = ca.vertcat(torques, 0.0, np.inf, 0.0, self.sample_time, self.width)
        z_next = sample_step(self.model, substeps=integration_steps(self.model, self.sample_time))(z, inputs, p)
        shown = sample_reading(self.model)(z, p)
        sensor = ca.Function("sensor", [z, p], [ca.vertcat(shown, ca.jacobian(shown, z).T)])
        derivatives = [ca.jacobian(z_next, z), ca.jacobian(z_next, torques)]
        return ca.Function("stage", [z, torques, p], [z_next, *derivatives, sensor(z_next, p)], {"cse": True})

    @cached_property
    def _horizons(self) -> dict[int, Any]:
        return {}

    def look_ahead(self, state: Array, torques: Array, disturbance: float) -> Trajectory:
        """Follow the model over M samples.

        Args:
            state: (n,) first state.
            torques: (M + 1,) follower torques [N m]; the first one belongs to the sample before.
            disturbance: torque added to each of them [N m].
        """
        samples, n = torques.size - 1, state.size
        if samples not in self._horizons:
            self._horizons[samples] = self._stage.mapaccum(samples)
        held = torques + disturbance
        outputs = self._horizons[samples](state, np.stack((held[1:], held[:-1])), self.parameters)
        states, by_state, by_torque, readings = (np.asarray(output, dtype=np.float64) for output in outputs)
        return Trajectory(
            states=np.vstack((state, states.T)),
            state_jacobians=by_state.reshape(n, samples, n).transpose(1, 0, 2),
            torque_jacobians=by_torque.reshape(n, samples, 2).transpose(1, 0, 2),
            readings=readings.T,
        )


def sensitivities(trajectory: Trajectory, first: int) -> Array:
    """(M - first, n, M - first) derivatives of states first + 1 .. M by the torques of samples first .. M - 1.

    S[k+1] = A[k] S[k] + B[k] e[k] + B'[k] e[k-1]
    """
    A, B = trajectory.state_jacobians[first:], trajectory.torque_jacobians[first:]
    samples, n = A.shape[0], A.shape[1]
    S = np.zeros((samples, n, samples))
    S[0, :, 0] = B[0, :, 0]
    for k in range(1, samples):
        S[k, :, :k] = A[k] @ S[k - 1, :, :k]
        S[k, :, k] = B[k, :, 0]
        S[k, :, k - 1] += B[k, :, 1]
    return S
