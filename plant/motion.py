"""Many machines simulated at once, by machine code on all cores, or one by one in CasADi's virtual machine.

Both give the same results to the last bit, for a machine alone or among others.
"""

from __future__ import annotations

import ctypes
import os
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from plant.flank import fine_steps
from plant.machine_code import MachineCode
from plant.symbolic import one_at_a_time

Array = NDArray[np.float64]

_SHARE = 16  # least number of machines per thread

_LOOP = """
#include <stdlib.h>
#include <string.h>
CASADI_SYMBOL_EXPORT int advance_machines(long long machines, long long blocks, double step, const double* command,
                                const double* disturbance, const double* parameters, double* state) {
  long long n_arg, n_res, n_iw, n_w, i, k;
  if (fine_steps_work(&n_arg, &n_res, &n_iw, &n_w)) return 1;
  const double** arg = malloc((n_arg + 1) * sizeof(double*));
  double** res = malloc((n_res + 1) * sizeof(double*));
  long long* iw = malloc((n_iw + 1) * sizeof(long long));
  double* w = malloc((n_w + %(states)d + 1) * sizeof(double));
  int failed = !arg || !res || !iw || !w;
  for (i = 0; i < machines && !failed; ++i) {
    for (k = 0; k < blocks && !failed; ++k) {
      arg[0] = state + i * %(states)d;
      arg[1] = command + i * %(drives)d;
      arg[2] = disturbance + i;
      arg[3] = &step;
      arg[4] = parameters + i * %(parameters)d;
      res[0] = w + n_w;
      failed = fine_steps(arg, res, iw, w, 0);
      memcpy(state + i * %(states)d, w + n_w, %(states)d * sizeof(double));
    }
  }
  free(arg); free(res); free(iw); free(w);
  return failed;
}
"""


class Motion:
    """Fine steps for machines with a given number of drives."""

    def __init__(self, drives: int) -> None:
        """Write the code and start the compiler, if there is one."""
        self._function = fine_steps(drives)
        generator = ca.CodeGenerator("fine_steps.c")
        generator.add(self._function)
        sizes = {
            "states": self._function.size1_in(0),
            "drives": drives,
            "parameters": self._function.size1_in(4),
        }
        self._code = MachineCode(f"rig-{drives}", str(generator.dump()) + _LOOP % sizes)

    def wait(self) -> bool:
        """Wait for the compiler; return whether there is machine code."""
        return self._code.wait()

    def advance(
        self, state: Array, command: Array, disturbance: Array, parameters: Array, blocks: int, step: float
    ) -> Array:
        """The states (B, S) after blocks of fine steps of a length [s].

        Output torques (B, drives) and load torques (B,) [N m] are held; parameters (B, P) are those of
        `plant.flank.fine_steps`.
        """
        library = self._code.library
        if library is None:
            function = _folded(self._function, blocks)
            rows = zip(state, command, disturbance, parameters, strict=True)
            ends = [function(z, drives, push, step, numbers) for z, drives, push, numbers in rows]
            return np.array([np.asarray(end, dtype=np.float64)[:, 0] for end in ends]).reshape(state.shape)
        end = np.array(state, dtype=np.float64, order="C")
        given = [np.ascontiguousarray(values, dtype=np.float64) for values in (command, disturbance, parameters)]
        parts = max(1, min(os.cpu_count() or 1, len(end) // _SHARE))
        edges = [len(end) * part // parts for part in range(parts + 1)]
        pieces = [slice(first, last) for first, last in pairwise(edges)]

        def move(piece: slice) -> int:
            pointers = [ctypes.c_void_p(values[piece].ctypes.data) for values in (*given, end)]
            count = ctypes.c_longlong(piece.stop - piece.start)
            return int(library.advance_machines(count, ctypes.c_longlong(blocks), ctypes.c_double(step), *pointers))

        if parts == 1:
            failed = move(pieces[0])
        else:
            with ThreadPoolExecutor(parts) as threads:  # other threads run while C does
                failed = max(threads.map(move, pieces))
        if failed:
            raise MemoryError("There is no memory left to move the rig.")
        return end


@lru_cache(maxsize=8)
def motion(drives: int) -> Motion:
    """The `Motion` for that number of drives, built once."""
    return Motion(drives)


@one_at_a_time
@lru_cache(maxsize=64)
def _folded(function: Any, blocks: int) -> Any:
    return function.fold(blocks) if blocks > 1 else function
