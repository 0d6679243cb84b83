"""What the command line is on a terminal: help with examples, 80 columns, colour, completion, and the time left."""

from __future__ import annotations

import inspect
import io
import json
import os
import pty
import re
import shlex
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import typer
from front_door import PLAIN, antidrive
from rich.console import Console as Terminal

from antidrive import console, exports, remaining_time
from antidrive.cli import app
from antidrive.console import Console
from antidrive.experiments.kinds import KINDS
from antidrive.help_examples import EXAMPLES
from antidrive.help_panels import COMMANDS as GROUPS
from antidrive.log_options import LogOptions
from antidrive.prediction import write_prediction
from antidrive.remaining_time import Watch
from antidrive.scenario import scenario_text
from antidrive.scenario_file import read_scenario_file
from mpc import Controller
from plant.gears import GearTrain

COMMANDS = typer.main.get_command(app).commands
PROGRAM = [sys.executable, "-c", "import sys; from antidrive.cli import main; sys.exit(main())"]
ROOT = Path(__file__).parents[1]
HOME = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]), "COLUMNS": "80"}


def on_a_terminal(*words: str, code: int = 0, **variables: str) -> str:
    """What a command writes when it ends with that code on a terminal."""
    screen, end = pty.openpty()
    done = subprocess.Popen([*PROGRAM, *words], stdout=end, stderr=end, env={**HOME, "TERM": "xterm", **variables})
    os.close(end)
    written = b""
    while True:
        try:
            written += os.read(screen, 65536)
        except OSError:  # closed at the other end
            break
    os.close(screen)
    assert done.wait() == code
    return written.decode()


@pytest.mark.parametrize("name", COMMANDS)
def test_help_has_examples_that_parse(name):
    result = antidrive(name, "--help")
    for line in EXAMPLES[name]:
        assert line in " ".join(result.out.split())
        program, command, *words = shlex.split(line.split(" > ")[0])
        assert (program, command) == ("antidrive", name)
        COMMANDS[name].make_context(name, words)


@pytest.mark.parametrize("name", COMMANDS)
def test_help_keeps_the_units(name):
    """Between brackets, small letters would be taken for a style, and left out."""
    reported = " ".join(antidrive(name, "--help").out.replace("│", " ").split())
    for option in COMMANDS[name].params:
        assert " ".join((option.help or "").split()) in reported


def test_help_groups_the_commands():
    assert [name for names in GROUPS.values() for name in names] == list(COMMANDS)
    reported = antidrive("--help").out
    assert [reported.index(f" {title} ") for title in GROUPS] == sorted(
        reported.index(f" {title} ") for title in GROUPS
    )
    assert "Exit code 0" in reported


@pytest.mark.parametrize("words", [["--help"], *([name, "--help"] for name in COMMANDS)], ids=" ".join)
def test_help_fits_80_columns(words, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setattr("typer.rich_utils.MAX_WIDTH", 80)
    assert max(map(len, antidrive(*words).out.splitlines())) <= 80


def test_tables_fit_80_columns(monkeypatch, tmp_path):
    monkeypatch.setattr("antidrive.gallery.gallery_page", lambda *_, **__: "")
    for result in (antidrive("effects", "--out", tmp_path / "out"), antidrive("allocate", "-0.12345", "9", "1e3")):
        assert result.code == 0, result.err
        table = [line for line in result.out.splitlines() if not line.startswith("Written")]
        assert max(map(len, table)) <= 80
    assert "out of reach" in result.out


@pytest.mark.parametrize(
    ("words", "code"), [("capability", 0), ("effects cogging", 0), ("simulate nothing", 2), ("identify nothing.csv", 2)]
)
def test_prose_fits_80_columns_of_a_terminal(words, code, tmp_path):
    out = [] if "effects" in words else ["--out", str(tmp_path / "out")]
    shown = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", on_a_terminal(*words.split(), *out, code=code))
    lines = [line.rstrip() for line in re.split(r"[\r\n]+", shown)]
    assert max(map(len, lines)) <= 80
    assert len(lines) > 2 or words.startswith("identify")


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_writes_json(name):
    assert any("--json" in option.opts for option in COMMANDS[name].params)


def test_json_is_all_that_is_on_stdout():
    assert json.loads(antidrive("effects", "cogging", "--json").out)["effects"][0]["name"] == "cogging"


def test_colour_is_used_on_terminals_only_unless_switched_off():
    assert "\x1b[1m" in on_a_terminal("allocate", "0.5")
    assert "\x1b[3" in on_a_terminal("allocate", "--help")
    assert "\x1b[3" not in on_a_terminal("allocate", "--help", NO_COLOR="1")
    piped = subprocess.run([*PROGRAM, "allocate", "0.5"], env=HOME, capture_output=True, text=True)
    assert piped.stdout.startswith("torque")
    assert "\x1b" not in piped.stdout + piped.stderr


def test_a_warning_is_highlighted_and_indented_on_a_terminal(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    screen = Terminal()
    monkeypatch.setattr(sys, "stdout", screen)
    monkeypatch.setenv("COLUMNS", "40")
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    Console().result(f"Verdict\n  warning: {'word ' * 12}", {})
    first, *warning = screen.getvalue().splitlines()
    assert first.strip() == "\x1b[1mVerdict\x1b[0m"
    assert len(warning) > 1
    assert all(line.startswith("  \x1b[33m") for line in warning)


@pytest.mark.parametrize(
    ("begun", "offered"),
    [
        ("dia", ["diagnose"]),
        ("simulate sect", ["section3", "section4"]),
        ("effects cogg", ["cogging"]),
        ("identify --dataset u", ["ur10e"]),
        ("allocate --min", ["--min-torque"]),
    ],
)
def test_bash_completes(begun, offered, tmp_path):
    shim = tmp_path / "antidrive"
    shim.write_text(f'#!/bin/sh\nexec {shlex.join(PROGRAM)} "$@"\n')
    shim.chmod(0o755)
    words = ["antidrive", *begun.split()]
    script = (
        'eval "$(antidrive --show-completion bash)"; complete -p antidrive > /dev/null || exit 1; '
        f"COMP_WORDS=({shlex.join(words)}); COMP_CWORD={len(words) - 1}; _antidrive_completion antidrive; "
        'printf "%s\\n" "${COMPREPLY[@]}"'
    )
    path = f"{tmp_path}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(["bash", "-c", script], env={**HOME, "PATH": path}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == offered


# The time left.


def test_the_time_left_follows_from_the_pace_of_the_parts():
    now = [0.0]
    watch = Watch("reading", clock=lambda: now[0])
    assert str(watch) == "reading"
    now[0] = 30.0
    assert str(watch) == "reading (30 s)"
    watch.tell("drawing, 0 of 20 are done")  # what went before says nothing of the pace
    now[0] = 31.0
    watch.tell("drawing, 1 of 20 are done")
    assert str(watch).endswith("(31 s)")
    now[0] = 34.0
    watch.tell("drawing, 2 of 20 are done")
    assert str(watch).endswith("(34 s, about 36 s left)")
    now[0] = 50.0
    assert str(watch).endswith("(50 s, about 20 s left)")
    now[0] = 75.0
    assert str(watch).endswith("(75 s)")  # the pace did not last: nothing is known
    watch.tell("drawing, 15 of 20 are done")
    assert str(watch).endswith("(75 s, about 15 s left)")
    watch.tell("writing")
    assert str(watch) == "writing (75 s)"


def test_of_a_fit_and_a_diagnosis_no_time_is_known():
    now = [0.0]
    watch = Watch("diagnosing", clock=lambda: now[0])
    for line in ("observer at 10 rad/s: noise 0.1", "round 1: asking 23 effects", "fitting non-parametric curves"):
        now[0] += 50.0
        watch.tell(line)
        assert str(watch) == f"{line} ({now[0]:.0f} s)"


def test_a_long_line_leaves_room_for_the_time_left():
    now = [0.0]
    watch = Watch("diagnosing", clock=lambda: now[0])
    now[0] = 6.0
    watch.tell(f"round 2: refitting with {'friction, ' * 20}")
    screen = io.StringIO()
    Terminal(file=screen, width=80).print(watch)
    (line,) = screen.getvalue().splitlines()
    assert line.startswith("round 2: refitting with friction, friction")
    assert line.endswith("... (6 s)")
    assert len(line) <= 80


def test_an_experiment_that_takes_long_reports_how_far_it_is(tmp_path):
    for kind in KINDS.values():
        assert ("tell" in inspect.signature(kind.run).parameters) == kind.long
    text = scenario_text("dwell").replace("[0.05, 0.15, 0.3]", "[2.0]").replace("[0.29e-3, 1.16e-3, 4.65e-3]", "[1e-3]")
    (tmp_path / "short.toml").write_text(text)
    reported: list[str] = []
    read_scenario_file(str(tmp_path / "short.toml")).run(None, 0, reported.append)
    assert reported == [f"simulating, {share} of 100 parts are done" for share in range(1, 101)]


@pytest.mark.parametrize("more", ["", "compare_single_drive = true", "[drive_loss]\ndrive = 1\ntime = 0.4"])
def test_a_closed_loop_reports_how_far_it_is(tmp_path, more):
    text = 'duration = 0.8\nsample_time = 0.005\nreference = { kind = "constant", level = 0.1 }\n'
    (tmp_path / "short.toml").write_text(text + more)
    reported: list[str] = []
    read_scenario_file(str(tmp_path / "short.toml")).run(None, 0, reported.append)
    assert reported == [f"simulating, {share} of 100 parts are done" for share in range(1, 101)]


def test_reading_and_predicting_report_how_far_they_are(tmp_path):
    count, reported = 500, []
    time_axis = 0.01 * np.arange(count)
    table = pd.DataFrame({"time": time_axis, "torque": np.sin(time_axis), "angle": 0.1 * np.sin(time_axis)})
    table.to_csv(tmp_path / "log.csv", index=False)
    table.iloc[:-1].to_csv(tmp_path / "held.csv", index=False)
    log = LogOptions(files=(tmp_path / "log.csv",), holdout=(tmp_path / "held.csv",)).read(reported.append).log
    assert reported == [f"reading, {share} of 100 parts are done" for share in (25, 50, 75, 100)]
    del reported[:]
    write_prediction(tmp_path / "p.csv", log, PLAIN, window=1.0, tell=reported.append)
    assert reported == [f"predicting, {share} of 100 parts are done" for share in (16, 32, 48, 64, 80, 100)]


def test_an_export_reports_how_far_it_is(tmp_path, monkeypatch):
    libraries = {"linux64": ("cc",), "darwin64": ("cc",)}
    monkeypatch.setattr("plant.fmu.Fmu.compilers", lambda self: libraries)
    monkeypatch.setattr("plant.fmu.Fmu._library", lambda self, command: b"")
    reported: list[str] = []
    exports.fmus(Controller(PLAIN, GearTrain.paper()), PLAIN, tmp_path, reported.append)
    assert reported == [f"compiling the FMUs, {share} of 100 parts are done" for share in (25, 50, 75, 100)]


def test_progress_is_shown_where_somebody_watches(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    screen = Terminal()
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setattr(remaining_time, "_LEAST_ELAPSED", 0.0)
    monkeypatch.setenv("TERM", "xterm")
    with Console().progress("diagnosing [log]") as tell:
        time.sleep(0.2)
        tell("drawing, 3 of 20 are done")
        time.sleep(0.2)
        tell("drawing, 10 of 20 are done")
        time.sleep(0.15)
    assert "diagnosing [log]" in screen.getvalue()
    assert "about 1 s left" in screen.getvalue()
    with Console(quiet=True).progress("diagnosing") as tell:
        assert tell is None


@pytest.mark.parametrize("json", [False, True])
def test_where_there_is_no_terminal_a_line_comes_now_and_then(json, monkeypatch, capsys):
    monkeypatch.setattr(console, "_BETWEEN", 0.1)
    monkeypatch.setattr(remaining_time, "_LEAST_ELAPSED", 0.0)
    with Console(json=json).progress("diagnosing") as tell:
        tell("round 1: asking 23 effects")
        time.sleep(0.35)
    time.sleep(0.2)
    printed = capsys.readouterr()
    assert printed.out == ""
    assert 2 <= len(printed.err.splitlines()) <= 3
    assert set(printed.err.splitlines()) == {"antidrive: round 1: asking 23 effects (0 s)"}
    with Console(quiet=True, json=json).progress("diagnosing") as tell:
        assert tell is None
        time.sleep(0.2)
    assert capsys.readouterr().err == ""
