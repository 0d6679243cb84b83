"""The quadratic program of the controller, stage by stage: the work of a sweep grows linearly with the horizon.

Relative to a prediction of the model the torques change by e[k] and the states by z[k] (z[0] = 0, e[-1] = 0):

    minimise    1/2 sum_k (miss[k] + z[k]_angle)^2 + 1/2 w sum_k (rate[k] + e[k] - e[k-1])^2
                + 1/2 (end + z[N]_angle,velocity)' P (end + z[N]_angle,velocity)
    subject to  z[k+1] = A[k] z[k] + B[k] [e[k], e[k-1]],    low[k] <= e[k] <= high[k]

If the controller has such limits, three more quantities of a stage have intervals: the change e[k] - e[k-1], and angle
and velocity of z[k+1]. The intervals of the last two are soft, with a price (`mpc.riccati_sweeps`).

The state of a stage is s = (z[k], e[k-1]); the cost to go is the parabola 1/2 s'Vs + v's. A torque is free, or held at
a bound. The solvers add the cost term 1/2 d q^2 + g q for each constrained quantity q of a stage.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import casadi as ca

TORQUE_ALONE, ALL_ROWS = 1, 4
"""Number of constrained quantities of a stage: the torque, or also its change, the next angle and velocity."""


def triangle(m: int) -> Any:
    """Sparsity of the upper triangle of V, column by column."""
    return ca.Sparsity.upper(m)


def _dynamics(n: int) -> tuple[Any, Any, Any, Any]:
    """A, B and the matrices of s[k+1] = F s[k] + G e[k]."""
    A, B = ca.SX.sym("A", n, n), ca.SX.sym("B", n, 2)
    return A, B, ca.vertcat(ca.horzcat(A, B[:, 1]), ca.SX(1, n + 1)), ca.vertcat(B[:, 0], 1)


@cache
def backward(n: int, rows: int = TORQUE_ALONE) -> Any:
    """The cost to go one stage earlier, and the optimal law, as a `casadi.Function`.

    (V, v, A, B, [miss, rate], [held, low, high], [d, g of each row], w) -> V, v, law; held is 0 for a free torque, -1
    at the lower and 1 at the upper bound. The law (2n + 5,) has K, k of e = Ks + k, then Q_es, q_e, Q_ee of the
    derivative of the cost by e, Q_ee e + Q_es s + q_e.
    """
    m = n + 1
    triangular, v = ca.SX.sym("V", triangle(m)), ca.SX.sym("v", m)
    A, B, F, G = _dynamics(n)
    data, bounds, w = ca.SX.sym("data", 2), ca.SX.sym("bounds", 3), ca.SX.sym("w")
    barrier = ca.SX.sym("barrier", 2 * rows)
    miss, rate = ca.vertsplit(data)
    held, low, high = ca.vertsplit(bounds)
    d, g = barrier[0], barrier[1]
    V, behind, weight, change = ca.triu2symm(triangular), v, w, w * rate
    if rows == ALL_ROWS:
        weight, change = w + barrier[2], w * rate + barrier[3]
        V = V + ca.diag(ca.vertcat(barrier[4], barrier[6], ca.SX(m - 2, 1)))
        behind = v + ca.vertcat(barrier[5], barrier[7], ca.SX(m - 2, 1))
    last = ca.vertcat(ca.SX(n, 1), 1)
    VG = ca.mtimes(V, G)
    Q_ee = ca.dot(G, VG) + weight + d
    Q_es = ca.mtimes(VG.T, F) - weight * last.T
    q_e = ca.dot(G, behind) + change + g
    Q_ss = ca.mtimes(ca.mtimes(F.T, V), F) + ca.diag(ca.vertcat(1, ca.SX(n - 1, 1), weight))
    q_s = ca.mtimes(F.T, behind) + ca.vertcat(miss, ca.SX(n - 1, 1), -change)
    gain = ca.if_else(held == 0, 1 / Q_ee, 0)
    K = -gain * Q_es
    k = ca.if_else(held == 0, -gain * q_e, ca.if_else(held < 0, low, high))
    earlier = [ca.densify(Q_ss + ca.mtimes(Q_es.T, K))[triangle(m)], q_s + Q_es.T * k]
    law = ca.vertcat(K.T, k, Q_es.T, q_e, Q_ee)
    inputs = [triangular, v, A, B, data, bounds, barrier, w]
    return ca.Function("backward", inputs, [*map(_filled, earlier), ca.densify(law)], {"cse": True})


@cache
def forward(n: int) -> Any:
    """One stage forward by the law, as a `casadi.Function`: (s, A, B, law, [held, low, high]) -> s, e, held.

    The last output is the updated active bound (primal-dual active set method; Hintermueller, Ito, Kunisch 2002): a
    free torque beyond a bound is held there. A held torque is released if the cost decreases inside, or moves to the
    other bound if its unconstrained step is that long.
    """
    m = n + 1
    s, law, bounds = ca.SX.sym("s", m), ca.SX.sym("law", 2 * m + 3), ca.SX.sym("bounds", 3)
    A, B, F, G = _dynamics(n)
    held, low, high = ca.vertsplit(bounds)
    e = ca.dot(law[:m], s) + law[m]
    slope = law[2 * m + 2] * e + ca.dot(law[m + 1 : 2 * m + 1], s) + law[2 * m + 1]
    pulled = e - ca.if_else(held == 0, 0, slope / law[2 * m + 2])
    now = ca.if_else(pulled < low, -1, ca.if_else(pulled > high, 1, 0))
    return ca.Function("forward", [s, A, B, law, bounds], [_filled(ca.mtimes(F, s) + G * e), e, now], {"cse": True})


@cache
def slope(n: int, rows: int = TORQUE_ALONE) -> Any:
    """The derivative of the cost by e, from the costate, as a `casadi.Function`.

    (costate (n + 1,) after the stage, s, e, A, B, [miss, rate], force of each row, w) -> costate before the stage and
    derivative. A force is the multiplier of an interval, positive at its upper end; that of the torque itself is left
    out. The computation does not use the method that found e, so it certifies e independently.
    """
    m = n + 1
    costate, s, e = ca.SX.sym("costate", m), ca.SX.sym("s", m), ca.SX.sym("e")
    A, B, F, G = _dynamics(n)
    data, forces, w = ca.SX.sym("data", 2), ca.SX.sym("forces", rows), ca.SX.sym("w")
    behind, change = costate, w * (data[1] + e - s[n])
    if rows == ALL_ROWS:
        behind, change = costate + ca.vertcat(forces[2], forces[3], ca.SX(m - 2, 1)), change + forces[1]
    before = ca.mtimes(F.T, behind) + ca.vertcat(data[0] + s[0], ca.SX(n - 1, 1), -change)
    outputs = [_filled(before), ca.dot(G, behind) + change]
    return ca.Function("slope", [costate, s, e, A, B, data, forces, w], outputs, {"cse": True})


def _filled(expression: Any) -> Any:
    """A column vector made dense; other expressions unchanged."""
    return ca.densify(expression) if expression.is_column() else expression
