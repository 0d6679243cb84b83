"""The controller: model in, pinion torques out."""

from __future__ import annotations

from collections import deque
from dataclasses import KW_ONLY, dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allocation import Bounds, least_effort
from mpc.box_qp import solve_box_qp
from mpc.drive import DriveInverse
from mpc.estimator import Estimator
from mpc.governor import Governor
from mpc.prediction import Predictor, Trajectory, sensitivities
from mpc.preview import Preview, prolonged
from mpc.weights import rate_weight, terminal_weight
from plant.errors import BadParameter
from plant.gears import GearTrain
from plant.servo import ServoModel

Array = NDArray[np.float64]

FRICTION_WIDTH = 0.005
"""Velocity over which the prediction smooths dry friction [rad/s], so that it has a derivative at rest."""

_USED_BY_GOVERNOR = 0.85
"""Share of the reachable acceleration that the governed reference may ask for; the rest is left to feedback."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Control:
    """What the controller hands out at one sample.

    Attributes:
        torques: (2,) pinion torques to apply now [N m]; always inside the bounds.
        status: "optimal", or "degraded: " and why.
        margin: least predicted flank torque above the minimum [N m], over both drives and the horizon, seen from the
            pinion; negative where `max_torque` cannot hold the teeth together.
        predicted_torques: (N, 2) pinion torques over the horizon [N m], the first row being `torques`.
        predicted_angle: (N + 1,) load angle from now on [rad], a delay of whole samples being left out.
        disturbance: estimated torque that the model does not know [N m].
        residual: how far from optimal, see `mpc.box_qp.optimality_residual`.
    """

    torques: Array
    status: str
    margin: float
    predicted_torques: Array
    predicted_angle: Array
    disturbance: float
    residual: float


@dataclass(eq=False)
class Controller:
    """Model predictive control of a preloaded pair of drives.

        minimise    sum_k (x[k] - r[k])^2 + s sum_k ((tau[k] - tau[k-1])/Ts)^2 + (z[N] - r[N])' P (z[N] - r[N])
        subject to  the servo model with its effects and an estimated disturbance
                    xi1[k] >= min_torque,  xi2[k] <= -min_torque,  |xi_i[k]| <= max_torque,  flank torques >= min_torque

    The preload lambda moves nothing (equation 3), so tracking depends on the follower torque tau alone, and the least
    effort at a given tau is the allocator's closed form. Torque and preload are therefore optimised one inside the
    other: tau over the horizon within what the bounds on xi let it reach, lambda in closed form at each stage. Every
    predicted pair of pinion torques satisfies the bounds.

    One quadratic programme a sample: the model is linearised along the last solution, shifted (real-time iteration;
    Diehl, Bock, Schloeder 2005). s and P are those of the rigid servo (`mpc.weights`); the torque at the end of the
    horizon is left free, because what the reference needs later is not known.

    The controller remembers: its estimate, its last solution, the torques under way. One object serves one machine.

    A reference that the torques cannot follow is approached in least time instead (`Governor`), because a horizon this
    short cannot see how long it takes to brake.

    Two things that a model may have learnt from its log do not hold here: the log's clock (`ServoModel.without_clock`),
    and a tooth gap, for the preload never lets it open.

    Attributes:
        model: the servo, on a rotary axis, torques on the follower.
        gears: the gear train.
        sample_time: Ts [s].
        horizon: N, samples looked ahead.
        min_torque, max_torque: bounds on each pinion torque [N m].
        rotor_inertia: of each motor at its shaft [kg m^2]; zero leaves the flank torque equal to the pinion torque.
        bandwidth: w/(2 pi) [Hz].
        encoder_resolution: step of the load's encoder [rad].
        encoder_noise: standard deviation of its noise [rad].
        torque_noise: what the model misses from sample to sample, standard deviation [N m].
        disturbance_rate: how fast the unknown torque may wander [N m/sqrt(s)].

    Raises:
        BadParameter: a number out of range, or a linear axis.
        InfeasibleTorque: min_torque above max_torque.
    """

    model: ServoModel
    gears: GearTrain
    _: KW_ONLY
    sample_time: float = 0.005
    horizon: int = 30
    min_torque: float = 0.02
    max_torque: float = 0.3
    rotor_inertia: float = 0.0
    bandwidth: float = 4.0
    encoder_resolution: float = 2 * np.pi / 2**17
    encoder_noise: float = 2e-5
    torque_noise: float = 0.05
    disturbance_rate: float = 1.0
    bounds: Bounds = field(init=False, repr=False)
    governor: Governor = field(init=False, repr=False)
    estimator: Estimator = field(init=False, repr=False)
    _plan: Array | None = field(default=None, init=False, repr=False)

    def __post_init__(self) -> None:
        """Check every number and prepare the estimator."""
        if self.model.axis != "rotary":
            raise BadParameter("The controller drives a load through gears; give it a model of a rotary axis.")
        for name in ("sample_time", "bandwidth"):
            value = getattr(self, name)
            if not np.isfinite(value) or value <= 0:
                raise BadParameter(f"{name} must be finite and above zero, not {value!r}.")
        if isinstance(self.horizon, bool) or not isinstance(self.horizon, int) or self.horizon < 2:
            raise BadParameter(f"horizon must be a whole number of at least 2 samples, not {self.horizon!r}.")
        if self.bandwidth * self.sample_time > 0.1:
            raise BadParameter(
                f"A bandwidth of {self.bandwidth:g} Hz needs a sample time of at most {0.1 / self.bandwidth:.3g} s."
            )
        self.model = self.model.without_clock().without_effect("backlash")
        self.bounds = Bounds(
            gears=self.gears,
            min_torque=self.min_torque,
            max_torque=self.max_torque,
            rotor_inertia=self.rotor_inertia,
        )
        delay = float(self.model.delay())
        self._whole_delay = int(np.floor(delay / self.sample_time + 1e-9))
        self._drive, behind = DriveInverse.of(self.model)
        self._predictor = Predictor(
            model=behind,
            sample_time=self.sample_time,
            switch=max(delay - self._whole_delay * self.sample_time, 0.0),
            width=FRICTION_WIDTH,
        )
        self.estimator = Estimator(
            predictor=self._predictor,
            resolution=self.encoder_resolution,
            noise=self.encoder_noise,
            torque_noise=self.torque_noise,
            disturbance_rate=self.disturbance_rate,
        )
        self.governor = Governor(sample_time=self.sample_time)
        attainable = 2.0 * self._greatest / self.model.inertia * self.sample_time**2
        self._preview = Preview(horizon=self.horizon, attainable=attainable)
        self._load_torque = 0.0
        # Effective torques under way, oldest first: those of a delay, and the two that acted around the last sample.
        self._past: deque[float] = deque([0.0] * (self._whole_delay + 2), maxlen=self._whole_delay + 2)

    @cached_property
    def _rate_weight(self) -> float:
        return rate_weight(self.model, self.bandwidth, self.sample_time)

    @cached_property
    def _terminal_weight(self) -> Array:
        return terminal_weight(self.model, self._rate_weight, self.sample_time)

    @cached_property
    def _greatest(self) -> float:
        """Follower torque that both directions can reach at rest [N m]."""
        return max(float(np.min(np.abs(self.bounds.reachable()))), 1e-3 * self.max_torque)

    def step(self, angle: float, reference: ArrayLike) -> Control:
        """One sample: the measured angle in, the pinion torques out.

        Args:
            angle: measured load angle [rad]. If it is not a number, the model's prediction stands in.
            reference: wanted load angle [rad]: a number, or the (N + 1,) samples from now on.

        Raises:
            BadParameter: the reference has another shape.
        """
        wanted = np.asarray(reference, dtype=np.float64)
        if wanted.shape not in ((), (self.horizon + 1,)):
            raise BadParameter(
                f"The reference must be a number or {self.horizon + 1} samples, not an array of shape {wanted.shape}."
            )
        # Absurd numbers may overflow; every result is checked, so no warning is needed.
        with np.errstate(all="ignore"):
            troubles = [self.estimator.advance(float(angle), self._past[1], self._past[0])]
            state = self.estimator.state
            if state is None:
                return self._hold(troubles)
            if not np.all(np.isfinite(wanted)):
                troubles.append("the reference is not a number, the angle is held")
                wanted = np.asarray(state[0])
            return self._plan_ahead(state, self._governed(self._preview.over(wanted), state), troubles)

    def _governed(self, wanted: Array, state: Array) -> Array:
        """What of the wanted angle (N + 1,) [rad] can be followed, see `Governor`."""
        least, greatest = self._drive.effective(self.bounds.reachable(), state[1])
        floor = 0.1 * self._greatest
        backward = max(_USED_BY_GOVERNOR * (self._load_torque - least), floor) / self.model.inertia
        forward = max(_USED_BY_GOVERNOR * (greatest - self._load_torque), floor) / self.model.inertia
        linear = (backward + forward) / 2 / (2 * np.pi * self.bandwidth) ** 2
        if self.governor.distance(float(state[0])) > 10 * linear:
            self.governor.restart(float(state[0]), float(state[1]))
        return self.governor.govern(wanted, (backward, forward))

    def _plan_ahead(self, state: Array, wanted: Array, troubles: list[str]) -> Control:
        """Solve for the torques of the horizon, split them, remember what is under way."""
        late, N = self._whole_delay, self.horizon
        guess = np.full(N, self._past[-1]) if self._plan is None else np.append(self._plan[1:], self._plan[-1])
        under_way = np.array(self._past)[1:]
        course = self._predictor.look_ahead(state, np.concatenate((under_way, guess)), self.estimator.disturbance)
        # What is decided now acts after the delay: the first samples are fate, and the reference must reach further.
        ahead = prolonged(wanted, late + 1)[late:]
        pace = course.states[late:-1, 1]
        acceleration = np.diff(course.states[late:, 1]) / self.sample_time
        reach = self._drive.effective(self.bounds.reachable(acceleration), pace[:, None])
        solution, response = self._optimise(course, ahead, guess, reach)
        if solution is None:
            troubles.append("no solution of the quadratic programme was certified, the last plan is followed")
            effective, residual = np.clip(guess, reach[:, 0], reach[:, 1]), float("inf")
            self._plan = None
        else:
            effective, residual = solution
            self._plan = effective
        change = np.einsum("kij,j->ki", response, effective - guess)
        speeds = course.states[late:, 1] + np.append(0.0, change[:, 1])
        acceleration = np.diff(speeds) / self.sample_time
        if not np.all(np.isfinite(acceleration)) or not np.all(np.isfinite(effective)):
            return self._hold(troubles)
        self._load_torque = float(effective[0] - self.model.inertia * acceleration[0])
        torques = least_effort(self.bounds, self._drive.command(effective, pace), acceleration)
        margin = float(np.min(self.bounds.margin(torques, acceleration)))
        if margin < -1e-9 * self.max_torque:
            troubles.append("max_torque cannot hold the teeth together at the predicted acceleration")
        angles = course.states[late:, 0] + np.append(0.0, change[:, 0])
        return self._hand_out(torques, troubles, speed=pace[0], margin=margin, angles=angles, residual=residual)

    def _optimise(
        self, course: Trajectory, wanted: Array, guess: Array, reach: Array
    ) -> tuple[tuple[Array, float] | None, Array]:
        """Condense the programme around a course and solve it, towards wanted angles (N + 2,) [rad].

        Returns:
            (torques, residual) or None, and (N, n, N) responses.
        """
        N, late = self.horizon, self._whole_delay
        S = sensitivities(course, late)
        unit = float(np.max(np.abs(reach)))
        angle, speed = S[:, 0, :] * unit, S[:, 1, :] * unit
        final = np.stack((angle[-1], speed[-1]))
        free = course.states[late + 1 :, :2]
        miss = free[:, 0] - wanted[1:-1]
        end_miss = np.array([miss[-1], free[-1, 1] - (wanted[-1] - wanted[-3]) / (2 * self.sample_time)])
        D = (np.eye(N) - np.eye(N, k=-1)) * unit
        before = np.append(self._past[-1], np.zeros(N - 1))
        rates = D @ (guess / unit) - before
        H = angle[:-1].T @ angle[:-1] + final.T @ self._terminal_weight @ final + self._rate_weight * (D.T @ D)
        g = angle[:-1].T @ miss[:-1] + final.T @ self._terminal_weight @ end_miss + self._rate_weight * (D.T @ rates)
        start = guess / unit
        solution = solve_box_qp(H, g - H @ start, reach[:, 0] / unit, reach[:, 1] / unit, start)
        if not solution.is_optimal:
            return None, S
        return (np.clip(solution.x * unit, reach[:, 0], reach[:, 1]), solution.residual), S

    def _hold(self, troubles: list[str]) -> Control:
        """Keep the teeth together with as little torque on the load as that allows, and know nothing."""
        self._plan = None
        torques = np.tile(least_effort(self.bounds, 0.0), (self.horizon, 1))
        margin = float(np.min(self.bounds.margin(torques)))
        unknown = np.full(self.horizon + 1, np.nan)
        return self._hand_out(torques, troubles, speed=0.0, margin=margin, angles=unknown, residual=float("inf"))

    def _hand_out(
        self, torques: Array, troubles: list[str], *, speed: float, margin: float, angles: Array, residual: float
    ) -> Control:
        self._past.append(float(self._drive.effective(self.gears.follower_torque(torques[0]), speed)))
        reasons = "; ".join(trouble for trouble in troubles if trouble)
        return Control(
            torques=torques[0],
            status=f"degraded: {reasons}" if reasons else "optimal",
            margin=margin,
            predicted_torques=torques,
            predicted_angle=angles,
            disturbance=self.estimator.disturbance,
            residual=residual,
        )
