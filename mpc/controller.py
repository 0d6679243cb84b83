"""The controller: model in, pinion torques out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allocation import Bounds, PerDrive
from mpc.arguments import take_elapsed, take_motor_angles, take_reference
from mpc.attributes import check, computable
from mpc.compiled import CompiledStep
from mpc.constant_numbers import constant_numbers
from mpc.control import Control
from mpc.controller_state import Remembering
from mpc.corridor import SoftLimits
from mpc.drive import DriveInverse
from mpc.encoder_faults import watched_of
from mpc.estimator import Estimator, MotorEncoders
from mpc.friction import Frictionless, rigid_contacts
from mpc.governor import Governor
from mpc.layout import laid_out
from mpc.prediction import Predictor
from mpc.quadratic_program import ROUNDS
from mpc.riccati import ALL_ROWS, TORQUE_ALONE
from mpc.split import machine
from mpc.stages import Stages
from mpc.step import InterpretedStep
from mpc.tuning import Tuning, observer_rate
from mpc.weights import rate_weight, terminal_weight
from plant.drive_train import DriveTrain
from plant.errors import BadParameter
from plant.servo import ServoModel
from plant.simulation import whole_samples

Array = NDArray[np.float64]

_CHOSEN: Any = None
"""Of what is left out and then chosen by `mpc.tuning`."""


@dataclass(eq=False)
class Controller(Remembering):
    """Model predictive control of a preloaded pair of drives.

        minimise    sum_k (x[k] - r[k])^2 + s sum_k ((tau[k] - tau[k-1])/Ts)^2 + (z[N] - r[N])' P (z[N] - r[N])
        subject to  the servo model with its effects and an estimated disturbance
                    xi1[k] >= min_torque,  xi2[k] <= -min_torque,  |xi_i[k]| <= max_torque,  flank torques >= min_torque
                    |tau[k] - tau[k-1]| <= torque_rate Ts,  and, at a price, angle_limits and speed_limit

    The preload lambda moves nothing (equation 3), so tracking depends on the follower torque tau alone, and the least
    effort at a given tau is the allocator's closed form. Torque and preload are therefore optimised one inside the
    other: tau over the horizon within what the bounds on xi let it reach, lambda in closed form at each stage. Every
    predicted pair of pinion torques satisfies the bounds.

    One quadratic program a sample: the model is linearised along the last solution, shifted (real-time iteration;
    Diehl, Bock, Schloeder 2005); on request as many as it takes (sequential quadratic programming). s and P are those
    of the rigid servo (`mpc.weights`); the torque at the end of the horizon is left free, because what the reference
    needs later is not known.

    The controller remembers: its estimate, its last solution, the torques under way. One object serves one machine. It
    can be pickled, and goes on where it was.

    A reference that the torques cannot follow is approached in least time instead (`Governor`), because a horizon this
    short cannot see how long it takes to brake; before a limit of the angle it brakes in time. Within the horizon these
    limits are soft, with a penalty that is exact (`mpc.corridor.prices`): they hold wherever the torques can make them
    hold, and never cost the bounds of the torques.

    Two things that a model may have learnt from its log do not hold here: the log's clock (`ServoModel.without_clock`),
    and a tooth gap, for the preload never lets it open.

    Attributes:
        model: the servo, torques on the load; on a linear axis forces, and lengths [m] in place of angles.
        gears: the drive train: a `GearTrain`, or `Ratios` of two drives, or of one, which has no preload to keep.
        sample_time: Ts [s].
        horizon: N, samples looked ahead; by default a quarter of a period of the bandwidth.
        min_torque, max_torque: bounds on each pinion torque [N m]; a number, or one for each drive, as the next two.
        rotor_inertia: of each motor at its shaft [kg m^2]; zero leaves rotors out.
        motor_friction: dry friction of each motor at its shaft [N m], counted against the flank in either sense.
        bandwidth: w/(2 pi) [Hz]; by default what machine, sample time and encoder allow (`mpc.tuning`).
        encoder_resolution: step of the load's encoder [rad].
        encoder_noise: standard deviation of its noise [rad].
        encoder_range: angle after which the load's encoder begins again [rad], 2 pi of one that knows a single turn;
            each reading is put on the turn that is nearest to the prediction. Zero if its readings go on. References
            go on: 3.3 rad is not -2.98 rad.
        torque_noise: what the model misses from sample to sample, standard deviation [N m].
        disturbance_rate: how fast the unknown torque may wander [N m/sqrt(s)]; by default as the bandwidth wants it.
        motor_resolution: step of the encoders at the motor shafts [rad]; None if there are none.
        motor_noise: standard deviation of what else they err by, teeth included, at the load [rad].
        friction_std: standard error of the model's dry friction, as a share of it: so much of it is not compensated
            until the load has shown it.
        torque_rate: greatest change of the follower torque behind the drive [N m/s]. Where it takes longer than the
            horizon from end to end, a big step overshoots.
        preload_rate: greatest change of the preload, as torque on pinion 1 [N m/s]. Both rates yield to the bounds: the
            preload falls slowly, and rises as soon as contact needs it.
        angle_limits: lowest and highest angle of the load [rad], kept to within the noise of the sensor; a load that is
            beyond returns smoothly.
        speed_limit: greatest speed of the load [rad/s], likewise.
        sqp_iterations: programs a sample at most; with more than one the model is linearised anew along each solution
            until the torques change no more.

    Raises:
        BadParameter: a number out of range, or a gear train on a linear axis.
        InfeasibleTorque: min_torque above max_torque.
    """

    model: ServoModel
    gears: DriveTrain
    _: KW_ONLY
    sample_time: float = 0.005
    horizon: int = _CHOSEN
    min_torque: PerDrive = 0.02
    max_torque: PerDrive = 0.3
    rotor_inertia: PerDrive = 0.0
    motor_friction: PerDrive = 0.0
    bandwidth: float = _CHOSEN
    encoder_resolution: float = 2 * np.pi / 2**17
    encoder_noise: float = 2e-5
    encoder_range: float = 0.0
    torque_noise: float = 0.0
    disturbance_rate: float = _CHOSEN
    motor_resolution: float | None = None
    motor_noise: float = 2e-5
    friction_std: float = 0.1
    torque_rate: float = float("inf")
    preload_rate: float = float("inf")
    angle_limits: tuple[float, float] = (-float("inf"), float("inf"))
    speed_limit: float = float("inf")
    sqp_iterations: int = 1
    bounds: Bounds = field(init=False, repr=False)
    governor: Governor = field(init=False, repr=False)
    estimator: Estimator = field(init=False, repr=False)

    _internal: ClassVar[frozenset[str]] = frozenset(("bounds", "governor", "estimator"))

    def __post_init__(self) -> None:
        """Check every number, lay out what is remembered, and compile the step if there is a compiler."""
        check(self)
        with computable(self):
            self._lay_out()

    def _lay_out(self) -> None:
        """Compute everything that a step needs."""
        self.model = self.model.without_clock().without_effect("backlash")
        self.bounds = Bounds(
            gears=self.gears,
            min_torque=self.min_torque,
            max_torque=self.max_torque,
            rotor_inertia=self.rotor_inertia,
            motor_friction=self.motor_friction,
        )
        if not np.ptp(self.bounds.reachable()) > 0:
            raise BadParameter(
                "min_torque must be below max_torque minus the motor friction; otherwise no torque is left to move the "
                "load."
            )
        least = float(np.min(self.bounds.greatest))
        self._greatest = max(float(np.min(np.abs(self.bounds.reachable()))), 1e-3 * least)
        self._floor = float(np.min(self.bounds.least * self.gears.mesh_ratios))
        self._tune()
        self._whole_delay, switch = whole_samples(float(self.model.delay()), self.sample_time)
        drive, behind = DriveInverse.of(self.model)
        behind = rigid_contacts(behind)
        smooth = Frictionless.of(behind)
        predictor = Predictor(model=smooth, sample_time=self.sample_time, switch=max(switch, 0.0))
        self.estimator = Estimator(
            predictor=predictor,
            resolution=self.encoder_resolution,
            noise=self.encoder_noise,
            torque_noise=self.torque_noise,
            disturbance_rate=self.disturbance_rate,
            motors=MotorEncoders.of(self.gears, self.motor_resolution, self.motor_noise),
            surprise=self._greatest / self.model.inertia / self._observer**2,
        )
        limits = SoftLimits(angle=self.angle_limits, speed=self.speed_limit)
        noise = float(np.sqrt(self.estimator.levels[0]))
        self._soft = limits.numbers(2 * np.pi * self.bandwidth, self.sample_time, noise)
        attainable = 2.0 * self._greatest / self.model.inertia * self.sample_time**2
        self.governor = Governor(
            sample_time=self.sample_time,
            soft=self._soft if limits.any else None,
            attainable=attainable,
            jerk=(self._floor or np.inf) / (4 * self.model.inertia * self.sample_time),
        )
        self._rows = ALL_ROWS if limits.any or self.torque_rate < np.inf else TORQUE_ALONE
        self._rate_weight = rate_weight(self.model, self.bandwidth, self.sample_time)
        self._terminal_weight = terminal_weight(self.model, self._rate_weight, self.sample_time)
        self._sizes = {
            "horizon": self.horizon,
            "late": self._whole_delay,
            "passes": self.sqp_iterations,
            "rounds": ROUNDS[self._rows],
        }
        preload_step = self.preload_rate * self.sample_time / (abs(float(self.gears.null_vector[0])) or 1.0)
        self._arrays = self._all_arrays(machine(self.bounds, drive, preload_step))
        self._answer = np.asarray(self._arrays["outcome"].base)  # and behind it torques and angles
        self._wanted, self._ahead, self._drives = self._arrays["wanted"], (self.horizon + 1,), self.gears.drives
        self._stages = Stages.of(behind, self.estimator, self.governor, self._rows)
        self._machine_code = CompiledStep(self._stages.every, self._sizes, self._arrays)
        self._step: Callable[[float, bool], int] = self._machine_code.function() or self._interpreted

    def _tune(self) -> None:
        """Choose what was left out."""
        noise = max(float(np.hypot(self.encoder_resolution / np.sqrt(12.0), self.encoder_noise)), 1e-12)
        chosen = Tuning.of(
            self.model,
            sample_time=self.sample_time,
            noise=noise,
            least=self._floor,
            greatest=self._greatest,
            bandwidth=self.bandwidth,
        )
        names = ("bandwidth", "horizon", "disturbance_rate")
        self._left_out = tuple(name for name in names if getattr(self, name) is _CHOSEN)
        for name in self._left_out:
            setattr(self, name, getattr(chosen, name))
        filtering = observer_rate(self.model.inertia, self.disturbance_rate, noise, self.sample_time)
        self._observer = max(filtering, 2 * np.pi * self.bandwidth)
        self.horizon, self.sqp_iterations = int(self.horizon), int(self.sqp_iterations)

    def _all_arrays(self, machine: Array) -> dict[str, Array]:
        """Everything that a step reads and writes, by name."""
        remembered = {"kalman": self.estimator.kalman, "path": self.governor.path}
        n = len(self.estimator.predictor.model.states)
        watched = watched_of(n, self.estimator.motors is not None)
        remembered |= laid_out(n, self.horizon, self._whole_delay, self._rows, watched)
        self._remembered = tuple(remembered)
        return constant_numbers(self, machine) | remembered

    def __repr__(self) -> str:
        """The machine and the main numbers, in one line."""
        effects = "".join(f" + {effect.title}" for effect in self.model.effects)
        numbers = f"sample_time={self.sample_time:g}, horizon={self.horizon}, bandwidth={self.bandwidth:.3g}"
        torques = f"min_torque={self.min_torque}, max_torque={self.max_torque}"
        return f"Controller(rigid body{effects}, gears {self.gears}; {numbers}, {torques})"

    @cached_property
    def _interpreted(self) -> InterpretedStep:
        """The step without machine code."""
        return InterpretedStep(self._sizes, self._arrays, self.estimator, self.governor, self._stages)

    @property
    def compiled(self) -> bool:
        """Whether a step is machine code; without a compiler it takes ten times as long."""
        return self._step is not self.__dict__.get("_interpreted")

    @property
    def _plan(self) -> Array | None:
        """(N,) torques behind the drive that were found last [N m], None if they were not certified."""
        plan = self._arrays["plan"]
        return plan[1:].copy() if plan[0] else None

    def step(
        self,
        angle: float,
        reference: ArrayLike,
        motor_angles: ArrayLike | None = None,
        *,
        elapsed: float | None = None,
    ) -> Control:
        """One sample: the measured angle in, the pinion torques out.

        Args:
            angle: measured load angle [rad], going on over turns unless there is an `encoder_range`. If it is not a
                number, the model's prediction stands in.
            reference: wanted load angle [rad]: a number, or the (N + 1,) samples from now on.
            motor_angles: (m,) measured angles of the motor shafts [rad], for a controller with a `motor_resolution`;
                those that are not numbers are left out.
            elapsed: time since the last step [s], where it is not the sample time: of a loop that jitters or misses
                cycles. After more than a horizon of them the estimate begins anew.

        Raises:
            BadParameter: the reference or the motor angles have another shape, or the time is not above zero.
        """
        if isinstance(reference, np.ndarray) and reference.shape == self._ahead:
            self._wanted[:], previewed = reference, True
        else:
            previewed = take_reference(reference, self._wanted)
        if motor_angles is not None or self.motor_resolution is not None:
            angles = take_motor_angles(motor_angles, self.motor_resolution, self._drives)
            self._arrays["readings"][1:] = angles
        if elapsed is not None:
            self._arrays["elapsed"][0] = take_elapsed(elapsed)
        trouble = self._step(angle, previewed)
        return Control(self._answer.copy(), trouble, self._drives)
