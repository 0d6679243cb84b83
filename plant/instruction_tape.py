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
from dataclasses import dataclass
from hashlib import sha256
from io import BytesIO
from typing import Any, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from plant.instruction_listing import InstructionListing, Places
from plant.symbolic import one_at_a_time
from plant.tape_loops import LANES, known, loops, pointer, pointers

Array: TypeAlias = NDArray[np.float64]


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
        """Convert a function that is dense in all inputs and outputs.

        None without a compiled loop, or if that lacks one of the operations.
        """
        library = loops()
        if library is None:
            return None
        listing = InstructionListing.of(function, library)
        if not known().issuperset(listing.kinds.tolist()):
            return None
        inputs, given = listing.inputs, sum(listing.inputs) + len(listing.constants)
        first, second, results, of_group, counts = np.empty((5, listing.kinds.size), dtype=np.int32)
        outputs, sizes = listing.outputs.copy(), np.empty(2, dtype=np.int32)
        failed = library.arrange_tape(
            *(listing.kinds.size, *map(pointer, (listing.kinds, listing.first, listing.second))),
            *(given, sum(inputs[: carried + 1]), not carried, outputs.size),
            *map(pointer, (outputs, first, second, results, of_group, counts, sizes)),
        )
        if failed:
            raise MemoryError("There is no memory left to arrange a function.")
        groups, once = sizes.tolist()
        return cls(
            inputs=inputs,
            carried=carried,
            shown=listing.shown[carried:],
            constants=np.array(listing.constants),
            kinds=of_group[:groups].copy(),
            counts=counts[:groups].copy(),
            once=once,
            first=first.copy(),
            second=second.copy(),
            results=results.copy(),
            outputs=outputs,
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
        along = ctypes.c_longlong(len(rows)), ctypes.c_longlong(rows.shape[1]), pointer(rows)
        seen = ctypes.c_longlong(len(self.shown)), pointer(written), pointers(shown), pointer(self.outputs)
        instructions = (
            *(ctypes.c_longlong(len(self.kinds)), pointer(self.kinds), pointer(self.counts)),
            *(pointer(self.first), pointer(self.second), pointer(self.results), pointer(values)),
            *(ctypes.c_longlong(self.once), ctypes.c_longlong(int(self.counts[: self.once].sum()))),
        )
        if not handed:
            return not library.map_tape(*along, *seen, *instructions)
        sizes = np.array([*self.inputs[:handed], 0], dtype=np.int64)
        before = ctypes.c_longlong(handed), pointer(sizes), pointers(carried)
        failed = library.follow_tape(*along, *before, *seen, ctypes.c_double(dust), *instructions)
        return not failed


def _written(function: Any) -> int:
    """Number of instructions in the code of a function and of the functions that it calls."""
    called = [] if function.is_a("SXFunction") else function.find_functions()
    return sum(
        each.n_instructions() for each in (function, *called) if each.class_name() in ("SXFunction", "MXFunction")
    )
