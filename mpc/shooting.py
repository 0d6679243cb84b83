"""The nonlinear program of a move from rest to rest, by multiple shooting."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Self

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from allocation import Limits, least_effort
from plant.discrete import Structure, integration_steps, sample_step
from plant.effects import Expression, Moment
from plant.effects.effect import parameters_of
from plant.servo import ServoModel
from plant.simulation import beginning

Array = NDArray[np.float64]

_LONGEST = 100.0
"""Greatest duration, in units of the shortest one for inertia alone."""

_TIDY = 1e-6
"""Weight of the copper loss beside time: it only determines the preload where no bound does."""

_OPTIONS: Any = {
    "print_time": False,
    "expand": False,
    "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-9, "bound_relax_factor": 0.0, "max_iter": 1000},
}


@dataclass(frozen=True, kw_only=True)
class SlidingServo(ServoModel):
    """A servo that moves in one direction from rest to rest: dry friction is then a smooth torque against the motion.

    Attributes:
        direction: direction of the move, 1 or -1.
    """

    direction: float = 1.0

    @classmethod
    def of(cls, model: ServoModel, sense: float) -> Self:
        """The same servo in a move in one direction."""
        own = {spec.name: getattr(model, spec.name) for spec in parameters_of(ServoModel)}
        return cls(**own, effects=model.effects, axis=model.axis, direction=sense)

    @property
    def structure(self) -> tuple[Any, ...]:
        """Everything besides parameter values that determines the equations."""
        return (*super().structure, self.direction)

    def dry_friction(self, at: Moment) -> None:
        """None: sliding friction is part of `smooth_acceleration`."""

    def smooth_acceleration(self, at: Moment, own: Mapping[str, tuple[Any, ...]] | None = None) -> Expression:
        """The acceleration with sliding friction."""
        forward, backward = super().dry_friction(at) or (0.0, 0.0)
        against = forward if self.direction > 0 else -backward
        return super().smooth_acceleration(at, own) - against / self.load_inertia(at)


@dataclass(frozen=True, kw_only=True, eq=False)
class Shot:
    """The result of the solver.

    Attributes:
        states: (N + 1, n) of the model without its dead zone.
        magnitudes: (N, 2) drive torques in their directions [N m], inside their bounds.
        duration: [s].
        outcome: return status of IPOPT.
    """

    states: Array
    magnitudes: Array
    duration: float
    outcome: str


@dataclass(frozen=True, kw_only=True, eq=False)
class _Block:
    """Variables of the program with bounds and first guess, or constraints with bounds; one column per stage."""

    symbols: Any
    lower: Any
    upper: Any
    guess: Any = 0.0

    def flat(self, name: str) -> Array:
        """Bounds or guess, column by column."""
        return np.broadcast_to(getattr(self, name), self.symbols.shape).ravel("F")


@dataclass(frozen=True, kw_only=True, eq=False)
class Shooting:
    """States at N + 1 times; in each interval a constant torque u after the dead zone and constant drive torques x.

    All variables are scaled, so that the solver behaves alike for motors of 0.01 and of 100 N m: x by the greatest
    torque, u by the torque of both drives together, angles by the length of the move, times by the expected duration.

    Attributes:
        model: the servo.
        bounds: of two drives on one joint.
        start, goal: angles [rad].
        intervals: N.
        speed_limit: of the load [rad/s], at the ends of the intervals; with a constant torque the speed inside stays
            below it.
    """

    model: ServoModel
    bounds: Limits
    start: float
    goal: float
    intervals: int
    speed_limit: float = float("inf")

    @property
    def begin(self) -> Array:
        """(n,) the initial state, at rest."""
        return beginning(self.model, angle=self.start)

    @property
    def _direction(self) -> float:
        return float(np.sign(self.goal - self.start))

    @cached_property
    def _servo(self) -> SlidingServo:
        """The model without the dead zone and saturation, which `_command` and `_limit` represent."""
        behind = self.model.without_effect("dead_zone").without_effect("torque_saturation")
        return SlidingServo.of(behind, self._direction)

    @cached_property
    def _strength(self) -> float:
        """Output torque that is reached in both directions [N m]."""
        return float(np.min(np.abs(self.bounds.reachable())))

    @property
    def _quickest(self) -> float:
        """Shortest duration for inertia alone [s]."""
        return 2.0 * float(np.sqrt(abs(self.goal - self.start) * self.model.inertia / self._strength))

    @property
    def _cruise(self) -> float:
        """Duration at the speed limit [s]."""
        return abs(self.goal - self.start) / self.speed_limit

    def solve(self, duration: float | None) -> Shot:
        """The move of shortest duration, or of least copper loss in a given duration [s]."""
        N, n, greatest = self.intervals, self.begin.size, self.bounds.greatest
        expected = 2.0 * self._quickest + self._cruise if duration is None else duration
        units = np.ones(n)
        units[:2] = abs(self.goal - self.start), abs(self.goal - self.start) / expected
        variables = self._variables(units, expected, duration is not None)
        Z, U, X, t = (block.symbols for block in variables)
        rows = self._rows(Z, U, X, t, units, expected)
        loss = ca.sum2(ca.sum1(X**2)) * t / N
        program = {
            "x": ca.vertcat(*(ca.vec(block.symbols) for block in variables)),
            "f": t + _TIDY * loss if duration is None else loss,
            "g": ca.vertcat(*(ca.vec(block.symbols) for block in rows)),
        }
        solver = ca.nlpsol("move", "ipopt", program, _OPTIONS)
        found = solver(
            x0=np.concatenate([block.flat("guess") for block in variables]),
            lbx=np.concatenate([block.flat("lower") for block in variables]),
            ubx=np.concatenate([block.flat("upper") for block in variables]),
            lbg=np.concatenate([block.flat("lower") for block in rows]),
            ubg=np.concatenate([block.flat("upper") for block in rows]),
        )
        x = np.asarray(found["x"])[:, 0]
        states, _, drives, _ = np.split(x, np.cumsum([n * (N + 1), N, 2 * N]))
        return Shot(
            states=self.begin + states.reshape(N + 1, n) * units,
            magnitudes=np.clip(drives.reshape(N, 2) * greatest, self.bounds.least, greatest),
            duration=float(x[-1]) * expected,
            outcome=str(solver.stats()["return_status"]),
        )

    def _variables(self, units: Array, expected: float, fixed: bool) -> tuple[_Block, ...]:
        """States minus the first one, torque, drive torques and time; the guess is a cubic with its torques."""
        N, n, way = self.intervals, units.size, self.goal - self.start
        p = np.linspace(0.0, 1.0, N + 1)
        angle, velocity = way * p**2 * (3 - 2 * p), way / expected * 6 * p * (1 - p)
        acceleration = way / expected**2 * 6 * (1 - p[1:] - p[:-1])
        motion = zip(self.start + angle[:-1], velocity[:-1], acceleration, strict=True)
        torque = np.array([self._torque(*at) for at in motion])
        drives = self.bounds.structure.signs * least_effort(self.bounds, torque, acceleration)
        course = np.zeros((n, N + 1))
        course[:2] = angle / units[0], velocity / units[1]

        lower, upper = np.full((n, N + 1), -np.inf), np.full((n, N + 1), np.inf)
        lower[1], upper[1] = -self.speed_limit / units[1], self.speed_limit / units[1]
        if self.model.slides:  # motion in one direction only
            (lower if self._direction > 0 else upper)[1] = 0.0
        lower[:, 0] = upper[:, 0] = 0.0
        lower[:2, -1] = upper[:2, -1] = self._direction, 0.0
        quick, longest = self._quickest / expected, (_LONGEST * self._quickest + 2.0 * self._cruise) / expected
        least, greatest = self.bounds.least[:, None], self.bounds.greatest[:, None]
        times = (1.0, 1.0) if fixed else (0.1 * quick, longest)
        return (
            _Block(symbols=ca.MX.sym("Z", n, N + 1), lower=lower, upper=upper, guess=course),
            _Block(symbols=ca.MX.sym("U", 1, N), lower=-np.inf, upper=np.inf, guess=torque / self._strength),
            _Block(symbols=ca.MX.sym("X", 2, N), lower=least / greatest, upper=1.0, guess=drives.T / greatest),
            _Block(symbols=ca.MX.sym("t"), lower=times[0], upper=times[1], guess=1.0),
        )

    def _rows(self, Z: Any, U: Any, X: Any, t: Any, units: Array, expected: float) -> tuple[_Block, ...]:
        """Constraints: continuity of the states, torque balance of the drives, contact at both ends of an interval."""
        N, greatest, servo = self.intervals, self.bounds.greatest, self._servo
        states = ca.repmat(ca.DM(self.begin), 1, N + 1) + ca.mtimes(ca.diag(units), Z)
        drives, torque = ca.mtimes(ca.diag(greatest), X), self._strength * U
        step = _interval(Structure(servo), integration_steps(servo, expected / N / 2)).map(N)
        after, acceleration = step(states[:, :-1], torque, ca.repmat(expected * t / N, 1, N), servo.values)
        together = ca.mtimes(ca.DM(self.bounds.structure.pushing), drives)
        command, limit = self._command(torque) / self._strength, self._limit / self._strength
        rotors = ca.DM(self.bounds.rotor_torque(1.0) / greatest)
        flanks = [X - ca.mtimes(rotors, acceleration[end, :]) for end in range(2)]
        floor = (self.bounds.floor / greatest)[:, None]
        return (
            _Block(symbols=ca.mtimes(ca.diag(1 / units), after - states[:, 1:]), lower=0.0, upper=0.0),
            _Block(symbols=together / self._strength - command, lower=0.0, upper=0.0),
            _Block(symbols=command, lower=-limit, upper=limit),
            *(_Block(symbols=flank, lower=floor, upper=np.inf) for flank in flanks),
        )

    def _command(self, torque: Any) -> Any:
        """The command for a torque after the dead zone [N m].

        It jumps by twice the half width g where the torque changes sign; the program uses g tanh(30 torque/g) instead.
        """
        zone = self.model.effect("dead_zone")
        width = 0.0 if zone is None else zone.values[0]
        return torque + width * ca.tanh(30.0 * torque / width) if width else torque

    @property
    def _limit(self) -> float:
        """Greatest torque command of the drive, its saturation [N m]."""
        saturation = self.model.effect("torque_saturation")
        return float("inf") if saturation is None else float(saturation.values[0])

    def _torque(self, angle: float, velocity: float, acceleration: float) -> float:
        """Torque required for a motion [N m]."""
        at = Moment(angle=angle, velocity=velocity, torque=0.0, inertia=self._servo.inertia)
        return float(self._servo.load_inertia(at) * (acceleration - self._servo.smooth_acceleration(at)))


@lru_cache(maxsize=64)
def _interval(structure: Structure, substeps: int) -> Any:
    """An interval with constant torque, as a `casadi.Function`.

    (state (n,), torque, length, parameters (P,)) -> next state and acceleration of the load at start and end (2,),
    extrapolated linearly from its means over both halves.
    """
    model = structure.model
    z, p = ca.SX.sym("z", len(model.states)), ca.SX.sym("p", len(model.names))
    torque, h = ca.SX.sym("torque"), ca.SX.sym("h")
    step = sample_step(model, substeps=substeps)
    inputs = ca.vertcat(torque, torque, 0.0, np.inf, 0.0, h / 2, 0.0, 0.0)
    half = step(z, inputs, p)
    end = step(half, inputs, p)
    early, late = (half[1] - z[1]) / (h / 2), (end[1] - half[1]) / (h / 2)
    ends = ca.vertcat(1.5 * early - 0.5 * late, 1.5 * late - 0.5 * early)
    return ca.Function("interval", [z, torque, h, p], [end, ends], {"cse": True})
