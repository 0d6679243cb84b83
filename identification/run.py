"""One checked experiment: the input of fit, prediction and diagnosis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.errors import MalformedLog
from identification.recording import Array, Recording, Response, drive_torque, nothing

_OPTIONAL = ("velocity", "reference", "setpoint", "acceleration", "direction")


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """One experiment with its initial state.

    The drive's torque is `command - servo_gain * output - servo_damping * velocity` of the true motion, within
    `command_limit`, so a torque log has `servo_gain` 0 and a position servo has `command = servo_gain * setpoint`.

    label: its source, such as "log.csv run 3".
    number: index of the experiment in the log, from 0 on; pieces of one experiment have the same number.
    run: label of the experiment in the run column; its number without such a column.
    time: (T,) strictly increasing [s], counted from `zero` on the recording's clock.
    command: (T,) output torque [N m] or force [N].
    output: (T,) load angle [rad] or position [m]; masked samples hold interpolated values. If only the velocity was
        logged, it is the integral of the velocity from zero on, used for starting values and never fitted.
    valid: (T,) False where the measurement is masked out of the fit.
    response: the measured quantity that is fitted: the "angle", the "velocity", or for an inverse model the "torque".
    servo_gain: (T,) torque per output error [N m/rad] or [N/m].
    servo_damping: (T,) torque per speed of the load [N m s/rad] or [N s/m]; zero by default.
    command_limit: largest magnitude of the drive's torque [N m] or force [N].
    velocity, reference, setpoint: (T,) of the load, when logged.
    acceleration, direction: (T,) of the load, and the sign of its velocity after a low pass, for an inverse model.
    own: differences of this run's parameters from those of the model, by name: for example a payload's inertia.
    zero: recording's clock at time zero [s]; the clock may count from 1970.
    start: time of the file's first sample, in the time of the run [s].
    drive_angles, torques: (T, 2) motor shaft angles [rad] and pinion torques [N m], when logged.

    Raises `MalformedLog` when shapes differ, a number is not finite, or time does not increase.
    """

    label: str
    number: int
    time: Array
    command: Array
    output: Array
    valid: NDArray[np.bool_]
    servo_gain: Array
    servo_damping: Array = field(default_factory=nothing)
    response: Response = "angle"
    command_limit: float = np.inf
    velocity: Array | None = None
    reference: Array | None = None
    setpoint: Array | None = None
    acceleration: Array | None = None
    direction: Array | None = None
    drive_angles: Array | None = None
    torques: Array | None = None
    own: Mapping[str, float] = field(default_factory=dict)
    zero: float = 0.0
    run: str = ""
    start: float = 0.0

    def __post_init__(self) -> None:
        """Convert the channels to float arrays and check that they fit together."""
        object.__setattr__(self, "run", self.run or str(self.number))
        if not np.any(self.servo_damping):
            object.__setattr__(self, "servo_damping", np.zeros(len(self.time)))
        shapes: dict[str, tuple[int, ...]] = dict.fromkeys(
            ("time", "command", "output", "servo_gain", "servo_damping", *_OPTIONAL), (len(self.time),)
        )
        shapes |= dict.fromkeys(("drive_angles", "torques"), (len(self.time), 2))
        for name, shape in shapes.items():
            value = getattr(self, name)
            if value is None and name in (*_OPTIONAL, "drive_angles", "torques"):
                continue
            value = np.asarray(value, dtype=np.float64)
            if value.shape != shape:
                raise MalformedLog(f"{self.label}: '{name}' has shape {value.shape} instead of {shape}.")
            if not np.isfinite(value).all():
                index = int(np.argwhere(~np.isfinite(value))[0][0])
                raise MalformedLog(f"{self.label}, sample {index}: '{name}' is not a finite number, mask or repair it.")
            object.__setattr__(self, name, _fixed(value))
        object.__setattr__(self, "valid", _fixed(np.asarray(self.valid, dtype=bool)))
        if self.valid.shape != self.time.shape:
            raise MalformedLog(f"{self.label}: 'valid' has shape {self.valid.shape} instead of {self.time.shape}.")
        if len(self.time) < 2 or np.any(np.diff(self.time) <= 0):
            raise MalformedLog(f"{self.label}: a run needs two samples or more and a time that strictly increases.")
        if not self.command_limit > 0:
            raise MalformedLog(f"{self.label}: the command limit is {self.command_limit:g}, it must be positive.")

    def __len__(self) -> int:
        """Number of samples."""
        return len(self.time)

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        return float(self.time[-1] - self.time[0])

    @cached_property
    def sample_time(self) -> float:
        """Median time step [s]."""
        return float(np.median(np.diff(self.time)))

    @cached_property
    def positioned(self) -> bool:
        """Whether the drive closes a position loop at some time: the command has its set-point, not its torque."""
        return bool(np.any(self.servo_gain))

    @property
    def measured(self) -> Array:
        """(T,) measured quantity that is fitted: the output, the velocity alone, or the torque."""
        if self.response != "velocity":
            return self.output if self.response == "angle" else self.command
        if self.velocity is None:
            raise MalformedLog(f"{self.label}: a run of the velocity alone has no velocity.")
        return self.velocity

    @cached_property
    def drive(self) -> Array:
        """(T,) torque of the drive's control law along the measured motion, without its limit."""
        return drive_torque(self.command, self.servo_gain, self.servo_damping, self.output, self.time)

    def slice(self, start: int | None, stop: int | None) -> Run:
        """The samples `start` to `stop` (by index, as in `a[start:stop]`), with their times unchanged."""
        names = (
            "time",
            "command",
            "output",
            "valid",
            "servo_gain",
            "servo_damping",
            *_OPTIONAL,
            "drive_angles",
            "torques",
        )
        cut = {name: getattr(self, name)[start:stop] for name in names if getattr(self, name) is not None}
        return replace(self, **cut)

    @classmethod
    def from_recording(cls, recording: Recording, zero: float = 0.0, own: Mapping[str, float] | None = None) -> Run:
        """A checked recording as a run whose time counts from `zero` on the recording's clock."""
        others, output = recording.others, recording.output
        if recording.response == "velocity":
            others = others | {"velocity": output}
            steps = 0.5 * (output[1:] + output[:-1]) * np.diff(recording.time)
            output = np.concatenate(([0.0], np.cumsum(steps)))
        return cls(
            label=recording.label,
            number=recording.number,
            time=recording.time - zero,
            command=recording.command,
            output=output,
            response=recording.response,
            valid=recording.valid,
            servo_gain=recording.servo_gain,
            servo_damping=recording.servo_damping,
            command_limit=recording.command_limit,
            velocity=others.get("velocity"),
            reference=others.get("reference"),
            setpoint=others.get("setpoint"),
            drive_angles=_pair(others, "angle_1", "angle_2"),
            torques=_pair(others, "torque_1", "torque_2"),
            own=own or {},
            zero=zero,
            run=recording.run,
            start=recording.start - zero,
        )


def _pair(others: dict[str, Array], first: str, second: str) -> Array | None:
    if first in others and second in others:
        return np.stack([others[first], others[second]], axis=1)
    return None


def _fixed(values: NDArray[Any]) -> NDArray[Any]:
    """An array that cannot be changed in place; whoever passed it keeps a writeable one."""
    view = values.view()
    view.flags.writeable = False
    return view
