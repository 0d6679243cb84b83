"""One sample of the controller without machine code: the same stages as in step.c, looped by CasADi's virtual machine.

Both forms work on the same arrays, so that either can go on where the other has stopped, and give the same numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpc.corridor import corridor, enter
from mpc.estimator import Estimator
from mpc.governor import Governor, followable
from mpc.kernel import Kernel, unrolled
from mpc.prepared import prepared
from mpc.preview import preview, prolonged
from mpc.programme import CERTIFIED, Programme
from mpc.riccati import TORQUE_ALONE
from mpc.split import reach, split
from mpc.trouble import Trouble

Array = NDArray[np.float64]

CONVERGED = 1e-9
"""Change of the torques at which a full solution ends, in units of the greatest torque."""


class InterpretedStep:
    """The whole step, stage by stage: see the functions of the same names in step.c.

    Attributes:
        programme: the quadratic programme.
    """

    def __init__(
        self,
        sizes: Mapping[str, int],
        arrays: Mapping[str, Array],
        estimator: Estimator,
        governor: Governor,
        friction: tuple[Any, Any],
        watch: Any,
    ) -> None:
        """On the arrays of a controller; the functions of friction are `mpc.friction.rub` and `learn`."""
        N, late = sizes["horizon"], sizes["late"]
        n = len(estimator.predictor.model.states)
        self._late, self._passes, self._dt = late, sizes["passes"], float(arrays["model"][-1])
        self._estimator, self._governor = estimator, governor
        self.programme = Programme(arrays, sizes["rounds"])
        self._a = arrays
        self._states = arrays["states"].reshape(-1, n)
        self._range, self._torques = arrays["range"].reshape(N, 2), arrays["torques"].reshape(N, 2)
        machine = arrays["machine"]
        self._preview = Kernel(preview(), {0: arrays["numbers"], 2: arrays["tuning"][7:8]})
        self._followable = Kernel(followable(), {1: arrays["load"], 2: machine, 3: arrays["tuning"]})
        stage = estimator.predictor.along.function
        along = unrolled(stage.mapaccum(late + N), late + N, stage)
        outputs = {0: arrays["states"][n:], 1: arrays["A"], 2: arrays["B"]}
        self._along = Kernel(along, {0: arrays["states"][:n], 2: np.tile(arrays["stage_numbers"], late + N)}, outputs)
        to_reach, to_split = prepared(reach()).function, prepared(split()).function
        reaching = {2: np.tile(arrays["reach_numbers"], N)}
        self._reach = Kernel(unrolled(to_reach.map(N), N, to_reach), reaching, {0: arrays["range"]})
        rub, learn = friction
        learnt, same, rubbing = arrays["learnt"], arrays["model"], arrays["rubbing"]
        self._learn = Kernel(learn, {0: estimator.belief, 1: learnt, 3: same, 4: rubbing, 5: arrays["tuning"]})
        self._rub = Kernel(rub, {3: learnt, 4: same, 5: rubbing})
        shared = {0: estimator.belief, 2: arrays["watched"], 4: arrays["acting"], 5: arrays["watching"]}
        self._watch = Kernel(watch, shared)
        self._enter = Kernel(enter(), {0: arrays["states"][late * n : late * n + 2], 1: arrays["soft"]})
        confined = {0: self._enter.outputs[0], 2: np.tile(arrays["soft"], N), 3: np.full(N, self._dt)}
        self._corridor = Kernel(unrolled(corridor().mapaccum(N), N, corridor()), confined)
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
        if self._estimator.belief[0]:
            trouble |= self._look(previewed)
            self._aim(previewed and not trouble & Trouble.AIMLESS)
            trouble |= self._astray()
            self._rubbed()
            trouble |= self._plan_ahead()
        else:
            self._hold()
        self._a["outcome"][1] = self._estimator.belief[2]
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
            self._estimator.belief[0] = path[0] = a["plan"][0] = numbers[0] = 0.0
            return
        if numbers[0] > 1:
            numbers[1:] += (elapsed / dt - 1) * (numbers[3] - numbers[2])
        path[1] += path[2] * (elapsed - dt)
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
            previewed, wanted[0] = False, self._estimator.belief[3]
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

    def _astray(self) -> int:
        """Whether the load has been beside the governed reference for long."""
        ahead, mean, tuning = self._a["ahead"], self._a["astray"], self._a["tuning"]
        step = self._dt * tuning[6]
        admitted = tuning[9] + abs(ahead[2] - 2 * ahead[1] + ahead[0]) / (2 * step * step)
        miss = (ahead[0] - self._estimator.belief[3]) / admitted
        if not 0 <= mean[0] <= 2:
            mean[0] = 0.0
        square = miss * miss
        mean[0] += tuning[10] * ((square if square < 2 else 2.0) - mean[0])
        return Trouble.ASTRAY if mean[0] > 1 else Trouble.NONE

    def _rubbed(self) -> None:
        """What friction there will be on the way, and what is known of it by now."""
        a, belief, ahead, newest = self._a, self._estimator.belief, self._a["ahead"][self._late :], self._late + 1
        rubs, total = a["rubs"], a["past"][newest] + a["rubs"][newest]
        self._learn.inputs[2][:] = rubs[1], total, ahead[0], ahead[1], a["ahead"][a["rub"].size]
        learnt, disturbance = self._learn()
        a["learnt"][:] = learnt
        more = belief[2] - disturbance[0]
        belief[2] = disturbance[0]
        a["past"] += more
        rubs -= more
        a["plan"][1:] += more
        before, self._rub.inputs[2][0] = rubs[newest], total
        last = a["rub"].size - 1
        samples = abs(before) / a["rubbing"][4]  # until friction is back at zero
        lead = int(samples) if samples < last + 1 else last + 1
        for k in range(last + 1):
            place = min(k + lead, last)
            self._rub.inputs[0][:], self._rub.inputs[1][0] = ahead[place : place + 2], before
            before = a["rub"][k] = self._rub()[0][0]

    def _plan_ahead(self) -> int:
        """The torques of the horizon for what was planned."""
        a, late, trouble = self._a, self._late, Trouble.NONE
        held, plan, guess = self.programme.bounds[:, 0], a["plan"], a["guess"]
        if plan[0]:
            guess[:-1], guess[-1] = plan[2:], plan[-1]
            held[:-1] = held[1:]
        else:
            guess[:], held[:] = a["past"][late + 1], 0.0
        a["outcome"][2] = self._optimise()
        if not plan[0]:
            trouble = Trouble.UNCERTIFIED
        states, s = self._states[late:], self.programme.s
        a["angles"][:] = states[:, 0] + s[:, 0]
        speeds = states[:, 1] + s[:, 1]
        a["acceleration"][:] = (speeds[1:] - speeds[:-1]) / self._dt
        if not all(np.isfinite(part).all() for part in (a["acceleration"], plan, a["rub"])):
            self._hold()
            return Trouble.UNCERTIFIED
        a["load"][0] = plan[1] + a["rub"][0] - a["tuning"][4] * a["acceleration"][0]
        self._split.inputs[1][:] = plan[1:] + a["rub"]
        self._split.inputs[2][:] = states[:-1, 1]
        preload, _, given, margin = self._split()
        a["preload"][0] = preload[0]
        a["outcome"][0] = margin.min()
        a["past"][late + 2], a["rubs"][late + 2] = given[0] - a["rub"][0], a["rub"][0]
        if a["outcome"][0] < -1e-9 * a["machine"][1]:
            trouble |= Trouble.PARTING
        low, high, speed, _, _, far, fast, _ = a["soft"].tolist()
        late_angles, late_speeds = a["angles"][1:], speeds[1:]
        beyond = (late_angles < low - far) | (late_angles > high + far) | (np.abs(late_speeds) > speed + fast)
        return trouble | (Trouble.BEYOND if self.programme.rows > TORQUE_ALONE and beyond.any() else Trouble.NONE)

    def _optimise(self) -> float:
        """Linearise, solve, and go on with the torques found; the residual."""
        a, programme = self._a, self.programme
        residual = float("inf")
        for place in range(self._passes):
            if place:
                a["guess"][:] = a["plan"][1:]
            self._linearise()
            residual = programme.solve()
            a["plan"][0] = residual <= CERTIFIED
            if not a["plan"][0]:  # the guess, as far as the bounds let it stand
                programme.bounds[:, 0] = -1.0
                programme.bounds[:, 1] = np.clip(0.0, programme.bounds[:, 1], programme.bounds[:, 2])
                programme.bounds[:, 2] = programme.bounds[:, 1]
                programme.sweep()
            a["plan"][1:] = np.clip(a["guess"] + programme.e, self._range[:, 0], self._range[:, 1])
            if not np.max(np.abs(programme.e)) > CONVERGED * a["unit"][0]:
                break
        return residual

    def _linearise(self) -> None:
        """The programme around the course of the model under the guess."""
        a, late, programme = self._a, self._late, self.programme
        N, guess, past = a["guess"].size, a["guess"], a["past"]
        a["states"][: self._states.shape[1]] = self._estimator.belief[3 : 3 + self._states.shape[1]]
        held = np.concatenate((past[1 : late + 2], guess)) + self._estimator.belief[2]
        self._along.inputs[1][0::2], self._along.inputs[1][1::2] = held[1:], held[:-1]
        self._along()
        states, ahead = self._states[late:], a["ahead"][late:]
        pace = states[:, 1]
        self._reach.inputs[0][:] = pace[:-1]
        self._reach.inputs[1][:] = (pace[1:] - pace[:-1]) / self._dt
        self._reach()
        steps = np.full(N, np.inf)
        if a["tuning"][8] < np.inf:
            self._range[:], steps = within_rate(self._range, past[late + 1] + a["rubs"][late + 1], a["tuning"][8])
        a["unit"][0] = np.abs(a["range"]).max()
        self._range[:] -= a["rub"][:, None]  # what is left to the net torque
        programme.bounds[:, 1:] = self._range - guess[:, None]
        programme.data[1:, 0] = states[1:-1, 0] - ahead[1:N]
        programme.data[0, 1] = guess[0] - past[late + 1]
        programme.data[1:, 1] = guess[1:] - guess[:-1]
        if programme.rows > TORQUE_ALONE:
            rubs = np.diff(a["rub"], prepend=a["rubs"][late + 1])
            programme.fence[:, 1] = np.stack((-steps, steps), axis=-1) - programme.data[:, 1:] - rubs[:, None]
            self._enter()
            for place in range(3):
                self._corridor.inputs[1][place::3] = ahead[place : place + N]
            _, ends = self._corridor()
            programme.fence[:, 2:] = ends.reshape(N, 2, 2) - states[1:, :2, None]
        programme.end[0] = states[-1, 0] - ahead[N]
        programme.end[1] = pace[-1] - (ahead[N + 1] - ahead[N - 1]) / (2 * self._dt)

    def _hold(self) -> None:
        """Keep the teeth together with as little torque on the load as that allows, and know nothing."""
        a = self._a
        a["plan"][0], a["acceleration"][:] = 0.0, 0.0
        self._split.inputs[1][:], self._split.inputs[2][:] = 0.0, 0.0
        preload, _, given, margin = self._split()
        a["preload"][0] = preload[0]
        a["angles"][:] = np.nan
        a["outcome"][0], a["outcome"][2] = margin[0], np.inf
        a["past"][self._late + 2] = given[0]
        a["rubs"][self._late + 2] = 0.0


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
