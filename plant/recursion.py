"""A function evaluated recursively along a log: some outputs are its next inputs, the others are stored row by row.

Predictions, linearisations and the signatures of effects with memory are such recursions. They start as a list of
instructions that a compiled loop executes. A function that is used for long is compiled itself meanwhile, which is
three times as fast; without a compiler CasADi's virtual machine is used, which is ten times slower. All give the same
results to the last bit. Instructions are cached for other programs: then the function itself is not built.
"""

from __future__ import annotations

import ctypes
import math
import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any, TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from plant import file_cache
from plant.instruction_tape import InstructionTape
from plant.machine_code import MachineCode
from plant.symbolic import one_at_a_time
from plant.tape_loops import pointers

Array: TypeAlias = NDArray[np.float64]
CHUNK = 250  # rows per call of the virtual machine
PIECE = 4096  # rows executed by instructions before it is checked whether the compiler has finished
ROWS_BEFORE_COMPILING = (
    150_000  # rows after which the compiler starts, if each instruction counts once: as long as it takes
)
_DUST = 1e-150  # its square is still not denormal

_LOOP = """
#include <stdlib.h>
#include <string.h>
static const long long carried_size[] = {%(carried)s 0}, shown_size[] = {%(shown)s 0};
static int one_row(const double** arg, double** res, long long* iw, double* w) { return %(name)s(arg, res, iw, w, 0); }
#ifdef _WIN32
__declspec(dllexport)
#endif
int follow_rows(long long rows, double** carried, const double* row, const double** constants,
                                double** shown) {
  long long n_arg, n_res, n_iw, n_w, i, k, total = 0;
  if (%(name)s_work(&n_arg, &n_res, &n_iw, &n_w)) return 1;
  for (i = 0; i < %(handed)d; ++i) total += carried_size[i];
  const double** arg = malloc((n_arg + 1) * sizeof(double*));
  double** res = malloc((n_res + 1) * sizeof(double*));
  long long* iw = malloc((n_iw + 1) * sizeof(long long));
  double* w = malloc((n_w + total + 1) * sizeof(double));
  int failed = !arg || !res || !iw || !w;
  for (k = 0; k < rows && !failed; ++k) {
    double* next = w + n_w;
    for (i = 0; i < %(handed)d; next += carried_size[i++]) { arg[i] = carried[i]; res[i] = next; }
    arg[%(handed)d] = row + k * %(width)d;
    for (i = 0; i < %(fixed)d; ++i) arg[%(handed)d + 1 + i] = constants[i];
    for (i = 0; i < %(written)d; ++i) res[%(handed)d + i] = shown[i] + k * shown_size[i];
    failed = one_row(arg, res, iw, w);
    for (i = 0; i < %(handed)d; ++i) memcpy(carried[i], res[i], carried_size[i] * sizeof(double));
  }
  free(arg); free(res); free(iw); free(w);
  return failed;
}
"""


class Recursion:
    """A CasADi function (carried ..., row, constants ...) -> (carried ..., shown ...), dense in all of them."""

    def __init__(self, build: Callable[[], Any], carried: int, kept: str | None = None) -> None:
        """Prepare a function whose first `carried` outputs, possibly none, are its next first inputs.

        Args:
            build: returns the function.
            carried: number of outputs carried to the next row.
            kept: folder of the cache for its instructions; by default they are not cached.
        """
        self._build, self._handed = build, carried
        self._built: Any = None
        tape = self._tape = _instructions(lambda: self._function, carried, kept)
        identifier = None if tape is None else "\n".join((ca.CasadiMeta.version(), _LOOP, repr(_DUST), tape.identifier))
        self._code = MachineCode("recursion", self._source, identifier=identifier, start=tape is None)
        self._rows_before_compiling = _rows_before_compiling(tape)
        self._followed = 0  # rows, without machine code
        self._chunk: Any = None
        # (S,) number of elements of each output that is not carried on
        self._shown = tuple(a * b for a, b in self._leaving[carried:]) if tape is None else tape.shown

    @property
    @one_at_a_time
    def _function(self) -> Any:
        # No cached_property: Python 3.11 locks it for all objects of a class. A thread with that lock would wait for
        # the thread that builds, which may wait for the lock.
        if self._built is None:
            self._built = _without_dust(self._build(), self._handed)
        return self._built

    @property
    def _entering(self) -> list[tuple[int, int]]:
        return [self._function.size_in(place) for place in range(self._function.n_in())]

    @property
    def _leaving(self) -> list[tuple[int, int]]:
        return [self._function.size_out(place) for place in range(self._function.n_out())]

    def __call__(self, begin: Sequence[Array], rows: Array, *constants: Array) -> tuple[list[Array], list[Array]]:
        """Evaluate the function along `rows`; other threads run meanwhile.

        Args:
            begin: carried inputs of the first row; a matrix by columns.
            rows: (T, width).
            constants: the function's further inputs.

        Returns:
            The carried outputs of the last row, and (T, size) of each other output.
        """
        rows = np.ascontiguousarray(rows, dtype=float)
        carried = [np.array(value, dtype=float).ravel() for value in begin]
        fixed = [np.ascontiguousarray(value, dtype=float).ravel() for value in constants]
        shown = [np.empty((len(rows), size)) for size in self._shown]
        first = 0
        while first < len(rows):
            library = self._library()
            last = len(rows) if library is not None else min(first + PIECE, len(rows))
            part, written = rows[first:last], [values[first:last] for values in shown]
            if library is not None:
                _in_machine_code(library, carried, part, fixed, written)
            else:
                self._followed += len(part)
                if self._tape is None or not self._tape.follow(carried, part, fixed, written, _DUST):
                    carried = self._in_virtual_machine(carried, part, fixed, written)
            first = last
        return carried, shown

    def wait(self) -> bool:
        """Compile it and wait for that; return whether there is machine code."""
        self._code.start()
        return self._code.wait()

    def _library(self) -> ctypes.CDLL | None:
        """The machine code, if there is some; the compiler is started once that pays.

        It runs in parallel to the program, most of whose threads wait for one of them most of the time. Only the
        virtual machine is so slow that it is better to wait.
        """
        if self._code.library is None and self._followed >= self._rows_before_compiling:
            self._code.start()
            if self._tape is None:
                self._code.wait()
        return self._code.library

    def _in_virtual_machine(
        self, carried: list[Array], rows: Array, fixed: list[Array], shown: list[Array]
    ) -> list[Array]:
        if self._chunk is None:
            self._chunk = _chunk_of(self._function, self._handed)
        after = [np.reshape(v, s, order="F") for v, s in zip(fixed, self._entering[self._handed + 1 :], strict=True)]
        for first in range(0, len(rows), CHUNK):
            part = rows[first : first + CHUNK]
            padded = np.zeros((CHUNK, rows.shape[1]))
            padded[: len(part)] = part
            before = [np.reshape(v, s, order="F") for v, s in zip(carried, self._entering, strict=False)]
            found = self._chunk.call([ca.DM(value) for value in (*before, padded.T, *after)])
            flat = [np.array(v).T.reshape(CHUNK, a * b) for v, (a, b) in zip(found, self._leaving, strict=True)]
            for values, written in zip(flat[self._handed :], shown, strict=True):
                written[first : first + len(part)] = values[: len(part)]
            carried = [values[len(part) - 1].copy() for values in flat[: self._handed]]
        return carried

    def _source(self) -> str:
        """C code of the function and of the loop around it."""
        name = self._function.name()
        generator = ca.CodeGenerator(f"{name}.c")
        generator.add(self._function)
        sizes = [a * b for a, b in self._leaving]
        return _own(str(generator.dump())) + _LOOP % {
            "name": name,
            "handed": self._handed,
            "width": self._entering[self._handed][0],
            "fixed": len(self._entering) - self._handed - 1,
            "written": len(sizes) - self._handed,
            "carried": "".join(f"{size}, " for size in sizes[: self._handed]),
            "shown": "".join(f"{size}, " for size in sizes[self._handed :]),
        }


def _rows_before_compiling(tape: InstructionTape | None) -> float:
    """Rows after which compiling pays; never for rows that are independent of one another."""
    if tape is None:
        return 0
    return ROWS_BEFORE_COMPILING * tape.written // max(len(tape.first), 1) if tape.carried else math.inf


def _instructions(function: Callable[[], Any], carried: int, folder: str | None) -> InstructionTape | None:
    """The instructions of a function, cached if possible; None if some cannot be executed."""
    path = None if folder is None else file_cache.kept(folder, "npz")
    try:
        if path is not None:
            return InstructionTape.read(path.read_bytes())
    except OSError:  # it has been deleted meanwhile
        pass
    tape = InstructionTape.of(function(), carried)
    if folder is not None and tape is not None:
        with suppress(OSError):  # they are built again next time
            file_cache.keep(folder, tape.content, "npz")
    return tape


def _own(source: str) -> str:
    """The generated code for use by the loop only: without other callers, the compiler may inline it.

    That makes the rows 4 to 15 % faster and the compiler 6 %. Library calls of fmin and fmax took 8 %.
    """
    hidden = re.sub(r"^(casadi_\w+|void) casadi_", r"static \1 casadi_", source, flags=re.MULTILINE)
    for name, before in (("fmin", "<"), ("fmax", ">")):
        hidden = hidden.replace(f"return {name}(x, y);", f"return x {before} y || y != y ? x : y;")
    return f"#define CASADI_SYMBOL_EXPORT static\n{hidden}"


@one_at_a_time
def _without_dust(function: Any, handed: int) -> Any:
    """The function with zeros for values that decay in its first `handed` outputs.

    Denormal numbers would slow a processor down many times.
    """
    if not handed:
        return function
    entering = (function.sx_in if function.is_a("SXFunction") else function.mx_in)()
    leaving = function.call(entering)
    kept = [value * (ca.fabs(value) >= _DUST) for value in leaving[:handed]]
    return ca.Function(function.name(), entering, [ca.densify(value) for value in kept] + leaving[handed:])


@one_at_a_time
def _chunk_of(function: Any, handed: int) -> Any:
    """The function over many rows, with its first `handed` outputs carried on."""
    places = list(range(handed))
    return function.mapaccum("chunk", CHUNK, places, places) if places else function.map(CHUNK)


def _in_machine_code(
    library: ctypes.CDLL, carried: list[Array], rows: Array, fixed: list[Array], shown: list[Array]
) -> None:
    """Evaluate in compiled code; the carried values are changed in place."""
    failed = library.follow_rows(
        ctypes.c_longlong(len(rows)),
        pointers(carried),
        ctypes.c_void_p(rows.ctypes.data),
        pointers(fixed),
        pointers(shown),
    )
    if failed:
        raise MemoryError("There is no memory left to follow a log.")
