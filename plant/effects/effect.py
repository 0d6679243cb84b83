"""The base of all effects. An effect is one physical cause that the simple servo model leaves out.

An effect acts at one stage between command and measurement,

    command -> actuator -> drivetrain -> load -> sensor -> measurement,

and overrides only the methods that it needs. Its methods are written once and are called with numbers or with CasADi
expressions alike: the fields of an effect hold floats for the user and are replaced by symbols when equations are built
(`bound`).

To add an effect: write one file in this folder and add the class to `plant.effects.catalogue`. Simulation, fit,
diagnosis, controller, saved models and the report then include it.
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
from plant.renamed import warn_of

if TYPE_CHECKING:
    from plant.servo import ServoModel

SAMPLE_TIME = 0.005  # of a log for which effects give their longest step [s]


class Stage(StrEnum):
    """Where an effect acts between command and measurement."""

    ACTUATOR = "actuator"
    DRIVETRAIN = "drivetrain"
    LOAD = "load"
    SENSOR = "sensor"


class State(StrEnum):
    """Kind of a state of an effect: it determines the initial value and the treatment by an observer."""

    COMMAND = "command"
    SETPOINT = "setpoint"
    TORQUE = "torque"
    ANGLE = "angle"
    VELOCITY = "velocity"
    RELAXED = "relaxed"  # starts at zero


@dataclass(frozen=True, kw_only=True, eq=False)
class Regressors:
    """Signature of a small effect: regressors for torque or measurement, at one value of its nonlinear parameters.

    Attributes:
        columns: (T, m) torque on the load [N m], or measurement error [rad], per unit of each coefficient.
        start: the effect for the coefficients (m,) that a regression has found.
        positive: (m,) which coefficients cannot be negative; none by default.
        searched: number of signatures that were compared to find this one; a search over many peaks has a prior cost.
        acts_on: whether the columns are torques or measurement errors.
        prior: (m, m) covariance of the coefficients up to a factor, if they are those of a smooth curve; else None.
    """

    columns: Array
    start: Callable[[Array], Effect]
    positive: tuple[bool, ...] = ()
    searched: int = 1
    acts_on: Place = "torque"
    prior: Array | None = None


_RENAMED = {"trace": "signature", "traces": "regressors", "reading": "measurement"}


@dataclass(frozen=True, kw_only=True)
class Effect:
    """Base of all effects; without overrides it has no influence."""

    name: ClassVar[str]
    title: ClassVar[str]
    stage: ClassVar[Stage]
    equation: ClassVar[str]
    signature: ClassVar[str]
    confused_with: ClassVar[tuple[str, ...]] = ()
    contains: ClassVar[tuple[str, ...]] = ()
    """Effects that are special cases of this one; it replaces them."""
    states: ClassVar[tuple[State, ...]] = ()
    """States that it adds."""
    flexible: ClassVar[bool] = False
    """Whether it adds a motor that moves relative to the load; it then has the states ANGLE, VELOCITY of the motor."""
    multimodal: ClassVar[bool] = False
    """Whether its likelihood has many peaks, so that a fit should start from several values."""
    periodic: ClassVar[bool] = False
    """Whether it repeats over the angle or over time."""
    chaotic: ClassVar[bool] = False
    """Whether a small error grows without bound in a free simulation, so that only short sections can be judged."""
    measured: ClassVar[tuple[str, ...]] = ()
    """Effects that a log cannot show together with this one: they act before the torque that was measured."""
    clocked: ClassVar[bool] = False
    """Whether it is valid only within the log: it depends on the log's clock, or on how the log was measured."""
    needs_angle: ClassVar[bool] = False
    """Whether it depends on the angle of the load, or changes its measurement: a log of the speed does not show it."""
    longest_step: ClassVar[float] = 0.005
    """Longest integration step for it in a log with samples of `SAMPLE_TIME` [s]; scaled with the sample time."""
    axes: ClassVar[tuple[Axis, ...]] = ("rotary", "linear")

    def __init_subclass__(cls) -> None:
        """Take what an effect defines under its old name."""
        super().__init_subclass__()
        for old, new in _RENAMED.items():
            if old in vars(cls) and new not in vars(cls):
                warn_of(f"{cls.__name__}.{old}", new)
                setattr(cls, new, vars(cls)[old])

    def __post_init__(self) -> None:
        """Validate every parameter, and store it as a float."""
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
        """Whether a model cannot have both: equal effects, two drivetrains, or one before a measured torque."""
        measured = other.name in cls.measured or cls.name in other.measured
        return cls.name == other.name or (cls.flexible and other.flexible) or measured

    @classmethod
    def on_the_load(cls) -> bool:
        """Whether it acts on a load that moves with the motor; else it is in the actuator, drivetrain or sensor."""
        rigid = all(kind is State.RELAXED for kind in cls.states)
        return rigid and (cls.stage is Stage.LOAD or cls.dry_friction is not Effect.dry_friction)

    @property
    def freed(self) -> bool:
        """Whether parameters with a given default are fitted too; their values then differ from the default."""
        return False

    def bound(self, values: Sequence[Expression]) -> Self:
        """The same effect with other values, which may be symbolic and are not validated."""
        other = copy.copy(self)
        for spec, value in zip(self.parameters(), values, strict=True):
            object.__setattr__(other, spec.name, value)
        return other

    def step_within(self, sample_time: float) -> float:
        """Longest integration step for the effect, also during a fit, in a log of that sample time [s]."""
        return self.longest_step * sample_time / SAMPLE_TIME

    # Methods on the command and in the actuator. A state of type COMMAND is the command before the drive's law, one of
    # type SETPOINT the set-point of a position servo; one of type TORQUE comes after the law.

    def delay(self) -> Expression:
        """Dead time of the command [s]."""
        return 0.0

    def lateness(self) -> Expression:
        """Delay of the torque by a slow response, without dead time [s]."""
        return 0.0

    def lead(self) -> Expression | None:
        """Lag of the torque in a log because it was measured [s]; None if it is a command."""
        return None

    def advance(self, state: Expression, torque: Expression, h: Expression) -> Expression:
        """The effect's state after `h` under a constant input torque."""
        return state

    def settling_time(self, state: Expression, command: Expression) -> Expression:
        """Time for the effect's state to follow a new command [s]."""
        return 0.0

    def mean(self, state: Expression, torque: Expression, h: Expression) -> Expression:
        """Mean of the effect's state over `h` under a constant input torque."""
        return state

    def command(self, torque: Expression, state: Expression, velocity: Expression) -> Expression:
        """Output torque of the effect for the input `torque` [N m], at a velocity of the motor."""
        return torque

    def command_for(self, torque: Expression, velocity: Expression) -> Expression:
        """Input torque of the effect for the output `torque` [N m]; the inverse of `command`."""
        return torque

    # Methods of a flexible drivetrain.

    def share(self) -> Expression:
        """Share of the inertia J on the motor's side [-]."""
        return 0.0

    def coupling(self, twist: Expression, rate: Expression, inertia: Expression) -> Expression:
        """Torque from motor to load at a twist (motor less load) and its rate [N m]; `inertia` is J."""
        return 0.0

    # Methods on the load.

    def load_torque(self, at: Moment, state: Expression) -> Expression:
        """Smooth torque that the effect adds on the load [N m]."""
        return 0.0

    def dry_friction(self, at: Moment) -> tuple[Expression, Expression] | None:
        """Friction torque against forward and backward motion [N m], both >= 0; at rest, the stiction limits."""
        return None

    def added_inertia(self, at: Moment) -> Expression:
        """Inertia that the effect adds to the load [N m s^2/rad]."""
        return 0.0

    def slide(self, state: Expression, travel: Expression) -> Expression:
        """A state of type RELAXED after a travel of the load."""
        return state

    # Methods in the sensor.

    def measurement(self, angle: Expression, state: Expression) -> Expression:
        """Output of the sensor for the input `angle` [rad]."""
        return angle

    def advance_sensor(
        self, state: Expression, before: Expression, middle: Expression, after: Expression, h: Expression
    ) -> Expression:
        """A sensor's state after `h`, while its input went from `before` over `middle` to `after`."""
        return state

    # Its static characteristic.

    @property
    def curve_over(self) -> str:
        """The variable of `curve`: "angle", "velocity" or "torque"; empty if there is no curve."""
        return characteristic(self)[0]

    def curve(self, values: ArrayLike) -> Array:
        """Characteristic over the single variable of the effect, named by `curve_over`.

        Args:
            values: of that variable, in any shape: velocity [rad/s], angle [rad] or torque [N m] (on a linear axis
                [m/s], [m], [N]).

        Returns:
            In the same shape: over the velocity the torque against the motion, so that friction is positive in forward
            motion [N m]; over the angle the torque on the load [N m], or the error of a sensor [rad]; over the torque
            the actuator's output, or the load-dependent friction [N m].

        Raises:
            BadParameter: it depends on several variables, on the past, or on none.
        """
        return curve(self, values)

    # Related effects and models.

    def without_clock(self, rest: ServoModel, end: float | None) -> ServoModel:
        """The rest of the model after the log, with the final influence of a clocked effect; by default without any.

        Args:
            rest: the servo without this effect.
            end: when the log ended, on its clock [s]; None if that is not known.
        """
        return rest

    def loaded(self, before: float, after: float) -> Effect:
        """A drivetrain after its load has grown, so that the total inertia J goes from `before` to `after`."""
        return self

    def reduced(self) -> tuple[Effect, ...]:
        """Special cases of the effect for its present parameters, as starts of a refit."""
        return ()

    def similar_shapes(self, stage: int) -> tuple[Effect, ...]:
        """Other values of its parameters with nearly the same signature; a descent cannot choose among them.

        Args:
            stage: 0, 1, 2: from the whole range to neighbouring values.
        """
        return ()

    def freer(self) -> tuple[Effect, ...]:
        """Variants in which the given parameters are fitted too, see `freed`; tried after the others are fitted."""
        return ()

    def vanishes(self, speed: float, sample_time: float) -> bool:
        """Whether the log cannot distinguish it from a simpler effect.

        Args:
            speed: typical of the log [rad/s].
            sample_time: of the log [s].
        """
        return False

    def plausible(self, log: Covered) -> bool:
        """Whether the values are physically plausible in a log; otherwise the effect is not reported."""
        return True

    # Its signatures.

    @classmethod
    def regressors(cls, motion: Motion) -> Iterator[Regressors]:
        """Signatures of the effect along a motion, one for each candidate value of its nonlinear parameters."""
        raise NotImplementedError(f"{cls.__name__} defines no regressors, by which a diagnosis would find it.")

    def closer(self, motion: Motion) -> Iterator[Regressors]:
        """Signatures between the values tried by `regressors`, for peaks narrower than their spacing."""
        return iter(())

    @classmethod
    def typical(cls, motion: Motion) -> Effect | None:
        """The effect at a size that is visible along a motion, at the middle signature; None without a signature."""
        regressors = list(cls.regressors(motion))
        if not regressors:
            return None
        middle = regressors[len(regressors) // 2]
        return middle.start(motion.visible(middle.columns, middle.acts_on))
