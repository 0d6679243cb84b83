"""Machine code for functions that run over whole logs, from C code, if the machine has a compiler.

CasADi's virtual machine is about ten times slower. The compiler runs in parallel to the program, which meanwhile uses
the virtual machine, or waits; both give the same results to the last bit, since no operations may be contracted or
reordered. Compiled libraries are cached, in a folder with the hash of their source. A truncated file would end the
program with a bus error when loaded: only complete ones are used.
"""

from __future__ import annotations

import ctypes
import os
import platform
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from functools import lru_cache
from importlib.util import find_spec
from multiprocessing.util import Finalize
from pathlib import Path

from plant import file_cache

_GROUPS = hasattr(os, "killpg")  # of processes
_changing = threading.RLock()  # held while a compiler is started, until its end is registered, and while it is ended
_FLAGS = ("-O2", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math", "-fPIC", "-shared")
"""They change no result: `errno` and traps are not used, so that a comparison needs no jump."""
_NATIVE = "-march=native"
_ANSWER = 2.0  # seconds to wait for a compiler's answer on the features of this processor


if hasattr(os, "register_at_fork"):  # a fork that copied the lock as held by another thread would wait for ever
    os.register_at_fork(before=_changing.acquire, after_in_parent=_changing.release, after_in_child=_changing.release)


class MachineCode:
    """C code as a library, once it is compiled.

    It never raises: without a compiler, a writable cache or the time to compile there is no library.
    """

    def __init__(
        self, name: str, source: str | Callable[[], str], *, identifier: str | None = None, start: bool = True
    ) -> None:
        """Look for the library of a source.

        Args:
            name: of the library.
            source: its C code, or a function that returns it when it is needed.
            identifier: identifier that is equal for equal sources only; by default the source itself.
            start: whether to start the compiler at once if there is no library yet, instead of in `start`.
        """
        self._lock = threading.Lock()
        self._library: ctypes.CDLL | None = None
        self._build: _Build | None = None
        self._name, self._source = name, source
        command = compiler()
        self._failed = command is None
        if command is None:
            return
        tuned, processor = _for_this_processor(command)
        self._command = (*tuned, *_FLAGS)
        machine = (sys.platform, platform.machine(), processor)  # several machines may share a home folder
        identifier = self._text() if identifier is None else identifier
        self._kept = "-".join(
            (name, file_cache.content_hash("\n".join((*machine, *self._command, identifier)).encode()))
        )
        if start:
            self.start()
        else:
            self._adopt()

    def start(self) -> None:
        """Start the compiler, unless there is a library, one is running already, or an earlier attempt failed."""
        with self._lock:
            if self._library is None and self._build is None and not self._failed and not self._adopt():
                self._build = _Build.start(self._command, self._name, self._text())
                self._failed = self._build is None

    def _text(self) -> str:
        return self._source if isinstance(self._source, str) else self._source()

    @property
    def library(self) -> ctypes.CDLL | None:
        """The machine code, or None while there is none."""
        with self._lock:
            build = self._build
            if build is not None and build.finished:
                self._build = None
                self._failed = not (build.deliver(self._kept) and self._adopt())
            return self._library

    def wait(self) -> bool:
        """Wait for the compiler; return whether there is machine code."""
        build = self._build
        if build is not None:
            build.process.wait()
        return self.library is not None

    def _adopt(self) -> bool:
        """Load a complete cached library; return whether there is one that this machine can load."""
        try:
            path = file_cache.kept(self._kept, "so")
            self._library = None if path is None else ctypes.CDLL(str(path))
        except OSError:
            pass
        return self._library is not None


class _Build:
    """A compiler running in a temporary folder, both of which end with this object, or with its process.

    A forked worker ends without the functions registered by `atexit` and `weakref.finalize`; `multiprocessing.util`
    calls its own finalizers.
    """

    def __init__(self, process: subprocess.Popen[bytes], folder: Path) -> None:
        self.process, self.folder = process, folder
        self._end = Finalize(self, _abandon, (process, folder), exitpriority=0)

    @classmethod
    def start(cls, command: tuple[str, ...], name: str, source: str) -> _Build | None:
        with _changing:
            return cls._started(command, name, source)

    @classmethod
    def _started(cls, command: tuple[str, ...], name: str, source: str) -> _Build | None:
        folder = None
        try:
            folder = Path(tempfile.mkdtemp(prefix="antidrive-"))
            (folder / f"{name}.c").write_text(source)
            line = [*command, f"{name}.c", "-o", "code.so", "-lm"]
            quiet, here = subprocess.DEVNULL, dict.fromkeys(("TMPDIR", "TMP", "TEMP"), str(folder))
            process = subprocess.Popen(
                line,
                cwd=folder,
                env={**os.environ, **here},
                stdin=quiet,
                stdout=quiet,
                stderr=quiet,
                start_new_session=_GROUPS,  # a compiler starts subprocesses, which end with its group
            )
            return cls(process, folder)
        except BaseException as error:  # an interruption too, which may come between any two lines
            if folder is not None:
                shutil.rmtree(folder, ignore_errors=True)
            if isinstance(error, OSError):
                return None
            raise

    @property
    def finished(self) -> bool:
        return self.process.poll() is not None

    def deliver(self, folder: str) -> bool:
        """Store the result in the cache."""
        try:
            if self.process.returncode != 0:
                return False
            file_cache.keep(folder, (self.folder / "code.so").read_bytes(), "so")
        except OSError:
            return False
        finally:
            self._end()
        return True


def start_no_more() -> None:
    """Wait for a compiler that is being started or ended, and start none from now on: the process is about to end."""
    _changing.acquire(timeout=1.0)  # a disk that hangs must not keep the process from ending


def _abandon(process: subprocess.Popen[bytes], folder: Path) -> None:
    with _changing:
        if process.poll() is None:
            if _GROUPS:
                os.killpg(process.pid, signal.SIGKILL)
            process.kill()
            process.wait()
        shutil.rmtree(folder, ignore_errors=True)


@lru_cache(maxsize=1)
def compiler() -> tuple[str, ...] | None:
    """The C compiler: that of the environment variable CC (none if it is empty), else cc; None without one.

    Without CC and cc, the compiler of the package `ziglang` is used (`pip install 'antidrive[fast]'`).
    """
    command = _words(os.environ.get("CC", "cc"))
    found = shutil.which(command[0]) if command else None
    if found:
        return (found, *command[1:])
    if "CC" not in os.environ and find_spec("ziglang"):
        return (sys.executable, "-m", "ziglang", "cc", "-mcpu=baseline")  # the cache may be shared with other machines
    return None


@lru_cache(maxsize=4)
def _for_this_processor(command: tuple[str, ...]) -> tuple[tuple[str, ...], str]:
    """A command with all instructions of this processor, and the compiler's answer on them; unchanged if not supported.

    That makes long functions 10 to 40 % faster. Options of the user come later and take precedence.
    """
    tuned = (command[0], _NATIVE, *command[1:])
    try:
        answer = subprocess.run(
            [*tuned, "-dM", "-E", "-x", "c", os.devnull], capture_output=True, text=True, timeout=_ANSWER, check=True
        )
    except (OSError, ValueError, subprocess.SubprocessError):
        return command, ""
    return tuned, answer.stdout


def _words(text: str) -> list[str]:
    """A command with its options, or a single path, which may contain blanks and apostrophes."""
    if shutil.which(text):
        return [text]
    try:
        return shlex.split(text)
    except ValueError:
        return text.split()
