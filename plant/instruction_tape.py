"""A CasADi function as a list of its instructions, executed by a compiled loop that is the same for all functions.

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
from hashlib import sha256
from io import BytesIO
from typing import Any, Self, TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from plant.symbolic import one_at_a_time
from plant.tape_loops import LANES, known, loops

Array: TypeAlias = NDArray[np.float64]
Places: TypeAlias = NDArray[np.int32]


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
        results: places of the instructions' results.
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
    results: Places
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
            elif kind in known():
                operands.append((values[cells[0]], values[cells[-1]]))
                kinds.append(kind)
                values[flat.instruction_output(k)[0]] = unplaced
                unplaced -= 1
            else:
                return None
        order, groups, once = _ordered(kinds, operands, moving=sum(inputs[: carried + 1]))
        given, still = begins[-1] + len(constants), sum(count for _, count in groups[:once])
        places = given + np.arange(len(order), dtype=np.int32)
        if not carried:
            places = given + _reused([operands[k] for k in order], order, list(outputs.values()), still)
        place_of = np.empty(len(order), dtype=np.int32)
        place_of[order] = places

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
            results=places,
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
        arrays = (self.constants, self.kinds, self.counts, self.first, self.second, self.results, self.outputs)
        sizes = repr((self.inputs, self.carried, self.shown, self.once))
        return sha256(sizes.encode() + b"".join(values.tobytes() for values in arrays)).hexdigest()

    def follow(
        self, carried: list[Array], rows: Array, fixed: list[Array], shown: list[Array], dust: float = 0.0
    ) -> bool:
        """Execute for rows (T, width), with the carried values changed in place; False if there is no compiled loop.

        Carried values smaller than `dust` are set to zero.
        """
        library = loops()
        if library is None:
            return False
        handed, given = self.carried, np.concatenate((*fixed, self.constants))
        still = sum(self.inputs[: handed + 1])
        values = np.empty((int(self.results.max(initial=still + given.size - 1)) + 1, 1 if handed else LANES))
        values[still : still + given.size] = given[:, None]
        written = np.array([*self.shown, 0], dtype=np.int64)
        along = ctypes.c_longlong(len(rows)), ctypes.c_longlong(rows.shape[1]), _pointer(rows)
        seen = ctypes.c_longlong(len(self.shown)), _pointer(written), pointers(shown), _pointer(self.outputs)
        instructions = (
            *(ctypes.c_longlong(len(self.kinds)), _pointer(self.kinds), _pointer(self.counts)),
            *(_pointer(self.first), _pointer(self.second), _pointer(self.results), _pointer(values)),
            *(ctypes.c_longlong(self.once), ctypes.c_longlong(int(self.counts[: self.once].sum()))),
        )
        if not handed:
            return not library.map_tape(*along, *seen, *instructions)
        sizes = np.array([*self.inputs[:handed], 0], dtype=np.int64)
        before = ctypes.c_longlong(handed), _pointer(sizes), pointers(carried)
        failed = library.follow_tape(*along, *before, *seen, ctypes.c_double(dust), *instructions)
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


def _reused(operands: Sequence[tuple[int, int]], order: Sequence[int], outputs: Sequence[int], still: int) -> Places:
    """A cell for each result, which later results take over when it is not needed any more: so all stay in the cache.

    Args:
        operands: of each instruction in turn; below zero: results, -1 that of the first one in the code.
        order: place of each instruction in the code.
        outputs: values that are needed at the end.
        still: number of leading instructions whose results are needed in every row.
    """
    turn_of = {place: turn for turn, place in enumerate(order)}
    last = np.arange(len(order))
    for turn, both in enumerate(operands):
        for each in both:
            if each < 0:
                last[turn_of[-1 - each]] = turn
    last[:still] = len(order)
    last[[turn_of[-1 - each] for each in outputs if each < 0]] = len(order)
    ends: dict[int, list[int]] = defaultdict(list)
    cells, free, used = np.empty(len(order), dtype=np.int32), list[int](), 0
    for turn in range(len(order)):
        if not free:
            free.append(used)
            used += 1
        cells[turn] = free.pop()  # before its own operands are freed: none is overwritten while it is read
        ends[int(last[turn])].append(int(cells[turn]))
        free += ends.pop(turn, [])
    return cells


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


def _pointer(values: NDArray[Any]) -> ctypes.c_void_p:
    return ctypes.c_void_p(values.ctypes.data)


def pointers(arrays: Sequence[Array]) -> Any:
    """The data pointers of arrays, as C needs them."""
    return (ctypes.c_void_p * (len(arrays) + 1))(*(values.ctypes.data for values in arrays))
