"""Bumpless transfer: the state that a controller takes over from its predecessor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mpc.drive import DriveInverse
from mpc.estimator import Estimator
from mpc.filter import covariance_of, motor_place, place_of_covariance
from mpc.slots import History
from plant.effects import State
from plant.servo import ServoModel

Array = NDArray[np.float64]

_CLOSE, _ROUNDS = 1e-10, 10  # of the search for the disturbance: size of the last step, and number of steps


@dataclass(frozen=True, kw_only=True, eq=False)
class Running:
    """The parts of a controller that take part in a transfer.

    Attributes:
        model: its servo model.
        sample_time: [s].
        late: dead time of the command in whole samples.
        greatest: greatest torque on the load [N m].
        estimator: its filter state is one of the arrays.
        arrays: all arrays by name.
        remembered: names of the arrays that hold the state.
    """

    model: ServoModel
    sample_time: float
    late: int
    greatest: float
    estimator: Estimator
    arrays: Mapping[str, Array]
    remembered: tuple[str, ...]


def hand_over(old: Running, new: Running) -> None:
    """Transfer the state of `old` to `new`: estimate, reference, plan, and torques not yet effective.

    Arrays of the same size are copied. A longer dead time or horizon is filled with its last known value. With a new
    model the estimated angle stays the same, and the disturbance is chosen such that the acceleration of the load does
    not change. So the torque on an unmodelled payload stays right when the new model includes that payload.
    """
    if not old.estimator.kalman[0]:
        return
    mine, theirs = old.arrays, new.arrays
    for name in new.remembered:
        if theirs[name].size == mine[name].size:
            theirs[name][:] = mine[name]
    _past(old, new)
    _plan(old, new)
    if old.model != new.model or old.sample_time != new.sample_time:
        theirs["fed"][:] = 0.0  # valid for the old model and sample time only
    if old.sample_time != new.sample_time:
        theirs["history"][History.COUNT] = 0.0  # the stored reference samples have another spacing
    if old.model.effects != new.model.effects:
        theirs["learnt"][:] = 0.0  # valid for the old friction only
    if old.model != new.model or mine["kalman"].size != theirs["kalman"].size:
        _estimate(old, new)


def _past(old: Running, new: Running) -> None:
    """Past torques: converted to the output of the new model's drive, and their friction compensation."""
    velocity, count, wanted = float(old.estimator.kalman[4]), old.late + 2, new.late + 2
    before, after = (DriveInverse.of(each.model)[0] for each in (old, new))
    net, rubs = old.arrays["past"][:count], old.arrays["rubs"][:count]
    if before != after:
        net = np.asarray(after.effective(before.command(net + rubs, velocity), velocity)) - rubs
    for name, torques in (("past", net), ("rubs", rubs)):
        kept = torques[-wanted:]
        new.arrays[name][:wanted] = np.append(np.full(wanted - kept.size, kept[0]), kept)


def _plan(old: Running, new: Running) -> None:
    """The planned torques, a first guess; for another horizon cut, or extended with the last one."""
    mine, theirs = old.arrays["plan"], new.arrays["plan"]
    if mine.size == theirs.size:
        return
    kept = mine[1 : theirs.size]
    theirs[0] = mine[0]
    theirs[1:] = np.append(kept, np.full(theirs.size - 1 - kept.size, kept[-1]))


def _estimate(old: Running, new: Running) -> None:
    """State and covariance, matched by the names of the states; states of the new model alone start at rest."""
    mine, theirs = old.estimator, new.estimator
    torque = float(new.arrays["past"][new.late + 1])
    theirs.start(float(mine.kalman[3]), torque)
    names = [_names(each) for each in (mine, theirs)]
    known = [name for name in names[1] if name in names[0]]
    here, there = ([own.index(name) for name in known] for own in names)
    values = [_values(each) for each in (mine, theirs)]
    spreads = [covariance_of(each.kalman, len(own)) for each, own in zip((mine, theirs), names, strict=True)]
    values[1][there] = values[0][here]
    spreads[1][there] = 0.0  # no correlation between transferred and new states
    spreads[1][:, there] = 0.0
    spreads[1][np.ix_(there, there)] = spreads[0][np.ix_(here, here)]
    n = len(theirs.predictor.model.states)
    theirs.kalman[2], theirs.kalman[3 : 3 + n] = values[1][n], values[1][:n]
    theirs.kalman[3 + n : 2 + len(names[1])] = values[1][n + 1 :]
    theirs.kalman[place_of_covariance(len(names[1]))] = spreads[1][np.tril_indices(len(names[1]))]
    _go_on_accelerating(old, new)


def _names(estimator: Estimator) -> list[str]:
    offsets = ["offset 1", "offset 2"] if estimator.motors else []
    return [*estimator.predictor.model.states, "disturbance", *offsets]


def _values(estimator: Estimator) -> Array:
    """State, disturbance and offsets, in the order of the covariance."""
    n, m = len(estimator.predictor.model.states), len(_names(estimator))
    kalman = estimator.kalman
    return np.concatenate((kalman[3 : 3 + n], kalman[2:3], kalman[3 + n : 2 + m]))


def _go_on_accelerating(old: Running, new: Running) -> None:
    """Choose the disturbance, and the twist of a flexible drivetrain, so that the load acceleration does not change.

    Newton's method on the change of velocity over a sample, of the load and, in a flexible drivetrain, of the motor.
    """
    kalman, n = new.estimator.kalman, len(new.estimator.predictor.model.states)
    motor, torques = motor_place(new.estimator.predictor.model), _torque_states(new)
    wanted = _gained(old)[0] / old.sample_time * new.sample_time
    start, acting = kalman[3 : 3 + n].copy(), float(new.arrays["past"][new.late + 1])
    units = np.array([new.greatest, _turned(new)] if motor else [new.greatest])

    def off(unknown: Array) -> Array:
        """Error (1,) or (2,) of the change of velocity for a scaled disturbance, and twist."""
        kalman[2] = unknown[0] * units[0]
        kalman[3 : 3 + n] = start
        kalman[3 + torques] = acting + kalman[2]  # settled actuators
        if motor:
            kalman[3 + motor] = start[0] + unknown[1] * units[1]
            kalman[4 + motor] = start[1]
        return np.asarray(_gained(new)[: units.size] - wanted)

    unknown, small = np.append(kalman[2], np.zeros(units.size - 1)) / units, 1e-3
    for _ in range(_ROUNDS):
        miss = off(unknown)
        slopes = [(off(unknown + small * row) - miss) / small for row in np.eye(units.size)]
        step = np.asarray(np.linalg.lstsq(np.column_stack(slopes), miss, rcond=None)[0], dtype=np.float64)
        if not np.isfinite(step).all() or np.max(np.abs(step)) < _CLOSE:
            break
        unknown = unknown - step
    off(unknown)


def _torque_states(running: Running) -> NDArray[np.intp]:
    """Indices of the states that are actuator torques."""
    return np.flatnonzero([kind is State.TORQUE for kind in running.estimator.predictor.model.kinds])


def _turned(running: Running) -> float:
    """Twice the angle by which the greatest torque turns the free load in a sample [rad]."""
    return running.greatest / running.model.inertia * running.sample_time**2


def _gained(running: Running) -> Array:
    """(2,) change of velocity of the load and of a motor over the next sample with the acting torque [rad/s]."""
    estimator, state = running.estimator, running.estimator.state
    assert state is not None
    acting = running.arrays["past"][running.late + 1]
    ahead = estimator.predictor.look_ahead(state, np.full(2, acting), estimator.disturbance)
    motor = motor_place(estimator.predictor.model)
    return np.asarray((ahead.states[1] - state)[[1, motor + 1]])
