"""A CasADi function as a list of its instructions, executed by one compiled loop that is the same for all functions.

Compiling a function takes as long as executing the list for a hundred thousand rows; most functions of a search over
models are executed for fewer. So only the loop is compiled, once for all of them. Instructions of the same kind are
grouped, as far as their operands allow, and executed together: that saves two thirds of the time. Instructions that
depend neither on the row nor on the carried values are executed in the first row only. The results equal those of
machine code and of CasADi's virtual machine to the last bit: the operations are the same and their operands are
computed before them.
"""

from __future__ import annotations

import ctypes
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from hashlib import sha256
from io import BytesIO
from typing import Any, Self, TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from plant.machine_code import MachineCode
from plant.symbolic import one_at_a_time

Array: TypeAlias = NDArray[np.float64]
Places: TypeAlias = NDArray[np.int32]

_OF_ONE = {
    **{name: f"{name.lower()}(x)" for name in ("EXP", "LOG", "SQRT", "SIN", "COS", "TAN", "ASIN", "ACOS", "ATAN")},
    **{name: f"{name.lower()}(x)" for name in ("FLOOR", "CEIL", "FABS", "ERF", "SINH", "COSH", "TANH")},
    **{name: f"{name.lower()}(x)" for name in ("ASINH", "ACOSH", "ATANH", "LOG1P", "EXPM1")},
    **{"ASSIGN": "x", "NEG": "-x", "SQ": "x * x", "TWICE": "x + x", "INV": "1.0 / x", "NOT": "!x"},
    **{"SIGN": "x < 0.0 ? -1.0 : x > 0.0 ? 1.0 : x"},
}
_OF_TWO = {
    **{"ADD": "x + y", "SUB": "x - y", "MUL": "x * y", "DIV": "x / y", "POW": "pow(x, y)", "CONSTPOW": "pow(x, y)"},
    **{"LT": "x < y", "LE": "x <= y", "EQ": "x == y", "NE": "x != y", "AND": "x && y", "OR": "x || y"},
    **{"FMIN": "x < y || y != y ? x : y", "FMAX": "x > y || y != y ? x : y", "IF_ELSE_ZERO": "x != 0.0 ? y : 0.0"},
    **{name: f"{name.lower()}(x, y)" for name in ("FMOD", "REMAINDER", "COPYSIGN", "ATAN2", "HYPOT")},
}
"""C expressions of CasADi's operations, as in CasADi's own code."""

_LOOP = """
#include <math.h>
#include <string.h>
#ifdef _WIN32
__declspec(dllexport)
#endif
int follow_tape(long long rows, long long width, const double* row, long long handed, const long long* size,
                double** carried, long long written, const long long* shown_size, double** shown, const int* outputs,
                double dust, long long groups, const int* kinds, const int* counts, const int* first, const int* second,
                double* values, double* results, long long once, long long still) {
  long long i, j, k, g;
  for (k = 0; k < rows; ++k) {
    const long long begun = k ? still : 0;
    double *entry = values, *out = results + begun;
    const int *a = first + begun, *b = second + begun, *o = outputs;
    for (i = 0; i < handed; entry += size[i++]) memcpy(entry, carried[i], size[i] * sizeof(double));
    memcpy(entry, row + k * width, width * sizeof(double));
    for (g = k ? once : 0; g < groups; a += counts[g], b += counts[g], out += counts[g], ++g) {
      const long long n = counts[g];
      switch (kinds[g]) {
%s
      default: return 1;
      }
    }
    for (i = 0; i < handed; ++i)
      for (j = 0; j < size[i]; ++j, ++o) carried[i][j] = values[*o] * (fabs(values[*o]) >= dust);
    for (i = 0; i < written; ++i) for (j = 0; j < shown_size[i]; ++j) shown[i][k * shown_size[i] + j] = values[*o++];
  }
  return 0;
}
"""
_ONE = "      case %d: for (i = 0; i < n; ++i) { const double x = values[a[i]]; out[i] = %s; } break;"
_TWO = "      case %d: for (i = 0; i < n; ++i) { const double x = values[a[i]], y = values[b[i]]; out[i] = %s; } break;"


@dataclass(frozen=True, kw_only=True, eq=False)
class InstructionTape:
    """Instructions on numbered values: all inputs, then the constants, then one result of each instruction.

    Attributes:
        inputs: number of elements of each input: the carried ones, the row, then the constant inputs.
        carried: number of inputs that are carried to the next row.
        shown: number of elements of each other output.
        constants: operands of the instructions.
        kinds, counts: operation of each group of instructions, and the group's size.
        once: number of leading groups that give the same result in every row.
        first, second: places of each instruction's operands.
        outputs: places of the elements of all outputs.
        written: number of instructions in the function's code, where a function called several times counts once.
    """

    inputs: tuple[int, ...]
    carried: int
    shown: tuple[int, ...]
    constants: Array
    kinds: Places
    counts: Places
    once: int
    first: Places
    second: Places
    outputs: Places
    written: int

    @classmethod
    @one_at_a_time
    def of(cls, function: Any, carried: int) -> InstructionTape | None:
        """Convert a function that is dense in all inputs and outputs; None if the loop lacks one of its operations."""
        flat = function if function.is_a("SXFunction") else function.expand()
        inputs = [flat.nnz_in(place) for place in range(flat.n_in())]
        begins = np.concatenate(([0], np.cumsum(inputs))).tolist()
        constants: dict[str, int] = {}
        values: dict[int, int] = {}  # index of the value in each cell of CasADi's memory
        kinds, operands, outputs = list[int](), list[tuple[int, int]](), dict[tuple[int, int], int]()
        unplaced = -1  # results get their places after the instructions have been ordered
        for k in range(flat.n_instructions()):
            kind, cells = flat.instruction_id(k), flat.instruction_input(k)
            if kind == ca.OP_INPUT:
                values[flat.instruction_output(k)[0]] = begins[cells[0]] + cells[1]
            elif kind == ca.OP_CONST:
                constant = flat.instruction_constant(k)
                same = constants.setdefault(constant.hex(), len(constants))
                values[flat.instruction_output(k)[0]] = begins[-1] + same
            elif kind == ca.OP_OUTPUT:
                place, element = flat.instruction_output(k)
                outputs[place, element] = values[cells[0]]
            elif kind in _kinds():
                operands.append((values[cells[0]], values[cells[-1]]))
                kinds.append(kind)
                values[flat.instruction_output(k)[0]] = unplaced
                unplaced -= 1
            else:
                return None
        order, groups, once = _ordered(kinds, operands, moving=sum(inputs[: carried + 1]))
        results = begins[-1] + len(constants)
        place_of = np.empty(len(order), dtype=np.int32)
        place_of[order] = results + np.arange(len(order))

        def placed(those: Sequence[int]) -> Places:
            found = np.array(those, dtype=np.int32)
            return np.where(found < 0, place_of[np.maximum(-1 - found, 0)], found) if order else found

        shown = [flat.nnz_out(place) for place in range(flat.n_out())]
        return cls(
            inputs=tuple(inputs),
            carried=carried,
            shown=tuple(shown[carried:]),
            constants=np.array([float.fromhex(constant) for constant in constants]),
            kinds=np.array([kind for kind, _ in groups], dtype=np.int32),
            counts=np.array([count for _, count in groups], dtype=np.int32),
            once=once,
            first=placed([operands[k][0] for k in order]),
            second=placed([operands[k][1] for k in order]),
            outputs=placed([outputs[p, e] for p, size in enumerate(shown) for e in range(size)]),
            written=_written(function),
        )

    @classmethod
    def read(cls, content: bytes) -> Self:
        """Read what `content` has written."""
        with np.load(BytesIO(content)) as stored:
            sizes = {name: stored[name].tolist() for name in ("inputs", "carried", "shown", "once", "written")}
            arrays = {name: stored[name] for name in stored.files if name not in sizes}
        sizes |= {name: tuple(sizes[name]) for name in ("inputs", "shown")}
        return cls(**sizes, **arrays)

    @property
    def content(self) -> bytes:
        """All of it as the content of a file."""
        file = BytesIO()
        np.savez(file, **vars(self))
        return file.getvalue()

    @property
    def identifier(self) -> str:
        """Hash, equal for equal tapes only."""
        arrays = (self.constants, self.kinds, self.counts, self.first, self.second, self.outputs)
        sizes = repr((self.inputs, self.carried, self.shown, self.once))
        return sha256(sizes.encode() + b"".join(values.tobytes() for values in arrays)).hexdigest()

    def follow(
        self, carried: list[Array], rows: Array, fixed: list[Array], shown: list[Array], dust: float = 0.0
    ) -> bool:
        """Execute for rows (T, width), with the carried values changed in place; False if there is no loop.

        Carried values smaller than `dust` are set to zero.
        """
        library = _loop()
        if library is None:
            return False
        values = np.concatenate(
            (np.empty(sum(self.inputs[: self.carried + 1])), *fixed, self.constants, np.empty(len(self.first)))
        )
        results = values[values.size - len(self.first) :]
        sizes = np.array([*self.inputs[: self.carried], 0], dtype=np.int64)
        written = np.array([*self.shown, 0], dtype=np.int64)
        failed = library.follow_tape(
            *(ctypes.c_longlong(len(rows)), ctypes.c_longlong(rows.shape[1]), _pointer(rows)),
            *(ctypes.c_longlong(self.carried), _pointer(sizes), pointers(carried)),
            *(ctypes.c_longlong(len(self.shown)), _pointer(written), pointers(shown), _pointer(self.outputs)),
            *(ctypes.c_double(dust), ctypes.c_longlong(len(self.kinds)), _pointer(self.kinds), _pointer(self.counts)),
            *(_pointer(self.first), _pointer(self.second), _pointer(values), _pointer(results)),
            *(ctypes.c_longlong(self.once), ctypes.c_longlong(int(self.counts[: self.once].sum()))),
        )
        return not failed


def _written(function: Any) -> int:
    """Number of instructions in the code of a function and of the functions that it calls."""
    called = [] if function.is_a("SXFunction") else function.find_functions()
    return sum(
        each.n_instructions() for each in (function, *called) if each.class_name() in ("SXFunction", "MXFunction")
    )


def _ordered(
    kinds: Sequence[int], operands: Sequence[tuple[int, int]], moving: int
) -> tuple[list[int], list[tuple[int, int]], int]:
    """An order of the instructions, its groups of one kind, and how many leading groups do not depend on the row.

    Operands below zero are results: -1 that of the first instruction. Operands below `moving` differ by row.
    """
    moves = list[bool]()
    for both in operands:
        moves.append(any(moves[-1 - each] if each < 0 else each < moving for each in both))
    order, groups, once = list[int](), list[tuple[int, int]](), 0
    for moved in (False, True):
        once = len(groups)
        members, more = _grouped([k for k, each in enumerate(moves) if each is moved], kinds, operands)
        order += members
        groups += more
    return order, groups, once


def _grouped(
    members: Sequence[int], kinds: Sequence[int], operands: Sequence[tuple[int, int]]
) -> tuple[list[int], list[tuple[int, int]]]:
    """Order some of the instructions so that operands come first, in groups of one kind.

    The kind with most ready instructions is always next.
    """
    users: dict[int, list[int]] = {k: [] for k in members}
    missing = dict.fromkeys(members, 0)
    ready: dict[int, list[int]] = defaultdict(list)
    for k in members:
        needed = {-1 - each for each in operands[k] if each < 0 and -1 - each in users}
        missing[k] = len(needed)
        for each in needed:
            users[each].append(k)
        if not needed:
            ready[kinds[k]].append(k)
    order, groups = list[int](), list[tuple[int, int]]()
    while len(order) < len(members):
        kind = max(ready, key=lambda each: len(ready[each]))
        group, begun = ready[kind], len(order)
        for k in group:  # grows while instructions become ready
            order.append(k)
            for user in users[k]:
                missing[user] -= 1
                if not missing[user]:
                    ready[kinds[user]].append(user)
        ready[kind] = []
        groups.append((kind, len(order) - begun))
    return order, groups


@lru_cache(maxsize=1)
def _kinds() -> dict[int, str]:
    """C code of each operation by its number in CasADi."""
    one = {getattr(ca, f"OP_{name}"): _ONE % (getattr(ca, f"OP_{name}"), code) for name, code in _OF_ONE.items()}
    two = {getattr(ca, f"OP_{name}"): _TWO % (getattr(ca, f"OP_{name}"), code) for name, code in _OF_TWO.items()}
    return one | two


@lru_cache(maxsize=1)
def _code() -> MachineCode:
    return MachineCode("tape", _LOOP % "\n".join(_kinds().values()))


def _loop() -> ctypes.CDLL | None:
    """The compiled loop; the first call on a machine waits for the compiler. None without a compiler."""
    code = _code()
    code.wait()
    return code.library


def _pointer(values: NDArray[Any]) -> ctypes.c_void_p:
    return ctypes.c_void_p(values.ctypes.data)


def pointers(arrays: Sequence[Array]) -> Any:
    """The data pointers of arrays, as C needs them."""
    return (ctypes.c_void_p * (len(arrays) + 1))(*(values.ctypes.data for values in arrays))
