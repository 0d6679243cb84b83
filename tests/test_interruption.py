"""Ctrl-C and SIGTERM leave nothing behind, and what is said of the results is so."""

from __future__ import annotations

import contextlib
import io
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from front_door import antidrive, columns, listing, write_csv

from antidrive.cli import main
from antidrive.interruption import Stopped, stoppable, unstoppable
from antidrive.output import whole_folder

PROGRAM = [sys.executable, "-c", "import sys; from antidrive.cli import main; sys.exit(main())"]
ROOT = Path(__file__).parents[1]
AT_ONCE = 10.0  # seconds, on a machine that does much else; about 0.3 on a quiet one


@pytest.fixture(scope="module")
def log(tmp_path_factory) -> Path:
    return write_csv(tmp_path_factory.mktemp("logs") / "log.csv", columns(duration=60.0))


def started(folder: Path, *words: object, **variables: str) -> subprocess.Popen[str]:
    """A command at work in a folder, with temporary folder and cache of its own."""
    here = {"TMPDIR": str(folder), "XDG_CACHE_HOME": str(folder / "cache"), "HOME": str(folder)}
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **here, **variables}
    line = [*PROGRAM, *map(str, words)]
    return subprocess.Popen(line, cwd=folder, env=environment, stdout=-1, stderr=-1, text=True)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
@pytest.mark.parametrize("after", [0.3, 2.5])
def test_a_command_that_is_stopped_leaves_nothing(number, code, after, log, tmp_path):
    # a compiler that never ends is still at work then, and so are threads
    (tmp_path / "cc").write_text("#!/bin/sh\nexec sleep 60\n" if after < 1 else '#!/bin/sh\nexec cc "$@"\n')
    (tmp_path / "cc").chmod(0o755)
    command = started(tmp_path, "diagnose", log, CC=str(tmp_path / "cc"))
    while not list(tmp_path.glob(".antidrive-*")):
        assert command.poll() is None, command.communicate()
        time.sleep(0.02)
    time.sleep(after)
    command.send_signal(number)
    begun = time.monotonic()
    out, err = command.communicate(timeout=60)
    assert time.monotonic() - begun < AT_ONCE
    assert (command.returncode, out, err.splitlines()[-1]) == (code, "", "antidrive: stopped; nothing was written.")
    assert "Traceback" not in err
    assert [name for name in listing(tmp_path) if not name.startswith("cache")] == ["cc"]
    assert [path.name for path in tmp_path.iterdir() if path.is_dir() and path.name != "cache"] == []


SLOW_TO_START = """
import subprocess, threading, time
from antidrive.interruption import leave
from plant.machine_code import MachineCode
begun, real = threading.Event(), subprocess.Popen
def slow(*words, **options):
    begun.set()
    time.sleep(0.3)
    return real(*words, **options)
subprocess.Popen = slow
kept = []
threading.Thread(target=lambda: kept.append(MachineCode("code", "int one(void) { return 1; }")), daemon=True).start()
begun.wait()
leave(0)
"""


def test_a_stop_while_a_thread_starts_a_compiler_leaves_nothing(tmp_path):
    here = {"TMPDIR": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path), "CC": "sleep 60 #", "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", SLOW_TO_START], env={**os.environ, **here}, timeout=60)
    assert (done.returncode, listing(tmp_path)) == (0, {})


def stopped_while_moving(out: Path) -> None:
    with stoppable(), whole_folder(out) as draft:
        for name in "abc":
            (draft / name).write_text(name)


def stopped_inside(ends: list[str]) -> None:
    with stoppable(), unstoppable():
        os.kill(os.getpid(), signal.SIGINT)
        ends.append("whole")


def test_a_signal_waits_until_results_are_whole(tmp_path, monkeypatch):
    real, moved = os.replace, []

    def slow(old: Path, new: Path) -> None:
        if not moved:
            os.kill(os.getpid(), signal.SIGTERM)
        moved.append(new)
        real(old, new)

    monkeypatch.setattr("antidrive.output.os.replace", slow)
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(Stopped) as stopped:
        stopped_while_moving(tmp_path / "out")
    assert stopped.value.code == 143
    assert sorted(listing(tmp_path)) == ["out/a", "out/b", "out/c"]
    assert signal.getsignal(signal.SIGTERM) is before
    ends: list[str] = []
    with pytest.raises(Stopped):
        stopped_inside(ends)
    assert ends == ["whole"]


class Telltale:
    """An object that is being taken away when the signal comes."""

    def __del__(self) -> None:
        os.kill(os.getpid(), signal.SIGTERM)
        _ = [number for number in range(100)]  # where Python looks for signals, and ignores what they raise


def stopped_while_something_goes() -> None:
    with stoppable():
        Telltale()
        begun = time.monotonic()
        while time.monotonic() - begun < 5.0:
            pass


def test_a_signal_that_python_ignores_comes_again():
    before = sys.unraisablehook
    with pytest.raises(Stopped) as stopped:
        stopped_while_something_goes()
    assert stopped.value.code == 143
    assert sys.unraisablehook is before


def failing_in_its_own_way(number: int) -> None:
    with stoppable():
        try:
            os.kill(os.getpid(), number)
            _ = [each for each in range(100)]
        except BaseException:  # as a wrapper does that then tries the next kind of arguments
            raise NotImplementedError("Wrong number or type of arguments") from None


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_what_an_interrupted_library_raises_is_the_stop(number, code):
    with pytest.raises(Stopped) as stopped:
        failing_in_its_own_way(number)
    assert stopped.value.code == code


@pytest.mark.parametrize(("what", "code"), [(KeyboardInterrupt(), 130), (Stopped(15), 143), (RuntimeError("x"), 1)])
def test_what_is_reported_of_the_results_is_true(what, code, tmp_path, monkeypatch):
    def fail(*_: object, **__: object) -> None:
        raise what

    monkeypatch.setattr("antidrive.console.Console.result", fail)
    result = antidrive("capability", "--out", tmp_path / "out")
    assert result.code == code
    assert result.err.endswith(f"; the results are in {tmp_path / 'out'}.\n")
    monkeypatch.setattr("antidrive.report.capability_page", fail)
    assert antidrive("capability", "--out", tmp_path / "no").err.endswith("; nothing was written.\n")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out"]


@pytest.mark.parametrize("encoding", ["cp1250", "cp1251", "cp932", "gbk", "cp949", "ascii", "utf-8"])
@pytest.mark.parametrize("words", ["allocate 1", "allocate 1 --json", "--help", "simulate ö²√", "capability --out ö"])
def test_what_a_console_cannot_show_is_replaced(words, encoding, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    streams = [io.TextIOWrapper(io.BytesIO(), encoding=encoding) for _ in "oe"]
    with contextlib.redirect_stdout(streams[0]), contextlib.redirect_stderr(streams[1]):
        code = main(words.split())
        for stream in streams:
            stream.flush()
    out, err = (stream.buffer.getvalue().decode(encoding) for stream in streams)
    assert code == (2 if words.startswith("simulate") else 0), err
    assert "Traceback" not in err
    if "json" in words:
        assert json.loads(out)["allocations"][0]["torques"][0] == pytest.approx(0.02)
    if "capability" in words:
        assert "report.html" in out
        assert (tmp_path / "ö" / "report.html").exists()


def test_a_pipe_of_another_encoding_gets_what_it_can_show(tmp_path):
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONIOENCODING": "cp932"}
    line = [*PROGRAM, "allocate", "1"]
    done = subprocess.run(line, cwd=tmp_path, env=environment, capture_output=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"N? m?" in done.stdout
