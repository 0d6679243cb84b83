"""The inverse model: the torque for a given motion, with the share of each effect.

Equations (4) and (6) in reverse: from the motion of the load to the torque required there, and from that through the
actuator's effects to the command. Effects with memory of the travel, such as presliding, are simulated along the
motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from plant.effects import Effect, Expression, Moment, State
from plant.effects.effect import Array
from plant.errors import BadParameter
from plant.symbolic import one_at_a_time

if TYPE_CHECKING:
    import pandas as pd

    from plant.servo import ServoModel

_LOAD = ("load_torque", "dry_friction", "added_inertia")
_NEWTON = 6  # iterations for a torque on which friction depends


@dataclass(frozen=True, kw_only=True, eq=False)
class InverseEquations:
    """The inverse model in symbols.

    Attributes:
        motion: angle, velocity and acceleration of the load [rad, rad/s, rad/s^2].
        memory: the previous angle, and the state of each effect with memory of the travel.
        remembered: names of the memory; empty without such effects.
        shares: components of the torque by name [N m]; their sum is the torque.
        after: the memory after this sample.
    """

    motion: Any
    memory: Any
    remembered: tuple[str, ...]
    shares: dict[str, Any]
    after: list[Any]


def inverse(model: ServoModel, angle: ArrayLike, velocity: ArrayLike, acceleration: ArrayLike) -> pd.DataFrame:
    """The torque command for a motion of the load, and its components.

    Friction acts against the velocity, at rest against the motion that is about to begin; at rest without acceleration
    it is zero. A flexible drivetrain is taken as rigid, a delayed command is not advanced (`time_lead` gives the
    delay), and an effect of the log's clock is left out.

    Args:
        model: the servo.
        angle, velocity, acceleration: (T,) of the load, sample after sample [rad, rad/s, rad/s^2] (on a linear axis [m,
            m/s, m/s^2]); or single numbers.

    Returns:
        (T,) rows: `inertia`, `gravity`, `viscous_friction`, a column for each effect with a torque, and their sum
        `torque` (on a linear axis `force`). `attrs["unit"]` is the unit of all.

    Raises:
        BadParameter: the three do not have the same length, or a value is not finite.
    """
    import pandas as pd

    try:
        x, v, a = np.broadcast_arrays(
            *(np.atleast_1d(np.asarray(q, dtype=float)) for q in (angle, velocity, acceleration))
        )
    except ValueError:
        raise BadParameter("inverse: angle, velocity and acceleration must have the same length.") from None
    if x.ndim != 1 or x.size == 0:
        raise BadParameter("inverse: give angle, velocity and acceleration as numbers or as (T,) arrays.")
    for name, values in zip(moving(model), (x, v, a), strict=True):
        if not np.isfinite(values).all():
            raise BadParameter(f"inverse: {name} is not finite in row {int(np.argmin(np.isfinite(values)))}.")
    names, shares = _followed(model.without_clock(), np.vstack((x, v, a)))
    frame = pd.DataFrame(shares.T, columns=list(names))
    frame[strength(model)] = shares.sum(axis=0)
    frame.attrs["unit"] = torque_unit(model)
    return frame


def time_lead(model: ServoModel) -> float:
    """How far ahead the set-points of a feed-forward should lie [s]: dead time and lag of the actuator."""
    return float(model.delay()) + float(sum(effect.lateness() for effect in model.effects))


def unmodelled_effects(model: ServoModel) -> list[str]:
    """Effects that the inverse model does not compensate, and what to do about them; a sentence each."""
    timeless = model.without_clock()
    kept, found = {effect.name for effect in timeless.effects}, []
    clocked = [effect.title for effect in model.effects if effect.name not in kept]
    rigid = [effect.title for effect in timeless.effects if effect.flexible]
    others = [
        effect.title
        for effect in timeless.effects
        if not (is_active(effect) or effect.flexible or effect.delay() or effect.lateness())
    ]
    if time_lead(model) > 0.0:
        found.append(f"The torque acts late: give set-points that lie {time_lead(model):.4g} s ahead.")
    if rigid:
        found.append(f"Motor and load are taken as rigid, without {_listed(rigid)}.")
    if others:
        found.append(f"Not compensated: {_listed(others)}.")
    if clocked:
        found.append(f"Left out, because it holds for the log alone: {_listed(clocked)}.")
    return found


def is_active(effect: Effect) -> bool:
    """Whether an effect adds to the torque of the inverse model."""
    kind = type(effect)
    return any(getattr(kind, method) is not getattr(Effect, method) for method in (*_LOAD, "command_for"))


def strength(model: ServoModel) -> str:
    """Output of a drive: "torque", or "force" on a linear axis."""
    return "torque" if model.axis == "rotary" else "force"


def moving(model: ServoModel) -> dict[str, str]:
    """Names of the load's motion variables, with their units."""
    place, length = ("angle", "rad") if model.axis == "rotary" else ("position", "m")
    return {place: length, "velocity": f"{length}/s", "acceleration": f"{length}/s^2"}


def torque_unit(model: ServoModel) -> str:
    """Unit of the torque, or force."""
    return model.torque_unit or {"rotary": "N m", "linear": "N"}[model.axis]


def inverse_equations(model: ServoModel) -> InverseEquations:
    """The inverse of a model without clocked effects, with numbers or symbols as parameters."""
    x, v, a = motion = [ca.SX.sym(name) for name in moving(model)]
    states = _states(model)
    memory = [ca.SX.sym(name) for name in (f"{x.name()}_before", *(f"{effect.name}_state" for effect in states))]
    travel = x - memory[0]
    held = {e.name: e.slide(state, travel) for e, state in zip(states, memory[1:], strict=True)}
    towards = ca.sign(ca.if_else(v == 0, a, v))

    def load_shares(torque: Expression) -> dict[str, Expression]:
        at = Moment(angle=x, velocity=v, torque=torque, inertia=model.inertia)
        found = {"inertia": model.inertia * a}
        if model.axis == "rotary":
            found["gravity"] = model.gravity * ca.cos(x)
        found["viscous_friction"] = model.viscous_friction * v
        for effect in filter(is_active, model.effects):
            if any(getattr(type(effect), method) is not getattr(Effect, method) for method in _LOAD):
                against = _against(effect.dry_friction(at), towards)
                own = effect.load_torque(at, held.get(effect.name, 0.0))
                found[effect.name] = effect.added_inertia(at) * a - own + against
        return found

    torque = _arriving(load_shares)
    shares = load_shares(torque)
    for effect in reversed(model.effects):
        if type(effect).command_for is not Effect.command_for:
            entering = effect.command_for(torque, v)
            shares[effect.name] = shares.get(effect.name, 0.0) + entering - torque
            torque = entering
    theirs = [effect.name for effect in model.effects if effect.name in shares]
    order = [*(name for name in shares if name not in theirs), *theirs]
    return InverseEquations(
        motion=motion,
        memory=memory,
        remembered=tuple(symbol.name() for symbol in memory) if states else (),
        shares={name: ca.SX(shares[name]) for name in order},
        after=[x, *held.values()],
    )


def _states(model: ServoModel) -> list[Effect]:
    """The effects with memory of the travel."""
    return [effect for effect in model.effects if effect.states == (State.RELAXED,) and is_active(effect)]


def _against(levels: tuple[Expression, Expression] | None, towards: Expression) -> Expression:
    """Dry friction in a direction, which is -1, 0 or 1."""
    if levels is None:
        return 0.0
    forward, backward = map(ca.SX, levels)
    if ca.is_equal(forward, backward, 10):
        return towards * forward
    return ca.fmax(towards, 0) * forward + ca.fmin(towards, 0) * backward


def _arriving(load_shares: Any) -> Expression:
    """The torque at the load if friction depends on it, by Newton's method.

    One step is exact for a linear dependence, and two for one with a kink at zero.
    """
    torque = ca.SX.sym("torque")
    short = ca.SX(sum(load_shares(torque).values())) - torque
    slope, guess = ca.jacobian(short, torque), ca.SX(0)
    better = torque - short / slope
    straight = ca.jacobian(slope, torque).is_zero()
    for _ in range(1 if slope.is_constant() else 2 if straight else _NEWTON):
        guess = ca.substitute(better, torque, guess)
    return guess


@one_at_a_time
def _followed(model: ServoModel, motion: Array) -> tuple[tuple[str, ...], Array]:
    """Names of the components, and (shares, T) their values along a motion (3, T)."""
    found = inverse_equations(model)
    inputs = [ca.vertcat(*found.memory), ca.vertcat(*found.motion)]
    outputs = [ca.densify(ca.vertcat(*found.after)), ca.densify(ca.vertcat(*found.shares.values()))]
    sample = ca.Function("inverse", inputs, outputs, {"cse": True})
    memory = np.zeros(len(found.memory))
    memory[0] = motion[0, 0]
    return tuple(found.shares), np.array(sample.mapaccum(motion.shape[1])(memory, motion)[1])


def _listed(names: list[str]) -> str:
    return ", ".join(names)
