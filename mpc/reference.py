"""The reference over the horizon: as given by the caller, and as governed so that the torques can follow it.

See look, aim and following_error in step.c.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from mpc.governor import Governor, governed_path
from mpc.kernel import Kernel, fused
from mpc.preview import preview, prolonged
from mpc.slots import History, Kalman, Path, Rubbing, Tuning
from mpc.status import Trouble
from mpc.time_optimal_law import followable

Array = NDArray[np.float64]


class Aim:
    """Given reference, governed reference, and check of the following error."""

    def __init__(self, arrays: Mapping[str, Array], governor: Governor, late: int) -> None:
        """Work on the arrays of a controller."""
        self._a, self._governor, self._limited, self._late = arrays, governor, governor.soft is not None, late
        known = {0: arrays["history"], 2: arrays["tuning"][Tuning.ATTAINABLE :][:1]}
        self._preview = Kernel(preview(), known)
        own = dict(arrays) | {"path": governor.path, "limits": np.zeros(2)}
        own |= {"requested": np.zeros(arrays["wanted"].size), "changes": np.zeros(arrays["wanted"].size + 1)}
        where = "kalman load machine tuning path"
        self._begun = fused("begun", own, where, self._begin, operations=0)
        more = " requested changes soft rubbing govern_numbers following_error model"
        self._aimed = fused("aimed", own, where + more, self._followed, operations=100 * own["requested"].size)
        self._requested, self._changes, self._limits = own["requested"], own["changes"], own["limits"]
        self._counts = np.arange(1, arrays["wanted"].size)

    def look(self, previewed: bool) -> int:
        """Fill the wanted angle over the horizon and its changes; a scalar reference is extrapolated."""
        wanted, history, steps = self._a["wanted"], self._a["history"], self._a["steps"]
        trouble = Trouble.NONE if np.isfinite(wanted if previewed else wanted[0]).all() else Trouble.NO_REFERENCE
        if trouble:
            previewed, wanted[0] = False, self._a["kalman"][Kalman.ANGLE]
        if previewed:
            np.subtract(wanted[1:], wanted[:-1], out=steps)
            history[History.COUNT] = 0.0
            return trouble
        self._preview.inputs[1][0] = wanted[0]
        history[:], speed = self._preview()
        wanted[1:], steps[:] = wanted[0] + speed * self._counts, speed
        return trouble

    def aim(self, previewed: bool) -> int:
        """Fill the governed reference over horizon and dead time; returns whether the load does not follow it."""
        wanted, governor, limits = self._a["wanted"], self._governor, None
        if previewed and governor.sees_a_jump(wanted):
            governor.path[:], (backward, forward) = self._begun()
            limits = float(backward), float(forward)
        governor.ask(wanted, self._a["steps"], self._requested, self._changes, limits)
        path, _, _, mean = self._aimed()
        governor.path[:], self._a["following_error"][:] = path, mean
        return Trouble.NOT_FOLLOWING if mean[0] > 1 else Trouble.NONE

    @staticmethod
    def _begin(kalman: Any, load: Any, machine: Any, tuning: Any, path: Any) -> dict[str, Any]:
        """Start of the governed reference, at the load if the two are too far apart, and acceleration limits."""
        angle, velocity = kalman[Kalman.ANGLE], kalman[Kalman.VELOCITY]
        limits, near = followable()(ca.vertcat(angle, velocity), load, machine, tuning)
        goes_on = ca.logic_and(path[Path.GOVERNED] != 0, ca.fabs(angle - path[Path.ANGLE]) <= near)
        where = ca.if_else(goes_on, path, ca.vertcat(1, angle, velocity, 0))
        return {"path": where, "limits": limits[:2]}

    def _followed(self, requested: Any, changes: Any, following_error: Any, model: Any, **known: Any) -> dict[str, Any]:
        """The governed reference and its speeds."""
        soft, jerk, numbers = known.pop("soft"), known.pop("rubbing")[Rubbing.JERK], known.pop("govern_numbers")
        tuning, kalman = known["tuning"], known["kalman"]
        where, limits = self._begin(**known).values()
        own = tuning[Tuning.ATTAINABLE], jerk, numbers
        path, ahead, speeds = governed_path(self._limited, where, requested, changes, limits, soft, *own)
        last = speeds.numel() - 1
        acceleration = speeds[last - 1] - speeds[last - 2]
        farther = [speeds[last - 1] + acceleration * k for k in range(1, self._late + 3)]
        found = {"path": path, "ahead": prolonged(ahead, self._late + 1)}
        found["speeds"] = ca.vertcat(speeds[:last], *farther)
        return found | {"following_error": _off(found["ahead"], kalman, following_error, tuning, model[-1])}


def _off(ahead: Any, kalman: Any, mean: Any, tuning: Any, dt: Any) -> Any:
    """Mean square of the following error, in units of the permitted error."""
    step = dt * tuning[Tuning.WAVE]
    admitted = tuning[Tuning.FOLLOWING_ERROR] + ca.fabs(ahead[2] - 2 * ahead[1] + ahead[0]) / (2 * step * step)
    miss = (ahead[0] - kalman[Kalman.ANGLE]) / admitted
    before = ca.if_else(ca.logic_and(mean >= 0, mean <= 2), mean, 0)
    return before + tuning[Tuning.SHARE] * (ca.if_else(miss * miss < 2, miss * miss, 2) - before)
