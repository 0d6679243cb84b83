"""Collinearity of effects: the part of an effect's signature that a refit, or another effect, absorbs to first order.

The signature is the response of the measurement to the torque of an effect, computed along the motion without it. It
passes through the same linearised model as in the diagnosis. Competing effects are represented by their regressors.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np

from antidrive.standard_excitation import SAMPLE_TIME, StandardExcitation, standard_excitation
from plant.discrete import INPUTS, integration_steps, sample_reading, sample_step
from plant.effects import Effect, Stage
from plant.effects.effect import Array
from plant.simulation import beginning


def absorbed_share(effect: Effect, on: StandardExcitation) -> float:
    """Fraction of an effect's signature that is absorbed by a refit of the model without it [-]."""
    signature = _signature(effect, on)
    return 1.0 - _power(_beyond(on, signature)) / max(_power(signature), 1e-300)


def collinear_share(kind: type[Effect], other: type[Effect]) -> float | None:
    """Fraction of an effect's signature, after a refit, that another effect would absorb at its best parameters [-].

    None if one of the two effects has no signature.
    """
    for on in (standard_excitation(False, kind, other), standard_excitation(True, kind, other)):
        effect = kind.typical(on.motion)
        if effect is not None:
            left = _beyond(on, _signature(effect, on))
            torque, measurement = (each[:, None] for each in on.score(left[:, 0]))
            motion = replace(on.motion, score=torque, reading_score=measurement, chance=on.chance)
            shapes = ((shape.columns, shape.acts_on == "measurement") for shape in other.regressors(motion))
            seen = (_beyond(on, on.response(columns, on_measurement=sensor)) for columns, sensor in shapes)
            return max((_explained(left, each) for each in seen), default=None)
    return None


def _signature(effect: Effect, on: StandardExcitation) -> Array:
    """(T, 1) response of the measurement to an effect, to first order [rad]."""
    return on.response(added_torque(effect, on)[:, None], on_measurement=effect.stage is Stage.SENSOR)


def added_torque(effect: Effect, on: StandardExcitation) -> Array:
    """(T,) mean torque that an effect adds over each sample of the motion without it [N m]; of a sensor, its error.

    The load is forced along its path without the effect, and only the effect's own states are simulated.
    """
    model = on.model.with_effect(effect)
    values, inputs = on.step_inputs(model)
    begin = beginning(model, angle=on.start)
    step = sample_step(model, substeps=integration_steps(model, SAMPLE_TIME))
    state, given, path = ca.MX.sym("state", begin.size), ca.MX.sym("given", len(INPUTS)), ca.MX.sym("path", 2)
    after = step(state, given, values)
    error = sample_reading(model)(state, values) - state[0]
    led = ca.Function("led", [state, given, path], [ca.vertcat(path, after[2:]), after[1], error])
    following = on.path[1:].T
    _, velocity, errors = led.mapaccum(following.shape[1])(begin, inputs, following)
    if effect.stage is Stage.SENSOR:
        return np.array(errors).ravel()
    return np.asarray(on.model.inertia * (np.array(velocity).ravel() - following[1]) / SAMPLE_TIME)


def _beyond(on: StandardExcitation, responses: Array) -> Array:
    """(T, m) residual of the responses (T, m) after a refit of the model."""
    return np.asarray(responses - on.absorbed @ (on.absorbed.T @ responses))


def _explained(signature: Array, responses: Array) -> float:
    """Fraction of a signature (T, 1) in the span of responses (T, m) [-]."""
    found = np.linalg.lstsq(responses, signature, rcond=1e-8)[0]
    return 1.0 - _power(signature - responses @ found) / max(_power(signature), 1e-300)


def _power(values: Array) -> float:
    return float(np.sum(values**2))
