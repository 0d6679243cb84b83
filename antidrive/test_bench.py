"""The test bench of a model: the rig with the model's mechanics, and contact, rotors and encoders of suitable size."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from plant.drive_train import DriveTrain
from plant.effects import (
    Backlash,
    Cogging,
    CoulombFriction,
    Effect,
    GravityOffset,
    LoadDependentFriction,
    QuadraticDrag,
    StribeckFriction,
    TorqueOffset,
)
from plant.rig import Rig
from plant.servo import ServoModel

_ROTORS = 0.04  # fraction of the total inertia, as on the paper-like rig
_PRESSED = {"rotary": 1.2e-4, "linear": 1e-5}  # compression of the flanks by the greatest torque [rad], [m]: likewise
_BACKLASH = {"rotary": 1.2e-3, "linear": 5e-5}  # backlash [rad], [m]
_DAMPED = 0.107  # damping ratio of a rotor on its contact stiffness: likewise
_OWN_STEP = 0.5  # fraction of the longest step for this contact stiffness
_LONGEST_STEP = 20e-6  # [s]
_MECHANICS = frozenset(
    {
        *("inertia", "gravity", "gravity_offset", "viscous_friction", "coulomb_friction", "breakaway_excess"),
        *("stribeck_velocity", "quadratic_drag", "cogging_amplitude", "cogging_order", "cogging_phase"),
        "torque_offset",
    }
)
"""Fields of the rig that are taken from a model."""


def test_bench(
    model: ServoModel, train: DriveTrain, kept: Mapping[str, float], *, max_torque: float, attributes: Mapping[str, Any]
) -> tuple[Rig, list[str]]:
    """The rig for a model, and remarks on it, in sentences.

    Args:
        model: everything that moves, including rotors in mesh.
        train: its drives.
        kept: numbers of a scenario for contact, motors and encoders; its numbers for the mechanics are ignored.
        max_torque: of a drive [N m].
        attributes: attributes of the controller that describe the machine: rotors, motor friction, encoder.
    """
    from_model = {"gravity": model.gravity, "viscous_friction": model.viscous_friction}
    for effect in model.effects:
        from_model |= _fields(effect) or {}
    missing = [effect.title for effect in model.effects if _fields(effect) is None]
    squares = train.motor_ratios**2
    rotor = float(np.max(attributes.get("rotor_inertia", 0.0))) or _ROTORS * model.inertia / float(np.sum(squares))
    seen = rotor * squares
    stiffness = max_torque * float(np.max(train.mesh_ratios)) / _PRESSED[model.axis]
    lightest = min(float(np.min(seen)), model.inertia - float(np.sum(seen)))
    teeth = {
        "rotor_inertia": rotor,
        "motor_viscous": 0.0,
        "motor_coulomb": float(np.max(attributes.get("motor_friction", 0.0))),
        "backlash": _BACKLASH[model.axis],
        "flank_stiffness": stiffness,
        "flank_damping": 2 * _DAMPED * float(np.sqrt(stiffness * abs(lightest))),
        "encoder_counts": round(2 * np.pi / attributes.get("encoder_resolution", 2 * np.pi / 2**17)),
        "encoder_noise": attributes.get("encoder_noise", 2e-5),
        "fine_step": min(_LONGEST_STEP, _OWN_STEP * float(np.sqrt(abs(lightest) / stiffness)) / 8),
    }
    others = {name: value for name, value in kept.items() if name not in _MECHANICS}
    numbers: dict[str, Any] = {**teeth, **from_model, **others, "inertia": model.inertia - float(np.sum(seen))}
    rig = Rig(gears=train, drives=tuple(range(1, train.drives + 1)), **numbers)
    unit = "kg m^2" if model.axis == "rotary" else "kg"
    notes = [f"The test-bench simulation is built from the model: {model.inertia:.4g} {unit}, drives {train}."]
    if missing:
        notes.append(
            f"In the model, but not in the test-bench simulation, and so not in its controller: {', '.join(missing)}."
        )
    return rig, notes


def on_the_bench(model: ServoModel) -> ServoModel:
    """A model without the effects that no rig has: a controller that compensates for them would be wrong there."""
    for effect in model.effects:
        if _fields(effect) is None:
            model = model.without_effect(effect.name)
    return model


def _fields(effect: Effect) -> dict[str, float] | None:
    """The fields of the rig for an effect; None for an effect that no rig has."""
    match effect:
        case CoulombFriction():
            return {"coulomb_friction": effect.torque}
        case StribeckFriction():
            speed = effect.velocity
            return {"coulomb_friction": effect.coulomb, "breakaway_excess": effect.excess, "stribeck_velocity": speed}
        case GravityOffset():
            return {"gravity_offset": effect.beta}
        case QuadraticDrag():
            return {"quadratic_drag": effect.drag}
        case TorqueOffset():
            return {"torque_offset": effect.torque}
        case LoadDependentFriction():
            return {"mesh_friction": effect.coefficient}
        case Backlash():
            return {"backlash": effect.gap}
        case Cogging():
            phase = {"cogging_order": effect.order, "cogging_phase": effect.phase}
            return {"cogging_amplitude": effect.amplitude, **phase}
        case _:
            return None


def is_built(kept: Mapping[str, float]) -> bool:
    """Whether the machine of a scenario is built from the model: it gives no inertia of its own."""
    return "inertia" not in kept
