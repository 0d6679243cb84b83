"""The quadratic program of a step on its arrays: Riccati sweeps over its stages, and the residual of a point."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from mpc.kernel import Kernel, fused, unrolled
from mpc.riccati import TORQUE_ALONE, backward, forward, slope, triangle
from mpc.slots import Tuning

Array = NDArray[np.float64]

CERTIFIED = 1e-6
"""Largest residual of an accepted solution, in units of the greatest torque."""

_DIGITS = 2.3e-16
"""Relative rounding error of a number."""


class Sweeps:
    """The program of `mpc.riccati` without its solvers, on the arrays of a controller.

    Attributes:
        rows: number of constrained quantities of a stage: the torque alone, or also its change, the next angle and the
            next velocity.
        data: (N, 2) miss [rad] and rate [N m] of each stage.
        bounds: (N, 3) the active bound, or 0 for none (see `mpc.riccati.backward`), least and greatest change of
            the torque [N m].
        fence: (N, rows, 2) ends of the intervals; those of the torque are in `bounds`.
        prices: (rows,) penalty per unit for leaving each interval; inf for a hard one.
        moved: (rows,) effect of a torque of 1 N m on each quantity in a sample: the scale of their errors.
        end: (2,) miss of the last angle and velocity [rad, rad/s].
        e: (N,) change of the torques [N m], the solution.
        s: (N + 1, n + 1) changes of states and last torque due to e.
        pressed: (N, rows) active set besides the torques: quantities held at the upper or lower end (1, -1), or at the
            price of leaving it (2, -2).
        forces: (N, rows) multipliers of the intervals, without those represented by `bounds`.
        held: (N,) active bounds after the last sweep.
        barrier: (N, 2 rows) cost terms d, g of each row, added by the solvers.
    """

    def __init__(self, arrays: Mapping[str, Array], rounds: int) -> None:
        """Work on arrays by name; `rounds`: greatest number of sweeps of each method."""
        self.rounds, self.unit = rounds, arrays["unit"]
        N, n = arrays["e"].size, arrays["s"].size // (arrays["e"].size + 1) - 1
        late, self.rows = arrays["A"].size // n**2 - N, arrays["forces"].size // N
        A, B = arrays["A"][late * n * n :], arrays["B"][late * 2 * n :]
        self.data, self.bounds = arrays["data"].reshape(N, 2), arrays["bounds"].reshape(N, 3)
        self.barrier, self.forces = arrays["barrier"].reshape(N, -1), arrays["forces"].reshape(N, -1)
        self.pressed = arrays["pressed"].reshape(N, -1)
        self.fence = arrays["fence"].reshape(N, self.rows, 2)
        self.rate_weight = arrays["tuning"][:1]
        self.prices, self.moved = arrays["prices"][: self.rows], arrays["moved"][: self.rows]
        self.end, self.e, self.held = arrays["end"], arrays["e"], arrays["held"]
        self.curvature = arrays["curvature"]
        self.s, self.law = arrays["s"].reshape(N + 1, n + 1), arrays["law"].reshape(N, 2 * n + 5)
        own = dict(arrays) | {"A": A, "B": B, "steady": np.zeros(1), "worst": np.zeros(1)}
        work = N * (backward(n, self.rows).n_instructions() + forward(n).n_instructions())
        reads = "tuning end A B data bounds barrier"
        behind = own | {"s": arrays["s"][n + 1 :]}
        self._sweep = fused("sweep", behind, reads, partial(_swept, n, self.rows), operations=work)
        self._steady, self._worst = own["steady"], own["worst"]
        course, after = forward(n).mapaccum(N), {0: arrays["s"][n + 1 :], 1: self.e}
        by_law = {1: A, 2: B, 3: arrays["law"], 4: arrays["bounds"]}
        self._course = Kernel(unrolled(course, N, forward(n)), by_law, after)
        known = "tuning end s e A B data forces bounds law curvature unit"
        fences = "moved prices fence"
        work = N * slope(n, self.rows).n_instructions()
        self._residual = fused("residual", own, f"{known} {fences}", partial(_residual, n, self.rows), operations=work)

    def sweep(self) -> bool:
        """Backward for the law, forward for the torques; returns whether the active bounds stay the same."""
        self._sweep()
        return bool(self._steady[0])

    def follow(self, e: Array) -> None:
        """Compute the states for given torques."""
        self.law[:, : self.s.shape[1]], self.law[:, self.s.shape[1]] = 0.0, e
        self._course()

    def numbers(self) -> Array:
        """(N rows,) the constrained quantities, stage by stage."""
        every = np.stack((self.e, self.e - self.s[:-1, -1], self.s[1:, 0], self.s[1:, 1]), axis=-1)
        return every[:, : self.rows].ravel()

    def residual(self) -> float:
        """Residual of the optimality conditions, in units of the greatest torque; zero at the minimiser.

        The maximum over the torques of |e - clip(e - slope/curvature, low, high)|, and over the other intervals of the
        error of the force f in the following equation, expressed as a torque m f/curvature, with m = moved:

            f = clip(f + (q - high) curvature/m^2, 0, price) + clip(f + (q - low) curvature/m^2, -price, 0)

        It is at least the rounding error of f: with a very large force the error of q would be lost by rounding.
        """
        self._residual()
        return float(self._worst[0])


def _swept(
    n: int, rows: int, tuning: Any, end: Any, A: Any, B: Any, data: Any, bounds: Any, barrier: Any
) -> dict[str, Any]:
    """One sweep: states, torques, active bounds, law, and whether the active bounds stay the same."""
    N, m, back, on = bounds.numel() // 3, n + 1, backward(n, rows), forward(n)
    (P_1, P_2, P_3), w = _end_weights(tuning), tuning[Tuning.RATE_WEIGHT]
    V = ca.MX(triangle(m), ca.vertcat(P_1, P_2, P_3, ca.MX.zeros(triangle(m).nnz() - 3)))
    v = ca.vertcat(P_1 * end[0] + P_2 * end[1], P_2 * end[0] + P_3 * end[1], ca.MX.zeros(m - 2))
    laws: list[Any] = [None] * N
    for k in reversed(range(N)):
        own = _at(k, 2, data), _at(k, 3, bounds), _at(k, 2 * rows, barrier)
        V, v, laws[k] = back(V, v, *_dynamics(k, n, A, B), *own, w)
    s, found, steady = ca.MX.zeros(m), [], ca.MX(1)
    for k, law in enumerate(laws):
        s, e, held = on(s, *_dynamics(k, n, A, B), law, _at(k, 3, bounds))
        found.append((s, e, held))
        steady = ca.logic_and(steady, held == bounds[3 * k])
    names = dict(zip(("s", "e", "held"), (ca.vertcat(*each) for each in zip(*found, strict=True)), strict=True))
    return names | {"law": ca.vertcat(*laws), "steady": steady}


def _residual(
    n: int,
    rows: int,
    tuning: Any,
    end: Any,
    s: Any,
    e: Any,
    A: Any,
    B: Any,
    data: Any,
    forces: Any,
    bounds: Any,
    law: Any,
    curvature: Any,
    unit: Any,
    **fences: Any,
) -> dict[str, Any]:
    """See `Sweeps.residual`; the sum propagates NaN."""
    N, m = e.numel(), n + 1
    (P_1, P_2, P_3), w = _end_weights(tuning), tuning[Tuning.RATE_WEIGHT]
    angle, velocity = end[0] + s[N * m], end[1] + s[N * m + 1]
    costate = ca.vertcat(P_1 * angle + P_2 * velocity, P_2 * angle + P_3 * velocity, ca.MX.zeros(m - 2))
    worst, whole, ordered = ca.MX(0), ca.MX(0), ca.MX(1)
    for k in reversed(range(N)):
        force, (low, high) = _at(k, rows, forces), ca.vertsplit(bounds[3 * k + 1 : 3 * k + 3])
        own = _at(k, m, s), e[k], *_dynamics(k, n, A, B), _at(k, 2, data)
        costate, by_e = slope(n, rows)(costate, *own, force, w)
        steep = curvature[k] if rows > TORQUE_ALONE else law[(2 * m + 3) * (k + 1) - 1]
        wrong = [ca.fabs(e[k] - _clipped(e[k] - by_e / steep, low, high))]
        numbers = (e[k], e[k] - s[m * k + n], s[m * (k + 1)], s[m * (k + 1) + 1])
        wrong += [_missing(k, i, rows, numbers[i], force[i], steep, **fences) for i in range(1, rows)]
        ordered = ca.logic_and(ordered, low <= high)
        for each in wrong:
            worst, whole = ca.fmax(worst, each), whole + each
    return {"worst": ca.if_else(ordered, (worst + 0 * whole) / unit, np.inf)}


def _missing(k: int, i: int, rows: int, q: Any, force: Any, curvature: Any, moved: Any, prices: Any, fence: Any) -> Any:
    """Error of the force of an interval, expressed as a torque."""
    stiff, place = curvature / (moved[i] * moved[i]), 2 * (rows * k + i)
    up = _clipped(force + stiff * (q - fence[place + 1]), 0, prices[i])
    down = _clipped(force + stiff * (q - fence[place]), -prices[i], 0)
    return ca.fmax(_DIGITS * ca.fabs(force), ca.fabs(up + down - force)) / stiff / moved[i]


def _clipped(x: Any, low: Any, high: Any) -> Any:
    return ca.if_else(x < low, low, ca.if_else(x > high, high, x))


def _end_weights(tuning: Any) -> tuple[Any, Any, Any]:
    return tuning[Tuning.END], tuning[Tuning.END_BOTH], tuning[Tuning.END_VELOCITY]


def _dynamics(k: int, n: int, A: Any, B: Any) -> tuple[Any, Any]:
    """A and B of a stage."""
    return ca.reshape(_at(k, n * n, A), n, n), ca.reshape(_at(k, 2 * n, B), n, 2)


def _at(k: int, width: int, array: Any) -> Any:
    """The part of an array that belongs to stage k."""
    return array[width * k : width * (k + 1)]
