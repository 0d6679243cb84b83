"""The instructions of a CasADi function, with the functions that it calls written out.

CasADi can write the calls out itself, but a function that is called at each integration step would then be read as
often, and reading an instruction takes as long as executing it thousands of times. Here each function is read once.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Self, TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from plant.tape_loops import pointer

Places: TypeAlias = NDArray[np.int32]
_READ = (ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST, ca.OP_CALL, ca.OP_GETNONZEROS, ca.OP_PROJECT)


@dataclass(frozen=True, kw_only=True, eq=False)
class InstructionListing:
    """Instructions on numbered values: all inputs, then the constants, then one result of each instruction.

    Attributes:
        inputs, shown: number of elements of each input and output.
        constants: operands of the instructions.
        kinds: (M,) CasADi's numbers of the operations.
        first, second: (M,) the operands of each.
        outputs: values of the elements of all outputs.
    """

    inputs: tuple[int, ...]
    shown: tuple[int, ...]
    constants: tuple[float, ...]
    kinds: Places
    first: Places
    second: Places
    outputs: Places

    @classmethod
    def of(cls, function: Any, library: ctypes.CDLL) -> Self:
        """List the instructions of a function that is dense in all inputs and outputs."""
        return cls._listed(function, library, {})

    @classmethod
    def _listed(cls, function: Any, library: ctypes.CDLL, known: dict[int, Self]) -> Self:
        key = function.__hash__()
        if key not in known:
            if function.is_a("SXFunction"):
                known[key] = cls._read(function, library)
            elif function.is_a("MXFunction") and {*_kinds(function)}.issubset(_READ):
                known[key] = cls._joined(function, library, known)
            else:
                known[key] = cls._read(function.expand(), library)
        return known[key]

    @classmethod
    def _read(cls, flat: Any, library: ctypes.CDLL) -> Self:
        """Read a function without calls."""
        inputs, shown = _sizes(flat)
        every, numbers = range(flat.n_instructions()), dict[str, int]()
        kinds = np.array(_kinds(flat), dtype=np.int32)
        # Cells of CasADi's memory; of inputs and outputs place and element; of constants a place after all inputs.
        entering, leaving = ([of(k) for k in every] for of in (flat.instruction_input, flat.instruction_output))
        for k in np.flatnonzero(kinds == ca.OP_CONST).tolist():
            value = flat.instruction_constant(k).hex()
            entering[k] = [len(inputs), numbers.setdefault(value, len(numbers))]
        cells = [np.array([(one[0], one[-1]) for one in of], dtype=np.int32) for of in (entering, leaving)]
        begins, ends = (np.cumsum([0, *sizes], dtype=np.int32) for sizes in (inputs, shown))
        own = np.empty((3, kinds.size), dtype=np.int32)
        outputs, memory = np.empty(sum(shown), dtype=np.int32), np.empty(max(flat.sz_w(), 1), dtype=np.int32)
        arrays = (*cells, begins, ends, memory, *own, outputs)
        written = library.list_instructions(
            kinds.size, sum(inputs) + len(numbers), pointer(kinds), *map(pointer, arrays)
        )
        kind, first, second = own[:, :written].copy()
        constants = tuple(map(float.fromhex, numbers))
        return cls(
            inputs=inputs, shown=shown, constants=constants, kinds=kind, first=first, second=second, outputs=outputs
        )

    @classmethod
    def _joined(cls, function: Any, library: ctypes.CDLL, known: dict[int, Self]) -> Self:
        """Join the listings of the functions that a function calls."""
        inputs, shown = _sizes(function)
        begins, ends = (np.cumsum([0, *sizes]).tolist() for sizes in (inputs, shown))
        constants, written = dict[str, int](), 0
        cells = dict[int, Any]()
        nothing: NDArray[Any] = np.empty(0, dtype=np.int64)
        parts, outputs = [(nothing, nothing, nothing)], np.empty(ends[-1], dtype=np.int64)

        def numbered(values: Iterable[float]) -> list[int]:  # below zero until all constants are known
            return [-1 - constants.setdefault(float(value).hex(), len(constants)) for value in values]

        for k, kind in enumerate(_kinds(function)):
            taken, given = function.instruction_input(k), function.instruction_output(k)
            node = function.instruction_MX(k)
            if kind == ca.OP_INPUT:
                cells[given[0]] = begins[taken[0]] + node.info()["offset"] + np.arange(node.nnz())
            elif kind == ca.OP_OUTPUT:
                values, begin = cells[taken[0]], ends[given[0]] + node.info()["offset"]
                outputs[begin : begin + len(values)] = values
            elif kind == ca.OP_CALL:
                called = cls._listed(node.which_function(), library, known)
                own = begins[-1] + written + np.arange(called.kinds.size)
                passed = zip(taken, called.inputs, strict=True)  # an argument that is left out is zero
                handed = [cells[each] if each >= 0 else numbered([0.0] * size) for each, size in passed]
                there = np.concatenate([*handed, numbered(called.constants), own]).astype(np.int64)
                parts.append((called.kinds, there[called.first], there[called.second]))
                written += called.kinds.size
                for place, values in zip(given, np.split(called.outputs, np.cumsum(called.shown)[:-1]), strict=True):
                    cells[place] = there[values]
            elif kind == ca.OP_CONST:
                cells[given[0]] = np.array(numbered(node.to_DM().nonzeros()), dtype=np.int64)
            else:
                cells[given[0]] = np.concatenate((cells[taken[0]], numbered([0.0])))[_taken(node, kind)]
        shift = begins[-1]

        def final(values: NDArray[Any]) -> Places:
            moved: NDArray[Any] = np.where(values < 0, shift - 1 - values, values + len(constants) * (values >= shift))
            return moved.astype(np.int32)

        kinds, first, second = (np.concatenate(each) for each in zip(*parts, strict=True))
        return cls(
            inputs=inputs,
            shown=shown,
            constants=tuple(map(float.fromhex, constants)),
            kinds=kinds.astype(np.int32),
            first=final(first),
            second=final(second),
            outputs=final(outputs),
        )


def _taken(node: Any, kind: int) -> NDArray[Any]:
    """Which elements of its operand a selection takes; -1 is a zero."""
    if kind == ca.OP_GETNONZEROS:
        return np.array(node.mapping().nonzeros(), dtype=np.int64)
    before = node.dep(0).sparsity()
    numbers = ca.DM(before, np.arange(1.0, before.nnz() + 1.0))
    return np.array(ca.project(numbers, node.sparsity()).nonzeros(), dtype=np.int64) - 1


def _kinds(function: Any) -> list[int]:
    return [function.instruction_id(k) for k in range(function.n_instructions())]


def _sizes(function: Any) -> tuple[tuple[int, ...], tuple[int, ...]]:
    return (
        tuple(function.nnz_in(place) for place in range(function.n_in())),
        tuple(function.nnz_out(place) for place in range(function.n_out())),
    )
