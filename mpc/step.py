"""One sample of the controller without machine code: the same stages as in step.c, run by CasADi's virtual machine.

Both forms work on the same arrays and give the same numbers, so one can continue after the other.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np
from numpy.typing import NDArray

from mpc.estimator import Estimator
from mpc.feed_forward import fed_forward
from mpc.friction import known_by_now
from mpc.governor import Governor
from mpc.kernel import Kernel, along_the_way, fused
from mpc.outcome import holding, outcome
from mpc.real_time_iteration import RealTimeIteration
from mpc.reference import Aim
from mpc.riccati import TORQUE_ALONE
from mpc.slots import Fed, History, Kalman, Learnt, Outcome, Path, Rubbing
from mpc.stages import Stages
from mpc.status import Trouble

Array = NDArray[np.float64]


class InterpretedStep:
    """The whole step, stage by stage: see the functions of the same names in step.c.

    Attributes:
        program: the quadratic program.
    """

    def __init__(
        self,
        sizes: Mapping[str, int],
        arrays: Mapping[str, Array],
        estimator: Estimator,
        governor: Governor,
        stages: Stages,
    ) -> None:
        """Work on the arrays of a controller."""
        N, self._late = sizes["horizon"], sizes["late"]
        self._a, self._dt, self._estimator = arrays, float(arrays["model"][-1]), estimator
        self._aim = Aim(arrays, governor, self._late)
        self._iteration = RealTimeIteration(sizes, arrays, estimator.predictor)
        self.program = self._iteration.program
        rub, learn, demand = stages.friction
        own = dict(arrays) | {name: np.zeros(1) for name in ("d", "total", "margin", "given", "sound", "beyond")}
        self._own, self._places = own, np.arange(N)
        reads = "kalman learnt rubs past plan ahead model rubbing tuning"
        work = learn.n_instructions() + 4 * N
        self._learn = fused("known", own, reads, partial(known_by_now, learn, self._late), operations=work)
        same = {2: own["total"], 3: arrays["learnt"], 4: arrays["model"], 5: arrays["rubbing"]}
        self._rub = Kernel(along_the_way(rub, N, 1), same, {0: arrays["rub"]})
        reads = "ahead speeds fed past kalman model rubbing"
        work = N * (demand.n_instructions() + 60)
        self._feed_forward = fused("feed", own, reads, partial(fed_forward, demand, self._late), operations=work)
        shared = {0: estimator.kalman, 2: arrays["watched"], 4: arrays["acting"], 5: arrays["watching"]}
        self._watch = Kernel(stages.watch, shared)
        reads = "plan rub states s preload allocation_numbers tuning soft model"
        come = partial(outcome, len(estimator.predictor.model.states), self.program.rows > TORQUE_ALONE)
        self._outcome = fused("outcome", own, reads, come, operations=150 * N, in_place=("preload",))
        reads = "preload allocation_numbers plan"
        self._holding = fused("holding", own, reads, holding, operations=120 * N, in_place=("preload",))

    def __call__(self, angle: float, previewed: bool) -> int:
        """One sample from the measured angle; the results are in the arrays. Returns the problems, see `Trouble`."""
        with np.errstate(all="ignore"):  # absurd numbers may overflow; every result is checked
            return self._sample(float(angle), previewed)

    def _sample(self, angle: float, previewed: bool) -> int:
        a, kalman = self._a, self._estimator.kalman
        self._lapse()
        angle, out = self._watched(angle)
        first, second = a["measurements"][1:].tolist()
        deaf = float(a["rubbing"][Rubbing.DEAF]) if a["learnt"][Learnt.DIRECTION] == 0 else 0.0
        before, last = a["past"][:2].tolist()
        trouble = self._estimator.update(angle, last, before, (first, second), deaf)
        if out:
            trouble = trouble & ~Trouble.ANGLE_PREDICTED | Trouble.ENCODER_FAULT
        if kalman[Kalman.KNOWN]:
            trouble |= self._aim.look(previewed)
            trouble |= self._aim.aim(previewed and not trouble & Trouble.NO_REFERENCE)
            self._adapt_friction()
            a["fed"][:] = self._feed_forward()[0]
            trouble |= self._plan_ahead()
        else:
            self._hold()
        a["outcome"][Outcome.DISTURBANCE] = kalman[Kalman.DISTURBANCE]
        self._move_on()
        return trouble

    def _move_on(self) -> None:
        """Shift the past torques by one sample."""
        for name in ("past", "rubs"):
            self._a[name][:-1] = self._a[name][1:]

    def _miss(self) -> None:
        """A missed sample: the last torques were held, and there was no measurement."""
        past, plan = self._a["past"], self._a["plan"]
        self._estimator.acting[-1] = self._dt
        self._estimator.update(np.nan, past[1], past[0])
        self._move_on()
        plan[1:-1] = plan[2:]
        self._a["watched"][1] = 0.0  # restart the free simulation of the fault detection

    def _lapse(self) -> None:
        """Process the time since the last sample: whole missed samples, and the remaining time for the next prediction.

        The stored reference samples are moved on accordingly.
        """
        a, dt = self._a, self._dt
        elapsed, a["elapsed"][0] = float(a["elapsed"][0]), 0.0
        a["acting"][:] = a["model"]
        if not (elapsed > 0 and np.isfinite(elapsed)):
            return
        path, history = a["path"], a["history"]
        if elapsed > (a["guess"].size + 0.5) * dt:  # the estimate is out of date
            a["kalman"][Kalman.KNOWN] = path[Path.GOVERNED] = a["plan"][0] = history[History.COUNT] = 0.0
            return
        if history[History.COUNT] > 1:
            history[History.FIRST :] += (elapsed / dt - 1) * (history[History.THIRD] - history[History.SECOND])
        late, velocity_change = (
            elapsed - dt,
            a["fed"][Fed.VELOCITY_CHANGE] if np.isfinite(a["fed"][Fed.VELOCITY_CHANGE]) else 0.0,
        )
        path[Path.ANGLE] += late * (path[Path.RATE] + late * (velocity_change / (2 * dt)))
        path[Path.RATE] += late * (velocity_change / dt)
        missed = int(elapsed / dt - 0.5) if elapsed > dt else 0
        for _ in range(missed):
            self._miss()
        a["acting"][-1] = elapsed - missed * dt

    def _watched(self, angle: float) -> tuple[float, bool]:
        """The unwrapped angle, NaN if it is faulty, and whether any encoder is; faulty motor angles become NaN."""
        a, watch = self._a, self._watch
        a["measurements"][0] = angle
        watch.inputs[1][:] = a["measurements"][: watch.inputs[1].size]
        before, last = a["past"][:2].tolist()
        watch.inputs[3][:] = last, before, last + a["rubs"][1]
        a["kalman"][:], measurement, a["watched"][:], load_out, motors_out = watch()
        if motors_out[0]:
            a["measurements"][1:] = np.nan
        a["measurements"][0] = np.nan if load_out[0] else measurement[0]
        return float(a["measurements"][0]), bool(load_out[0] or motors_out[0])

    def _adapt_friction(self) -> None:
        """Adapt friction, and compute its compensation along the path."""
        a, own, ahead, newest = self._a, self._own, self._a["ahead"][self._late :], self._late + 1
        a["learnt"][:], *_, a["past"][:], a["rubs"][:], a["plan"][:] = self._learn()
        a["kalman"][Kalman.DISTURBANCE] = own["d"][0]
        before, last = float(a["rubs"][newest]), a["rub"].size - 1
        samples = abs(before) / float(a["rubbing"][Rubbing.MOST_CHANGE])  # until friction is back at zero
        lead = int(samples) if samples < last + 1 else last + 1
        way, self._rub.inputs[1][0] = self._rub.inputs[0], before
        if lead:
            place = np.minimum(self._places + lead, last)
            way[0::2], way[1::2] = ahead[place], ahead[place + 1]
        else:
            way[0::2], way[1::2] = ahead[: last + 1], ahead[1 : last + 2]
        self._rub()

    def _plan_ahead(self) -> int:
        """Plan the net torques, and compute the drive torques over the horizon."""
        a, late, own, program, trouble = self._a, self._late, self._own, self.program, Trouble.NONE
        held, plan, guess = program.bounds[:, 0], a["plan"], a["guess"]
        if plan[0]:
            guess[:-1], guess[-1] = plan[2:], plan[-1]
            held[:-1] = held[1:]
            if program.rows > TORQUE_ALONE:
                for active in (program.pressed, program.forces):
                    active[:-1] = active[1:]
        else:
            guess[:], held[:] = a["past"][late + 1], 0.0
            program.pressed[:] = program.forces[:] = 0.0
        a["outcome"][Outcome.RESIDUAL] = self._iteration.optimise()
        if not plan[0]:
            trouble = Trouble.UNCERTIFIED
        preload, load = float(a["preload"][0]), float(a["load"][0])
        self._outcome()
        if not own["sound"][0]:
            a["preload"][0], a["load"][0] = preload, load
            self._hold()
            return Trouble.UNCERTIFIED
        a["outcome"][Outcome.MARGIN] = own["margin"][0]
        a["past"][late + 2], a["rubs"][late + 2] = own["given"][0] - a["rub"][0], a["rub"][0]
        if own["margin"][0] < -1e-9 * a["machine"][1]:
            trouble |= Trouble.CONTACT_AT_RISK
        return trouble | (Trouble.LIMIT_VIOLATED if own["beyond"][0] else Trouble.NONE)

    def _hold(self) -> None:
        """Without an estimate: keep contact with as little torque on the load as possible."""
        a, late = self._a, self._late
        self._holding()
        a["plan"][0], a["acceleration"][:], a["angles"][:] = 0.0, 0.0, np.nan
        a["outcome"][Outcome.MARGIN], a["outcome"][Outcome.RESIDUAL] = self._own["margin"][0], np.inf
        a["past"][late + 2], a["rubs"][late + 2] = self._own["given"][0], 0.0
