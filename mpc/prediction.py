"""Prediction by the model: states over a horizon and their derivatives by states and torques."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from mpc.kernel import Kernel
from mpc.prepared import Prepared, prepared
from plant.actuator import settles_slowly
from plant.discrete import Structure, integration_steps, sample_reading, sample_step
from plant.servo import ServoModel
from plant.simulation import at_switch

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """States over M samples and their derivatives.

    Attributes:
        states: (M + 1, n) states [rad, rad/s, effect states]; the first one is given.
        state_jacobians: (M, n, n) derivative of each next state by its state.
        torque_jacobians: (M, n, 2) derivative of each next state by the torque during the sample and the one before.
    """

    states: Array
    state_jacobians: Array
    torque_jacobians: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Predictor:
    """A sampled servo model with a constant disturbance torque in addition to the command.

        z[k+1] = step(z[k], tau[k] + d, tau[k-1] + d)

    The second torque acts during the fractional part of the dead time; the caller applies its whole samples.

    Attributes:
        model: the servo.
        sample_time: [s].
        switch: fractional part of the dead time inside a sample [s].
    """

    model: ServoModel
    sample_time: float
    switch: float

    @cached_property
    def parameters(self) -> Array:
        """(P + 1,) parameter values, with the fractional dead time only, then the sample time."""
        return np.append(at_switch(self.model, self.switch), self.sample_time)

    @cached_property
    def stage(self) -> Any:
        """Prediction of one sample, see `stage`."""
        steps = integration_steps(self.model, self.sample_time)
        return stage(Structure(self.model), steps, 1 if settles_slowly(self.model, self.sample_time) else 3)

    @cached_property
    def along(self) -> Prepared:
        """The same for many samples in a row with constant parameters, see `mpc.prepared`."""
        return prepared(self.stage)

    @cached_property
    def prepared(self) -> Array:
        """(Q,) the prepared numbers of these parameters."""
        return self.along.of(self.parameters)

    @cached_property
    def sensor(self) -> Any:
        """(state, parameters) -> predicted measurement [rad] and its derivative by the state (n,)."""
        z, p = ca.SX.sym("z", len(self.model.states)), ca.SX.sym("p", self.parameters.size)
        shown = sample_reading(self.model)(z, p[:-1])
        return ca.Function("sensor", [z, p], [shown, ca.densify(ca.jacobian(shown, z).T)])

    @cached_property
    def _horizons(self) -> dict[int, Kernel]:
        return {}

    def look_ahead(self, state: Array, torques: Array, disturbance: float) -> Trajectory:
        """Simulate the model over M samples.

        Args:
            state: (n,) first state.
            torques: (M + 1,) output torques [N m]; the first one belongs to the sample before.
            disturbance: torque added to each of them [N m].
        """
        samples, n = torques.size - 1, state.size
        if samples not in self._horizons:
            self._horizons[samples] = Kernel(self.along.function.mapaccum(samples))
        along = self._horizons[samples]
        held = torques + disturbance
        along.inputs[0][:] = state
        along.inputs[1][:] = np.column_stack((held[1:], held[:-1])).ravel()
        along.inputs[2][:] = np.tile(self.prepared, samples)
        states, by_state, by_torque = along()
        return Trajectory(
            states=np.vstack((state, states.reshape(samples, n))),
            state_jacobians=by_state.reshape(samples, n, n).transpose(0, 2, 1).copy(),
            torque_jacobians=by_torque.reshape(samples, 2, n).transpose(0, 2, 1).copy(),
        )


@lru_cache(maxsize=64)
def stage(structure: Structure, substeps: int, settling: int) -> Any:
    """Prediction of one sample with its derivatives, as a `casadi.Function`.

    (state (n,), torques (2,) now and before, parameters (P + 1,)) -> next state (n,), its derivatives by the state
    (n, n) and by the torques (n, 2).
    """
    model = structure.model
    z, torques = ca.SX.sym("z", len(model.states)), ca.SX.sym("torques", 2)
    p = ca.SX.sym("p", len(model.names) + 1)
    inputs = ca.vertcat(torques, 0.0, np.inf, 0.0, p[-1], 0.0, 0.0)
    z_next = sample_step(model, substeps=substeps, settling=settling)(z, inputs, p[:-1])
    derivatives = [ca.densify(ca.jacobian(z_next, z)), ca.densify(ca.jacobian(z_next, torques))]
    return ca.Function("stage", [z, torques, p], [ca.densify(z_next), *derivatives], {"cse": True})
