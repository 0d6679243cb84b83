"""The options on a command line that say what drives a machine has, and what its controller is told."""

from __future__ import annotations

import inspect
import typing
from collections.abc import Callable, Mapping
from typing import Annotated, Any

import typer

Text = str | None
Number = float | None

DRIVES: dict[str, Any] = {
    "gears": Annotated[
        Text,
        typer.Option(metavar="N1,N2:N", help="Teeth of both pinions and of the gear that they drive: 20,20:161."),
    ],
    "ratio": Annotated[
        Text,
        typer.Option(
            metavar="RATIO",
            help="Instead of teeth, torque on the load for 1 N m of each drive: 8.05, or one each: 8.05,-8.05; on a "
            "linear axis the force (N).",
        ),
    ],
    "one_drive": Annotated[bool, typer.Option("--one-drive", help="There is one drive, of that ratio: no preload.")],
    "pre_reduction": Annotated[
        Text, typer.Option(metavar="RATIO", help="Turns of a motor for one of its pinion; one for both, or one each.")
    ],
}
"""What the machine is, by name in Python, and how it is typed."""

LIMITS: dict[str, Any] = {
    "min_torque": Annotated[Text, typer.Option(metavar="NM", help="Least torque of each drive (N m); or one each.")],
    "max_torque": Annotated[Text, typer.Option(metavar="NM", help="Greatest torque of each drive (N m); likewise.")],
    "rotor_inertia": Annotated[
        Text, typer.Option(metavar="KGM2", help="Of each motor, at its shaft (kg m^2); likewise.")
    ],
    "motor_friction": Annotated[
        Text, typer.Option(metavar="NM", help="Dry friction of each motor, at its shaft (N m); likewise.")
    ],
}
"""What its drives may do."""

TUNING: dict[str, Any] = {
    "sample_time": Annotated[Number, typer.Option(metavar="S", help="Seconds between two steps of the controller.")],
    "horizon": Annotated[int | None, typer.Option(metavar="N", help="Samples looked ahead.")],
    "bandwidth": Annotated[Number, typer.Option(metavar="HZ", help="Of the closed loop.")],
    "encoder_resolution": Annotated[Number, typer.Option(metavar="RAD", help="Step of the load's encoder.")],
    "encoder_noise": Annotated[Number, typer.Option(metavar="RAD", help="Standard deviation of its noise.")],
    "encoder_range": Annotated[
        Number, typer.Option(metavar="RAD", help="Angle after which it begins again: 6.2832 of a single turn.")
    ],
    "torque_noise": Annotated[
        Number, typer.Option(metavar="NM", help="What the model misses from sample to sample, standard deviation.")
    ],
    "disturbance_rate": Annotated[
        Number, typer.Option(metavar="RATE", help="How fast the unknown torque may wander (N m/sqrt(s)).")
    ],
    "motor_resolution": Annotated[
        Number, typer.Option(metavar="RAD", help="Step of the motors' encoders; without it there are none.")
    ],
    "motor_noise": Annotated[
        Number, typer.Option(metavar="RAD", help="What else they err by, teeth included, at the load.")
    ],
    "friction_std": Annotated[
        Number, typer.Option(metavar="SHARE", help="Standard error of the model's dry friction, as a share of it.")
    ],
    "torque_rate": Annotated[
        Number, typer.Option(metavar="RATE", help="Greatest change of the torque on the load (N m/s).")
    ],
    "preload_rate": Annotated[Number, typer.Option(metavar="RATE", help="Greatest change of the preload (N m/s).")],
    "angle_limits": Annotated[
        tuple[float, float] | None, typer.Option(metavar="LOW HIGH", help="Lowest and highest angle of the load (rad).")
    ],
    "speed_limit": Annotated[Number, typer.Option(metavar="SPEED", help="Greatest speed of the load (rad/s).")],
    "sqp_iterations": Annotated[
        int | None, typer.Option(metavar="N", help="Quadratic programs solved in a sample, at most.")
    ],
}
"""What else its controller is told: the attributes of `mpc.Controller`, whose own values stand where none is typed."""


def with_options(*tables: dict[str, Any]) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """A command whose parameter `said` holds what was typed of the options in some tables, by name."""
    words = {name: kind for table in tables for name, kind in table.items()}

    def typed_as(command: Callable[..., None]) -> Callable[..., None]:
        def typed(**given: Any) -> None:
            typed_in = {name: given.pop(name) for name in words}
            said = {name: value for name, value in typed_in.items() if value is not None and value is not False}
            command(said=said, **given)

        own = [one for name, one in inspect.signature(command, eval_str=True).parameters.items() if name != "said"]
        keyword = inspect.Parameter.KEYWORD_ONLY
        options = [
            inspect.Parameter(name, keyword, default=False if name == "one_drive" else None, annotation=kind)
            for name, kind in words.items()
        ]
        first = [one for one in own if one.default is inspect.Parameter.empty]
        others = [one for one in own if one.default is not inspect.Parameter.empty]
        typed.__name__, typed.__doc__ = command.__name__, command.__doc__
        merged = [one.replace(kind=keyword) for one in (*first, *options, *others)]
        typed.__signature__ = inspect.Signature(merged)  # type: ignore[attr-defined]
        hints = typing.get_type_hints(command, include_extras=True)
        typed.__annotations__ = {n: kind for n, kind in {**hints, **words}.items() if n not in ("said", "return")}
        return typed

    return typed_as


def controller_numbers(said: Mapping[str, Any]) -> dict[str, Any]:
    """Of what was typed, the attributes of a controller; a number for all drives, or one for each.

    Raises:
        BadParameter: a text that is no number, and no list of them.
    """
    return {name: _per_drive(name, said[name]) if name in LIMITS else said[name] for name in said if name not in DRIVES}


def _per_drive(name: str, text: str) -> float | tuple[float, ...]:
    try:
        numbers = tuple(float(number) for number in text.split(","))
    except ValueError:
        from plant.errors import BadParameter

        raise BadParameter(
            f"--{name.replace('_', '-')} is {text!r}; give a number, or one for each drive as 0.3,0.2."
        ) from None
    return numbers[0] if len(numbers) == 1 else numbers
