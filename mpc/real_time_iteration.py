"""Real-time iteration: linearise the model along the last solution, and solve the resulting quadratic program.

See the functions of the same names in step.c.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from mpc.kernel import fused
from mpc.prediction import Predictor
from mpc.prepared import prepared
from mpc.quadratic_program import QuadraticProgram
from mpc.riccati import TORQUE_ALONE
from mpc.riccati_sweeps import CERTIFIED
from mpc.slots import Kalman, Tuning
from mpc.soft_limits import corridor, enter
from mpc.stage_allocation import reach

Array = NDArray[np.float64]

CONVERGED = 1e-9
"""Change of the torques below which the iteration has converged, in units of the greatest torque."""


class RealTimeIteration:
    """One program per sample, or several until the torques converge.

    Attributes:
        program: the quadratic program.
    """

    def __init__(self, sizes: Mapping[str, int], arrays: Mapping[str, Array], predictor: Predictor) -> None:
        """Work on the arrays of a controller."""
        N, self._late, self._passes = sizes["horizon"], sizes["late"], sizes["passes"]
        self._a, self._stage, self._n = arrays, predictor.along.function, len(predictor.model.states)
        self.program = QuadraticProgram(arrays, sizes["rounds"])
        self._range = arrays["range"].reshape(N, 2)
        self._least, self._most = self._range.T
        reads = "kalman past guess rubs rub ahead feed bounds tuning stage_numbers reach_numbers soft model"
        work = (self._late + N) * self._stage.n_instructions() + 100 * N
        own = ("bounds",)
        self._linearise = fused("linearise", arrays, reads, self._linearised, operations=work, in_place=own)

    def optimise(self) -> float:
        """Linearise, solve, and repeat with the new torques if requested; returns the residual."""
        a, program = self._a, self.program
        residual = float("inf")
        for place in range(self._passes):
            if place:
                a["guess"][:] = a["plan"][1:]
            self._linearise()
            residual = program.solve()
            a["plan"][0] = residual <= CERTIFIED
            if not a["plan"][0]:  # fall back to the guess, clipped to the bounds
                program.bounds[:, 0] = -1.0
                program.bounds[:, 1] = np.clip(0.0, program.bounds[:, 1], program.bounds[:, 2])
                program.bounds[:, 2] = program.bounds[:, 1]
                program.sweep()
            np.minimum(np.maximum(a["guess"] + program.e, self._least), self._most, out=a["plan"][1:])
            if self._passes == 1 or not np.max(np.abs(program.e)) > CONVERGED * a["unit"][0]:
                break
        return residual

    def _linearised(self, past: Any, guess: Any, rubs: Any, rub: Any, **known: Any) -> dict[str, Any]:
        """The program, linearised along the prediction of the model with the guess."""
        late, N, n, dt = self._late, guess.numel(), self._n, known["model"][-1]
        kalman, ahead, step = known["kalman"], known["ahead"][late:], known["tuning"][Tuning.TORQUE_STEP]
        held, state = ca.vertcat(past[1 : late + 2], guess) + kalman[Kalman.DISTURBANCE], kalman[3 : 3 + n]
        states, A, B = [state], [], []
        for k in range(late + N):
            state, by_state, by_torque = self._stage(state, ca.vertcat(held[k + 1], held[k]), known["stage_numbers"])
            states.append(state)
            A.append(ca.vec(by_state))
            B.append(ca.vec(by_torque))
        course, made = states[late:], {"states": ca.vertcat(*states), "A": ca.vertcat(*A), "B": ca.vertcat(*B)}
        changes = guess - ca.vertcat(past[late + 1], guess[:-1])
        rates = changes - (known["feed"][1:] - known["feed"][:-1])
        misses = [0, *(course[k][0] - ahead[k] for k in range(1, N))]
        paces = [(course[k + 1][1] - course[k][1]) / dt for k in range(N)]
        ends = [prepared(reach()).function(course[k][1], paces[k], known["reach_numbers"]) for k in range(N)]
        reached = within_rate([(each[0], each[1]) for each in ends], past[late + 1] + rubs[late + 1], step)
        ranges, unit = [], ca.MX(0)
        for k, (low, high, _) in enumerate(reached):
            unit = ca.fmax(unit, ca.fmax(ca.fabs(low), ca.fabs(high)))
            ranges += [low - rub[k], high - rub[k]]  # range of the net torque
        kept = [known["bounds"][3 * k] for k in range(N)]
        bounds = [(kept[k], ranges[2 * k] - guess[k], ranges[2 * k + 1] - guess[k]) for k in range(N)]
        made |= {
            "range": ca.vertcat(*ranges),
            "unit": unit,
            "bounds": ca.vertcat(*(x for each in bounds for x in each)),
        }
        made["data"] = ca.vertcat(*(x for k in range(N) for x in (misses[k], rates[k])))
        made["end"] = ca.vertcat(course[N][0] - ahead[N], course[N][1] - (ahead[N + 1] - ahead[N - 1]) / (2 * dt))
        if self.program.rows > TORQUE_ALONE:
            steps = [most for _, _, most in reached]
            made["fence"] = _confined(course, ahead, steps, changes, rub, rubs[late + 1], known["soft"], dt)
        return made


def within_rate(ends: list[tuple[Any, Any]], last: Any, step: Any) -> list[tuple[Any, Any, Any]]:
    """The parts of the ranges (N,) that are reachable from the last torque under a rate limit, and these steps [N m].

    If a range is out of reach, the rate limit is relaxed, and the torque goes to the nearest end.
    """
    low, high, reached = last, last, []
    for least, most in ends:
        before_low, before_high = low, high
        low, high = ca.fmin(ca.fmax(low - step, least), most), ca.fmax(ca.fmin(high + step, most), least)
        reached.append((low, high, ca.fmax(step, ca.fmax(low - before_high, before_low - high))))
    return reached


def _confined(
    course: list[Any], ahead: Any, steps: list[Any], changes: Any, rub: Any, rubbed: Any, soft: Any, dt: Any
) -> Any:
    """The intervals of the constrained quantities other than the torque, relative to their values with the guess."""
    memory, fence = enter()(course[0][:2], soft), []
    for k, step in enumerate(steps):
        memory, (least, most, slowest, fastest) = _corridor(memory, ahead[k : k + 3], soft, dt)
        more = rub[k] - (rub[k - 1] if k else rubbed)
        fence += [0, 0, -step - changes[k] - more, step - changes[k] - more]
        angle, speed = course[k + 1][0], course[k + 1][1]
        fence += [least - angle, most - angle, slowest - speed, fastest - speed]
    return ca.vertcat(*fence)


def _corridor(memory: Any, ahead: Any, soft: Any, dt: Any) -> tuple[Any, list[Any]]:
    memory, ends = corridor()(memory, ahead, soft, dt)
    return memory, ca.vertsplit(ends)
