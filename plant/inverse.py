"""The inverse model: the torque that a motion takes, with each effect's share apart.

Equations (4) and (6) read backwards: from the motion of the load to the torque that must arrive there, and from that
through the actuator's effects to the command. What has a memory of the way, such as presliding, is followed along it.
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
_NEWTON = 6  # steps to a torque on which friction depends


@dataclass(frozen=True, kw_only=True, eq=False)
class InverseEquations:
    """The inverse model in symbols.

    Attributes:
        motion: angle, velocity and acceleration of the load [rad, rad/s, rad/s^2].
        memory: the angle before, and the state of each effect that follows the way.
        remembered: names of what is in the memory.
        shares: by name, what of the torque is for what [N m]; all together are the torque.
        after: the memory behind this sample.
    """

    motion: Any
    memory: Any
    remembered: tuple[str, ...]
    shares: dict[str, Any]
    after: list[Any]


def inverse(model: ServoModel, angle: ArrayLike, velocity: ArrayLike, acceleration: ArrayLike) -> pd.DataFrame:
    """The torque command that a motion of the load takes, and what of it is for what.

    Friction acts against the velocity, at rest against the motion that is about to begin; at rest without acceleration
    it asks for nothing. A drivetrain that gives is taken as rigid, a command that acts late is not advanced
    (`time_lead` says by how much it should be), and an effect of the log's clock is left out.

    Args:
        model: the servo.
        angle, velocity, acceleration: (T,) of the load, sample after sample [rad, rad/s, rad/s^2] (on a linear axis
            [m, m/s, m/s^2]); or single numbers.

    Returns:
        (T,) rows: `inertia`, `gravity`, `viscous_friction`, a column for each effect that takes or gives torque, and
        their sum `torque` (on a linear axis `force`). `attrs["unit"]` is the unit of all.

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
    """What the inverse model does not undo, and what to do about it; a sentence each."""
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
    """Whether an effect takes or gives torque in the inverse model."""
    kind = type(effect)
    return any(getattr(kind, method) is not getattr(Effect, method) for method in (*_LOAD, "command_for"))


def strength(model: ServoModel) -> str:
    """What a drive gives: "torque", or "force" on a linear axis."""
    return "torque" if model.axis == "rotary" else "force"


def moving(model: ServoModel) -> dict[str, str]:
    """What the motion of the load is called, and its units."""
    place, length = ("angle", "rad") if model.axis == "rotary" else ("position", "m")
    return {place: length, "velocity": f"{length}/s", "acceleration": f"{length}/s^2"}


def torque_unit(model: ServoModel) -> str:
    """The unit of that."""
    return model.torque_unit or {"rotary": "N m", "linear": "N"}[model.axis]


def inverse_equations(model: ServoModel) -> InverseEquations:
    """The inverse of a model without clocked effects, whose parameters may be numbers or symbols."""
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
    """The effects that follow the way of the load."""
    return [effect for effect in model.effects if effect.states == (State.RELAXED,) and is_active(effect)]


def _against(levels: tuple[Expression, Expression] | None, towards: Expression) -> Expression:
    """What dry friction takes in a direction, which is -1, 0 or 1."""
    if levels is None:
        return 0.0
    forward, backward = map(ca.SX, levels)
    if ca.is_equal(forward, backward, 10):
        return towards * forward
    return ca.fmax(towards, 0) * forward + ca.fmin(towards, 0) * backward


def _arriving(load_shares: Any) -> Expression:
    """The torque at the load, on which its own friction may depend: found by Newton's method.

    One step is exact where the dependence is a straight line, and two where it has a kink at zero.
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
    """Names of the shares, and (shares, T) their course along a motion (3, T)."""
    found = inverse_equations(model)
    inputs = [ca.vertcat(*found.memory), ca.vertcat(*found.motion)]
    outputs = [ca.densify(ca.vertcat(*found.after)), ca.densify(ca.vertcat(*found.shares.values()))]
    sample = ca.Function("inverse", inputs, outputs, {"cse": True})
    memory = np.zeros(len(found.memory))
    memory[0] = motion[0, 0]
    return tuple(found.shares), np.array(sample.mapaccum(motion.shape[1])(memory, motion)[1])


def _listed(names: list[str]) -> str:
    return ", ".join(names)
