"""What an effect is: one physical cause that the simple servo model leaves out.

An effect acts at one stage on the way from command to measurement,

    command -> actuator -> drivetrain -> load -> sensor -> reading,

and overrides only the methods of what it does. Its methods are written once and
are called with numbers or with CasADi expressions alike: the fields of an effect
hold floats for the user and are exchanged for symbols when equations are built
(`bound`).

To add an effect: write one file beside this one and name the class in
`plant.effects.catalogue`. Simulation, fit, diagnosis, controller, saved models
and the report then know it.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, ClassVar, Self

from numpy.typing import ArrayLike

from plant.effects.moment import Expression as Expression
from plant.effects.moment import Moment as Moment
from plant.effects.motion import TURN as TURN
from plant.effects.motion import Array as Array
from plant.effects.motion import Covered as Covered
from plant.effects.motion import Motion as Motion
from plant.effects.motion import Place as Place
from plant.effects.parameter import POSITIVE as POSITIVE
from plant.effects.parameter import Axis as Axis
from plant.effects.parameter import Parameter as Parameter
from plant.effects.parameter import fastest_swing as fastest_swing
from plant.effects.parameter import parameter as parameter
from plant.effects.parameter import parameters_of as parameters_of
from plant.effects.parameter import within as within
from plant.effects.static_characteristic import characteristic, curve

if TYPE_CHECKING:
    from plant.servo import ServoModel

SAMPLE_TIME = 0.005  # of a log for which effects state their longest step [s]


class Stage(StrEnum):
    """Where on the way from command to measurement an effect acts."""

    ACTUATOR = "actuator"
    DRIVETRAIN = "drivetrain"
    LOAD = "load"
    SENSOR = "sensor"


class State(StrEnum):
    """What a state of an effect is: it says where the state begins, and what an observer does with it."""

    COMMAND = "command"
    GOAL = "goal"
    TORQUE = "torque"
    ANGLE = "angle"
    VELOCITY = "velocity"
    RELAXED = "relaxed"  # begins at zero
    RANDOM_WALK = "random_walk"  # begins at zero too, and only an observer moves it


@dataclass(frozen=True, kw_only=True, eq=False)
class Trace:
    """The torque, or the error of the reading, by which a small effect would show, at one choice of its shape.

    Attributes:
        columns: (T, m) torque on the load [N m], or error of the reading [rad], per unit of each coefficient.
        start: the effect that coefficients (m,) found by regression suggest.
        positive: (m,) which coefficients cannot be negative; none by default.
        searched: how many shapes were compared to find this one; where there are many peaks, the search is charged for.
        acts_on: whether the columns are torques or readings.
        prior: (m, m) covariance of the coefficients up to a factor, where they are not free but a smooth curve's.
    """

    columns: Array
    start: Callable[[Array], Effect]
    positive: tuple[bool, ...] = ()
    searched: int = 1
    acts_on: Place = "torque"
    prior: Array | None = None


@dataclass(frozen=True, kw_only=True)
class Effect:
    """Base of all effects; by itself it does nothing."""

    name: ClassVar[str]
    title: ClassVar[str]
    stage: ClassVar[Stage]
    equation: ClassVar[str]
    trace: ClassVar[str]
    confused_with: ClassVar[tuple[str, ...]] = ()
    contains: ClassVar[tuple[str, ...]] = ()
    """Effects that are special cases of this one; it takes their place."""
    states: ClassVar[tuple[State, ...]] = ()
    """States that it brings."""
    flexible: ClassVar[bool] = False
    """Whether it puts a motor of its own motion before the load; it then has the states ANGLE, VELOCITY of it."""
    multimodal: ClassVar[bool] = False
    """Whether its likelihood has many peaks over its shape, so that a fit should start from several of them."""
    periodic: ClassVar[bool] = False
    """Whether it repeats over the angle or over time."""
    chaotic: ClassVar[bool] = False
    """Whether a small error grows without bound in a free simulation, so that only short pieces can be judged."""
    measured: ClassVar[tuple[str, ...]] = ()
    """Effects that a log cannot show beside this one: they come before the torque that was measured."""
    clocked: ClassVar[bool] = False
    """Whether it ends with the log: it depends on the log's clock, or on how the log was measured."""
    needs_angle: ClassVar[bool] = False
    """Whether it depends on where the load is, or changes the reading of that: a log of the speed does not show it."""
    longest_step: ClassVar[float] = 0.005
    """Longest integration step that follows it in a log with samples of `SAMPLE_TIME` [s]; shorter ones shorten it."""
    axes: ClassVar[tuple[Axis, ...]] = ("rotary", "linear")

    def __post_init__(self) -> None:
        """Validate every parameter, and keep it as a float."""
        for spec in self.parameters():
            object.__setattr__(self, spec.name, spec.check(self.name, getattr(self, spec.name)))

    @classmethod
    def parameters(cls) -> tuple[Parameter, ...]:
        """The parameters, in the order of the fields."""
        return parameters_of(cls)

    @property
    def values(self) -> tuple[Expression, ...]:
        """The parameters' values, in order."""
        return tuple(getattr(self, spec.name) for spec in self.parameters())

    @classmethod
    def excludes(cls, other: type[Effect]) -> bool:
        """Whether a model cannot have both: the same twice, two motors before one load, or what was measured behind."""
        measured = other.name in cls.measured or cls.name in other.measured
        return cls.name == other.name or (cls.flexible and other.flexible) or measured

    @property
    def freed(self) -> bool:
        """Whether what is stated at first is fitted too, as its values are no longer those that one would state."""
        return False

    def bound(self, values: Sequence[Expression]) -> Self:
        """The same effect with other values, also symbolic ones, unchecked."""
        other = copy.copy(self)
        for spec, value in zip(self.parameters(), values, strict=True):
            object.__setattr__(other, spec.name, value)
        return other

    def step_within(self, sample_time: float) -> float:
        """Longest integration step that follows it, also while a log of that sample time is fitted [s]."""
        return self.longest_step * sample_time / SAMPLE_TIME

    # What an effect can do to the command and in the actuator. A state of type COMMAND is the command that is played,
    # before the drive's law, and one of type GOAL a position servo's goal; one of type TORQUE belongs behind the law.

    def delay(self) -> Expression:
        """Dead time of the command [s]."""
        return 0.0

    def lateness(self) -> Expression:
        """By how much a slow torque leaves the effect later than it entered, dead time apart [s]."""
        return 0.0

    def lead(self) -> Expression | None:
        """By how much the torque of a log is late because it was measured [s]; None where it is a command."""
        return None

    def advance(self, state: Expression, torque: Expression, h: Expression) -> Expression:
        """The effect's own state after `h` under a constant incoming torque."""
        return state

    def settling_time(self, state: Expression, command: Expression) -> Expression:
        """How long the effect's own state takes to follow a new command [s]."""
        return 0.0

    def mean(self, state: Expression, torque: Expression, h: Expression) -> Expression:
        """Mean of the effect's own state over `h` under a constant incoming torque."""
        return state

    def command(self, torque: Expression, state: Expression, velocity: Expression) -> Expression:
        """The torque that leaves the effect when `torque` enters it [N m], at a velocity of the motor."""
        return torque

    def command_for(self, torque: Expression, velocity: Expression) -> Expression:
        """The torque that must enter the effect so that `torque` leaves it [N m]; the inverse of `command`."""
        return torque

    # ... in the drivetrain, if it is flexible ...

    def share(self) -> Expression:
        """Share of the inertia J that sits on the motor's side [-]."""
        return 0.0

    def coupling(self, twist: Expression, rate: Expression, inertia: Expression) -> Expression:
        """Torque from motor to load at a twist (motor less load) and its rate; `inertia` is J [N m]."""
        return 0.0

    # ... on the load ...

    def load_torque(self, at: Moment, state: Expression) -> Expression:
        """Smooth torque that the effect adds on the load [N m]."""
        return 0.0

    def dry_friction(self, at: Moment) -> tuple[Expression, Expression] | None:
        """Friction torque against forward and against backward motion [N m], both >= 0; at rest it holds up to them."""
        return None

    def added_inertia(self, at: Moment) -> Expression:
        """Inertia that the effect adds to the load [N m s^2/rad]."""
        return 0.0

    def slide(self, state: Expression, travel: Expression) -> Expression:
        """A state of type RELAXED after the load has travelled."""
        return state

    # ... and to what the sensor shows.

    def reading(self, angle: Expression, state: Expression) -> Expression:
        """What the sensor shows when `angle` enters it [rad]."""
        return angle

    def sense(
        self, state: Expression, before: Expression, middle: Expression, after: Expression, h: Expression
    ) -> Expression:
        """A sensor's state after `h`, in which what enters it went from `before` over `middle` to `after`."""
        return state

    # What it looks like.

    @property
    def curve_over(self) -> str:
        """The variable of `curve`: "angle", "velocity" or "torque"; empty where there is no curve."""
        return characteristic(self)[0]

    def curve(self, values: ArrayLike) -> Array:
        """Its characteristic over the one variable that it depends on, which `curve_over` names.

        Args:
            values: of that variable, in any shape: velocity [rad/s], angle [rad] or torque [N m] (on a linear axis
                [m/s], [m], [N]).

        Returns:
            In the same shape: over the velocity the torque against the motion, so that friction is positive in forward
            motion [N m]; over the angle the torque on the load [N m], or the error of a sensor [rad]; over the torque
            what leaves the actuator, or the friction that the torque brings along [N m].

        Raises:
            BadParameter: it depends on several variables, on the past, or on none.
        """
        return curve(self, values)

    # What it becomes.

    def without_clock(self, rest: ServoModel, end: float | None) -> ServoModel:
        """What a clocked effect leaves of itself in the rest of the model; by default nothing.

        Args:
            rest: the servo without this effect.
            end: when the log ended, on its clock [s]; None where that is not known.
        """
        return rest

    def loaded(self, before: float, after: float) -> Effect:
        """A drivetrain, when its load grows so that the whole inertia J goes from `before` to `after`."""
        return self

    def reduced(self) -> tuple[Effect, ...]:
        """Its special cases, as they would be if its own parameters were right: where a refit of them may start."""
        return ()

    def similar_shapes(self, stage: int) -> tuple[Effect, ...]:
        """Other values of its parameters with nearly the same trace, among which a descent cannot choose.

        Args:
            stage: 0, 1, 2: from all over the range to near by.
        """
        return ()

    def freer(self) -> tuple[Effect, ...]:
        """Shapes of which what this one states is fitted too, as `freed` says: tried once its own values are found."""
        return ()

    def vanishes(self, speed: float, sample_time: float) -> bool:
        """Whether nothing shows that a simpler effect would not show too.

        Args:
            speed: typical of the log [rad/s].
            sample_time: of the log [s].
        """
        return False

    def plausible(self, log: Covered) -> bool:
        """Whether the values are such as the cause can well have in a log; with others it is not named."""
        return True

    # How its trace looks.

    @classmethod
    def traces(cls, motion: Motion) -> Iterator[Trace]:
        """Traces of the effect over a motion, one for each shape worth trying."""
        raise NotImplementedError(f"{cls.__name__} does not say how its trace looks.")

    def closer(self, motion: Motion) -> Iterator[Trace]:
        """Traces of shapes between its own and the next that `traces` has, where a peak may be narrower than that."""
        return iter(())

    @classmethod
    def typical(cls, motion: Motion) -> Effect | None:
        """The effect at a size that shows along a motion: the middle one of its shapes; None where it has no trace."""
        traces = list(cls.traces(motion))
        if not traces:
            return None
        middle = traces[len(traces) // 2]
        return middle.start(motion.visible(middle.columns, middle.acts_on))
