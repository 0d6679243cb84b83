"""One integration step of the servo: actuator, drivetrain, load and sensor under a held command.

The motion is integrated by the classical Runge-Kutta method. Closed forms are used instead for states of the actuator,
forces that depend on the travel, the sensor, and dry friction at a reversal.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from plant.actuator import Course, Own, actuated, played
from plant.effects import Effect, Expression, Moment, State
from plant.servo import ServoModel


@dataclass(frozen=True, kw_only=True)
class Step:
    """Inputs of an integration step.

    Attributes:
        command: held torque command, of a position servo servo gain times set-point; of a measured torque its value at
            the beginning [N m].
        gain, damping, limit: the drive's law, see `plant.discrete.INPUTS`.
        rise: slope of a measured torque [N m/s].
        time, length: start and length of the step [s].
        width: smoothing of dry friction [rad/s].
    """

    command: Expression
    gain: Expression
    damping: Expression
    limit: Expression
    time: Expression
    length: Expression
    width: Expression
    rise: Expression = 0.0

    def entering(self, model: ServoModel) -> Course:
        """The held command, or the acting torque if that of the log is measured with a lag."""
        lead = model.lead()
        if lead is None:
            return Course.held(self.command)
        return Course.straight(self.command + lead * self.rise, self.rise * self.length)

    def drive(self, model: ServoModel, own: Own, angle: Expression, velocity: Expression) -> Course:
        """Torque of the drive's law at an angle and a velocity of the load."""
        course, _ = played(model, own, self.entering(model), self.gain, self.length)
        return course.moved(1.0, -self.gain * angle - self.damping * velocity).limited(self.limit)


def advance(model: ServoModel, state: Any, step: Step) -> Any:
    """The state (n,) after an integration step."""
    own, h = model.own_states(state), step.length
    motor = model.drivetrain
    start = [state[0], state[1], *(own[motor.name] if motor else ())]
    x, v = start[:2]
    way = _Way.of(model, own, step)
    accelerates = _accelerates(model, own, step, x, v)

    def arriving(motion: list[Any], part: str) -> tuple[Any, Any]:
        """Torque after the actuator and after the drivetrain, at the start, middle or end of the step."""
        torque = way.torque(part, motion[0], motion[1], motion[-1])
        if motor is None:
            return torque, torque
        return torque, motor.coupling(motion[2] - motion[0], motion[3] - motion[1], model.inertia)

    def rates(motion: list[Any], part: str) -> list[Any]:
        torque, behind = arriving(motion, part)
        load = [motion[1], accelerates(motion[0], motion[1], behind, {"start": 0.0, "middle": h / 2, "end": h}[part])]
        if motor is None:
            return load
        return [*load, motion[3], (torque - behind) / (motor.share() * model.inertia)]

    def moved(by: Any, slopes: list[Any]) -> list[Any]:
        return [value + by * slope for value, slope in zip(start, slopes, strict=True)]

    k1 = rates(start, "start")
    k2 = rates(moved(h / 2, k1), "middle")
    k3 = rates(moved(h / 2, k2), "middle")
    k4 = rates(moved(h, k3), "end")
    end = [s + h / 6 * (a + 2 * b + 2 * c + d) for s, a, b, c, d in zip(start, k1, k2, k3, k4, strict=True)]
    half = moved(h / 2, k1)
    if model.slides:
        speed = (ca.if_else(v * end[1] > 0, v, 0) + end[1]) / 2  # mean; after a reversal that of the rest of the step
        at = _moment(model, step, x, (x, speed), arriving(half, "middle")[1], h / 2)
        end[:2] = _stop_and_go(model, x, v, end[0], end[1], at, step)
    angles = x, (x + end[0]) / 2 + h * (v - end[1]) / 8, end[0]
    return ca.vertcat(end[0], end[1], *_own_after(model, own, step, way, angles, half[:2], end))


def _moment(model: ServoModel, step: Step, begin: Any, motion: tuple[Any, Any], torque: Any, elapsed: Any) -> Moment:
    """Variables of the load with a motion (angle, velocity), some time after the step began at an angle."""
    return Moment(
        angle=motion[0],
        velocity=motion[1],
        torque=torque,
        time=step.time + elapsed,
        travel=motion[0] - begin,
        step=step.length,
        inertia=model.inertia,
    )


def _accelerates(model: ServoModel, own: Own, step: Step, begin: Any, direction: Any) -> Callable[..., Any]:
    """Acceleration of the load by angle, velocity, torque and elapsed time; built once for all Runge-Kutta stages."""
    angle, velocity, torque, elapsed = symbols = [ca.SX.sym("symbol") for _ in range(4)]
    at = _moment(model, step, begin, (angle, velocity), torque, elapsed)
    acceleration = model.smooth_acceleration(at, own) - _slowing(model, at, direction)
    return lambda *values: _at(acceleration, symbols, values)


@dataclass(frozen=True, kw_only=True)
class _Way:
    """The torque through the actuator in a step, for any motion of the load; built once for all stages.

    Attributes:
        symbols: symbols of angle and velocity of the load, for the drive's law, and velocity of the motor.
        course: of the torque after the actuator.
        states: of the actuator's effects after the step.
    """

    symbols: list[Any]
    course: Course
    states: dict[str, tuple[Any, ...]]

    @classmethod
    def of(cls, model: ServoModel, own: Own, step: Step) -> _Way:
        angle, velocity, motor = symbols = [ca.SX.sym("symbol") for _ in range(3)]
        course, states = actuated(model, own, step.drive(model, own, angle, velocity), step.length, motor)
        return cls(symbols=symbols, course=course, states=states)

    def torque(self, part: str, *motion: Any) -> Any:
        """Torque at the start, middle or end of the step [N m]."""
        return _at(getattr(self.course, part), self.symbols, motion)

    def after(self, *motion: Any) -> dict[str, tuple[Any, ...]]:
        """The states after the step."""
        return {name: tuple(_at(each, self.symbols, motion) for each in own) for name, own in self.states.items()}


def _at(expression: Any, symbols: list[Any], values: Sequence[Any]) -> Any:
    """An expression with values substituted for its symbols."""
    expression = ca.SX(expression)
    if not ca.depends_on(expression, ca.vertcat(*symbols)):
        return expression
    return ca.substitute(expression, ca.vertcat(*symbols), ca.vertcat(*values))


def _own_after(
    model: ServoModel,
    own: Own,
    step: Step,
    way: _Way,
    angles: tuple[Any, Any, Any],
    half: list[Any],
    end: list[Any],
) -> list[Any]:
    """The states of the effects after a step, given the angle at its start, middle and end, and half a step's motion.

    The sensor needs the angle in the middle: an accelerated load moves along a parabola. The drive's law uses the
    motion at half a step.
    """
    h = step.length
    on_the_way = played(model, own, step.entering(model), step.gain, h)[1]
    on_the_way |= way.after(*half, end[-1])
    entering = angles  # input of the sensor
    states: list[Any] = []
    for effect in model.effects:
        mine: tuple[Any, ...] = own[effect.name]
        if effect.flexible:
            mine = tuple(end[2:])
        elif effect.states == (State.RELAXED,):
            mine = (effect.slide(mine[0], angles[2] - angles[0]),)
        elif _is_sensor(effect):
            shown = effect.advance_sensor(mine[0], *entering, h)
            entering, mine = (mine[0], (mine[0] + shown) / 2, shown), (shown,)
        else:
            mine = on_the_way.get(effect.name, ())
            entering = tuple(effect.measurement(angle, 0.0) for angle in entering)
        states += mine
    return states


def _is_sensor(effect: Effect) -> bool:
    return not effect.flexible and State.ANGLE in effect.states


def _slowing(model: ServoModel, at: Moment, direction: Any) -> Any:
    """Deceleration by dry friction for motion in a direction, zero at rest [rad/s^2]."""
    levels = model.dry_friction(at)
    if levels is None:
        return 0.0
    inertia = model.load_inertia(at)
    return ca.if_else(direction > 0, levels[0] / inertia, 0) - ca.if_else(direction < 0, levels[1] / inertia, 0)


def _stop_and_go(model: ServoModel, x: Any, v: Any, angle: Any, velocity: Any, at: Moment, step: Step) -> list[Any]:
    """Correct a step from (x, v) to (angle, velocity), taken with the friction of its start, for a stop within it.

    Exact form (width 0): the load slides until it stops; then it sticks, or slides on if the torque is above breakaway.
    There is no chatter at any step length, stiction holds to rounding, and the instant of the reversal is found within
    the step.

    Smooth form: friction rises linearly with velocity up to `width`, as an implicit step in closed form (Moreau 1988
    for width 0), so that a fit has a derivative also where the load sticks.
    """
    h, width, inertia = step.length, step.width, model.load_inertia(at)
    forward, backward = (level / inertia for level in model.dry_friction(at) or (0.0, 0.0))
    slowing = _slowing(model, at, v)
    pull = (velocity - v) / ca.fmax(h, 1e-15) + slowing  # mean acceleration without dry friction

    free = v + pull * h
    most = h * ca.if_else(free > 0, forward, backward)
    reach = width + most + 1e-15  # so that zero friction has a derivative too
    taken = most * ca.fmax(ca.fmin(free / reach, 1), -1)
    smooth = (angle + slowing * h**2 / 2 - h / 2 * taken, free - taken)

    # Exact form. Until it stops, the load follows the Runge-Kutta step, at least to its mean acceleration and jerk.
    jerk = 12 * (h * (v + velocity) / 2 - (angle - x)) / ca.fmax(h, 1e-15) ** 3
    chord = (velocity - v) / ca.fmax(h, 1e-15)
    same_way = v * velocity > 0
    about = ca.fmin(h * v / ca.if_else(same_way, ca.sign(v) * 1e15, v - velocity + 1e-300), h)
    late = jerk * about * (h - about) / 2  # velocity in which the chord errs
    slope = chord + jerk * (about - h / 2)
    to_rest = ca.if_else(slope * chord > 0, ca.fmax(ca.fmin(about + late / slope, h), 0), about)
    left = h - to_rest
    again = ca.fmax(pull - forward, 0) + ca.fmin(pull + backward, 0)
    changed = again - chord  # by the friction, which acts the other way now
    fading = model.viscous_friction / inertia * left
    halted = angle - velocity * left / 2 + jerk * left**3 / 12
    slides = ca.fabs(again) > 0
    stopped = (
        ca.if_else(slides, angle + changed * left**2 / 2 * (1 - fading / 3), halted),
        ca.if_else(slides, velocity + changed * left * (1 - fading / 2), 0),
    )
    exact = [ca.if_else(same_way, a, b) for a, b in zip((angle, velocity), stopped, strict=True)]
    return [ca.if_else(width > 0, a, b) for a, b in zip(smooth, exact, strict=True)]
