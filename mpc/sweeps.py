"""The quadratic program of a step on its arrays: sweeps over its stages, and how far a point is from solving it."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from mpc.kernel import Kernel, unrolled
from mpc.riccati import TORQUE_ALONE, backward, forward, slope, triangle
from mpc.slots import Tuning

Array = NDArray[np.float64]

CERTIFIED = 1e-6
"""Largest residual of an accepted solution, in units of the greatest torque."""

_DIGITS = 2.3e-16
"""What a number is rounded by, in units of itself."""


class Sweeps:
    """The program of `mpc.riccati` before it is solved, on arrays that others fill.

    Attributes:
        rows: how many numbers of a stage have an interval: the torque alone, or also its change, the next angle and the
            next velocity.
        data: (N, 2) miss [rad] and rate [N m] of each stage.
        bounds: (N, 3) the bound that holds, or 0 for none (see `mpc.riccati.backward`), least and greatest change of
            the torque [N m].
        fence: (N, rows, 2) ends of the intervals, the torque's own standing in `bounds`.
        prices: (rows,) of leaving each interval by so much, inf where it cannot be left.
        moved: (rows,) by how much a torque of 1 N m moves each number in a sample: the scale of their errors.
        end: (2,) miss of the last angle and velocity [rad, rad/s].
        e: (N,) change of the torques [N m], the solution.
        s: (N + 1, n + 1) what it makes of states and last torque.
        pressed: (N, rows) which numbers beside the torque are held at their upper or lower end (1, -1), or given up to
            its price (2, -2).
        forces: (N, rows) with which the intervals push back, as far as they are needed besides `bounds`.
        held: (N,) what the last sweep says about the bounds.
        barrier: (N, 2 rows) what the interior point method adds to the cost.
    """

    def __init__(self, arrays: Mapping[str, Array], rounds: int) -> None:
        """For arrays by name; `rounds` bounds the sweeps of each method."""
        self.rounds, self.unit, self._tuning = rounds, arrays["unit"], arrays["tuning"]
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
        self._V, self._v = np.zeros(triangle(n + 1).nnz()), np.zeros(n + 1)
        w = self.rate_weight
        self._sweep = Kernel(
            sweep(n, N, self.rows),
            {0: self._V, 1: self._v, 2: A, 3: B, 4: arrays["data"], 5: arrays["bounds"], 6: arrays["barrier"], 7: w},
            {0: self.e, 1: self.held, 2: arrays["s"][n + 1 :], 3: arrays["law"]},
        )
        course, after = forward(n).mapaccum(N), {0: arrays["s"][n + 1 :], 1: self.e}
        by_law = {1: A, 2: B, 3: arrays["law"], 4: arrays["bounds"]}
        self._course = Kernel(unrolled(course, N, forward(n)), by_law, after)
        inputs = {1: arrays["s"][: -n - 1], 2: self.e, 3: A, 4: B, 5: arrays["data"], 6: arrays["forces"], 7: w}
        self._slopes = Kernel(slopes(n, N, self.rows), inputs)

    def sweep(self) -> bool:
        """Backward for the law, forward for the torques; whether the bounds that hold stay the same."""
        P = self._tuning[Tuning.END : Tuning.END_VELOCITY + 1]
        self._V[:3] = P
        self._v[0] = P[0] * self.end[0] + P[1] * self.end[1]
        self._v[1] = P[1] * self.end[0] + P[2] * self.end[1]
        self._sweep()
        return bool((self.held == self.bounds[:, 0]).all())

    def follow(self, e: Array) -> None:
        """Where these torques lead."""
        self.law[:, : self.s.shape[1]], self.law[:, self.s.shape[1]] = 0.0, e
        self._course()

    def numbers(self) -> Array:
        """(N rows,) what has intervals, stage by stage."""
        every = np.stack((self.e, self.e - self.s[:-1, -1], self.s[1:, 0], self.s[1:, 1]), axis=-1)
        return every[:, : self.rows].ravel()

    def residual(self) -> float:
        """How far from the minimiser, in units of the greatest torque: zero there.

        The largest of |e - clip(e - slope/curvature, low, high)|, and for each other interval of what its force f would
        have to change by, seen as a torque m f/curvature with the stage's m = moved:

            f = clip(f + (q - high) curvature/m^2, 0, price) + clip(f + (q - low) curvature/m^2, -price, 0)

        and no less than what f is rounded by: a force beyond all digits would hide how far q is off.
        """
        low, high = self.bounds[:, 1], self.bounds[:, 2]
        P, (angle, velocity) = self._tuning[Tuning.END : Tuning.END_VELOCITY + 1], self.end + self.s[-1, :2]
        self._slopes.inputs[0][:2] = P[0] * angle + P[1] * velocity, P[1] * angle + P[2] * velocity
        (slope_e,) = self._slopes()
        curvature = self.law[:, -1] if self.rows == TORQUE_ALONE else self.curvature
        pulled = np.clip(self.e - slope_e / curvature, low, high)
        worst = float(np.max(np.abs(self.e - pulled)))
        if self.rows > TORQUE_ALONE:
            f, q = self.forces[:, 1:], self.numbers().reshape(-1, self.rows)[:, 1:]
            moved, price = self.moved[1:], self.prices[1:]
            stiff = curvature[:, None] / (moved * moved)
            up = np.clip(f + stiff * (q - self.fence[:, 1:, 1]), 0.0, price)
            down = np.clip(f + stiff * (q - self.fence[:, 1:, 0]), -price, 0.0)
            missing = np.maximum(np.abs(up + down - f), _DIGITS * np.abs(f))
            worst = float(np.max(missing / stiff / moved, initial=worst))
        return worst / float(self.unit[0])


@lru_cache(maxsize=64)
def sweep(n: int, N: int, rows: int) -> Any:
    """One sweep over N stages: (V, v at the end, A, B, data, bounds, barrier, w) -> e, held, s[1..N], law."""
    m = n + 1
    V, v = ca.MX.sym("V", triangle(m)), ca.MX.sym("v", m)
    A, B = ca.MX.sym("A", n, n * N), ca.MX.sym("B", n, 2 * N)
    data, bounds, w = ca.MX.sym("data", 2, N), ca.MX.sym("bounds", 3, N), ca.MX.sym("w")
    barrier = ca.MX.sym("barrier", 2 * rows, N)
    latest = [_reversed(stages, N) for stages in (A, B, data, bounds, barrier)]
    _, _, law = backward(n, rows).mapaccum("laws", N, [0, 1], [0, 1])(V, v, *latest, ca.repmat(w, 1, N))
    law = _reversed(law, N)
    s, e, held = forward(n).mapaccum(N)(ca.MX(m, 1), A, B, law, bounds)
    loop = ca.Function("sweep", [V, v, A, B, data, bounds, barrier, w], [e, held, s, law])
    return unrolled(loop, N, backward(n, rows), forward(n))


@lru_cache(maxsize=64)
def slopes(n: int, N: int, rows: int) -> Any:
    """The derivative of the cost by each torque: (costate at the end, s[0..N-1], e, A, B, data, forces, w) -> (N,)."""
    m = n + 1
    end, s, e = ca.MX.sym("end", m), ca.MX.sym("s", m, N), ca.MX.sym("e", 1, N)
    A, B = ca.MX.sym("A", n, n * N), ca.MX.sym("B", n, 2 * N)
    data, forces, w = ca.MX.sym("data", 2, N), ca.MX.sym("forces", rows, N), ca.MX.sym("w")
    latest = [_reversed(stages, N) for stages in (s, e, A, B, data, forces)]
    _, by_e = slope(n, rows).mapaccum(N)(end, *latest, ca.repmat(w, 1, N))
    loop = ca.Function("slopes", [end, s, e, A, B, data, forces, w], [_reversed(by_e, N)])
    return unrolled(loop, N, slope(n, rows))


def _reversed(stages: Any, N: int) -> Any:
    """The blocks of N stages beside each other, the last one first."""
    width = stages.shape[1] // N
    return stages[:, [k * width + i for k in range(N - 1, -1, -1) for i in range(width)]]
