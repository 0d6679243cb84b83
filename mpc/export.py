"""A controller as C99 files for a target: see the templates in `mpc/target`.

The code has the parts of `CompiledStep.source`. The state is in a struct of the caller and the constants are in tables,
so the code runs from read-only memory and has no fixed addresses.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from string import Template
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpc import effort
from mpc.controller import Controller
from mpc.status import Trouble, sentence
from mpc.target_report import ranges, words_of
from plant.errors import BadParameter

Array = NDArray[np.float64]

FILES = ("controller.h", "controller.c", "driver.c", "CMakeLists.txt", "README.txt")
"""Templates; the names of the first two get the name of the controller as a prefix."""

_CONSTANT = (
    "model",
    "stage_numbers",
    "reach_numbers",
    "allocation_numbers",
    "govern_numbers",
    "levels",
    "machine",
    "tuning",
    "prices",
    "moved",
    "soft",
    "rubbing",
    "watching",
)
_SHOWN = ("outcome", "torques", "angles")
_CLOCK = 200e6  # clock of the Cortex-M7 of the estimate [Hz]

CERTIFIED = {"double": "1e-6", "single": "1e-5f"}
"""Largest residual of an accepted solution, in units of the greatest torque."""

_FIRM, _DIGITS = {"double": "1e4", "single": "1e2f"}, {"double": "2.3e-16", "single": "1.2e-7f"}
"""Penalty weight of a held interval end (see `mpc.active_set.FIRM`), and relative rounding error."""

_STIFF, _CLOSE = {"double": "1e11", "single": "1e5f"}, {"double": "1e-9", "single": "1e-6f"}
"""Greatest curvature of the barrier of the interior point method, and its tolerance, as the precision allows."""


@dataclass(frozen=True, kw_only=True)
class TargetCode:
    """A controller for a target.

    Attributes:
        files: name and content of each.
        name: prefix of every symbol.
        precision: "double" or "single".
        memory: size of the struct of one controller [bytes].
        stack: upper bound of the stack of one step [bytes].
        usual, worst: operations of one step.
        sample_time: time available for a step [s].
    """

    files: Mapping[str, str]
    name: str
    precision: str
    memory: int
    stack: int
    usual: effort.Effort
    worst: effort.Effort
    sample_time: float

    @property
    def cortex_m7(self) -> tuple[float, float]:
        """Estimated time of a usual and of the worst step on a Cortex-M7 at 200 MHz [s]."""
        costs = effort.CORTEX_M7[self.precision]
        return self.usual.cycles(costs) / _CLOCK, self.worst.cycles(costs) / _CLOCK

    def summary(self) -> dict[str, Any]:
        """The key figures; times in seconds, sizes in bytes."""
        return {
            "schema": 1,
            "files": list(self.files),
            "name": self.name,
            "precision": self.precision,
            "memory": self.memory,
            "stack": self.stack,
            "operations": {"usual": vars(self.usual), "worst": vars(self.worst)},
            "cortex_m7_200_mhz": dict(zip(("usual", "worst"), self.cortex_m7, strict=True)),
            "fits": dict(zip(("usual", "worst"), (t <= self.sample_time for t in self.cortex_m7), strict=True)),
        }

    def sentences(self) -> list[str]:
        """The key figures in sentences."""
        usual, worst = (1e6 * time for time in self.cortex_m7)
        return [
            f"A controller takes {self.memory} bytes and at most {self.stack} of stack, in {self.precision} precision.",
            f"A step takes {self.usual.total} operations, {self.worst.total} at most: an estimated {usual:.0f} and "
            f"{worst:.0f} us on a Cortex-M7 at 200 MHz.",
            *self._too_slow(),
        ]

    def _too_slow(self) -> list[str]:
        """A sentence if the usual or the worst step takes longer on the Cortex-M7 than a sample."""
        usual, worst = (time > self.sample_time for time in self.cortex_m7)
        if not worst:
            return []
        what = "Even the usual step does" if usual else "The usual step fits, the worst one does"
        return [f"{what} NOT FIT into a sample of {1e6 * self.sample_time:.0f} us there; {self._way_out(usual)}."]

    def _way_out(self, usual: bool) -> str:
        """How to make a step fit; single precision only if its estimate fits."""
        rest = "a shorter horizon or a longer sample may"
        if self.precision == "single":
            return rest
        needed = self.usual if usual else self.worst
        time = needed.cycles(effort.CORTEX_M7["single"]) / _CLOCK
        estimate = f"an estimated {1e6 * time:.0f} us"
        if time <= self.sample_time:
            return f"in single precision (--single) it would take {estimate}"
        return f"single precision alone would not do ({estimate}), {rest}"


def export(controller: Controller, *, single: bool = False, name: str = "antidrive") -> TargetCode:
    """The C99 files of a controller, without its present state.

    In double precision the code gives the torques of the Python form to the last bit. README.txt states the accuracy
    of single precision.

    Args:
        controller: the controller to export.
        single: numbers of 4 bytes instead of 8, for targets without double precision.
        name: prefix of the controller's files and of every symbol and constant, so that several controllers link into
            one program.

    Raises:
        BadParameter: a name that is not valid in C.
    """
    check_name(name)
    precision = "single" if single else "double"
    arrays, sizes, stages = controller._arrays, controller._sizes, controller._machine_code.stages
    remembered = {field: array.size for field, array in arrays.items() if field not in _CONSTANT}
    number = 4 if single else 8
    made = TargetCode(
        files={},
        name=name,
        precision=precision,
        memory=number * sum(remembered.values()),
        stack=effort.stack(stages, number),
        usual=effort.of_step(stages, sizes, worst=False),
        worst=effort.of_step(stages, sizes, worst=True),
        sample_time=controller.sample_time,
    )
    words = {
        "name": name,
        "NAME": name.upper(),
        "real": "float" if single else "double",
        "sample_time": _number(controller.sample_time, single),
        "min_torque": _number(float(np.min(controller.bounds.least)), single),
        "max_torque": _number(float(np.max(controller.bounds.greatest)), single),
        "intervals": _intervals(controller, name.upper(), single),
        "drives": controller.gears.drives,
        **sizes,
        "again": effort.again(stages, sizes),
        "tries": effort.tries(stages, sizes),
        "motors": int(controller.motor_resolution is not None),
        "statuses": _statuses(name.upper()),
        "torques": remembered["torques"],
        "angles": remembered["angles"],
        "members": _members(name, {field: size for field, size in remembered.items() if field not in _SHOWN}),
        "constants": "".join(_table(table, arrays[table], single) for table in _CONSTANT),
        "certified": CERTIFIED[precision],
        "digits": _DIGITS[precision],
        "firm": _FIRM[precision],
        "stiff": _STIFF[precision],
        "close": _CLOSE[precision],
        **{part: _literals(code, single) for part, code in controller._machine_code.parts.items()},
    }
    words |= words_of(controller) | _cost(controller, made)
    filled = {_own(name, file): Template(_template(file)).substitute(words) for file in FILES}
    return TargetCode(**(vars(made) | {"files": filled}))


def check_name(name: str) -> None:
    """Raise `BadParameter` unless the name is a valid prefix of C names."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,39}", name, re.ASCII):
        raise BadParameter(
            f"name must be a word of C, up to 40 letters, digits and underscores with a letter first, not {name!r}."
        )


def _own(name: str, file: str) -> str:
    """Name of the file of a template; header and code get the prefix, to coexist with other controllers."""
    return f"{name}_{file}" if file.startswith("controller.") else file


def _template(file: str) -> str:
    return (files("mpc") / "target" / file).read_text(encoding="utf-8")


def _literals(code: str, single: bool) -> str:
    """The code with its numeric literals in the precision of the target."""
    if not single:
        return code
    return re.sub(r"(?<![\w.])(?:\d+\.\d*(?:e[+-]?\d+)?|\d+e[+-]?\d+)(?![\w.])", _short, code)


def _short(literal: re.Match[str]) -> str:
    """A literal for single precision; values outside its range are clipped to its limits."""
    value, limits = float(literal[0]), np.finfo(np.float32)
    least, most = float(limits.tiny), float(limits.max)
    if 0.0 < value < least or value > most:
        return f"{min(max(value, least), most):.8e}f"
    return f"{literal[0]}f"


def _statuses(prefix: str) -> str:
    """The status values as C constants, each with its sentence as a comment."""
    reasons = [reason for reason in Trouble if reason]
    lines = [f"  {prefix}_{reason.name} = {reason.value}, /* {sentence(reason)} */" for reason in reasons]
    return "\n".join(lines).replace(f"{reasons[-1].value},", f"{reasons[-1].value}")


def _members(name: str, sizes: Mapping[str, int]) -> str:
    return "\n".join(f"  {name}_real {field}[{size}];" for field, size in sizes.items())


def _table(name: str, values: Array, single: bool) -> str:
    numbers = ", ".join(_number(value, single) for value in values.tolist())
    return f"static const real {name}[{values.size}] = {{{numbers}}};\n"


def _number(value: float, single: bool) -> str:
    """A C literal that gives exactly the same number."""
    if np.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    return f"{float(value)!r}{'f' if single else ''}"


def _intervals(controller: Controller, prefix: str, single: bool) -> str:
    """The torque range of each drive as C constants."""
    return "\n".join(
        f"#define {prefix}_TORQUE_{drive}_{end} ({_number(value, single)})"
        for drive, interval in enumerate(ranges(controller), start=1)
        for end, value in zip(("LOW", "HIGH"), interval, strict=True)
    )


def _cost(controller: Controller, made: TargetCode) -> dict[str, str]:
    """The cost of a step, for README.txt."""
    usual, worst = (1e6 * time for time in made.cortex_m7)
    costs = effort.CORTEX_M7[made.precision]
    ends = [
        "fits into a sample"
        if time <= controller.sample_time
        else "DOES NOT FIT into a sample; that of a shorter horizon may"
        for time in made.cortex_m7
    ]
    return {
        "servo": str(controller.model),
        "seconds": f"{controller.sample_time:g}",
        "precision": made.precision,
        "memory": str(made.memory),
        "stack": str(made.stack),
        **{f"usual_{kind}": str(count) for kind, count in vars(made.usual).items()},
        **{f"worst_{kind}": str(count) for kind, count in vars(made.worst).items()},
        **{f"cost_{kind}": str(count) for kind, count in vars(costs).items()},
        "usual_time": f"{usual:.0f}",
        "worst_time": f"{worst:.0f}",
        "usual_fits": ends[0],
        "worst_fits": ends[1],
    }
