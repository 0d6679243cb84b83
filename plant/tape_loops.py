"""The compiled loops that execute the instructions of any function, row by row or for many rows at once.

They are compiled once for all functions. With results that are carried from row to row, the rows are executed one after
the other. Without, each instruction is executed for some rows together, which takes a fifth of the time: the processor
computes several at once, and looks up each instruction once for all of them.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import casadi as ca
from numpy.typing import NDArray

from plant.machine_code import MachineCode
from plant.tape_arrangement import ARRANGEMENT

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

_NO_OPERATION = ("INPUT", "CONST", "OUTPUT")

_LOOPS = """
#include <math.h>
#include <string.h>
#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT
#endif
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC optimize ("tree-vectorize", "vect-cost-model=dynamic")
#endif
#define LANES %d
%s
EXPORT int follow_tape(
    long long rows, long long width, const double* row, long long handed, const long long* size, double** carried,
    long long written, const long long* shown_size, double** shown, const int* outputs, double dust, long long groups,
    const int* kinds, const int* counts, const int* first, const int* second, const int* results, double* values,
    long long once, long long still) {
  long long i, j, k, g;
  for (k = 0; k < rows; ++k) {
    const long long begun = k ? still : 0;
    double *entry = values;
    const int* out = results + begun;
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

/* Each value stands LANES times; the last rows are completed with the last one. */
EXPORT int map_tape(
    long long rows, long long width, const double* row, long long written, const long long* shown_size, double** shown,
    const int* outputs, long long groups, const int* kinds, const int* counts, const int* first, const int* second,
    const int* results, double* values, long long once, long long still) {
  long long i, j, k, g, l;
  for (k = 0; k < rows; k += LANES) {
    const long long begun = k ? still : 0, filled = rows - k < LANES ? rows - k : LANES;
    const int *a = first + begun, *b = second + begun, *out = results + begun, *o = outputs;
    for (l = 0; l < LANES; ++l) {
      const double* one = row + (k + (l < filled ? l : filled - 1)) * width;
      for (j = 0; j < width; ++j) values[j * LANES + l] = one[j];
    }
    for (g = k ? once : 0; g < groups; a += counts[g], b += counts[g], out += counts[g], ++g) {
      const long long n = counts[g];
      switch (kinds[g]) {
%s
      default: return 1;
      }
    }
    for (i = 0; i < written; ++i)
      for (j = 0; j < shown_size[i]; ++j, ++o)
        for (l = 0; l < filled; ++l) shown[i][(k + l) * shown_size[i] + j] = values[*o * (long long) LANES + l];
  }
  return 0;
}
"""
LANES = 32
"""Rows that `map_tape` executes at once."""
_ONE_ROW = "for (i = 0; i < n; ++i) { const double x = values[a[i]]; %svalues[out[i]] = %s; }"
_SECOND = "const double y = values[b[i]]; "
_MANY_ROWS = """for (i = 0; i < n; ++i) {
          const double *xs = values + a[i] * (long long) LANES, *ys = values + b[i] * (long long) LANES;
          double* restrict to = values + out[i] * (long long) LANES;
          for (l = 0; l < LANES; ++l) { const double x = xs[l]; %sto[l] = %s; }
        }"""
_SECONDS = "const double y = ys[l]; "


@lru_cache(maxsize=1)
def known() -> frozenset[int]:
    """CasADi's numbers of the operations that the loops can execute."""
    return frozenset(getattr(ca, f"OP_{name}") for name in (*_OF_ONE, *_OF_TWO))


def loops() -> ctypes.CDLL | None:
    """The compiled loops; the first call on a machine waits for the compiler. None without a compiler."""
    code = _code()
    code.wait()
    return code.library


def pointer(values: NDArray[Any]) -> ctypes.c_void_p:
    """The data pointer of an array, as C needs it."""
    return ctypes.c_void_p(values.ctypes.data)


def pointers(arrays: Sequence[NDArray[Any]]) -> Any:
    """The data pointers of arrays, as C needs them."""
    return (ctypes.c_void_p * (len(arrays) + 1))(*(values.ctypes.data for values in arrays))


@lru_cache(maxsize=1)
def _code() -> MachineCode:
    names = "\n".join(f"#define IS_{name} {getattr(ca, f'OP_{name}')}" for name in _NO_OPERATION)
    arrangement = f"#define KINDS {max(known()) + 1}\n{names}\n{ARRANGEMENT}"
    loops = _LOOPS % (LANES, arrangement, _cases(_ONE_ROW, _SECOND), _cases(_MANY_ROWS, _SECONDS))
    return MachineCode("tape", loops)


def _cases(form: str, second: str) -> str:
    """The cases of a switch over the operations."""
    lines = [(name, form % ("", result)) for name, result in _OF_ONE.items()]
    lines += [(name, form % (second, result)) for name, result in _OF_TWO.items()]
    return "\n".join(f"      case {getattr(ca, f'OP_{name}')}: {line} break;" for name, line in lines)
