"""Torque at the output of the actuator for a held command, over one integration step."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import casadi as ca

from plant.effects import ActuatorLag, Effect, Expression, State
from plant.effects.ramp import Ramp
from plant.servo import ServoModel

Own: TypeAlias = Mapping[str, tuple[Any, ...]]  # states of each effect, by the name of the effect
_TINY = 1e-30
_LOOKS = 12  # equal parts of a step in whose middles a path is sampled


@dataclass(frozen=True, kw_only=True)
class Course:
    """Course of a torque or set-point over one step: three values, and the error of Simpson's rule for its mean.

    A lag or a ramp can settle in much less time than the step. A static law (dead zone, limit) can bend the course
    within the step. The mean at the output of such a law is therefore sampled along the path. The sampling error of the
    input's mean is assumed to reappear at the output in proportion. The result is correct in both limits and stays
    between the end values.

    Attributes:
        start, half, end: values at the start, after half of the step, and at its end [N m].
        early: error of the mean of the three values, as a fraction of end - start [-].
        path: torque in the middles of equal parts of the step [N m]; empty for a constant or linear course.
    """

    start: Expression
    half: Expression
    end: Expression
    early: Expression
    path: tuple[Expression, ...] = ()

    @classmethod
    def held(cls, torque: Expression) -> Course:
        """A constant torque."""
        return cls(start=torque, half=torque, end=torque, early=0.0)

    @classmethod
    def straight(cls, torque: Expression, more: Expression) -> Course:
        """A torque that rises linearly by `more`."""
        return cls(start=torque, half=torque + more / 2, end=torque + more, early=0.0)

    @property
    def is_held(self) -> bool:
        """Whether the torque is constant: start and end are the same expression."""
        return self.start is self.end

    @property
    def middle(self) -> Expression:
        """Value for the middle of the step with which Simpson's rule gives the correct mean [N m]."""
        return self.half + 1.5 * self.early * (self.end - self.start)

    @property
    def mean(self) -> Expression:
        """Mean over the step [N m]."""
        return (self.start + 4 * self.middle + self.end) / 6

    def through(self, law: Callable[[Expression], Expression]) -> Course:
        """The course at the output of a static law."""
        if self.is_held:
            return Course.held(law(self.start))
        behind = Course(
            start=law(self.start),
            half=law(self.half),
            end=law(self.end),
            early=0.0,
            path=tuple(map(law, self.along)),
        )
        way, way_behind = self.end - self.start, behind.end - behind.start
        missed = self.early - (self._sampled() / _not_zero(way) if self.path else 0.0)
        early = missed + behind._sampled() / _not_zero(way_behind)
        return replace(behind, early=ca.if_else(ca.fabs(way_behind) > 0, _bounded(early), 0))

    def moved(self, factor: Expression, shift: Expression = 0.0) -> Course:
        """The course at the output of an affine law."""
        if self.is_held:
            return Course.held(factor * self.start + shift)
        return Course(
            start=factor * self.start + shift,
            half=factor * self.half + shift,
            end=factor * self.end + shift,
            early=self.early,
            path=tuple(factor * value + shift for value in self.path),
        )

    def limited(self, limit: Expression) -> Course:
        """The course clipped to minus and plus a limit; three values are enough if it is linear, as steps split it."""

        def law(torque: Expression) -> Expression:
            return ca.fmax(ca.fmin(torque, limit), -limit)

        behind = self.through(law)
        return behind if self.path else replace(behind, early=0.0)

    @property
    def along(self) -> tuple[Expression, ...]:
        """The samples of the path, also of a constant or linear one [N m]."""
        way = self.end - self.start
        return self.path or tuple(self.start + (k + 0.5) / _LOOKS * way for k in range(_LOOKS))

    def _sampled(self) -> Expression:
        """Mean along the sampled path less the Simpson mean of the three values [N m]."""
        return sum(self.along) / _LOOKS - (self.start + 4 * self.half + self.end) / 6

    def followed_by(self, effect: Effect, state: Expression, h: Expression, *, straight: bool) -> Course:
        """The state of an effect driven by this torque over `h`; `straight` if the state moves linearly."""
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
            path=tuple(_stepped(effect, state, entering, h)),
        )

    def where(self, condition: Expression, other: Course) -> Course:
        """This course where a condition holds, the other one elsewhere."""
        curved = zip(self.along, other.along, strict=True) if self.path or other.path else ()
        return Course(
            start=ca.if_else(condition, self.start, other.start),
            half=ca.if_else(condition, self.half, other.half),
            end=ca.if_else(condition, self.end, other.end),
            early=ca.if_else(condition, self.early, other.early),
            path=tuple(ca.if_else(condition, one, another) for one, another in curved),
        )


def _stepped(effect: Effect, state: Expression, entering: Expression, h: Expression) -> Iterator[Expression]:
    """Samples of the path of an effect's state, each from the one before: all share one exponential."""
    length = h / (2 * _LOOKS)
    for _ in range(_LOOKS):
        state = effect.advance(state, entering, length)
        yield state
        length = h / _LOOKS


def _bounded(early: Expression) -> Expression:
    return ca.fmax(ca.fmin(early, 0.5), -0.5)


def _not_zero(way: Expression) -> Expression:
    return ca.if_else(ca.fabs(way) > 0, way, 1)


def played(
    model: ServoModel, own: Own, entering: Course, gain: Expression, h: Expression
) -> tuple[Course, dict[str, tuple[Any, ...]]]:
    """The command after the effects that act before the drive's law, and the states of these effects after `h`.

    The set-point (goal) of a position servo is its command over the servo gain. At gain zero there is none: the command
    passes unchanged, and an internal set-point keeps its value.
    """
    states: dict[str, tuple[Any, ...]] = {}
    course = entering
    for effect in model.effects:
        if State.COMMAND in effect.states:
            course = course.followed_by(effect, own[effect.name][0], h, straight=_is_straight(model, effect))
            states[effect.name] = (course.end,)
        elif State.SETPOINT in effect.states:
            wanted, straight = course.moved(1 / _or_one(gain)), _is_straight(model, effect)
            setpoint = wanted.followed_by(effect, own[effect.name][0], h, straight=straight)
            states[effect.name] = (ca.if_else(gain > 0, setpoint.end, setpoint.start),)
            course = setpoint.moved(gain).where(gain > 0, course)
    return course, states


def _followers(model: ServoModel) -> list[Effect]:
    """The effects of the actuator whose state follows their input."""
    kinds = (State.COMMAND, State.SETPOINT, State.TORQUE)
    return [effect for effect in model.effects if effect.states and effect.states[0] in kinds]


def _is_straight(model: ServoModel, effect: Effect) -> bool:
    """Whether the effect's state moves linearly within an integration step: a ramp, if steps end where the ramp ends.

    That is the case if no other effect of the actuator has a settling time.
    """
    return isinstance(effect, Ramp) and len(_followers(model)) == 1


def settling_time(model: ServoModel, own: Own, command: Expression, gain: Expression) -> Expression | None:
    """Time for the actuator's states to settle after a new command [s]; None if there are none."""
    times = []
    for effect in _followers(model):
        if State.SETPOINT in effect.states:
            ramp = effect.settling_time(own[effect.name][0], command / _or_one(gain))
            times.append(ca.if_else(gain > 0, ramp, 0))
        else:
            times.append(effect.settling_time(own[effect.name][0], command))
    return sum(times) if times else None


def settles_slowly(model: ServoModel, time: float) -> bool:
    """Whether every actuator effect with a state is a lag, and settles no faster than such a time [s]."""
    return all(isinstance(effect, ActuatorLag) and 2 * effect.time_constant >= time for effect in _followers(model))


def _or_one(gain: Expression) -> Expression:
    """The servo gain, for dividing a command into its set-point; one where the gain is zero."""
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
                path=tuple(
                    effect.command(*both, velocity) for both in zip(course.along, own_course.along, strict=True)
                ),
            )
        else:
            course = course.through(lambda torque, effect=effect: effect.command(torque, 0.0, velocity))  # type: ignore[misc]
    return course, states
