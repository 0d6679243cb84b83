"""What a step costs on the target: floating-point operations, counted from the code, and an estimate of the time.

Every loop of step.c and solve.c has a bound, so the worst case is a sum: how often each stage runs, times its
operations. The stages are counted in the expressions they are written from, the loops around them by reading.
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
        simple: sums, products, comparisons and the like.
        divisions: and square roots.
        functions: sines, exponentials and other calls into the mathematical library.
    """

    simple: int = 0
    divisions: int = 0
    functions: int = 0

    def __add__(self, other: Effort) -> Effort:
        """Both, one after the other."""
        return Effort(self.simple + other.simple, self.divisions + other.divisions, self.functions + other.functions)

    def __mul__(self, times: int) -> Effort:
        """So many times."""
        return Effort(self.simple * times, self.divisions * times, self.functions * times)

    @property
    def total(self) -> int:
        """All of them."""
        return self.simple + self.divisions + self.functions

    def cycles(self, costs: Effort) -> int:
        """Of a processor on which each kind costs so many."""
        pairs = ((self.simple, costs.simple), (self.divisions, costs.divisions), (self.functions, costs.functions))
        return sum(count * cost for count, cost in pairs)


CORTEX_M7 = {"single": Effort(4, 18, 150), "double": Effort(9, 35, 500)}
"""Cycles of each kind of operation on a Cortex-M7 with the unit for both precisions, loads and stores included."""

# The loops' own operations, by reading solve.c and step.c: of each stage of the horizon, once a pass or once a round.
_LINEARISE, _RESIDUAL, _CENTRAL, _AHEAD = Effort(40, 1), Effort(8, 1), Effort(9), Effort(16, 1)
_FENCE, _FORCES, _END = Effort(8), Effort(54, 9), Effort(54, 15)  # of other intervals, and of each end of an interval
_PRESSING = Effort(24, 3)  # of each other interval in a round of the active set


_FRAMES = 5632  # bytes: addresses and arrays of all functions at once, registers saved, the mathematical library


def of(function: Any) -> Effort:
    """One call of a stage."""
    kinds = [function.instruction_id(k) for k in range(function.n_instructions())]
    moves = sum(kind in _MOVES for kind in kinds)
    divisions, simple = sum(kind in _DIVISIONS for kind in kinds), sum(kind in _SIMPLE for kind in kinds)
    return Effort(simple, divisions, len(kinds) - moves - divisions - simple)


def calls(functions: Mapping[str, Any], sizes: Mapping[str, int], *, worst: bool) -> dict[str, int]:
    """How often each stage runs in one step: at most, or usually, when two sweeps find the bounds that are active."""
    N, passes = sizes["horizon"], sizes["passes"]
    sweeps, certificates = _sweeps(functions, sizes, worst), 2 if worst else 1
    once = {"watch": 1, "estimate": 1 + N * worst, "begin": int(worst)}  # at most for a horizon of missed samples
    once |= {"preview": 1, "jump": N - 1, "early": int(worst), "followable": 1, "hurry": 1, "govern": N + 1}
    once |= {"learn": 1, "rub": N, "demand": N + 1, "ease": 3 * N, "split": N}
    courses = sweeps + 2 * worst  # the interior point method follows its first and its last torques
    each = {"stage": sizes["late"] + N, "reach": N, "backward": N * sweeps, "forward": N * courses}
    if rows(functions) > 1:
        each |= {"enter": 1, "corridor": N}
    return once | {name: passes * count for name, count in (each | {"slope": N * certificates}).items()}


def of_step(functions: Mapping[str, Any], sizes: Mapping[str, int], *, worst: bool) -> Effort:
    """One step, at most or usually."""
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
    """How many numbers of a stage have an interval."""
    return int(functions["backward"].size1_in(6)) // 2


def tries(functions: Mapping[str, Any], sizes: Mapping[str, int]) -> int:
    """Rounds of the active set before the interior point method."""
    return sizes["rounds"] if rows(functions) == 1 else min(sizes["rounds"], TRIES)


def again(functions: Mapping[str, Any], sizes: Mapping[str, int]) -> int:
    """Rounds of the active set behind the interior point method, final where there are more intervals."""
    return sizes["rounds"] if rows(functions) == 1 else 0


def _sweeps(functions: Mapping[str, Any], sizes: Mapping[str, int], worst: bool) -> int:
    """The active set, the interior point with its start, the active set again, and the plan if all of that failed."""
    rounds = sizes["rounds"]
    return tries(functions, sizes) + (1 + rounds) + again(functions, sizes) + 1 if worst else 2


def stack(functions: Mapping[str, Any], number: int) -> int:
    """Bytes of stack of a step at most, for numbers of so many bytes: temporaries of all stages, and what they find."""
    temporaries: int = sum(function.sz_w() for function in functions.values())
    kalman, watched = functions["estimate"].size1_in(0), functions["watch"].size1_in(2)
    memories: int = 3 * kalman + watched  # each is found beside the one that it replaces
    return number * (temporaries + memories) + _FRAMES
