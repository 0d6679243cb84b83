"""The command line; `antidrive --help` lists its commands.

Heavy packages are imported inside the commands, so that `--help` answers at once.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from antidrive import __version__, completion
from antidrive.cli_drive_options import DRIVES, LIMITS, TUNING, with_options
from antidrive.cli_fit_options import Bounds, Candidates, Effects, Exclude, Fixed, Inverse, PerRun, Prior, fit_options
from antidrive.cli_log_options import with_log
from antidrive.cli_options import OUT, Force, Json, Out, Quiet, Seed
from antidrive.compare_command import compare
from antidrive.friction_command import friction
from antidrive.help_examples import examples_of
from antidrive.help_panels import FIRST, grouped
from antidrive.plan_command import plan
from antidrive.program import run
from antidrive.table_command import table

app = typer.Typer()

Holdout = Annotated[
    list[Path] | None,
    typer.Option(
        "--holdout",
        metavar="LOG",
        help="Validation log. May be repeated. Without it a part of the log is kept for validation.",
    ),
]
Base = Annotated[
    Path | None,
    typer.Option(
        metavar="MODEL.json", help="Model to start from, in place of inertia, gravity, viscous friction and dead zone."
    ),
]
EXPORTS = "In place of the controller"
DesignModel = Annotated[Path | None, typer.Option(metavar="MODEL.json", help="Model of the machine.")]


def _say_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"antidrive {__version__}")
        raise typer.Exit


@app.callback(epilog="\n\n".join(FIRST))
def everything(
    version: Annotated[
        bool, typer.Option("--version", callback=_say_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Find the missing physical effects in the model of a geared servo from its log, and design its controller."""


@app.command(epilog=examples_of("demo"))
def demo(context: typer.Context, out: Out = OUT, seed: Seed = 0, quiet: Quiet = False, json: Json = False) -> None:
    """Run the whole chain on a synthetic log: identify, diagnose, design a controller, close the loop."""
    from antidrive import commands

    commands.demo(out=out, seed=seed, console=commands.Console(quiet=quiet, json=json, words=context.obj))


@app.command(epilog=examples_of("identify"))
@with_log
def identify(
    context: typer.Context,
    log: Any,
    base: Base = None,
    fixed: Fixed = None,
    bounds: Bounds = None,
    prior: Prior = None,
    per_run: PerRun = None,
    effects: Effects = None,
    inverse: Inverse = None,
    force: Force = False,
    out: Out = OUT,
    seed: Seed = 0,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Fit inertia, gravity, friction and dead zone to a log. Writes model.json, fit.json, report.html."""
    from antidrive import commands

    console = commands.Console(quiet=quiet, json=json, words=context.obj)
    known = fit_options(fixed=fixed, bounds=bounds, prior=prior, per_run=per_run, effects=effects, inverse=inverse)
    commands.identify(log, base=base, known=known, force=force, out=out, seed=seed, console=console)


@app.command(epilog=examples_of("diagnose"))
@with_log
def diagnose(
    context: typer.Context,
    log: Any,
    holdout: Holdout = None,
    base: Base = None,
    fixed: Fixed = None,
    bounds: Bounds = None,
    prior: Prior = None,
    candidates: Candidates = None,
    exclude: Exclude = None,
    effects: Effects = None,
    inverse: Inverse = None,
    force: Force = False,
    out: Out = OUT,
    seed: Seed = 0,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Find the effects that the model lacks. Writes diagnosis.json, the extended model.json, report.html."""
    from antidrive import commands

    console = commands.Console(quiet=quiet, json=json, words=context.obj)
    known = fit_options(
        fixed=fixed,
        bounds=bounds,
        prior=prior,
        candidates=candidates,
        exclude=exclude,
        effects=effects,
        inverse=inverse,
    )
    commands.diagnose(log, base=base, known=known, force=force, out=out, seed=seed, console=console)


@app.command("inspect", epilog=examples_of("inspect"))
@with_log
def inspect_log(
    context: typer.Context,
    log: Any,
    holdout: Holdout = None,
    out: Out = OUT,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Show how a log is read: columns, units, runs, faults. Writes log.toml, report.html."""
    from antidrive import commands

    commands.inspect(log, out=out, console=commands.Console(quiet=quiet, json=json, words=context.obj))


@app.command(epilog=examples_of("predict"))
@with_log
def predict(
    context: typer.Context,
    model: Annotated[Path, typer.Argument(metavar="MODEL.json", help="Model to simulate.")],
    log: Any,
    effects: Effects = None,
    window: Annotated[
        float | None, typer.Option(metavar="S", help="Restart the simulation every S seconds (multi-step prediction).")
    ] = None,
    measured: Annotated[bool, typer.Option("--measured", help="Add the measured values as a last column.")] = False,
    report: Annotated[
        Path | None,
        typer.Option(metavar="PAGE.html", help="Report with measured and simulated. Default: the name of the table."),
    ] = None,
    out: Annotated[
        Path,
        typer.Option(
            metavar="FILE.csv",
            help="File for the columns run, time and angle, position or velocity; also .parquet, .json, .xlsx.",
        ),
    ] = Path("antidrive-out/prediction.csv"),
    seed: Seed = 0,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Simulate a log in open loop, from its command alone. Writes prediction.csv, and a report beside it."""
    from antidrive import commands

    console = commands.Console(quiet=quiet, json=json, words=context.obj)
    commands.predict(
        model, log, effects=effects, window=window, measured=measured, page=report, out=out, console=console
    )


@app.command(epilog=examples_of("simulate"))
@with_options(DRIVES, LIMITS, TUNING)
def simulate(
    context: typer.Context,
    scenario: Annotated[
        str,
        typer.Argument(
            metavar="SCENARIO",
            autocompletion=completion.scenarios,
            help="section3, section4, figure5, figure6, figure7, figure7-samples, dwell, camera, fail-safe, tracking, "
            "drive-loss, disturbance, differential, preload-sizing, or TOML.",
        ),
    ],
    options: Any,
    model: Annotated[
        Path | None, typer.Option(metavar="MODEL.json", help="Model for the controller and for the simulated machine.")
    ] = None,
    effects: Effects = None,
    out: Out = OUT,
    seed: Seed = 0,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Run a closed loop or an experiment in the test-bench simulation. Writes a trajectory, a summary, a report."""
    from antidrive import commands

    console = commands.Console(quiet=quiet, json=json, words=context.obj)
    commands.simulate(scenario, options, model=model, effects=effects, out=out, seed=seed, console=console)


@app.command(epilog=examples_of("effects"))
def effects(
    context: typer.Context,
    name: Annotated[
        str | None,
        typer.Argument(metavar="NAME", help="Only this effect, in words.", autocompletion=completion.effects),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for gallery.html. With a NAME nothing is written unless it is given.")
    ] = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """List the effects that a model may lack, and draw their signatures. Writes gallery.html."""
    from antidrive import commands

    console = commands.Console(quiet=quiet, json=json, words=context.obj)
    commands.effects(name, out=out if name is not None else out or OUT, console=console)


@app.command(context_settings={"ignore_unknown_options": True}, epilog=examples_of("allocate"))
@with_options(DRIVES, LIMITS)
def allocate(
    torques: Annotated[list[float], typer.Argument(metavar="TORQUE", help="Torques on the load [N m].")],
    options: Any,
    model: DesignModel = None,
    effects: Effects = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Allocate load torques to the drives, with margin and copper-loss index."""
    from antidrive import commands, drive_commands

    console = commands.Console(quiet=quiet, json=json)
    drive_commands.allocate(torques, options, model=model, effects=effects, console=console)


@app.command(epilog=examples_of("capability"))
@with_options(DRIVES, LIMITS)
def capability(
    context: typer.Context,
    options: Any,
    inertia: Annotated[
        float | None,
        typer.Option(
            help="Inertia of load and rotors, seen from the load, in kg m^2. Default: that of the model, else 2."
        ),
    ] = None,
    model: DesignModel = None,
    effects: Effects = None,
    out: Out = OUT,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Map what two preloaded drives can do without losing contact. Writes capability.csv, report.html."""
    from antidrive import commands, drive_commands

    console = commands.Console(quiet=quiet, json=json, words=context.obj)
    drive_commands.capability(options, inertia=inertia, model=model, effects=effects, out=out, console=console)


@app.command(epilog=examples_of("export"))
@with_options(DRIVES, LIMITS, TUNING)
def export(
    model: Annotated[Path, typer.Argument(metavar="MODEL.json", help="Model to export.")],
    options: Any,
    name: Annotated[
        str,
        typer.Option(
            metavar="NAME", help="Prefix of all symbols and files, so that several controllers fit in one program."
        ),
    ] = "antidrive",
    single: Annotated[bool, typer.Option("--single", help="Use single precision.")] = False,
    fmu: Annotated[bool, typer.Option("--fmu", rich_help_panel=EXPORTS, help="Controller and plant as FMUs.")] = False,
    feedforward: Annotated[
        bool,
        typer.Option(
            "--feedforward", rich_help_panel=EXPORTS, help="Feedforward (inverse model) as C99 and Structured Text."
        ),
    ] = False,
    mujoco: Annotated[
        bool, typer.Option("--mujoco", rich_help_panel=EXPORTS, help="Model for MuJoCo: MJCF and a Python class.")
    ] = False,
    urdf: Annotated[bool, typer.Option("--urdf", rich_help_panel=EXPORTS, help="Model as a URDF joint.")] = False,
    modelica: Annotated[
        bool, typer.Option("--modelica", rich_help_panel=EXPORTS, help="Model as a Modelica class.")
    ] = False,
    plant: Annotated[
        bool, typer.Option("--plant", rich_help_panel=EXPORTS, help="Model as an FMU with one torque as input.")
    ] = False,
    effects: Effects = None,
    out: Out = OUT,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Export the controller as C99; or with an option the feedforward, or the model for a simulator."""
    from antidrive import commands, drive_commands, model_commands

    console = commands.Console(quiet=quiet, json=json)
    given = {"feedforward": feedforward, "mujoco": mujoco, "urdf": urdf, "modelica": modelica, "plant": plant}
    if form := model_commands.chosen(given, fmu=fmu):
        model_commands.export_model(
            model, form, options, name=name, single=single, effects=effects, out=out, console=console
        )
        return
    drive_commands.export(model, options, name=name, single=single, fmu=fmu, effects=effects, out=out, console=console)


for _command in (compare, table, friction, plan):
    app.command(epilog=examples_of(_command.__name__))(_command)
grouped(app)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return the exit code.

    0 is done, 2 bad input (one sentence on stderr), 130 and 143 stopped by Ctrl-C and SIGTERM, 1 anything else. As the
    program, without `arguments`, a command that is stopped ends the process.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    return run(app, words or ["--help"], whole=arguments is None)
