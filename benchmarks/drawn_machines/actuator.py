"""From the command that is held to the torque that turns the motor, link by link.

A link passes on the mean of its answer over a stretch of constant input, and keeps its state in closed form: short
lags and steep ramps need no short steps. What a link adds to what enters it is what the effect of its name is worth.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import exp

Values = Mapping[str, float]


@dataclass
class Link:
    """A law without memory: torque that enters, speed of the motor -> torque that leaves [N m]."""

    name: str
    law: Callable[[float, float], float]

    def mean(self, entering: float, speed: float, h: float) -> float:
        return self.law(entering, speed)

    def advance(self, entering: float, h: float) -> None:
        pass


@dataclass
class Lag(Link):
    """First order; the state is what leaves."""

    time_constant: float = 0.0
    state: float = 0.0

    def mean(self, entering: float, speed: float, h: float) -> float:
        settled = self.time_constant / h * (1.0 - exp(-h / self.time_constant))
        return entering + (self.state - entering) * settled

    def advance(self, entering: float, h: float) -> None:
        self.state = entering + (self.state - entering) * exp(-h / self.time_constant)


@dataclass
class Ramp(Link):
    """A limited slope; the state is what leaves."""

    rate: float = 0.0
    state: float = 0.0

    def mean(self, entering: float, speed: float, h: float) -> float:
        gap, reach = entering - self.state, self.rate * h
        if abs(gap) >= reach:
            return self.state + (0.5 * reach if gap > 0.0 else -0.5 * reach)
        return entering - 0.5 * gap * abs(gap) / reach

    def advance(self, entering: float, h: float) -> None:
        reach = self.rate * h
        self.state += min(max(entering - self.state, -reach), reach)


def _same(torque: float, speed: float) -> float:
    return torque


def _dead(half_width: float) -> Callable[[float, float], float]:
    return lambda torque, speed: torque - min(max(torque, -half_width), half_width)


def _clipped(limit: float) -> Callable[[float, float], float]:
    return lambda torque, speed: min(max(torque, -limit), limit)


def links_of(effects: Mapping[str, Values], dead_zone: float, current_lag: float) -> tuple[list[Link], list[Link]]:
    """The links before a position servo's law, and those behind it, in the order in which the torque meets them."""
    before: list[Link] = []
    behind: list[Link] = []
    if "goal_rate_limit" in effects:
        before.append(Ramp("goal_rate_limit", _same, rate=effects["goal_rate_limit"]["rate"]))
    if "rate_limit" in effects:
        behind.append(Ramp("rate_limit", _same, rate=effects["rate_limit"]["rate"]))
    if "actuator_lag" in effects:
        behind.append(Lag("actuator_lag", _same, time_constant=effects["actuator_lag"]["time_constant"]))
    if current_lag > 0.0:
        behind.append(Lag("current", _same, time_constant=current_lag))
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
    """The drive: a torque that is commanded, or the law kp (goal - angle) - kd velocity of a position servo.

    added: what each link has added since it was last asked, times its duration [N m s].
    """

    before: list[Link]
    behind: list[Link]
    kp: float = 0.0
    kd: float = 0.0
    added: dict[str, float] = field(default_factory=dict)

    def begin(self, command: float) -> None:
        """An inner goal begins at the first set-point; everything else begins without torque."""
        for link in self.before:
            if isinstance(link, Ramp):
                link.state = command

    def torque(self, held: float, angle: float, velocity: float, speed: float, h: float) -> float:
        """Mean torque that leaves the drive over `h`, of a load at an angle and velocity, a motor at a speed."""
        for link in self.before:
            held = link.mean(held, speed, h)
        if self.kp:
            held = self.kp * (held - angle) - self.kd * velocity
        for link in self.behind:
            held = link.mean(held, speed, h)
        return held

    def play(self, held: float, angle: float, velocity: float, speed: float, h: float) -> float:
        """The same, and the states go on by `h`."""
        factor = (self.kp or 1.0) * h
        for link in self.before:
            leaving = link.mean(held, speed, h)
            link.advance(held, h)
            self.added[link.name] += (leaving - held) * factor
            held = leaving
        if self.kp:
            held = self.kp * (held - angle) - self.kd * velocity
        for link in self.behind:
            leaving = link.mean(held, speed, h)
            link.advance(held, h)
            self.added[link.name] += (leaving - held) * h
            held = leaving
        return held
