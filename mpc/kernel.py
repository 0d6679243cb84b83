"""A CasADi function on arrays of its own: called from Python in a microsecond instead of tens."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_UNROLLED = 200_000
"""Operations up to which a loop over stages is written out: the virtual machine then takes half the time."""


class Kernel:
    """A CasADi function that reads and writes the same arrays at every call.

    An array holds the nonzeros of an argument, one column after another. Several kernels may share an array: what one
    writes another reads, and nothing is copied.

    Attributes:
        inputs, outputs: flat arrays, in the function's order.
    """

    def __init__(self, function: Any, inputs: Mapping[int, Array] = {}, outputs: Mapping[int, Array] = {}) -> None:
        """Bind a function to the arrays that are given, by place, and to new ones elsewhere."""
        self._function = function  # the buffer does not keep it, nor the arrays
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
    """A kernel that reads arrays by their names and writes others, with what is between them as one list of operations.

    Args:
        name: of the function.
        arrays: by name.
        reads: which of them are arguments, with blanks between.
        build: their symbols, by name -> expressions, by the name of the array that each is written to. What is an
            argument too, or no array, has an output of its own.
        operations: about how many it takes; see `unrolled`.
        in_place: arguments that are written nevertheless, each place as soon as it has been read for the last time.
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
    """No operation is simplified, also across functions: that would round otherwise than C does."""
    simplifies = ca.GlobalOptions.getSimplificationOnTheFly()
    ca.GlobalOptions.setSimplificationOnTheFly(False)
    try:
        yield
    finally:
        ca.GlobalOptions.setSimplificationOnTheFly(simplifies)


def unrolled(loop: Any, stages: int, *functions: Any) -> Any:
    """A loop over stages that calls functions, written out as one list of operations unless that would be too long."""
    work = stages * sum(function.n_instructions() for function in functions)
    return loop.expand() if work <= _UNROLLED else loop


def along_the_way(function: Any, stages: int, memory: int) -> Any:
    """A function of a stage and of what the last one left, over many stages.

    Args:
        function: (what is new at a stage, ..., memory, ..., the same for all) -> memory.
        stages: how many there are.
        memory: place of what the last stage left.

    Returns:
        The function with the first argument stage by stage, and the memory behind each stage as its result.
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
