"""A CasADi function on fixed arrays: a call from Python takes about a microsecond instead of tens."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_UNROLLED = 200_000
"""Greatest number of operations for which a loop over stages is unrolled, which halves its time."""


class Kernel:
    """A CasADi function that reads and writes the same arrays at every call.

    An array has the nonzeros of an argument, column by column. Several kernels may share an array: one writes it and
    another reads it, without a copy.

    Attributes:
        inputs, outputs: flat arrays, in the function's order.
    """

    def __init__(self, function: Any, inputs: Mapping[int, Array] = {}, outputs: Mapping[int, Array] = {}) -> None:
        """Bind a function to the given arrays, by position of the argument, and to new ones for the others."""
        self._function = function  # keeps it alive; the buffer keeps neither function nor arrays alive
        self._buffer, self._call = function.buffer()
        self.inputs = tuple(_array(function.nnz_in(i), inputs.get(i)) for i in range(function.n_in()))
        self.outputs = tuple(_array(function.nnz_out(i), outputs.get(i)) for i in range(function.n_out()))
        for place, array in enumerate(self.inputs):
            self._buffer.set_arg(place, array.data)
        for place, array in enumerate(self.outputs):
            self._buffer.set_res(place, array.data)

    def __call__(self) -> tuple[Array, ...]:
        """Evaluate; the outputs are overwritten by the next call."""
        self._call()
        return self.outputs


def _array(size: int, given: Array | None) -> Array:
    if given is None:
        return np.zeros(size)
    if given.size != size or given.dtype != np.float64 or not given.flags.c_contiguous:
        raise ValueError(f"A kernel needs a contiguous array of {size} numbers, not one of {given.size}.")
    return given.ravel()


def fused(
    name: str,
    arrays: Mapping[str, Array],
    reads: str,
    build: Callable[..., dict[str, Any]],
    *,
    operations: int,
    in_place: tuple[str, ...] = (),
) -> Kernel:
    """A kernel that reads and writes arrays by name, with all operations in one function.

    Args:
        name: of the function.
        arrays: by name.
        reads: names of the arrays that are arguments, separated by blanks.
        build: symbols of the arguments, by name -> expressions, by the name of the array that each is written to. A
            result that is also an argument, or is not among `arrays`, gets an array of its own.
        operations: approximate number of operations; see `unrolled`.
        in_place: arguments that are also written, each element after it has been read for the last time.
    """
    given = reads.split()
    symbols = {each: ca.MX.sym(each, arrays[each].size) for each in given}
    with _as_written():
        made = build(**symbols)
        function = ca.Function(name, list(symbols.values()), [ca.densify(expression) for expression in made.values()])
        function = function.expand() if operations <= _UNROLLED else function
    written = arrays.keys() - (set(given) - set(in_place))
    return Kernel(
        function,
        {place: arrays[each] for place, each in enumerate(given)},
        {place: arrays[each] for place, each in enumerate(made) if each in written},
    )


@contextmanager
def _as_written() -> Iterator[None]:
    """Switch off simplification, also across functions, because it would change the rounding relative to C."""
    simplifies = ca.GlobalOptions.getSimplificationOnTheFly()
    ca.GlobalOptions.setSimplificationOnTheFly(False)
    try:
        yield
    finally:
        ca.GlobalOptions.setSimplificationOnTheFly(simplifies)


def unrolled(loop: Any, stages: int, *functions: Any) -> Any:
    """A loop over stages that calls functions, unrolled into one list of operations unless that is too long."""
    work = stages * sum(function.n_instructions() for function in functions)
    return loop.expand() if work <= _UNROLLED else loop


def along_the_way(function: Any, stages: int, memory: int) -> Any:
    """A recursive function of a stage, applied to many stages.

    Args:
        function: (input of the stage, ..., memory, ..., common arguments) -> memory.
        stages: number of stages.
        memory: position of the memory among the arguments.

    Returns:
        The function with the inputs of all stages as its first argument; its result is the memory after each stage.
    """
    given = [ca.MX.sym(function.name_in(i), function.sparsity_in(i)) for i in range(function.n_in())]
    new = ca.MX.sym("new", function.size1_in(0), stages)
    found, left = [], given[memory]
    for k in range(stages):
        arguments = [new[:, k], *given[1:]]
        arguments[memory] = left
        left = function(*arguments)
        found.append(left)
    loop = ca.Function(f"{function.name()}_along", [new, *given[1:]], [ca.horzcat(*found)])
    return unrolled(loop, stages, function)
