"""The compiled step of the controller: the stages as C functions, and the loops that call them."""

from __future__ import annotations

import ctypes
import re
import time
from collections.abc import Mapping
from functools import partial
from importlib.resources import files
from string import Template
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from mpc.slots import c_names
from plant.machine_code import MachineCode

Array = NDArray[np.float64]

_MINIMUM = {  # same result as fmin and fmax of C (the other number if one is NaN), but without a library call
    "casadi_fmin": "static real casadi_fmin(real x, real y) { return x < y || y != y ? x : y; }",
    "casadi_fmax": "static real casadi_fmax(real x, real y) { return x > y || y != y ? x : y; }",
}


class CompiledStep:
    """The whole step as one call of machine code.

    Attributes:
        stages: the CasADi functions, by name.
        layout: the struct that the machine code works on.
        parts: see `parts`.
        source: the C source.
        code: the library, compiled in the background.
        compile_time: time spent waiting for the compiler [s]; zero if the library was cached, or there is no compiler.
    """

    def __init__(self, functions: tuple[Any, ...], sizes: Mapping[str, int], arrays: Mapping[str, Array]) -> None:
        """Start the compiler.

        Args:
            functions: the stages.
            sizes: integer parameters of the controller.
            arrays: all other data, shared with the machine code.
        """
        self.stages = {function.name(): function for function in functions}
        self._arrays = dict(arrays)  # keeps them alive: the machine code has only their addresses
        fields = [(name, ctypes.c_int) for name in sizes] + [(name, ctypes.c_void_p) for name in arrays]
        layout: Any = type("Layout", (ctypes.Structure,), {"_fields_": fields})
        self.layout = layout(*sizes.values(), *(array.ctypes.data for array in arrays.values()))
        self.parts = parts(functions)
        members = [*(f"  int {name};" for name in sizes), *(f"  real *{name};" for name in arrays)]
        self.source = Template(_text("library.c")).substitute(self.parts, members="\n".join(members))
        self.code, self.compile_time = MachineCode("controller", self.source), 0.0

    def function(self) -> Any:
        """The step (angle, whether the reference is previewed) -> `Trouble`, or None without a compiler."""
        begin, kept = time.perf_counter(), self.code.library is not None
        if not self.code.wait() or self.code.library is None:
            return None
        self.compile_time = 0.0 if kept else time.perf_counter() - begin
        step = ctypes.PYFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_double, ctypes.c_int)
        where = ctypes.c_void_p(ctypes.addressof(self.layout))
        return partial(step(("control_step", self.code.library)), where)


def parts(functions: tuple[Any, ...]) -> dict[str, str]:
    """Parts of the C code of a library or a target: the stages, the sizes of their arguments, the loops around them."""
    generator = ca.CodeGenerator("stages.c")
    for function in functions:
        generator.add(function)
    by_name = {function.name(): function for function in functions}
    places = {"STATES": ("stage", 0), "PARAMETERS": ("learn", 3), "KALMAN": ("estimate", 0)}
    places |= {"BARRIER": ("backward", 6), "LEARNT": ("learn", 1), "WATCHED": ("watch", 2)}
    counts = ", ".join(f"{name} = {by_name[stage].size1_in(i)}" for name, (stage, i) in places.items())
    return {
        "stages": _plain(str(generator.dump()), functions),
        "counts": f"enum {{ {counts} }};\n{c_names()}",
        "loops": "\n".join(map(_text, ("solve.c", "step.c"))),
    }


def _text(name: str) -> str:
    return (files("mpc") / name).read_text(encoding="utf-8")


def _plain(code: str, functions: tuple[Any, ...]) -> str:
    """CasADi's code without its interface: static functions with plain arguments, and the helpers that they call."""
    defined = r"^(?:static )?(casadi_real (casadi_\w+)\([^\n]*(?:\}\n|\{\n.*?^\}\n))"
    helpers = [(name, text) for text, name in re.findall(defined, code, re.M | re.S)]
    parts = []
    for function in functions:
        entry = re.search(rf"int {function.name()}\(.*?\{{\s*return (casadi_f\d+)\(", code, re.S)
        assert entry is not None
        body = re.search(rf"^static int {entry[1]}\(.*?\{{\n(.*?)  return 0;\n\}}\n", code, re.M | re.S)
        assert body is not None
        text = re.sub(r"arg\[(\d+)\]\? arg\[\1\]\[(\d+)\] : 0", r"i\1[\2]", body[1])
        text = re.sub(r"if \(res\[(\d+)\]!=0\) res\[\1\]\[(\d+)\]", r"o\1[\2]", text)
        text += "".join(f"  (void)i{place};\n" for place in range(function.n_in()) if f"i{place}[" not in text)
        arguments = [f"const real *i{place}" for place in range(function.n_in())]
        arguments += [f"real *restrict o{place}" for place in range(function.n_out())]
        signature = f"static void {function.name()}({', '.join(arguments)})"
        parts.append(f"{signature}\n{{\n{text.replace('casadi_real', 'real')}}}\n")
    for name, text in reversed(helpers):  # a helper calls only those before it
        if any(f"{name}(" in part for part in parts):
            parts.insert(0, _MINIMUM.get(name, "static " + text.replace("casadi_real", "real").rstrip()) + "\n")
    return "\n".join(parts) + "\n"
