"""From the held command to the motor torque, link by link.

A link with memory has a closed-form response to a constant input: at the start of a step, for its middle, and at its
end, so that Simpson's rule over the three gives the exact mean. Short lags and steep ramps need no short steps. The
torque of an effect is the output of its link less the input.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import exp

Values = Mapping[str, float]


@dataclass
class Link:
    """A static law: input torque, speed of the motor -> output torque [N m]."""

    name: str
    law: Callable[[float, float], float]


@dataclass
class Memory:
    """A link whose state is its output; `course`: output at the start, for the middle and at the end of a step."""

    name: str
    state: float = 0.0
    course: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def follow(self, entering: float, h: float) -> float:
        """Advance by `h` under a constant input; return the mean output."""
        before = self.state
        mean = self._advance(entering, h)
        self.course = (before, 1.5 * mean - 0.25 * (before + self.state), self.state)
        return mean

    def _advance(self, entering: float, h: float) -> float:
        raise NotImplementedError


@dataclass
class Lag(Memory):
    """First order."""

    time_constant: float = 0.0

    def _advance(self, entering: float, h: float) -> float:
        behind, decay = self.state - entering, exp(-h / self.time_constant)
        self.state = entering + behind * decay
        return entering + behind * self.time_constant / h * (1.0 - decay)


@dataclass
class Ramp(Memory):
    """A limited slope."""

    rate: float = 0.0

    def _advance(self, entering: float, h: float) -> float:
        gap, reach, before = entering - self.state, self.rate * h, self.state
        self.state += min(max(gap, -reach), reach)
        if abs(gap) >= reach:
            return 0.5 * (before + self.state)
        return entering - 0.5 * gap * abs(gap) / reach


def _dead(half_width: float) -> Callable[[float, float], float]:
    return lambda torque, speed: torque - min(max(torque, -half_width), half_width)


def _clipped(limit: float) -> Callable[[float, float], float]:
    return lambda torque, speed: min(max(torque, -limit), limit)


def links_of(
    effects: Mapping[str, Values], dead_zone: float, current_lag: float
) -> tuple[list[Memory], list[Link | Memory]]:
    """The links before a position servo's law, and those after it, in signal order."""
    before: list[Memory] = []
    behind: list[Link | Memory] = []
    if "setpoint_rate_limit" in effects:
        before.append(Ramp("setpoint_rate_limit", rate=effects["setpoint_rate_limit"]["rate"]))
    if "rate_limit" in effects:
        behind.append(Ramp("rate_limit", rate=effects["rate_limit"]["rate"]))
    if "actuator_lag" in effects:
        behind.append(Lag("actuator_lag", time_constant=effects["actuator_lag"]["time_constant"]))
    if current_lag > 0.0:
        behind.append(Lag("current", time_constant=current_lag))
    if "torque_saturation" in effects:
        behind.append(Link("torque_saturation", _clipped(effects["torque_saturation"]["limit"])))
    if "back_emf" in effects:
        constant = effects["back_emf"]["constant"]
        behind.append(Link("back_emf", lambda torque, speed: torque - constant * speed))
    if dead_zone > 0.0:
        behind.append(Link("dead_zone", _dead(dead_zone)))
    if "torque_offset" in effects:
        offset = effects["torque_offset"]["torque"]
        behind.append(Link("torque_offset", lambda torque, speed: torque + offset))
    return before, behind


@dataclass
class Actuator:
    """The drive: a torque command, or the law kp (set-point - angle) - kd velocity of a position servo.

    Attributes:
        added: time integral of the torque that each link has added since the last reset [N m s].
    """

    before: list[Memory]
    behind: list[Link | Memory]
    kp: float = 0.0
    kd: float = 0.0
    added: dict[str, float] = field(default_factory=dict)
    held: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def begin(self, command: float) -> None:
        """Set an internal set-point to the first command; all other links start at zero torque."""
        for link in self.before:
            link.state = command

    def follow(self, command: float, angle: float, velocity: float, speed: float, h: float) -> float:
        """Advance by `h` under a held command, for the motion in the middle of the step; return the mean torque."""
        self.held, torque = (command,) * 3, command
        for link in self.before:
            mean = link.follow(torque, h)
            self.added[link.name] += (mean - torque) * (self.kp or 1.0) * h
            self.held, torque = link.course, mean
        if self.kp:
            torque = self.kp * (torque - angle) - self.kd * velocity
        for each in self.behind:
            mean = each.follow(torque, h) if isinstance(each, Memory) else each.law(torque, speed)
            self.added[each.name] += (mean - torque) * h
            torque = mean
        return torque

    def torque(self, part: int, angle: float, velocity: float, speed: float) -> float:
        """Torque at the start (0), in the middle (1) or at the end (2) of the last step."""
        torque = self.held[part]
        if self.kp:
            torque = self.kp * (torque - angle) - self.kd * velocity
        for link in self.behind:
            torque = link.course[part] if isinstance(link, Memory) else link.law(torque, speed)
        return torque
