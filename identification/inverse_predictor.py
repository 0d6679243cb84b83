"""Prediction of the torque from the motion, with sensitivities: the inverse model in place of the observer.

    e[k] = tau[k] - needed(motion[k])

There is no observer: this is the regression of robot identification (Gautier 1997), with every effect that acts on the
load. An observer would follow the slow torques, which say most about friction and gravity.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from identification.log import Run
from identification.predictor import Prediction, Predictor
from identification.run_parameters import own_values
from plant.discrete import Structure
from plant.effects import Moment, State
from plant.effects.effect import Array
from plant.recursion_cache import recursion


@dataclass(frozen=True, kw_only=True, eq=False)
class InversePredictor(Predictor):
    """A model's structure prepared to predict the torque of the runs of an `inverse_log`; attributes as in its base."""

    @property
    def fitted_starts(self) -> tuple[int, ...]:
        """None: the motion is given."""
        return ()

    def pieces(
        self, values: Array, initial: Array, *, bandwidth: float, width: float, sensitivities: bool = True
    ) -> Iterator[tuple[int, Prediction]]:
        """Each run as one piece, with its index; initial state, bandwidth and width have no influence."""
        free = self.free if sensitivities else ()
        for place, run in enumerate(self.runs):
            own = own_values(run, self.model, values)
            begin = [np.zeros(len(self.model.states)), np.zeros((len(self.model.states), len(free)))]
            dt = np.array([run.sample_time])
            _, (needed, slopes, states) = _needed(Structure(self.model), free)(begin, motion_rows(run), own, dt)
            errors = run.valid * (run.command - needed[:, 0])
            yield (
                place,
                Prediction(
                    errors=errors,
                    innovations=errors,
                    jacobian=np.where(run.valid[:, None], -slopes, 0.0),
                    states=states.T,
                    output=needed[:, 0],
                    initials=0,
                ),
            )

    def with_sensitivities(
        self, pieces: Iterable[tuple[int, Prediction]], values: Array, initial: Array, *, bandwidth: float, width: float
    ) -> Iterator[tuple[int, Prediction]]:
        """The same pieces with their Jacobian: they are predicted again, as nearly all the work is the Jacobian."""
        return self.pieces(values, initial, bandwidth=bandwidth, width=width)


def motion_rows(run: Run) -> Array:
    """(T, 6) angle, velocity, acceleration, time, direction of motion and travel since the sample before."""
    travel = np.diff(run.output, prepend=run.output[0])
    columns = (run.output, run.velocity, run.acceleration, run.time, run.direction, travel)
    return np.column_stack([column for column in columns if column is not None])


@recursion(carried=2)
def _needed(structure: Structure, free: tuple[int, ...]) -> Any:
    """(state, slopes), `motion_rows`, parameters, time step -> needed torque, its slopes (F,), state.

    Dry friction is that of both directions, weighted with their share of the time around a sample.
    """
    template = structure.model
    n = len(template.states)
    state, slopes = ca.SX.sym("state", n), ca.SX.sym("slopes", n, len(free))
    parameters, row, dt = ca.SX.sym("parameters", len(template.names)), ca.SX.sym("row", 6), ca.SX.sym("dt")
    model = template.bound(parameters)
    x, v, a, t, direction, travel = ca.vertsplit(row)
    own = model.own_states(state)

    def moment(torque: Any) -> Moment:
        return Moment(angle=x, velocity=v, torque=torque, time=t, travel=travel, step=dt, inertia=model.inertia)

    at = moment(0.0)
    smooth = (model.inertia + sum((effect.added_inertia(at) for effect in model.effects), start=0.0)) * a
    smooth -= model.load_inertia(at) * model.smooth_acceleration(at, own)
    needed = smooth
    for _ in range(2):  # a friction that grows with the torque grows with itself too
        levels = model.dry_friction(moment(needed))
        if levels is not None:
            needed = smooth + 0.5 * ((1.0 + direction) * levels[0] - (1.0 - direction) * levels[1])
    for effect in reversed(model.effects):
        needed = effect.command_for(needed, v)
    slid = [
        effect.slide(own[effect.name][i], travel) if kind is State.RELAXED else own[effect.name][i]
        for effect in model.effects
        for i, kind in enumerate(effect.states)
    ]
    following_state = ca.vertcat(x, v, *slid)
    moving = parameters[list(free)]

    def along(end: Any) -> Any:
        return ca.mtimes(ca.jacobian(end, state), slopes) + ca.jacobian(end, moving)

    outputs = [following_state, along(following_state), ca.SX(needed), along(ca.SX(needed)), following_state]
    return ca.Function(
        "needed", [state, slopes, row, parameters, dt], [ca.densify(value) for value in outputs], {"cse": True}
    )
