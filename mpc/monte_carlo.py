"""Closed loops in great number: on machines given one by one, or drawn around a nominal one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mpc.closed_loop import closed_loop
from mpc.controller import Controller
from plant.errors import BadParameter
from plant.executors import in_order
from plant.number import whole
from plant.rig import Rig

Array = NDArray[np.float64]

DRAWN = (
    "inertia",
    "gravity",
    "viscous_friction",
    "coulomb_friction",
    "rotor_inertia",
    "motor_viscous",
    "motor_coulomb",
    "backlash",
    "flank_stiffness",
    "flank_damping",
)
"""Fields of the rig that are uncertain by default."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """One closed loop to run, see `mpc.closed_loop`; for workers that are processes it must be picklable.

    Attributes:
        design: makes a fresh controller, say `functools.partial(Controller, model, gears, min_torque=0.05)`.
        rig: the machine.
        reference: wanted load angle [rad]: samples, the last of them held, or a function of time (M,) [s].
        duration: [s].
        seed: of the encoder's noise.
    """

    design: Callable[[], Controller]
    rig: Rig
    reference: Callable[[Array], ArrayLike] | ArrayLike
    duration: float
    seed: int

    def outcome(self) -> tuple[float, float, int, float]:
        """Run it: tracking rms, least flank torque, degraded samples, heat."""
        loop = closed_loop(self.design(), self.rig, self.reference, self.duration, self.seed)
        return loop.tracking_rms, loop.least_flank_torque, loop.degraded, loop.heat


@dataclass(frozen=True, kw_only=True, eq=False)
class Sweep:
    """What came of R closed loops.

    Attributes:
        tracking_rms: (R,) root mean square of angle less reference [rad].
        least_flank_torque: (R,) least torque of any required flank [N m], follower side.
        degraded: (R,) number of samples whose status was not "optimal".
        heat: (R,) mean of xi1^2 + xi2^2 [N^2 m^2].
    """

    tracking_rms: Array
    least_flank_torque: Array
    degraded: NDArray[np.int64]
    heat: Array

    @property
    def contact_lost(self) -> NDArray[np.bool_]:
        """(R,) whether contact was lost."""
        return self.least_flank_torque <= 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class MonteCarlo(Sweep):
    """What came of R closed loops on machines drawn around a nominal one.

    Attributes:
        names: (P,) fields of the rig that were drawn.
        factors: (R, P) what they were multiplied by.
    """

    names: tuple[str, ...]
    factors: Array


def sweep(
    trials: Sequence[Trial],
    *,
    executor: Executor | None = None,
    progress: Callable[[str], None] | None = None,
) -> Sweep:
    """Run closed loops, each by itself.

    Args:
        trials: what to run.
        executor: any of `concurrent.futures`, see `plant.executors.in_order`; None runs one after the other here. The
            results are the same to the last bit.
        progress: called with a line of text as each result comes, in the order of the trials.

    Raises:
        BadParameter: there are none.
    """
    if not trials:
        raise BadParameter("A sweep needs at least one trial.")
    outcomes = []
    for number, outcome in enumerate(in_order(Trial.outcome, trials, executor), start=1):
        outcomes.append(outcome)
        if progress is not None:
            progress(
                f"{number} of {len(trials)}: rms {outcome[0]:.3g} rad, minimum contact torque {outcome[1]:.3g} N m"
            )
    rms, flank, degraded, heat = zip(*outcomes, strict=True)
    return Sweep(
        tracking_rms=np.array(rms),
        least_flank_torque=np.array(flank),
        degraded=np.array(degraded),
        heat=np.array(heat),
    )


def monte_carlo(
    design: Callable[[], Controller],
    rig: Rig,
    reference: Callable[[Array], ArrayLike] | ArrayLike,
    duration: float,
    *,
    runs: int = 1000,
    spread: float = 0.2,
    seed: int = 0,
    names: Sequence[str] = DRAWN,
    executor: Executor | None = None,
    progress: Callable[[str], None] | None = None,
) -> MonteCarlo:
    """One controller on many machines: each field is multiplied by a factor uniform in [1 - spread, 1 + spread].

    Machine i and its noise depend on (seed, i) alone, so more runs leave the first ones what they were. The controllers
    share their machine code: a model's numbers are data of it, so nothing is compiled twice.

    Args:
        design, rig, reference, duration: see `Trial`; the rig is the nominal one.
        runs: R.
        spread: below one.
        seed: of machines and noise.
        names: fields of the rig that are drawn.
        executor, progress: see `sweep`.

    Raises:
        BadParameter: a number out of range, a name that is no such field, or a machine that cannot be.
    """
    for name, number, least in (("runs", runs, 1), ("seed", seed, 0)):
        if (count := whole(number)) is None or count < least:
            raise BadParameter(f"{name} must be a whole number of at least {least}, not {number!r}.")
    if not 0.0 <= spread < 1.0:
        raise BadParameter(f"spread must be at least 0 and below 1, not {spread!r}.")
    if unknown := set(names) - {field.name for field in fields(Rig) if "float" in str(field.type)}:
        raise BadParameter(f"A rig has no such number to draw: {', '.join(sorted(unknown))}.")
    factors, trials = np.empty((runs, len(names))), []
    for i, row in enumerate(factors):
        rng = np.random.default_rng([seed, i])
        row[:] = rng.uniform(1 - spread, 1 + spread, len(names))
        drawn: dict[str, Any] = {name: _times(getattr(rig, name), by) for name, by in zip(names, row, strict=True)}
        machine = replace(rig, **drawn)
        noise = int(rng.integers(2**63))
        trials.append(Trial(design=design, rig=machine, reference=reference, duration=duration, seed=noise))
    found = sweep(trials, executor=executor, progress=progress)
    return MonteCarlo(**{f.name: getattr(found, f.name) for f in fields(found)}, names=tuple(names), factors=factors)


def _times(value: float | tuple[float, ...], factor: float) -> float | tuple[float, ...]:
    """A number of the rig, or one for each of its drives, multiplied."""
    return tuple(v * float(factor) for v in value) if isinstance(value, tuple) else value * float(factor)
