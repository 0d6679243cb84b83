"""The real-time iteration: the model linearised along the last solution, and the quadratic program of that solved.

See the functions of the same names in step.c.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from mpc.corridor import corridor, enter
from mpc.estimator import Estimator
from mpc.kernel import Kernel, unrolled
from mpc.prepared import prepared
from mpc.quadratic_program import QuadraticProgram
from mpc.riccati import TORQUE_ALONE
from mpc.slots import Belief, Tuning
from mpc.split import reach
from mpc.sweeps import CERTIFIED

Array = NDArray[np.float64]

CONVERGED = 1e-9
"""Change of the torques at which a full solution ends, in units of the greatest torque."""


class RealTimeIteration:
    """One program a sample, or on request as many as it takes until the torques change no more.

    Attributes:
        program: the quadratic program.
    """

    def __init__(self, sizes: Mapping[str, int], arrays: Mapping[str, Array], estimator: Estimator) -> None:
        """On the arrays of a controller."""
        N, late = sizes["horizon"], sizes["late"]
        n = len(estimator.predictor.model.states)
        self._late, self._passes, self._dt = late, sizes["passes"], float(arrays["model"][-1])
        self._a, self._belief = arrays, estimator.belief
        self.program = QuadraticProgram(arrays, sizes["rounds"])
        self._states, self._range = arrays["states"].reshape(-1, n), arrays["range"].reshape(N, 2)
        stage = estimator.predictor.along.function
        along = unrolled(stage.mapaccum(late + N), late + N, stage)
        outputs = {0: arrays["states"][n:], 1: arrays["A"], 2: arrays["B"]}
        self._along = Kernel(along, {0: arrays["states"][:n], 2: np.tile(arrays["stage_numbers"], late + N)}, outputs)
        to_reach, reaching = prepared(reach()).function, {2: np.tile(arrays["reach_numbers"], N)}
        self._reach = Kernel(unrolled(to_reach.map(N), N, to_reach), reaching, {0: arrays["range"]})
        self._enter = Kernel(enter(), {0: arrays["states"][late * n : late * n + 2], 1: arrays["soft"]})
        confined = {0: self._enter.outputs[0], 2: np.tile(arrays["soft"], N), 3: np.full(N, self._dt)}
        self._corridor = Kernel(unrolled(corridor().mapaccum(N), N, corridor()), confined)

    def optimise(self) -> float:
        """Linearise, solve, and go on with the torques found; the residual."""
        a, program = self._a, self.program
        residual = float("inf")
        for place in range(self._passes):
            if place:
                a["guess"][:] = a["plan"][1:]
            self._linearise()
            residual = program.solve()
            a["plan"][0] = residual <= CERTIFIED
            if not a["plan"][0]:  # the guess, as far as the bounds let it stand
                program.bounds[:, 0] = -1.0
                program.bounds[:, 1] = np.clip(0.0, program.bounds[:, 1], program.bounds[:, 2])
                program.bounds[:, 2] = program.bounds[:, 1]
                program.sweep()
            a["plan"][1:] = np.clip(a["guess"] + program.e, self._range[:, 0], self._range[:, 1])
            if not np.max(np.abs(program.e)) > CONVERGED * a["unit"][0]:
                break
        return residual

    def _linearise(self) -> None:
        """The program around the course of the model under the guess."""
        a, late, program = self._a, self._late, self.program
        N, guess, past = a["guess"].size, a["guess"], a["past"]
        a["states"][: self._states.shape[1]] = self._belief[3 : 3 + self._states.shape[1]]
        held = np.concatenate((past[1 : late + 2], guess)) + self._belief[Belief.DISTURBANCE]
        self._along.inputs[1][0::2], self._along.inputs[1][1::2] = held[1:], held[:-1]
        self._along()
        states, ahead = self._states[late:], a["ahead"][late:]
        pace = states[:, 1]
        self._reach.inputs[0][:] = pace[:-1]
        self._reach.inputs[1][:] = (pace[1:] - pace[:-1]) / self._dt
        self._reach()
        steps = np.full(N, np.inf)
        if a["tuning"][Tuning.TORQUE_STEP] < np.inf:
            self._range[:], steps = within_rate(
                self._range, past[late + 1] + a["rubs"][late + 1], a["tuning"][Tuning.TORQUE_STEP]
            )
        a["unit"][0] = np.abs(a["range"]).max()
        self._range[:] -= a["rub"][:, None]  # what is left to the net torque
        program.bounds[:, 1:] = self._range - guess[:, None]
        program.data[1:, 0] = states[1:-1, 0] - ahead[1:N]
        changes = np.diff(guess, prepend=past[late + 1])
        program.data[:, 1] = changes - np.diff(a["feed"])
        if program.rows > TORQUE_ALONE:
            rubs = np.diff(a["rub"], prepend=a["rubs"][late + 1])
            program.fence[:, 1] = np.stack((-steps, steps), axis=-1) - changes[:, None] - rubs[:, None]
            self._enter()
            for place in range(3):
                self._corridor.inputs[1][place::3] = ahead[place : place + N]
            _, ends = self._corridor()
            program.fence[:, 2:] = ends.reshape(N, 2, 2) - states[1:, :2, None]
        program.end[0] = states[-1, 0] - ahead[N]
        program.end[1] = pace[-1] - (ahead[N + 1] - ahead[N - 1]) / (2 * self._dt)


def within_rate(ranges: Array, last: float, step: float) -> tuple[Array, Array]:
    """What of the ranges (N, 2) can be reached from a last torque in steps of bounded size, and these sizes (N,) [N m].

    Where the range is out of reach the step yields, and the torque goes to the nearest end.
    """
    reached, steps, (low, high) = np.empty_like(ranges), np.empty(len(ranges)), (last, last)
    for k, (least, most) in enumerate(ranges.tolist()):
        before = low, high
        reached[k] = low, high = min(max(low - step, least), most), max(min(high + step, most), least)
        steps[k] = max(step, low - before[1], before[0] - high)
    return reached, steps
