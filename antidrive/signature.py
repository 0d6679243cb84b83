"""The signature of an effect: its influence under a standard excitation, in a noise-free simulation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from antidrive.standard_excitation import SAMPLE_TIME, StandardExcitation, standard_excitation
from plant.discrete import sample_reading, sample_step
from plant.effects import Effect, Stage, State
from plant.effects.effect import Array

_TELLING = 0.6  # least fraction of the signature explained by one variable, to be drawn over it instead of time
_BINS = 40
_EVEN = 1e-2  # fraction of the power in its variation up to which a torque counts as constant


@dataclass(frozen=True, kw_only=True, eq=False)
class Signature:
    """An effect at a visible size.

    Attributes:
        effect: with its parameters.
        excitation: the standard excitation of its servo.
        without, seen: (T,) measurement without and with the effect [rad].
        lacking: (T,) torque that the model without the effect lacks along the motion with it [N m]; of a sensor's
            effect the measurement error [rad].
        variables: (T,) velocity, angle and torque along the motion with it, and time.
    """

    effect: Effect
    excitation: StandardExcitation
    without: Array
    seen: Array
    lacking: Array
    variables: Mapping[str, Array]

    @property
    def change(self) -> Array:
        """(T,) change of the measurement [rad]."""
        return self.seen - self.without

    @property
    def loops(self) -> bool:
        """Whether it depends on the travel of the load with hysteresis."""
        return State.RELAXED in self.effect.states

    @cached_property
    def variable(self) -> str:
        """The variable that explains most of it; "time" if none explains enough, and "angle" for hysteresis."""
        if self.loops:
            return "angle"
        shares = {name: _explained(self.lacking, values) for name, values in self.variables.items()}
        best = max(shares, key=lambda name: shares[name])
        return best if shares[best] >= _TELLING else "time"


def signature(kind: type[Effect]) -> Signature | None:
    """The signature for a torque input or, if it has none there, for a position servo; None if in neither."""
    for on in (standard_excitation(False, kind), standard_excitation(True, kind)):
        effect = kind.typical(on.motion)
        if effect is not None:
            return _simulated(effect, on)
    return None


def _simulated(effect: Effect, on: StandardExcitation) -> Signature:
    model = on.model.with_effect(effect)
    states = on.states(model)
    angle, velocity, samples = states[:-1, 0], states[:-1, 1], on.command.size
    seen = np.array(sample_reading(model).map(samples)(states[:-1].T, model.values)).ravel()
    values, inputs = on.step_inputs(on.model)
    following = np.array(sample_step(on.model).map(samples)(states[:-1, :2].T, inputs, values))
    lacking = on.model.inertia * (states[1:, 1] - following[1]) / SAMPLE_TIME
    torque = on.command - on.servo_gain * angle
    return Signature(
        effect=effect,
        excitation=on,
        without=on.motion.angle,
        seen=seen,
        lacking=seen - angle if effect.stage is Stage.SENSOR else lacking,
        variables={"velocity": velocity, "angle": angle, "torque": torque, "time": on.motion.time},
    )


def _explained(lacking: Array, values: Array) -> float:
    """Fraction of the variance that is explained by the mean over each interval of a variable [-]."""
    place = np.minimum((values - values.min()) / max(float(np.ptp(values)), 1e-300) * _BINS, _BINS - 1).astype(int)
    count = np.maximum(np.bincount(place, minlength=_BINS), 1)
    mean = np.bincount(place, weights=lacking, minlength=_BINS) / count
    total = float(np.var(lacking))
    even = total <= _EVEN * float(np.mean(lacking**2))
    return 0.0 if even else 1.0 - float(np.mean((lacking - mean[place]) ** 2)) / total
