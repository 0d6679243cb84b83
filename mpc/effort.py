"""Cost of a step on the target: floating-point operations, counted from the code, and an estimate of the time.

Every loop of step.c and solve.c is bounded, so the worst case is the sum over the stages of number of calls times
operations. The operations of a stage are counted in its CasADi expressions, those of the loops by hand.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca

from mpc.active_set import TRIES

_MOVES = frozenset({ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST, ca.OP_PARAMETER, ca.OP_ASSIGN})
_DIVISIONS = frozenset({ca.OP_DIV, ca.OP_INV, ca.OP_SQRT})
_SIMPLE = frozenset(
    {ca.OP_ADD, ca.OP_SUB, ca.OP_MUL, ca.OP_NEG, ca.OP_TWICE, ca.OP_SQ, ca.OP_FABS, ca.OP_FMIN, ca.OP_FMAX}
    | {ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_NOT, ca.OP_AND, ca.OP_OR, ca.OP_IF_ELSE_ZERO}
    | {ca.OP_SIGN, ca.OP_COPYSIGN}
)


@dataclass(frozen=True)
class Effort:
    """Floating-point operations.

    Attributes:
        simple: sums, products, comparisons and similar operations.
        divisions: divisions and square roots.
        functions: sines, exponentials and other calls of the mathematical library.
    """

    simple: int = 0
    divisions: int = 0
    functions: int = 0

    def __add__(self, other: Effort) -> Effort:
        """Sum of the operations of both."""
        return Effort(self.simple + other.simple, self.divisions + other.divisions, self.functions + other.functions)

    def __mul__(self, times: int) -> Effort:
        """The operations of `times` repetitions."""
        return Effort(self.simple * times, self.divisions * times, self.functions * times)

    @property
    def total(self) -> int:
        """Number of all operations."""
        return self.simple + self.divisions + self.functions

    def cycles(self, costs: Effort) -> int:
        """Processor cycles, for given cycles per operation of each kind."""
        pairs = ((self.simple, costs.simple), (self.divisions, costs.divisions), (self.functions, costs.functions))
        return sum(count * cost for count, cost in pairs)


CORTEX_M7 = {"single": Effort(4, 18, 150), "double": Effort(9, 35, 500)}
"""Cycles per operation on a Cortex-M7 with a floating-point unit for both precisions, loads and stores included."""

# Operations of the loops in solve.c and step.c, counted by hand: for each stage of the horizon, per pass or per round.
_LINEARISE, _RESIDUAL, _CENTRAL, _AHEAD = Effort(40, 1), Effort(8, 1), Effort(9), Effort(16, 1)
_FENCE, _FORCES, _END = Effort(8), Effort(54, 9), Effort(54, 15)  # of the other intervals; _END of each interval end
_PRESSING = Effort(24, 3)  # of each interval other than the torque's, in a round of the active set


_FRAMES = 5632  # bytes: pointers and arrays of all functions together, saved registers, the mathematical library


def of(function: Any) -> Effort:
    """Operations of one call of a stage."""
    kinds = [function.instruction_id(k) for k in range(function.n_instructions())]
    moves = sum(kind in _MOVES for kind in kinds)
    divisions, simple = sum(kind in _DIVISIONS for kind in kinds), sum(kind in _SIMPLE for kind in kinds)
    return Effort(simple, divisions, len(kinds) - moves - divisions - simple)


def calls(functions: Mapping[str, Any], sizes: Mapping[str, int], *, worst: bool) -> dict[str, int]:
    """Number of calls of each stage in one step: at most, or usually, when two sweeps find the active bounds."""
    N, passes = sizes["horizon"], sizes["passes"]
    sweeps, certificates = _sweeps(functions, sizes, worst), 2 if worst else 1
    once = {"watch": 1, "estimate": 1 + N * worst, "begin": int(worst)}  # at most for a horizon of missed samples
    once |= {"preview": 1, "jump": N - 1, "early": int(worst), "followable": 1, "hurry": 1, "govern": N + 1}
    once |= {"learn": 1, "rub": N, "demand": N + 1, "ease": 3 * N, "allocation": N}
    courses = sweeps + 2 * worst  # the interior point method simulates its first and its last torques
    each = {"stage": sizes["late"] + N, "reach": N, "backward": N * sweeps, "forward": N * courses}
    if rows(functions) > 1:
        each |= {"enter": 1, "corridor": N}
    return once | {name: passes * count for name, count in (each | {"slope": N * certificates}).items()}


def of_step(functions: Mapping[str, Any], sizes: Mapping[str, int], *, worst: bool) -> Effort:
    """Operations of one step, at most or usually."""
    N, passes, rounds = sizes["horizon"], sizes["passes"], sizes["rounds"] + 1 if worst else 0
    linearise, residual, fenced = _LINEARISE, _RESIDUAL, rows(functions) > 1
    if fenced:
        linearise, residual = linearise + _FENCE, residual + _FORCES
    inside = (_CENTRAL + _END * (2 * rows(functions))) * rounds
    pressing = _PRESSING * (rows(functions) * tries(functions, sizes)) if worst and fenced else Effort()
    total = _AHEAD * N + (linearise + residual * 2 + inside + pressing) * (N * passes)
    for name, count in calls(functions, sizes, worst=worst).items():
        total += of(functions[name]) * count
    return total


def rows(functions: Mapping[str, Any]) -> int:
    """Number of constrained quantities of a stage."""
    return int(functions["backward"].size1_in(6)) // 2


def tries(functions: Mapping[str, Any], sizes: Mapping[str, int]) -> int:
    """Rounds of the active set before the interior point method."""
    return sizes["rounds"] if rows(functions) == 1 else min(sizes["rounds"], TRIES)


def again(functions: Mapping[str, Any], sizes: Mapping[str, int]) -> int:
    """Rounds of the active set after the interior point method; zero with more intervals, where that one is final."""
    return sizes["rounds"] if rows(functions) == 1 else 0


def _sweeps(functions: Mapping[str, Any], sizes: Mapping[str, int], worst: bool) -> int:
    """Worst case: active set, interior point with its start, active set again, and the fallback plan. Usual: two."""
    rounds = sizes["rounds"]
    return tries(functions, sizes) + (1 + rounds) + again(functions, sizes) + 1 if worst else 2


def stack(functions: Mapping[str, Any], number: int) -> int:
    """Upper bound of the stack of a step [bytes], for numbers of `number` bytes: temporaries and results of stages."""
    temporaries: int = sum(function.sz_w() for function in functions.values())
    kalman, watched = functions["estimate"].size1_in(0), functions["watch"].size1_in(2)
    memories: int = 3 * kalman + watched  # a new state is stored separately from the one that it replaces
    return number * (temporaries + memories) + _FRAMES
