"""The standard excitation of a simulated servo, for the signatures of effects."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from diagnosis.experiment.separation import blank_run
from diagnosis.linear import AT_ONCE, Filter, linearised
from identification.predictor import Prediction, Predictor
from identification.run import Run
from plant.discrete import INPUTS, integration_steps
from plant.effects import Effect, Motion
from plant.effects.effect import Array
from plant.servo import ServoModel
from plant.signals import chirp, steps
from plant.simulation import at_switch, beginning, held_commands, simulate

SAMPLE_TIME = 0.01  # s
_STIFFNESS = 40.0  # of the position servo [N m/rad]
_DAMPING = 12.0  # its viscous friction, at the load side [N m s/rad]


@dataclass(frozen=True, kw_only=True, eq=False)
class StandardExcitation:
    """A servo and its excitation.

    Attributes:
        model: without the effects that are to be shown.
        command: (T,) torque [N m], or servo gain times set-point.
        servo_gain: decrease of the drive's torque with the angle [N m/rad]; 0 for a torque input.
        start: initial angle at rest [rad].
    """

    model: ServoModel
    command: Array
    servo_gain: float = 0.0
    start: float = 0.0

    def states(self, model: ServoModel) -> Array:
        """(T + 1, n) free simulation of a model."""
        begin = beginning(model, angle=self.start)
        return simulate(model, command=self.command, dt=SAMPLE_TIME, servo_gain=self.servo_gain, state=begin)

    def step_inputs(self, model: ServoModel) -> tuple[Array, Array]:
        """(P,) parameters and (8, T) inputs of a model's step, see `plant.discrete.INPUTS`."""
        steps = np.full(self.command.size, SAMPLE_TIME)
        now, before, switch = held_commands(model, self.command, steps)
        given: dict[str, Array | float] = {"command": now, "previous_command": before, "time": self.motion.time}
        given |= {"servo_gain": self.servo_gain, "command_limit": np.inf, "dt": SAMPLE_TIME, "width": 0.0}
        given |= {"servo_damping": 0.0}
        rows = np.stack([np.broadcast_to(given[name], now.shape) for name in INPUTS])
        return at_switch(model, switch), rows

    @cached_property
    def path(self) -> Array:
        """(T + 1, 2) angle and velocity of the model without the effects [rad, rad/s]."""
        return self.states(self.model)[:, :2]

    @cached_property
    def motion(self) -> Motion:
        """The motion of the servo alone, from which an effect chooses its size and computes its signatures."""
        angle, velocity = self.path[:-1].T
        nothing, gain = np.zeros_like(angle), np.full_like(angle, self.servo_gain)
        return Motion(
            time=np.arange(angle.size) * SAMPLE_TIME,
            angle=angle,
            velocity=velocity,
            acceleration=np.diff(self.path[:, 1]) / SAMPLE_TIME,
            command=self.command,
            servo_gain=gain,
            torque=self.command - gain * angle,
            score=nothing,
            reading_score=nothing,
            run=np.zeros(angle.size, dtype=np.intp),
            inertia=self.model.inertia,
            velocity_resolution=1e-3 * float(np.abs(velocity).max()),
            law=lambda command: command - gain * angle,
            arriving=self._arriving,
        )

    def _arriving(self, torque: Array) -> Array:
        """(T,) torque at the load for a torque (T,) of the drive [N m]; the model's actuator has no memory."""
        for effect in self.model.effects:
            torque = np.array(effect.command(ca.DM(torque), 0.0, 0.0)).ravel()
        return torque

    def response(self, columns: Array, *, on_measurement: bool) -> Array:
        """(T, m) response of the measurement to small torques or measurement errors (T, m), to first order [rad]."""
        return -self._linear.response(columns, on_measurement=on_measurement)

    def score(self, signature: Array) -> tuple[Array, Array]:
        """(T,) gradient of the fit to a signature (T,) by a torque, and by a measurement error, at each sample."""
        torque, measurement = self._linear.score(-signature[:, None])
        return torque[:, 0], measurement[:, 0]

    def chance(self) -> tuple[Array, Array]:
        """(T, M) the same scores for white noise, after a refit."""
        noise = np.random.default_rng(0).normal(size=(self.command.size, AT_ONCE))
        return self._linear.score(noise - self.absorbed @ (self.absorbed.T @ noise))

    @cached_property
    def absorbed(self) -> Array:
        """(T, F) orthonormal basis of the changes by a refit of model and initial state, to first order."""
        jacobian = self._prediction.jacobian
        return np.asarray(np.linalg.qr(jacobian[:, np.any(jacobian != 0.0, axis=0)])[0])

    @cached_property
    def _linear(self) -> Filter:
        return linearised(self.model, self._run, self._prediction, 0.0, substeps=self._substeps)

    @cached_property
    def _prediction(self) -> Prediction:
        free = tuple(range(len(self.model.names)))
        predictor = Predictor(model=self.model, runs=(self._run,), free=free, substeps=self._substeps)
        start = np.array([[self.start, 0.0]])
        return predictor.predict(self.model.values, start, bandwidth=0.0, width=0.0)[0]

    @property
    def _run(self) -> Run:
        gain = np.full_like(self.command, self.servo_gain)
        return replace(blank_run(self.command, SAMPLE_TIME), servo_gain=gain, output=self.motion.angle)

    @property
    def _substeps(self) -> int:
        return integration_steps(self.model, SAMPLE_TIME)


def standard_excitation(servo: bool, *shown: type[Effect]) -> StandardExcitation:
    """The paper's servo with a torque input, or as a position servo; without the effects that are to be shown.

    It has a rotary axis if all of them can have one, otherwise a linear axis.
    """
    gone = {kind.name for kind in shown}
    kept = tuple(effect for effect in ServoModel.paper().effects if effect.name not in gone)
    return _bench(servo, kept, all("rotary" in kind.axes for kind in shown))


@lru_cache(maxsize=16)
def _bench(servo: bool, effects: tuple[Effect, ...], rotary: bool) -> StandardExcitation:
    model = replace(ServoModel.paper(), effects=effects)
    if not rotary:
        model = replace(model, gravity=0.0, axis="linear")
    if servo:
        model = replace(model, viscous_friction=_DAMPING)
        return StandardExcitation(model=model, command=_STIFFNESS * _excitation(0.6), servo_gain=_STIFFNESS)
    return StandardExcitation(
        model=model, command=_excitation(3.5), start=-np.pi / 2 if rotary else 0.0
    )  # gravity holds it there


def _excitation(amplitude: float) -> Array:
    """(T,) the standard excitation: a slow chirp, steps and a fast chirp."""
    levels = tuple(amplitude * share for share in (-0.7, -0.4, 0.9, -1.0, 0.5, -0.5))
    slow = chirp(amplitude=amplitude, start=0.2, stop=1.0, duration=8.0, sample_time=SAMPLE_TIME)
    fast = chirp(amplitude=amplitude, start=1.0, stop=8.0, duration=4.0, sample_time=SAMPLE_TIME)
    return np.concatenate((slow, steps(levels=levels, hold=1.0, sample_time=SAMPLE_TIME), fast))
