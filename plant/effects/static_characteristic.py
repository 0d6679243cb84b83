"""The static characteristic of an effect: friction over velocity, ripple over angle, output of a dead zone."""

from __future__ import annotations

from typing import Any, Protocol

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from plant.effects.moment import Expression, Moment
from plant.effects.motion import Array
from plant.errors import BadParameter
from plant.symbolic import one_at_a_time


class _Law(Protocol):
    """Members of an effect that are used here."""

    @property
    def title(self) -> str: ...
    @property
    def states(self) -> tuple[Any, ...]: ...
    def command(self, torque: Expression, state: Expression, velocity: Expression) -> Expression: ...
    def load_torque(self, at: Moment, state: Expression) -> Expression: ...
    def dry_friction(self, at: Moment) -> tuple[Expression, Expression] | None: ...
    def measurement(self, angle: Expression, state: Expression) -> Expression: ...


@one_at_a_time
def characteristic(law: _Law) -> tuple[str, Any]:
    """The one variable of an effect, and its curve over that as a CasADi function; "" and None if there is none."""
    x, v, torque, time = symbols = [ca.SX.sym(name) for name in ("angle", "velocity", "torque", "time")]
    if law.states:
        return "", None
    at = Moment(angle=x, velocity=v, torque=torque, time=time)
    load, leaving = ca.SX(law.load_torque(at, 0.0)), ca.SX(law.command(torque, 0.0, v))
    forward, backward = map(ca.SX, law.dry_friction(at) or (0.0, 0.0))
    dry = ca.fmax(ca.sign(v), 0) * forward + ca.fmin(ca.sign(v), 0) * backward
    curves: list[tuple[Any, Any]] = [
        (x, load),
        (x, ca.SX(law.measurement(x, 0.0)) - x),
        (v, dry - load),
        (v, ca.simplify(torque - leaving)),
        (torque, leaving),
        (torque, forward),
    ]
    for symbol, expression in curves:
        others = ca.vertcat(*(other for other in symbols if other is not symbol))
        passes = ca.is_equal(expression, torque)
        if ca.depends_on(expression, symbol) and not ca.depends_on(expression, others) and not passes:
            return symbol.name(), ca.Function("curve", [symbol], [ca.densify(expression)])
    return "", None


def curve(law: _Law, values: ArrayLike) -> Array:
    """See `Effect.curve`."""
    variable, function = characteristic(law)
    if not variable:
        raise BadParameter(f"The effect {law.title} has no curve over angle, velocity or torque alone.")
    entering = np.asarray(values, dtype=float)
    return np.array(function(entering.reshape(1, -1))).reshape(entering.shape)
