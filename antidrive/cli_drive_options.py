"""Command-line options for the drives of a machine, their limits, and the controller."""

from __future__ import annotations

import inspect
import typing
from collections.abc import Callable, Mapping
from typing import Annotated, Any

import typer

from antidrive.help_panels import in_panel

Text = str | None
Number = float | None

DRIVES = in_panel(
    "The drives",
    {
        "gears": Annotated[
            Text,
            typer.Option(metavar="N1,N2:N", help="Teeth of both pinions and of the output gear: 20,20:161."),
        ],
        "ratio": Annotated[
            Text,
            typer.Option(
                metavar="RATIO",
                help="Reduction in place of teeth: 8.05, or one for each drive, 8.05,-8.05. On a linear axis the "
                "force [N] for 1 N m.",
            ),
        ],
        "one_drive": Annotated[bool, typer.Option("--one-drive", help="The machine has one drive, so no preload.")],
        "pre_reduction": Annotated[
            Text,
            typer.Option(
                metavar="RATIO", help="Turns of the motor for one of its pinion: for both drives, or one each."
            ),
        ],
    },
)
"""Options of the drives, by their name in Python."""

LIMITS = in_panel(
    "Limits of the drives",
    {
        "min_torque": Annotated[
            Text, typer.Option(metavar="NM", help="Minimum torque of a drive [N m]: for both, or one each.")
        ],
        "max_torque": Annotated[
            Text, typer.Option(metavar="NM", help="Maximum torque of a drive [N m]: for both, or one each.")
        ],
        "rotor_inertia": Annotated[
            Text,
            typer.Option(metavar="KGM2", help="Rotor inertia at the motor shaft, in kg m^2: for both, or one each."),
        ],
        "motor_friction": Annotated[
            Text, typer.Option(metavar="NM", help="Dry friction at the motor shaft [N m]: for both, or one each.")
        ],
    },
)
"""Options of the drives' limits."""

TUNING = in_panel(
    "The controller",
    {
        "sample_time": Annotated[Number, typer.Option(metavar="S", help="Sample time of the controller, in s.")],
        "horizon": Annotated[int | None, typer.Option(metavar="N", help="Prediction horizon, in samples.")],
        "bandwidth": Annotated[Number, typer.Option(metavar="HZ", help="Closed-loop bandwidth, in Hz.")],
        "encoder_resolution": Annotated[
            Number, typer.Option(metavar="RAD", help="Resolution of the load encoder, in rad.")
        ],
        "encoder_noise": Annotated[
            Number, typer.Option(metavar="RAD", help="Standard deviation of the load encoder's noise, in rad.")
        ],
        "encoder_range": Annotated[
            Number,
            typer.Option(
                metavar="RAD", help="Angle at which the load encoder wraps, in rad: 6.2832 if it is single-turn."
            ),
        ],
        "torque_noise": Annotated[
            Number,
            typer.Option(
                metavar="NM", help="Standard deviation of the torque that the model does not explain, per sample [N m]."
            ),
        ],
        "disturbance_rate": Annotated[
            Number, typer.Option(metavar="RATE", help="Random-walk rate of the disturbance torque [N m/sqrt(s)].")
        ],
        "motor_resolution": Annotated[
            Number,
            typer.Option(metavar="RAD", help="Resolution of the motor encoders, in rad. Without it there are none."),
        ],
        "motor_noise": Annotated[
            Number, typer.Option(metavar="RAD", help="Other errors of the motor encoders, seen at the load, in rad.")
        ],
        "friction_std": Annotated[
            Number, typer.Option(metavar="SHARE", help="Relative standard error of the model's dry friction.")
        ],
        "torque_rate": Annotated[Number, typer.Option(metavar="RATE", help="Maximum rate of the load torque [N m/s].")],
        "preload_rate": Annotated[Number, typer.Option(metavar="RATE", help="Maximum rate of the preload [N m/s].")],
        "angle_limits": Annotated[
            tuple[float, float] | None,
            typer.Option(metavar="LOW HIGH", help="Lowest and highest angle of the load, in rad."),
        ],
        "speed_limit": Annotated[Number, typer.Option(metavar="SPEED", help="Maximum speed of the load, in rad/s.")],
        "sqp_iterations": Annotated[
            int | None, typer.Option(metavar="N", help="Maximum number of quadratic programs in a sample.")
        ],
    },
)
"""Options of the controller: attributes of `mpc.Controller`, whose defaults apply if an option is not given."""


def with_options(*tables: dict[str, Any]) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Decorate a command so that its parameter `options` holds the given options of some tables, by name."""
    words = {name: kind for table in tables for name, kind in table.items()}

    def typed_as(command: Callable[..., None]) -> Callable[..., None]:
        def typed(**given: Any) -> None:
            typed_in = {name: given.pop(name) for name in words}
            chosen = {name: value for name, value in typed_in.items() if value is not None and value is not False}
            command(options=chosen, **given)

        own = [one for name, one in inspect.signature(command, eval_str=True).parameters.items() if name != "options"]
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
        typed.__annotations__ = {n: kind for n, kind in {**hints, **words}.items() if n not in ("options", "return")}
        return typed

    return typed_as


def controller_numbers(options: Mapping[str, Any]) -> dict[str, Any]:
    """The attributes of a controller among the given options; a number for all drives, or one for each.

    Raises:
        BadParameter: a text that is no number, and no list of numbers.
    """
    return {
        name: _per_drive(name, options[name]) if name in LIMITS else options[name]
        for name in options
        if name not in DRIVES
    }


def _per_drive(name: str, text: str) -> float | tuple[float, ...]:
    try:
        numbers = tuple(float(number) for number in text.split(","))
    except ValueError:
        from plant.errors import BadParameter

        raise BadParameter(
            f"--{name.replace('_', '-')} is {text!r}; give a number, or one for each drive as 0.3,0.2."
        ) from None
    return numbers[0] if len(numbers) == 1 else numbers
