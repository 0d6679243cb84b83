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
from mpc.drive import DriveInverse
from mpc.encoder_faults import watched_of
from mpc.estimator import Estimator, MotorEncoders
from mpc.friction import Frictionless, rigid_contacts
from mpc.governor import Governor
from mpc.layout import laid_out
from mpc.prediction import Predictor
from mpc.quadratic_program import ROUNDS
from mpc.riccati import ALL_ROWS, TORQUE_ALONE
from mpc.soft_limits import SoftLimits
from mpc.stage_allocation import machine
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
"""Default of an attribute that `mpc.tuning` chooses."""


@dataclass(eq=False)
class Controller(Remembering):
    """Model predictive control of a preloaded pair of drives.

        minimise    sum_k (x[k] - r[k])^2 + s sum_k ((tau[k] - tau[k-1])/Ts)^2 + (z[N] - r[N])' P (z[N] - r[N])
        subject to  the servo model with its effects and an estimated disturbance
                    xi1[k] >= min_torque,  xi2[k] <= -min_torque,  |xi_i[k]| <= max_torque
                    contact torque of each drive >= min_torque
                    |tau[k] - tau[k-1]| <= torque_rate Ts,  and as soft limits angle_limits and speed_limit

    The preload lambda gives no output torque (equation 3), so tracking depends on the output torque tau alone, and
    the least effort at a given tau is the closed form of the allocator. The two optimisations are nested: tau over the
    horizon within the range that the bounds on xi allow, and lambda in closed form at each stage. Every predicted pair
    of pinion torques satisfies the bounds.

    One quadratic program is solved per sample: the model is linearised along the last solution, shifted by one sample
    (real-time iteration; Diehl, Bock, Schloeder 2005). With `sqp_iterations` several are solved (sequential quadratic
    programming). s and P are those of the rigid servo (`mpc.weights`). The torque at the end of the horizon has no
    terminal cost, because the later reference is unknown.

    The controller has a state: estimate, last solution, torques not yet effective. Use one object per machine. It can
    be pickled with its state.

    If the torques cannot follow the reference, a governed reference approaches it in least time (`Governor`), because
    the braking time may be longer than the horizon; it also brakes in time before an angle limit. Within the horizon
    these limits are soft with an exact penalty (`mpc.soft_limits.prices`): they hold whenever the torques can make them
    hold, and they never violate the torque bounds.

    Two effects of an identified model are removed: the clock error of the log (`ServoModel.without_clock`), and
    backlash, because the preload keeps contact.

    Attributes:
        model: the servo, with torques on the load; on a linear axis with forces, and lengths [m] instead of angles.
        gears: the drive train: a `GearTrain`, or `Ratios` of two drives or of one; a single drive has no preload.
        sample_time: Ts [s].
        horizon: N in samples; by default a quarter of a period of the bandwidth, at least ten samples.
        min_torque, max_torque: bounds on each pinion torque [N m]; a number, or one for each drive, as the next two.
        rotor_inertia: of each motor at its shaft [kg m^2]; zero neglects the rotors.
        motor_friction: dry friction of each motor at its shaft [N m], always subtracted from the contact torque.
        bandwidth: w/(2 pi) [Hz]; by default chosen for machine, sample time and encoder (`mpc.tuning`).
        encoder_resolution: step of the load encoder [rad].
        encoder_noise: standard deviation of its noise [rad].
        encoder_range: angle after which the load encoder wraps around [rad], 2 pi for a single-turn encoder; each
            measurement is unwrapped to the turn nearest to the prediction. Zero if it counts over turns. References
            are never wrapped: 3.3 rad is not -2.98 rad.
        torque_noise: standard deviation of the torque error of the model, independent from sample to sample [N m].
        disturbance_rate: rate of the random-walk disturbance [N m/sqrt(s)]; by default chosen to suit the bandwidth.
        motor_resolution: step of the encoders at the motor shafts [rad]; None if there are none.
        motor_noise: standard deviation of their other errors, gear errors included, at the load [rad].
        friction_std: relative standard error of the model's dry friction; this part of it is not compensated until it
            has been learnt from the motion of the load.
        torque_rate: greatest rate of the output torque at the drive output [N m/s]. If the change between the
            torque limits takes longer than the horizon, a large step overshoots.
        preload_rate: greatest rate of the preload, as torque on pinion 1 [N m/s]. The bounds have priority over both
            rates: the preload falls slowly, and rises at once if contact requires it.
        angle_limits: lowest and highest angle of the load [rad], kept within the sensor noise; a load outside returns
            smoothly.
        speed_limit: greatest speed of the load [rad/s], kept in the same way.
        sqp_iterations: greatest number of programs per sample; with more than one the model is linearised again along
            each solution until the torques converge.

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
        """Check every attribute, allocate the state, and compile the step if there is a compiler."""
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
        self._answer = np.asarray(self._arrays["outcome"].base)  # outcome, torques and angles
        self._wanted, self._ahead, self._drives = self._arrays["wanted"], (self.horizon + 1,), self.gears.drives
        self._stages = Stages.of(behind, self.estimator, self.governor, self._rows)
        self._machine_code = CompiledStep(self._stages.every, self._sizes, self._arrays)
        self._step: Callable[[float, bool], int] = self._machine_code.function() or self._interpreted

    def _tune(self) -> None:
        """Choose the attributes that were not given."""
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
        """All arrays that a step reads and writes, by name."""
        remembered = {"kalman": self.estimator.kalman, "path": self.governor.path}
        n = len(self.estimator.predictor.model.states)
        watched = watched_of(n, self.estimator.motors is not None)
        remembered |= laid_out(n, self.horizon, self._whole_delay, self._rows, watched)
        self._remembered = tuple(remembered)
        return constant_numbers(self, machine) | remembered

    def __repr__(self) -> str:
        """The machine and the main parameters, in one line."""
        effects = "".join(f" + {effect.title}" for effect in self.model.effects)
        numbers = f"sample_time={self.sample_time:g}, horizon={self.horizon}, bandwidth={self.bandwidth:.3g}"
        torques = f"min_torque={self.min_torque}, max_torque={self.max_torque}"
        return f"Controller(rigid body{effects}, gears {self.gears}; {numbers}, {torques})"

    @cached_property
    def _interpreted(self) -> InterpretedStep:
        """The step in the Python form, without machine code."""
        return InterpretedStep(self._sizes, self._arrays, self.estimator, self.governor, self._stages)

    @property
    def compiled(self) -> bool:
        """Whether a step runs as machine code; without a compiler it takes about ten times as long."""
        return self._step is not self.__dict__.get("_interpreted")

    @property
    def _plan(self) -> Array | None:
        """(N,) last planned drive output torques [N m]; None if they were not certified."""
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
            angle: measured load angle [rad], counted over turns unless there is an `encoder_range`. If it is NaN, the
                prediction of the model is used.
            reference: wanted load angle [rad]: a number, or the (N + 1,) samples from now on.
            motor_angles: (m,) measured angles of the motor shafts [rad], for a controller with a `motor_resolution`;
                NaN is ignored.
            elapsed: time since the last step [s] if it differs from the sample time, for a loop with jitter or missed
                cycles. After more than a horizon the estimate is restarted.

        Raises:
            BadParameter: the reference or the motor angles have another shape, or the time is not above zero.
        """
        if isinstance(reference, np.ndarray) and reference.shape == self._ahead:
            self._wanted[:], previewed = reference, True
        else:
            previewed = take_reference(reference, self._wanted)
        if motor_angles is not None or self.motor_resolution is not None:
            angles = take_motor_angles(motor_angles, self.motor_resolution, self._drives)
            self._arrays["measurements"][1:] = angles
        if elapsed is not None:
            self._arrays["elapsed"][0] = take_elapsed(elapsed)
        trouble = self._step(angle, previewed)
        return Control(self._answer.copy(), trouble, self._drives)
