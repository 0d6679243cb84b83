"""One experiment as it was recorded, before and during its checks."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
Response: TypeAlias = Literal["angle", "velocity", "torque"]


def nothing() -> Array:
    """Default of a channel that most logs do not have: empty, later replaced by zeros."""
    return np.zeros(0)


@dataclass(frozen=True, kw_only=True)
class Finding:
    """The finding of a check in one recording.

    `kind` names the check, so that the same finding in a hundred runs can be reported once; `repaired` is True
    when samples were changed, masked or left out; `text` is one sentence that says where. `unusable` is True when no
    model can be fitted to the recording as it is.
    """

    kind: str
    repaired: bool
    text: str
    unusable: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """One experiment in SI units and the sign conventions of the log contract, not yet checked.

    number: index of the experiment in its file; its pieces have the same number.
    time, command, output, servo_gain: (T,) [s], [N m] or [N], [rad] or [m], [N m/rad] or [N/m].
    servo_damping: (T,) of a position servo's control law [N m s/rad] or [N s/m]; zero by default.
    valid: (T,) False where the output is masked out of the fit.
    response: what `output` measures, an "angle" (or position), or a "velocity" [rad/s] or [m/s].
    rows: (T,) data row of each sample, counted from 1; `first_line` is the line of row 1 in a text file.
    names: names of "command" and "output" in the file, for messages.
    stated: "time", "command", "output", "velocity", if the file, its headings, or the user gives their unit; "rate" if
        the times are counted with a sampling rate.
    others: further channels by their name in the log contract, (T,) each.
    run: label of the experiment in the run column; its number without such a column.
    start: clock time of the first sample of the file [s].
    """

    label: str
    number: int
    time: Array
    command: Array
    output: Array
    servo_gain: Array
    valid: NDArray[np.bool_]
    rows: NDArray[np.int64]
    servo_damping: Array = field(default_factory=nothing)
    axis: str = "rotary"
    response: Response = "angle"
    command_limit: float = np.inf
    first_line: int | None = None
    names: dict[str, str] = field(default_factory=dict)
    stated: frozenset[str] = frozenset()
    others: dict[str, Array] = field(default_factory=dict)
    run: str = ""
    start: float = 0.0

    def __post_init__(self) -> None:
        """Name an experiment without a label by its number; expand a missing damping to zeros."""
        object.__setattr__(self, "run", self.run or str(self.number))
        if not np.any(self.servo_damping):
            object.__setattr__(self, "servo_damping", np.zeros(len(self.time)))

    def __len__(self) -> int:
        """Number of samples."""
        return len(self.time)

    @property
    def drive(self) -> Array:
        """(T,) torque of the drive's control law along the measured motion, without its limit."""
        return drive_torque(self.command, self.servo_gain, self.servo_damping, self.output, self.time)

    def name(self, channel: str) -> str:
        """The user's name of "command", "output" or another channel."""
        rotary = self.axis == "rotary"
        usual = {"command": "torque" if rotary else "force", "output": "angle" if rotary else "position"}
        if self.response == "velocity":
            usual["output"] = "velocity"
        return self.names.get(channel, usual.get(channel, channel))

    def where(self, index: int) -> str:
        """File, row, line and time since the file's first sample, for messages."""
        row = int(self.rows[index])
        line = "" if self.first_line is None else f" (line {row + self.first_line - 1})"
        time = self.time[index] - self.start
        since = " after the start" if self.start else ""
        return f"{self.label}, row {row}{line}" + (f", t = {time:.6g} s{since}" if np.isfinite(time) else "")

    def take(self, index: NDArray[np.bool_] | NDArray[np.int64] | slice, label: str | None = None) -> Recording:
        """The samples selected by `index`, in every channel."""
        return replace(
            self,
            label=label or self.label,
            time=self.time[index],
            command=self.command[index],
            output=self.output[index],
            servo_gain=self.servo_gain[index],
            servo_damping=self.servo_damping[index],
            valid=self.valid[index],
            rows=self.rows[index],
            others={name: values[index] for name, values in self.others.items()},
        )


def drive_torque(command: Array, servo_gain: Array, servo_damping: Array, output: Array, time: Array) -> Array:
    """(T,) torque of a drive along a measured motion: command - gain * output - damping * velocity."""
    torque = command - servo_gain * output
    return torque - servo_damping * np.gradient(output, time) if servo_damping.any() else torque


Checked: TypeAlias = tuple[Recording, list[Finding]]


def counted(number: int, noun: str) -> str:
    """A number with its noun: "1 sample", "3 samples"."""
    return f"{number} {noun}{'s' * (number != 1)}"
