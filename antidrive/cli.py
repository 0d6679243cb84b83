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
from antidrive.examples import told
from antidrive.fit_words import Bounds, Candidates, Effects, Exclude, Fixed, PerRun, Prior, fit_options
from antidrive.log_words import with_log
from antidrive.program import run

app = typer.Typer()

Out = Annotated[Path, typer.Option(help="Folder for the results.")]
Holdout = Annotated[
    list[Path] | None, typer.Option("--holdout", metavar="LOG", help="Log to validate on; may be repeated.")
]
Base = Annotated[Path | None, typer.Option(metavar="MODEL.json", help="Model to start from, instead of eqs. (4)+(6).")]
Seed = Annotated[int, typer.Option(min=0, help="Seed of everything random.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON, and nothing else.")]
Force = Annotated[bool, typer.Option("--force", help="Go on with a log that contradicts every machine.")]
MinTorque = Annotated[float, typer.Option(help="Least torque of each pinion [N m].")]
MaxTorque = Annotated[float, typer.Option(help="Greatest torque of each pinion [N m].")]
OUT = Path("antidrive-out")


def _say_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"antidrive {__version__}")
        raise typer.Exit


@app.callback()
def everything(
    version: Annotated[
        bool, typer.Option("--version", callback=_say_version, is_eager=True, help="Print the version, and end.")
    ] = False,
) -> None:
    """From the log of a geared servo to what its model gets wrong, by name, and to the controller."""


@app.command(epilog=told("demo"))
def demo(context: typer.Context, out: Out = OUT, seed: Seed = 0, quiet: Quiet = False, json: Json = False) -> None:
    """The whole chain on a synthetic log: identify, diagnose, extend, design, close the loop, report."""
    from antidrive import commands

    commands.demo(out=out, seed=seed, voice=commands.Voice(quiet=quiet, json=json, words=context.obj))


@app.command(epilog=told("identify"))
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
    force: Force = False,
    out: Out = OUT,
    seed: Seed = 0,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Fit a model to a log: model.json, fit.json, report.html."""
    from antidrive import commands

    voice = commands.Voice(quiet=quiet, json=json, words=context.obj)
    known = fit_options(fixed=fixed, bounds=bounds, prior=prior, per_run=per_run, effects=effects)
    commands.identify(log, base=base, known=known, force=force, out=out, seed=seed, voice=voice)


@app.command(epilog=told("diagnose"))
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
    force: Force = False,
    out: Out = OUT,
    seed: Seed = 0,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Name what the model misses: diagnosis.json, model.json (extended), report.html."""
    from antidrive import commands

    voice = commands.Voice(quiet=quiet, json=json, words=context.obj)
    known = fit_options(
        fixed=fixed, bounds=bounds, prior=prior, candidates=candidates, exclude=exclude, effects=effects
    )
    commands.diagnose(log, base=base, known=known, force=force, out=out, seed=seed, voice=voice)


@app.command("inspect", epilog=told("inspect"))
@with_log
def inspect_log(
    context: typer.Context,
    log: Any,
    holdout: Holdout = None,
    out: Out = OUT,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Show what is understood of a log: columns, units, runs, faults; log.toml, report.html."""
    from antidrive import commands

    commands.inspect(log, out=out, voice=commands.Voice(quiet=quiet, json=json, words=context.obj))


@app.command(epilog=told("predict"))
@with_log
def predict(
    model: Annotated[Path, typer.Argument(metavar="MODEL.json", help="Model to simulate.")],
    log: Any,
    effects: Effects = None,
    window: Annotated[float | None, typer.Option(metavar="S", help="Restart every S seconds.")] = None,
    out: Annotated[Path, typer.Option(metavar="FILE.csv", help="File for run, time, angle or position.")] = Path(
        "antidrive-out/prediction.csv"
    ),
    seed: Seed = 0,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Simulate freely what a model says will follow from a log's command."""
    from antidrive import commands

    voice = commands.Voice(quiet=quiet, json=json)
    commands.predict(model, log, effects=effects, window=window, out=out, voice=voice)


@app.command(epilog=told("simulate"))
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
    model: Annotated[Path | None, typer.Option(metavar="MODEL.json", help="Design model of the controller.")] = None,
    effects: Effects = None,
    out: Out = OUT,
    seed: Seed = 0,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Run a closed loop, or an experiment of the paper, on the rig: trajectory.csv, summary.json, report.html."""
    from antidrive import commands

    voice = commands.Voice(quiet=quiet, json=json, words=context.obj)
    commands.simulate(scenario, model=model, effects=effects, out=out, seed=seed, voice=voice)


@app.command(epilog=told("effects"))
def effects(
    context: typer.Context,
    name: Annotated[
        str | None,
        typer.Argument(metavar="[NAME]", help="Only this effect, in words.", autocompletion=completion.effects),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for gallery.html; antidrive-out, or none with a NAME.")
    ] = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """List what a model may lack, and draw it: gallery.html."""
    from antidrive import commands

    voice = commands.Voice(quiet=quiet, json=json, words=context.obj)
    commands.effects(name, out=out if name is not None else out or OUT, voice=voice)


@app.command(context_settings={"ignore_unknown_options": True}, epilog=told("allocate"))
def allocate(
    torques: Annotated[list[float], typer.Argument(metavar="TORQUE...", help="Follower torques [N m].")],
    min_torque: MinTorque = 0.02,
    max_torque: MaxTorque = 0.3,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Share follower torques between the two drives, with margin and heat."""
    from antidrive import commands, drive_commands

    voice = commands.Voice(quiet=quiet, json=json)
    drive_commands.allocate(torques, min_torque=min_torque, max_torque=max_torque, voice=voice)


@app.command(epilog=told("capability"))
def capability(
    context: typer.Context,
    inertia: Annotated[float, typer.Option(help="Of load and rotors, seen from the load [kg m^2].")] = 2.0,
    min_torque: MinTorque = 0.02,
    max_torque: MaxTorque = 0.3,
    rotor_inertia: Annotated[float, typer.Option(help="Of each motor, at its shaft [kg m^2].")] = 0.0,
    motor_friction: Annotated[float, typer.Option(help="Dry friction of each motor, at its shaft [N m].")] = 0.0,
    out: Out = OUT,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """What the paper's two drives can do with teeth that stay together: capability.csv, report.html."""
    from antidrive import commands, drive_commands

    drive_commands.capability(
        inertia=inertia,
        min_torque=min_torque,
        max_torque=max_torque,
        rotor_inertia=rotor_inertia,
        motor_friction=motor_friction,
        out=out,
        voice=commands.Voice(quiet=quiet, json=json, words=context.obj),
    )


@app.command(epilog=told("export"))
def export(
    model: Annotated[Path, typer.Argument(metavar="MODEL.json", help="Model that the controller works with.")],
    pinion_teeth: Annotated[tuple[int, int], typer.Option(help="Teeth of the two pinions; by default the paper's.")] = (
        20,
        20,
    ),
    follower_teeth: Annotated[int, typer.Option(help="Teeth of the follower, which turns the load.")] = 161,
    sample_time: Annotated[float, typer.Option(help="Seconds between two steps of the controller.")] = 0.005,
    horizon: Annotated[int | None, typer.Option(help="Samples looked ahead; chosen if left out.")] = None,
    min_torque: MinTorque = 0.02,
    max_torque: MaxTorque = 0.3,
    single: Annotated[bool, typer.Option("--single", help="Calculate in single precision.")] = False,
    fmu: Annotated[bool, typer.Option("--fmu", help="Write controller and plant as FMUs instead.")] = False,
    effects: Effects = None,
    out: Out = OUT,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Write the controller as C99 for a target, with driver, CMakeLists.txt, README.txt; or as FMU with its plant."""
    from antidrive import commands, drive_commands
    from plant.gears import GearTrain

    drive_commands.export(
        model,
        GearTrain(pinion_teeth=pinion_teeth, follower_teeth=follower_teeth),
        sample_time=sample_time,
        horizon=horizon,
        min_torque=min_torque,
        max_torque=max_torque,
        single=single,
        fmu=fmu,
        effects=effects,
        out=out,
        voice=commands.Voice(quiet=quiet, json=json),
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return the exit code.

    0 is done, 2 bad input (one sentence on stderr), 130 and 143 stopped by Ctrl-C and SIGTERM, 1 anything else. As the
    program, without `arguments`, a command that is stopped ends the process.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    return run(app, words or ["--help"], whole=arguments is None)
