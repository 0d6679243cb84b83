"""State estimation: the state of the servo and a slowly changing disturbance torque."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from mpc.filter import beginning, estimation, kalman_of
from mpc.kernel import Kernel
from mpc.prediction import Predictor
from mpc.status import sentence
from plant.drive_train import DriveTrain
from plant.errors import BadParameter

Array = NDArray[np.float64]

NO_ANGLES = (float("nan"), float("nan"))
"""No measurement of the motor angles."""


@dataclass(frozen=True, kw_only=True)
class MotorEncoders:
    """Encoders at the two motor shafts.

    While contact is kept, a motor turns with the load, -ratio (x + offset). The offset is estimated as a random walk,
    which follows the gear errors.

    Attributes:
        ratios: turns of each motor for one of the load.
        resolution: step [rad], at the shaft.
        noise: standard deviation besides the steps [rad], at the load.
        offset_rate: of the random walk of the offsets [rad/sqrt(s)].
    """

    ratios: tuple[float, float]
    resolution: float
    noise: float
    offset_rate: float = 1e-5

    @classmethod
    def of(cls, gears: DriveTrain, resolution: float | None, noise: float) -> Self | None:
        """Encoders of a drive train, None without a resolution; a single motor is treated as a pair."""
        if resolution is None:
            return None
        turns = np.copysign(gears.motor_ratios, -gears.angle_map).tolist()
        first, second = turns if len(turns) > 1 else turns * 2
        return cls(ratios=(first, second), resolution=resolution, noise=noise)

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name in ("resolution", "noise", "offset_rate"):
            value = getattr(self, name)
            if not np.isfinite(value) or value < 0:
                raise BadParameter(f"{name} of the motors' encoders must be finite and not negative, not {value!r}.")
        if self.resolution == self.noise == 0:
            raise BadParameter("The motors' encoders need a resolution or a noise above zero.")

    @property
    def levels(self) -> list[float]:
        """Variance of each at the load [rad^2], rate of the random walk, and the ratios."""
        return [*((self.resolution / r) ** 2 / 12 + self.noise**2 for r in self.ratios), self.offset_rate, *self.ratios]


@dataclass(eq=False, kw_only=True)
class Estimator:
    """Extended Kalman filter on the servo model with a disturbance torque d as a further state.

        z[k+1] = step(z[k], tau[k] + d[k], tau[k-1] + d[k]) + w,    d[k+1] = d[k] + v,    y[k] = measurement(z[k]) + e

    The disturbance removes the steady-state error due to unmodelled torques (offset-free control, Pannocchia and
    Rawlings 2003). The steps of the sensor count as noise of variance resolution^2/12. Measurements of motor
    encoders, if any, are processed one after the other.

    Attributes:
        predictor: the sampled model.
        resolution: step of the sensor [rad].
        noise: standard deviation of the sensor besides its steps [rad].
        torque_noise: standard deviation of the torque error of the model, independent from sample to sample [N m].
        disturbance_rate: rate of the random-walk disturbance [N m/sqrt(s)].
        motors: encoders at the motors, None if there are none.
        acting: parameters of the predictor with the actual time since the last sample.
        surprise: angle by which an unknown torque may move the load before the filter has estimated it [rad].
        kalman: state of the filter: whether there is an estimate, outliers in a row, d, state (n,), offsets of
            the motors, and the upper triangle of the covariance of state, d and offsets, column by column.
        levels: variance of the sensor, torque_noise, disturbance_rate, surprise, and the levels of the motors.
    """

    predictor: Predictor
    resolution: float
    noise: float
    torque_noise: float
    disturbance_rate: float
    motors: MotorEncoders | None = None
    surprise: float = 0.0
    acting: Array = field(init=False, repr=False)
    kalman: Array = field(init=False, repr=False)
    levels: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Check the noise levels."""
        for name in ("resolution", "noise", "torque_noise", "disturbance_rate"):
            value = getattr(self, name)
            if not np.isfinite(value) or value < 0:
                raise BadParameter(f"{name} must be finite and not negative, not {value!r}.")
        variance = self.resolution**2 / 12.0 + self.noise**2
        if variance == 0.0:
            raise BadParameter("The sensor needs a resolution or a noise above zero: no filter can trust it fully.")
        more = self.motors.levels if self.motors else []
        self.levels = np.array([variance, self.torque_noise, self.disturbance_rate, self.surprise, *more])
        self.acting = self.predictor.parameters.copy()
        self.kalman = np.zeros(kalman_of(len(self.predictor.model.states), self.motors is not None).shape[0])

    @property
    def state(self) -> Array | None:
        """(n,) state; None before the first measurement."""
        n = len(self.predictor.model.states)
        return self.kalman[3 : 3 + n].copy() if self.kalman[0] else None

    @state.setter
    def state(self, state: Array | None) -> None:
        self.kalman[0] = state is not None
        if state is not None:
            self.kalman[3 : 3 + state.size] = state

    @property
    def disturbance(self) -> float:
        """Estimate of d [N m]."""
        return float(self.kalman[2])

    @disturbance.setter
    def disturbance(self, torque: float) -> None:
        self.kalman[2] = torque

    def start(self, measurement: float, torque: float, motor_angles: tuple[float, float] = NO_ANGLES) -> None:
        """Restart at rest from a measurement [rad], with actuators settled at a torque [N m] and no disturbance."""
        begin = self._begin
        begin.inputs[0][:] = (measurement, *motor_angles) if self.motors else (measurement,)
        begin.inputs[1][0] = torque
        begin()
        self.kalman[:] = begin.outputs[0]

    def advance(
        self, measurement: float, torque: float, previous_torque: float, motor_angles: tuple[float, float] = NO_ANGLES
    ) -> str:
        """Predict a sample by the torque since the last one and the one before [N m], correct by measurements [rad].

        Returns:
            The problem in words, or an empty string.
        """
        return sentence(self.update(measurement, torque, previous_torque, motor_angles))

    def update(
        self,
        measurement: float,
        torque: float,
        previous_torque: float,
        motor_angles: tuple[float, float] = NO_ANGLES,
        deaf: float = 0.0,
    ) -> int:
        """As `advance`, but returns a `Trouble` number; `deaf` is a dead band of the innovation [rad]."""
        estimate = self._estimate
        estimate.inputs[1][:] = (measurement, *motor_angles) if self.motors else (measurement,)
        estimate.inputs[2][:] = torque, previous_torque, deaf
        kalman, trouble, anew = estimate()
        self.kalman[:] = kalman
        if anew[0]:
            self.start(measurement, torque, motor_angles)
        return int(trouble[0])

    @property
    def functions(self) -> tuple[Any, Any]:
        """The functions of one sample of the filter and of its start."""
        motors = self.motors is not None
        return estimation(self.predictor, motors), beginning(self.predictor, motors)

    @cached_property
    def _begin(self) -> Kernel:
        return Kernel(self.functions[1], {2: self.predictor.parameters, 3: self.levels})

    @cached_property
    def _estimate(self) -> Kernel:
        return Kernel(self.functions[0], {0: self.kalman, 3: self.acting, 4: self.levels})
