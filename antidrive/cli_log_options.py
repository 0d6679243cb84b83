"""Command-line options for the files of a log and their interpretation; read by `log_options`."""

from __future__ import annotations

import inspect
import typing
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from antidrive import completion
from antidrive.help_panels import in_panel

Words = list[str] | None

WORDS = in_panel(
    "How the log is read",
    {
        "logs": Annotated[
            list[Path] | None,
            typer.Argument(
                metavar="LOG",
                help="CSV and other text, Parquet, MAT, HDF5, NPZ, JSON, Excel, MF4, TDMS or MCAP files, also "
                "compressed; - is standard input; or the log.toml that `antidrive inspect` writes.",
            ),
        ],
        "mapping": Annotated[
            Words,
            typer.Option(
                "--map", metavar="COLUMN=NAME", help="Column of a quantity: angle=qm, or by its number, angle=3."
            ),
        ],
        "unit": Annotated[
            Words,
            typer.Option(
                "--unit",
                metavar="COLUMN=UNIT",
                help="Unit of a column: angle=deg; of encoder counts angle=turn/131072.",
            ),
        ],
        "scale": Annotated[
            Words,
            typer.Option(
                "--scale", metavar="COLUMN=FACTOR", help="Factor by which a column is multiplied: torque=35.15."
            ),
        ],
        "rate": Annotated[
            float | None, typer.Option(metavar="HZ", help="Samples per second, for a file without time stamps.")
        ],
        "gears": Annotated[
            str | None,
            typer.Option(
                metavar="N1,N2:N", help="Two drives: teeth of both pinions and of the output gear, 20,20:161."
            ),
        ],
        "ratio": Annotated[
            str | None,
            typer.Option(
                metavar="RATIO",
                help="Two drives: reduction from the motors to the load, 8.05, or one each, 8.05,-8.05.",
            ),
        ],
        "torque_constant": Annotated[
            float | None, typer.Option(metavar="KT", help="Torque constant, for a log of a current [N m/A].")
        ],
        "kp": Annotated[
            float | None,
            typer.Option(metavar="GAIN", help="Position gain, for a log of position set-points [N m/rad]."),
        ],
        "kd": Annotated[
            float | None, typer.Option(metavar="GAIN", help="Velocity gain of the same position servo [N m s/rad].")
        ],
        "joint": Annotated[str | None, typer.Option(metavar="NAME", help="Joint to read, if the log has several.")],
        "dataset": Annotated[
            str | None,
            typer.Option(
                metavar="NAME",
                help=f"Public data set: {', '.join(completion.DATASETS)}.",
                autocompletion=completion.datasets,
            ),
        ],
        "data": Annotated[Path | None, typer.Option(metavar="FOLDER", help="Folder of the data set.")],
    },
)
"""Options of a log, by their name in Python."""


def with_log(command: Callable[..., None]) -> Callable[..., None]:
    """Decorate a command so that its parameter `log`, a `LogOptions`, is built from the options in `WORDS`."""

    def typed(**given: Any) -> None:
        words = {name: given.pop(name) for name in WORDS}
        command(log=log_options(**words, holdout=given.pop("holdout", None)), **given)

    hints = typing.get_type_hints(command, include_extras=True)
    own = {name: one for name, one in inspect.signature(command, eval_str=True).parameters.items() if name != "log"}
    keyword = inspect.Parameter.KEYWORD_ONLY
    options = [inspect.Parameter(name, keyword, default=None, annotation=kind) for name, kind in WORDS.items()]
    first = [one for name, one in own.items() if name in ("context", "model")]
    others = [one for name, one in own.items() if name not in ("context", "model")]
    merged = [one.replace(kind=keyword) for one in (*first, *options, *others)]
    typed.__name__, typed.__doc__ = command.__name__, command.__doc__
    typed.__signature__ = inspect.Signature(merged)  # type: ignore[attr-defined]
    typed.__annotations__ = {name: kind for name, kind in {**hints, **WORDS}.items() if name not in ("log", "return")}
    return typed


def log_options(
    *,
    logs: list[Path] | None,
    mapping: Words,
    unit: Words,
    scale: Words,
    dataset: str | None,
    data: Path | None,
    holdout: list[Path] | None,
    **given: Any,
) -> Any:
    """The `LogOptions` of these words; imported only here, as its dependencies are slow to import.

    A log.toml in place of a log is read; options on the command line override it.
    """
    from antidrive.log_options import LogOptions
    from plant.errors import BadParameter

    options = LogOptions.typed(
        files=logs or (),
        mapping=mapping or (),
        units=unit or (),
        scales=scale or (),
        dataset=dataset,
        data=data,
        holdout=holdout or (),
        **given,
    )
    described = [path for path in options.files if path.suffix.lower() == ".toml"]
    if not described:
        return options
    if len(options.files) > 1:
        raise BadParameter(f"{described[0].name} names its files itself; give it alone.")
    from antidrive.log_file import read_log_file

    return read_log_file(described[0]).overruled(options)
