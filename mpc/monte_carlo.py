"""Many closed-loop simulations: on given machines, or on machines randomly drawn around a nominal one."""

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
from plant.result_display import Drawn
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
"""Fields of the test bench that are drawn by default."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """One closed loop to simulate, see `mpc.closed_loop`; it must be picklable for an executor of processes.

    Attributes:
        design: returns a new controller, e.g. `functools.partial(Controller, model, gears, min_torque=0.05)`.
        rig: the test bench.
        reference: wanted load angle [rad]: samples, the last one is held, or a function of time (M,) [s].
        duration: [s].
        seed: of the encoder noise.
    """

    design: Callable[[], Controller]
    rig: Rig
    reference: Callable[[Array], ArrayLike] | ArrayLike
    duration: float
    seed: int

    def outcome(self) -> tuple[float, float, int, float]:
        """Simulate it: tracking rms, minimum contact torque, degraded samples, copper loss."""
        loop = closed_loop(self.design(), self.rig, self.reference, self.duration, self.seed)
        return loop.tracking_rms, loop.minimum_contact_torque, loop.degraded, loop.copper_loss


@dataclass(frozen=True, kw_only=True, eq=False)
class Sweep(Drawn):
    """Results of R closed loops.

    Attributes:
        tracking_rms: (R,) root mean square of angle minus reference [rad].
        minimum_contact_torque: (R,) minimum contact torque [N m], at the output gear.
        degraded: (R,) number of samples whose status was not "optimal".
        copper_loss: (R,) mean of xi1^2 + xi2^2 [N^2 m^2].
    """

    tracking_rms: Array
    minimum_contact_torque: Array
    degraded: NDArray[np.int64]
    copper_loss: Array

    def __repr__(self) -> str:
        """Number of loops, greatest error and smallest contact torque in one line."""
        name, loops = type(self).__name__, self.tracking_rms.size
        return (
            f"{name}({loops} loops, largest tracking error {np.max(self.tracking_rms):.3g} rad rms, minimum contact "
            f"torque {np.min(self.minimum_contact_torque):.3g} N m)"
        )

    @property
    def contact_lost(self) -> NDArray[np.bool_]:
        """(R,) whether contact was lost."""
        return self.minimum_contact_torque <= 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class MonteCarlo(Sweep):
    """Results of R closed loops on machines randomly drawn around a nominal one.

    Attributes:
        names: (P,) fields of the test bench that were drawn.
        factors: (R, P) factors on their nominal values.
    """

    names: tuple[str, ...]
    factors: Array


def sweep(
    trials: Sequence[Trial],
    *,
    executor: Executor | None = None,
    progress: Callable[[str], None] | None = None,
) -> Sweep:
    """Simulate closed loops, independently of each other.

    Args:
        trials: the closed loops.
        executor: any of `concurrent.futures`, see `plant.executors.in_order`; None: one after the other in this
            process. The results are the same to the last bit.
        progress: called with a line of text for each result, in the order of the trials.

    Raises:
        BadParameter: there is no trial.
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
    rms, flank, degraded, loss = zip(*outcomes, strict=True)
    return Sweep(
        tracking_rms=np.array(rms),
        minimum_contact_torque=np.array(flank),
        degraded=np.array(degraded),
        copper_loss=np.array(loss),
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

    Machine i and its noise depend only on (seed, i), so a larger `runs` does not change the first results. The
    controllers share their machine code: the model parameters are data, so it is compiled once.

    Args:
        design, rig, reference, duration: see `Trial`; the rig is the nominal one.
        runs: R.
        spread: relative, below one.
        seed: of machines and noise.
        names: fields of the test bench that are drawn.
        executor, progress: see `sweep`.

    Raises:
        BadParameter: a number out of range, an unknown field, or an invalid machine.
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
    """A number of the test bench, or one for each of its drives, multiplied by a factor."""
    return tuple(v * float(factor) for v in value) if isinstance(value, tuple) else value * float(factor)
