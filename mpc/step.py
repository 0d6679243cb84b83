"""One sample of the controller without machine code: the same stages as in step.c, looped by CasADi's virtual machine.

Both forms work on the same arrays, so that either can go on where the other has stopped, and give the same numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpc.estimator import Estimator
from mpc.feed_forward import ease
from mpc.governor import Governor, followable
from mpc.kernel import Kernel, along_the_way, unrolled
from mpc.prepared import prepared
from mpc.preview import preview, prolonged
from mpc.real_time_iteration import RealTimeIteration
from mpc.riccati import TORQUE_ALONE
from mpc.slots import Belief, Fed, Outcome, Path, Tuning
from mpc.split import split
from mpc.trouble import Trouble

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
        friction: tuple[Any, Any, Any],
        watch: Any,
    ) -> None:
        """On the arrays of a controller; friction: `mpc.friction.rub`, `learn`, and `mpc.feed_forward.demand`."""
        N, late = sizes["horizon"], sizes["late"]
        n = len(estimator.predictor.model.states)
        self._late, self._dt = late, float(arrays["model"][-1])
        self._estimator, self._governor = estimator, governor
        governor.speeds = np.zeros(N + 1)
        self._iteration = RealTimeIteration(sizes, arrays, estimator)
        self.program = self._iteration.program
        self._a, self._places = arrays, np.arange(N)
        self._states = arrays["states"].reshape(-1, n)
        machine = arrays["machine"]
        self._preview = Kernel(preview(), {0: arrays["numbers"], 2: arrays["tuning"][Tuning.ATTAINABLE :][:1]})
        self._followable = Kernel(followable(), {1: arrays["load"], 2: machine, 3: arrays["tuning"]})
        rub, learn, demand = friction
        learnt, same, rubbing = arrays["learnt"], arrays["model"], arrays["rubbing"]
        self._learn = Kernel(learn, {0: estimator.belief, 1: learnt, 3: same, 4: rubbing, 5: arrays["tuning"]})
        self._rub = Kernel(along_the_way(rub, N, 1), {3: learnt, 4: same, 5: rubbing}, {0: arrays["rub"]})
        self._demand_first = Kernel(demand, {3: same})
        self._demand = Kernel(unrolled(demand.map(N), N, demand), {3: np.tile(same, N)}, {0: arrays["taken"]})
        self._ease = Kernel(along_the_way(ease(), N, 1), {2: rubbing})
        shared = {0: estimator.belief, 2: arrays["watched"], 4: arrays["acting"], 5: arrays["watching"]}
        self._watch = Kernel(watch, shared)
        to_split = prepared(split()).function
        inputs = {0: arrays["preload"], 3: arrays["acceleration"], 4: np.tile(arrays["split_numbers"], N)}
        self._split = Kernel(unrolled(to_split.mapaccum(N), N, to_split), inputs, {1: arrays["torques"]})

    def __call__(self, angle: float, previewed: bool) -> int:
        """The measured angle in, the torques and all else in the arrays; what went wrong, see `Trouble`."""
        with np.errstate(all="ignore"):  # absurd numbers may overflow; every result is checked
            return self._sample(float(angle), previewed)

    def _sample(self, angle: float, previewed: bool) -> int:
        past = self._a["past"]
        self._lapse()
        angle, out = self._watched(angle)
        _, first, second = self._a["readings"].tolist()
        deaf = float(self._a["rubbing"][3]) if self._a["learnt"][6] == 0 else 0.0
        trouble = self._estimator.update(angle, past[1], past[0], (first, second), deaf)
        if out:
            trouble = trouble & ~Trouble.BRIDGED | Trouble.CONTRADICTED
        if self._estimator.belief[Belief.KNOWN]:
            trouble |= self._look(previewed)
            self._aim(previewed and not trouble & Trouble.AIMLESS)
            trouble |= self._astray()
            self._rubbed()
            self._feed_forward()
            trouble |= self._plan_ahead()
        else:
            self._hold()
        self._a["outcome"][Outcome.DISTURBANCE] = self._estimator.belief[Belief.DISTURBANCE]
        self._move_on()
        return trouble

    def _move_on(self) -> None:
        """The torques under way move on by a sample."""
        for name in ("past", "rubs"):
            self._a[name][:-1] = self._a[name][1:]

    def _miss(self) -> None:
        """A sample that was missed: the last torques were held, and nothing was read."""
        past, plan = self._a["past"], self._a["plan"]
        self._estimator.acting[-1] = self._dt
        self._estimator.update(np.nan, past[1], past[0])
        self._move_on()
        plan[1:-1] = plan[2:]
        self._a["watched"][1] = 0.0  # the model that runs free begins anew

    def _lapse(self) -> None:
        """The time since the last sample: whole samples that were missed, and what is left, which the model takes.

        The reference that is remembered by the sample moves on by as much.
        """
        a, dt, path, numbers = self._a, self._dt, self._governor.path, self._a["numbers"]
        elapsed, a["elapsed"][0] = float(a["elapsed"][0]), 0.0
        a["acting"][:] = a["model"]
        if not (elapsed > 0 and np.isfinite(elapsed)):
            return
        if elapsed > (a["guess"].size + 0.5) * dt:  # nothing is known any more
            self._estimator.belief[Belief.KNOWN] = path[Path.GOVERNED] = a["plan"][0] = numbers[0] = 0.0
            return
        if numbers[0] > 1:
            numbers[1:] += (elapsed / dt - 1) * (numbers[3] - numbers[2])
        late, bend = elapsed - dt, a["fed"][Fed.BEND] if np.isfinite(a["fed"][Fed.BEND]) else 0.0
        path[Path.ANGLE] += late * (path[Path.RATE] + late * (bend / (2 * dt)))
        path[Path.RATE] += late * (bend / dt)
        missed = int(elapsed / dt - 0.5) if elapsed > dt else 0
        for _ in range(missed):
            self._miss()
        a["acting"][-1] = elapsed - missed * dt

    def _watched(self, angle: float) -> tuple[float, bool]:
        """The angle on its turn, or NaN, as the motors' readings, where it is contradicted, and whether anything is."""
        a, watch = self._a, self._watch
        a["readings"][0] = angle
        watch.inputs[1][:] = a["readings"][: watch.inputs[1].size]
        past, newest = a["past"], a["past"][1] + a["rubs"][1]
        watch.inputs[3][:] = past[1], past[0], newest
        belief, reading, watched, load_out, motors_out = watch()
        self._estimator.belief[:], a["watched"][:] = belief, watched
        if motors_out[0]:
            a["readings"][1:] = np.nan
        a["readings"][0] = np.nan if load_out[0] else reading[0]
        return float(a["readings"][0]), bool(load_out[0] or motors_out[0])

    def _look(self, previewed: bool) -> int:
        """The wanted angle over the horizon; of a reference that is one number only that number is given."""
        wanted, numbers = self._a["wanted"], self._a["numbers"]
        trouble = Trouble.NONE if np.isfinite(wanted if previewed else wanted[0]).all() else Trouble.AIMLESS
        if trouble:
            previewed, wanted[0] = False, self._estimator.belief[Belief.ANGLE]
        if previewed:
            numbers[0] = 0.0
            return trouble
        self._preview.inputs[1][0] = wanted[0]
        after, speed = self._preview()
        numbers[:] = after
        wanted[1:] = wanted[0] + speed * np.arange(1, wanted.size)
        return trouble

    def _aim(self, previewed: bool) -> None:
        """What of it can be followed, over the horizon and as far beyond as a delay reaches."""
        angle, velocity = self._followable.inputs[0][:] = self._estimator.belief[3:5]
        limits, near = self._followable()
        if not self._governor.distance(float(angle)) <= near[0]:
            self._governor.restart(float(angle), float(velocity))
        governed = self._governor.govern(self._a["wanted"], (limits[0], limits[1]), previewed)
        self._a["ahead"][:] = prolonged(governed, self._late + 1)
        speeds, last = self._a["speeds"], governed.size - 1
        speeds[:last] = self._governor.speeds[:last]
        bend = speeds[last - 1] - speeds[last - 2]
        speeds[last:] = speeds[last - 1] + bend * np.arange(1, self._late + 3)

    def _astray(self) -> int:
        """Whether the load has been beside the governed reference for long."""
        ahead, mean, tuning = self._a["ahead"], self._a["astray"], self._a["tuning"]
        step = self._dt * tuning[Tuning.WAVE]
        admitted = tuning[Tuning.ASTRAY] + abs(ahead[2] - 2 * ahead[1] + ahead[0]) / (2 * step * step)
        miss = (ahead[0] - self._estimator.belief[Belief.ANGLE]) / admitted
        if not 0 <= mean[0] <= 2:
            mean[0] = 0.0
        square = miss * miss
        mean[0] += tuning[Tuning.SHARE] * ((square if square < 2 else 2.0) - mean[0])
        return Trouble.ASTRAY if mean[0] > 1 else Trouble.NONE

    def _rubbed(self) -> None:
        """What friction there will be on the way, and what is known of it by now."""
        a, belief, ahead, newest = self._a, self._estimator.belief, self._a["ahead"][self._late :], self._late + 1
        rubs, total = a["rubs"], a["past"][newest] + a["rubs"][newest]
        self._learn.inputs[2][:] = rubs[1], total, ahead[0], ahead[1], a["ahead"][a["rub"].size]
        learnt, disturbance = self._learn()
        a["learnt"][:] = learnt
        more = belief[Belief.DISTURBANCE] - disturbance[0]
        belief[Belief.DISTURBANCE] = disturbance[0]
        a["past"] += more
        rubs -= more
        a["plan"][1:] += more
        before, self._rub.inputs[2][0] = rubs[newest], total
        last = a["rub"].size - 1
        samples = abs(before) / a["rubbing"][4]  # until friction is back at zero
        lead = int(samples) if samples < last + 1 else last + 1
        place = np.minimum(self._places + lead, last)
        self._rub.inputs[0][0::2], self._rub.inputs[0][1::2] = ahead[place], ahead[place + 1]
        self._rub.inputs[1][0] = before
        self._rub()

    def _feed_forward(self) -> None:
        """The torque that the governed reference takes, and what of it is fed; before the first it is what acts."""
        a, ahead, speeds = self._a, self._a["ahead"][self._late :], self._a["speeds"][self._late :]
        fed, taken, feed, N = a["fed"], a["taken"], a["feed"], a["taken"].size
        known = fed[Fed.KNOWN] == 1.0 and np.isfinite(fed).all()
        if not known:
            fed[Fed.BEND] = speeds[1] - speeds[0]
            first = self._demand_first.inputs
            first[0][0], first[1][:], first[2][0] = ahead[0], speeds[:2], -fed[Fed.BEND]
            fed[Fed.EASED] = fed[Fed.TORQUE] = self._demand_first()[0][0]
            fed[Fed.EASED_CHANGE] = fed[Fed.CHANGE] = 0.0
        feed[0] = fed[Fed.TORQUE] if known else a["past"][self._late + 1] + self._estimator.belief[Belief.DISTURBANCE]
        angles, pairs, before, _ = self._demand.inputs
        angles[:], pairs[0::2], pairs[1::2] = ahead[:N], speeds[:N], speeds[1 : N + 1]
        before[0], before[1:] = fed[Fed.BEND], speeds[1:N] - speeds[: N - 1]
        _, bends = self._demand()
        fed[Fed.BEND] = bends[0]
        forward = self._eased(taken, fed[Fed.EASED : Fed.TORQUE])
        fed[Fed.EASED : Fed.TORQUE] = forward[0]
        there = forward[:, 0].copy()
        back = self._eased(taken[::-1], np.array([taken[-1], taken[-2] - taken[-1]]))[::-1, 0]
        eased = self._eased((there + back) / 2, fed[Fed.TORQUE :])
        feed[1:], fed[Fed.TORQUE :], fed[Fed.KNOWN] = eased[:, 0], eased[0], 1.0

    def _eased(self, torques: Array, before: Array) -> Array:
        """(N, 2) torques and their changes from sample to sample; overwritten by the next call."""
        self._ease.inputs[0][:], self._ease.inputs[1][:] = torques, before
        return self._ease()[0].reshape(-1, 2)

    def _plan_ahead(self) -> int:
        """The torques of the horizon for what was planned."""
        a, late, trouble = self._a, self._late, Trouble.NONE
        held, plan, guess = self.program.bounds[:, 0], a["plan"], a["guess"]
        if plan[0]:
            guess[:-1], guess[-1] = plan[2:], plan[-1]
            held[:-1] = held[1:]
            for active in (self.program.pressed, self.program.forces):
                active[:-1] = active[1:]
        else:
            guess[:], held[:] = a["past"][late + 1], 0.0
            self.program.pressed[:] = self.program.forces[:] = 0.0
        a["outcome"][Outcome.RESIDUAL] = self._iteration.optimise()
        if not plan[0]:
            trouble = Trouble.UNCERTIFIED
        states, s = self._states[late:], self.program.s
        a["angles"][:] = states[:, 0] + s[:, 0]
        speeds = states[:, 1] + s[:, 1]
        a["acceleration"][:] = (speeds[1:] - speeds[:-1]) / self._dt
        if not all(np.isfinite(part).all() for part in (a["acceleration"], plan, a["rub"])):
            self._hold()
            return Trouble.UNCERTIFIED
        a["load"][0] = plan[1] + a["rub"][0] - a["tuning"][Tuning.INERTIA] * a["acceleration"][0]
        self._split.inputs[1][:] = plan[1:] + a["rub"]
        self._split.inputs[2][:] = states[:-1, 1]
        preload, _, given, margin = self._split()
        a["preload"][0] = preload[0]
        a["outcome"][Outcome.MARGIN] = margin.min()
        a["past"][late + 2], a["rubs"][late + 2] = given[0] - a["rub"][0], a["rub"][0]
        if a["outcome"][Outcome.MARGIN] < -1e-9 * a["machine"][1]:
            trouble |= Trouble.PARTING
        low, high, speed, _, _, far, fast, _ = a["soft"].tolist()
        late_angles, late_speeds = a["angles"][1:], speeds[1:]
        beyond = (late_angles < low - far) | (late_angles > high + far) | (np.abs(late_speeds) > speed + fast)
        return trouble | (Trouble.BEYOND if self.program.rows > TORQUE_ALONE and beyond.any() else Trouble.NONE)

    def _hold(self) -> None:
        """Keep the teeth together with as little torque on the load as that allows, and know nothing."""
        a = self._a
        a["plan"][0], a["acceleration"][:] = 0.0, 0.0
        self._split.inputs[1][:], self._split.inputs[2][:] = 0.0, 0.0
        preload, _, given, margin = self._split()
        a["preload"][0] = preload[0]
        a["angles"][:] = np.nan
        a["outcome"][Outcome.MARGIN], a["outcome"][Outcome.RESIDUAL] = margin[0], np.inf
        a["past"][self._late + 2] = given[0]
        a["rubs"][self._late + 2] = 0.0
