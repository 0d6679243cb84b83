"""One sample step with its derivatives, for fits and for the search.

The integration steps of a sample are calls of one function, whose code exists only once: so it stays in the processor's
cache, and is compiled in a fraction of the time. Steps that a sample does not need are skipped. Small Jacobians
propagate the derivatives.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

from plant.discrete import INPUTS, division, rise, stretches
from plant.integrator import Step, advance
from plant.servo import ServoModel
from plant.symbolic import one_at_a_time


@one_at_a_time
def step_with_slopes(
    model: ServoModel, free: Sequence[int], columns: int, *, substeps: int, positioned: bool = True
) -> Any:
    """The step (state, slopes, inputs, parameters) -> (next state, next slopes), as a `casadi.Function`.

    Args:
        model: its structure is used, not its numbers.
        free: (F,) places of parameters.
        columns: number C of derivatives; the first F are those by the free parameters, which also act within the
            sample, the others are those of the initial state only.
        substeps: integration steps in one sample.
        positioned: whether the servo gain may be other than zero; if not, the actuator's torque does not depend on the
            angle, and is computed once a step instead of at each stage of the integration.

    Returns:
        Function of (n,) state, (n, C) its derivatives, (8,) inputs (see `plant.discrete.INPUTS`), (P,) parameters.
    """
    kind: Any = ca.SX
    state, slopes = kind.sym("state", len(model.states)), kind.sym("slopes", len(model.states), columns)
    inputs, parameters = kind.sym("inputs", len(INPUTS)), kind.sym("parameters", len(model.names))
    bound, moving = model.bound(parameters), parameters[list(free)]

    def along(end: Any) -> Any:
        """(m, C) derivatives of an expression (m,) of state and parameters."""
        return ca.mtimes(ca.jacobian(end, state), slopes) + _beside(ca.jacobian(end, moving), columns)

    gain, damping = (inputs[2], inputs[7]) if positioned else (ca.SX(0), ca.SX(0))
    limit, width, time, parts = inputs[3], inputs[6], inputs[4], []
    divided = False  # whether the steps differ by sample, so that it may not need all of them
    for command, stretch in stretches(bound, inputs):
        lengths = division(bound, state, command, inputs, stretch, substeps)
        table, now = list[Any](), (command, time)
        for length in lengths:  # of each step: the torque and its slope, the time and the length
            table.append(ca.vertcat(now[0], rise(bound, inputs), now[1], length))
            now = now[0] + length * rise(bound, inputs), now[1] + length
        steps, moments = ca.horzcat(*table), along(ca.vertcat(*(each[2:] for each in table)))
        parts.append(ca.Function("stretch", [state, slopes, inputs, parameters], [steps, moments], {"cse": True}))
        divided = divided or ca.depends_on(ca.vertcat(*lengths), ca.vertcat(state, parameters))
        time = time + stretch

    held, clock = kind.sym("held", 2), kind.sym("clock", 2)
    clock_slopes = kind.sym("clock_slopes", _moving([part.sparsity_out(1) for part in parts]))
    begun = {"time": clock[0], "length": clock[1]}
    step = Step(command=held[0], rise=held[1], gain=gain, damping=damping, limit=limit, width=width, **begun)
    end = ca.cse(advance(bound, state, step))  # common subexpressions are differentiated once
    after = along(end) + ca.mtimes(ca.jacobian(end, clock), clock_slopes)
    given = [state, slopes, inputs, parameters, held, clock, clock_slopes]
    one = ca.Function("integration_step", given, [end, ca.densify(after)], {"cse": True})

    if sum(part.size2_out(0) for part in parts) > 1:
        kind = ca.MX  # preserves the calls
        one = _unless_needless(one) if divided else one
    state, slopes = kind.sym("state", *state.shape), kind.sym("slopes", *slopes.shape)
    inputs, parameters = kind.sym("inputs", *inputs.shape), kind.sym("parameters", *parameters.shape)
    end, after = state, slopes
    for part in parts:
        steps, moments = part(end, after, inputs, parameters)
        for column in range(steps.shape[1]):
            torque, moment = steps[:2, column], steps[2:, column]
            moment_slopes = moments[2 * column : 2 * column + 2, :]
            end, after = one(end, after, inputs, parameters, torque, moment, moment_slopes)
    return ca.Function("step_with_slopes", [state, slopes, inputs, parameters], [end, after])


@one_at_a_time
def _unless_needless(one: Any) -> Any:
    """The integration step, skipped if its length is zero with zero derivatives."""
    given = one.sx_in()
    nothing = ca.Function("nothing", given, [given[0], ca.densify(given[1])])
    branches = ca.Function.if_else("needed_or_not", one, nothing)
    given = one.mx_in()
    clock, clock_slopes = given[5:]
    moves = ca.sum2(ca.fabs(ca.densify(clock_slopes[1, :])))
    return ca.Function("step_if_needed", given, branches(ca.logic_or(clock[1] > 0, moves > 0), *given))


def _moving(moments: Sequence[Any]) -> Any:
    """The derivatives by which time or length of any step depends on a parameter; two rows of each are of one step."""
    ones = ca.vertcat(*(ca.DM(each, 1.0) for each in moments))
    return sum((ones[row : row + 2, :] for row in range(0, ones.shape[0], 2)), ca.DM(2, ones.shape[1])).sparsity()


def _beside(first: Any, columns: int) -> Any:
    """A matrix extended by columns of zeros to `columns`."""
    return ca.horzcat(first, ca.SX(first.shape[0], columns - first.shape[1]))
