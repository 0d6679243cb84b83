"""From the command to the torque that reaches the drivetrain, over one integration step of a held command."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import casadi as ca

from plant.effects import ActuatorLag, Effect, Expression, State
from plant.effects.ramp import Ramp
from plant.servo import ServoModel

Own: TypeAlias = Mapping[str, tuple[Any, ...]]  # states of the effects by name
_TINY = 1e-30
_LOOKS = tuple((k + 0.5) / 12 for k in range(12))  # shares of a step at which a path is looked at


@dataclass(frozen=True, kw_only=True)
class Course:
    """A torque, or a goal, over a step, in three values and what Simpson's rule over them leaves out of its mean.

    A lag or a ramp may make its way in much less time than the step. A law without memory (a dead zone, a limit) may
    bend it within the step: the mean behind it is looked for along the path, and what the looking misses of the mean
    before it is missed behind it in proportion. So it is right in both limits, and never beyond the two ends.

    Attributes:
        start, half, end: at the start, after half of the step, at its end [N m].
        early: share of the way from start to end that is missing in the mean of the three [-].
        path: where the torque is after a share of the step [N m]; None where its way is straight, or there is none.
        seen: where it was looked at.
    """

    start: Expression
    half: Expression
    end: Expression
    early: Expression
    path: Callable[[float], Expression] | None = None
    seen: dict[float, Expression] = field(default_factory=dict)

    @classmethod
    def held(cls, torque: Expression) -> Course:
        """A torque that does not change."""
        return cls(start=torque, half=torque, end=torque, early=0.0)

    @classmethod
    def straight(cls, torque: Expression, more: Expression) -> Course:
        """A torque that rises evenly by so much."""
        return cls(start=torque, half=torque + more / 2, end=torque + more, early=0.0)

    @property
    def is_held(self) -> bool:
        """Whether it does not change: start and end are one and the same expression."""
        return self.start is self.end

    @property
    def middle(self) -> Expression:
        """What stands for the middle of the step, so that Simpson's rule finds the mean [N m]."""
        return self.half + 1.5 * self.early * (self.end - self.start)

    @property
    def mean(self) -> Expression:
        """Over the step [N m]."""
        return (self.start + 4 * self.middle + self.end) / 6

    def through(self, law: Callable[[Expression], Expression]) -> Course:
        """Behind a law without memory."""
        if self.is_held:
            return Course.held(law(self.start))
        behind = Course(
            start=law(self.start),
            half=law(self.half),
            end=law(self.end),
            early=0.0,
            path=lambda share: law(self.at(share)),
        )
        way, way_behind = self.end - self.start, behind.end - behind.start
        missed = self.early - (0.0 if self.path is None else self._seen_along() / _not_zero(way))
        early = missed + behind._seen_along() / _not_zero(way_behind)
        return replace(behind, early=ca.if_else(ca.fabs(way_behind) > 0, _bounded(early), 0))

    def moved(self, factor: Expression, shift: Expression = 0.0) -> Course:
        """Behind a law that is linear."""
        if self.is_held:
            return Course.held(factor * self.start + shift)
        return Course(
            start=factor * self.start + shift,
            half=factor * self.half + shift,
            end=factor * self.end + shift,
            early=self.early,
            path=None if self.path is None else lambda share: factor * self.at(share) + shift,
        )

    def limited(self, limit: Expression) -> Course:
        """Between minus and plus a limit; of a straight way, which steps follow in parts, three values tell enough."""

        def law(torque: Expression) -> Expression:
            return ca.fmax(ca.fmin(torque, limit), -limit)

        behind = self.through(law)
        return behind if self.path is not None else replace(behind, early=0.0)

    def at(self, share: float) -> Expression:
        """After a share of the step [N m]; the same expression each time, for what comes behind looks at it too."""
        if share not in self.seen:
            straight = self.start + share * (self.end - self.start)
            self.seen[share] = straight if self.path is None else self.path(share)
        return self.seen[share]

    def _seen_along(self) -> Expression:
        """What the path has more in the mean than the three values [N m]."""
        return sum(self.at(share) for share in _LOOKS) / len(_LOOKS) - (self.start + 4 * self.half + self.end) / 6

    def followed_by(self, effect: Effect, state: Expression, h: Expression, *, straight: bool) -> Course:
        """The state of an effect that follows this torque over `h`, if `straight` without a bend on its way."""
        entering = self.mean
        if straight:
            after = effect.advance(state, entering, h)
            return Course(start=state, half=(state + after) / 2, end=after, early=0.0)
        half, after = effect.advance(state, entering, h / 2), effect.advance(state, entering, h)
        missing, way = effect.mean(state, entering, h) - (state + 4 * half + after) / 6, after - state
        early = missing * way / (way**2 + _TINY)
        return Course(
            start=state,
            half=half,
            end=after,
            early=_bounded(early),
            path=lambda share: effect.advance(state, entering, share * h),
        )

    def where(self, condition: Expression, other: Course) -> Course:
        """This one where a condition holds, elsewhere another."""
        straight = self.path is None and other.path is None
        return Course(
            start=ca.if_else(condition, self.start, other.start),
            half=ca.if_else(condition, self.half, other.half),
            end=ca.if_else(condition, self.end, other.end),
            early=ca.if_else(condition, self.early, other.early),
            path=None if straight else lambda share: ca.if_else(condition, self.at(share), other.at(share)),
        )


def _bounded(early: Expression) -> Expression:
    return ca.fmax(ca.fmin(early, 0.5), -0.5)


def _not_zero(way: Expression) -> Expression:
    return ca.if_else(ca.fabs(way) > 0, way, 1)


def played(
    model: ServoModel, own: Own, entering: Course, gain: Expression, h: Expression
) -> tuple[Course, dict[str, tuple[Any, ...]]]:
    """The command behind the effects that shape it before the drive's law, and the states of these after `h`.

    The goal of a position servo is its command over the servo gain. At gain zero there is none: the command passes, and
    an internal goal stays where it is.
    """
    states: dict[str, tuple[Any, ...]] = {}
    course = entering
    for effect in model.effects:
        if State.COMMAND in effect.states:
            course = course.followed_by(effect, own[effect.name][0], h, straight=_is_straight(model, effect))
            states[effect.name] = (course.end,)
        elif State.GOAL in effect.states:
            wanted, straight = course.moved(1 / _or_one(gain)), _is_straight(model, effect)
            goal = wanted.followed_by(effect, own[effect.name][0], h, straight=straight)
            states[effect.name] = (ca.if_else(gain > 0, goal.end, goal.start),)
            course = goal.moved(gain).where(gain > 0, course)
    return course, states


def _followers(model: ServoModel) -> list[Effect]:
    """The effects whose state follows what enters them on the way to the drivetrain."""
    kinds = (State.COMMAND, State.GOAL, State.TORQUE)
    return [effect for effect in model.effects if effect.states and effect.states[0] in kinds]


def _is_straight(model: ServoModel, effect: Effect) -> bool:
    """Whether an effect's way has no bend inside an integration step: a ramp at whose end a step ends.

    That is so where nothing else has a settling time beside it.
    """
    return isinstance(effect, Ramp) and len(_followers(model)) == 1


def settling_time(model: ServoModel, own: Own, command: Expression, gain: Expression) -> Expression | None:
    """How long the states on the way to the drivetrain take to follow a new command [s], None if there are none."""
    times = []
    for effect in _followers(model):
        if State.GOAL in effect.states:
            ramp = effect.settling_time(own[effect.name][0], command / _or_one(gain))
            times.append(ca.if_else(gain > 0, ramp, 0))
        else:
            times.append(effect.settling_time(own[effect.name][0], command))
    return sum(times) if times else None


def settles_slowly(model: ServoModel, time: float) -> bool:
    """Whether what follows a command, if anything does, is a lag that goes on for longer than such a time [s]."""
    return all(isinstance(effect, ActuatorLag) and 2 * effect.time_constant >= time for effect in _followers(model))


def _or_one(gain: Expression) -> Expression:
    """The servo gain, by which a command is divided for its goal; one where there is neither."""
    return ca.if_else(gain > 0, gain, 1)


def actuated(
    model: ServoModel, own: Own, drive: Course, h: Expression, velocity: Expression
) -> tuple[Course, dict[str, tuple[Any, ...]]]:
    """Torque at the output of the actuator for a commanded torque, and the states of its effects after `h`."""
    states: dict[str, tuple[Any, ...]] = {}
    course = drive
    for effect in model.effects:
        if State.TORQUE in effect.states:
            own_course = course.followed_by(effect, own[effect.name][0], h, straight=False)
            states[effect.name] = (own_course.end,)
            course = Course(
                start=effect.command(course.start, own_course.start, velocity),
                half=effect.command(course.half, own_course.half, velocity),
                end=effect.command(course.end, own_course.end, velocity),
                early=own_course.early,
                path=lambda share, effect=effect, before=course, own=own_course: effect.command(  # type: ignore[misc]
                    before.at(share), own.at(share), velocity
                ),
            )
        else:
            course = course.through(lambda torque, effect=effect: effect.command(torque, 0.0, velocity))  # type: ignore[misc]
    return course, states
