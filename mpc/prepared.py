"""A function with constant parameters over many calls; expressions of the parameters alone are computed once.

All samples of a horizon have the same inertia, friction and sample time. Subexpressions that depend only on these are
precomputed, and a division by one becomes a multiplication, in about a quarter of the time.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Prepared:
    """A function of prepared numbers, and the function that computes these.

    Attributes:
        function: the original function, but with prepared numbers (Q,) as its last argument.
        numbers: parameters (P,) -> prepared numbers (Q,).
    """

    function: Any
    numbers: Any

    def of(self, parameters: Array) -> Array:
        """(Q,) prepared numbers of the given parameters."""
        return np.asarray(self.numbers(parameters), dtype=np.float64).ravel()


@dataclass(eq=False)
class _Value:
    """An intermediate value of the function.

    Attributes:
        own: its expression, of arguments and prepared numbers, or of the parameters alone.
        constant: whether it is a constant.
        parametric: whether it depends on the parameters alone.
        places: symbols of the value (False) and of its inverse (True) among the prepared numbers, once created.
    """

    own: Any
    constant: bool = False
    parametric: bool = False
    places: dict[bool, Any] = field(default_factory=dict)


class _Telling:
    """Separates the operations of a function of scalars that depend only on its last argument."""

    def __init__(self, function: Any) -> None:
        self.given = [ca.SX.sym(f"i{place}", function.sparsity_in(place)) for place in range(function.n_in())]
        self.found = [ca.SX(function.sparsity_out(place)) for place in range(function.n_out())]
        self.symbols: list[Any] = []
        self.expressions: list[Any] = []
        self.work: dict[int, _Value] = {}
        for k in range(function.n_instructions()):
            self._go_on(function, k)

    def _go_on(self, function: Any, k: int) -> None:
        operation, sources, targets = (
            function.instruction_id(k),
            function.instruction_input(k),
            function.instruction_output(k),
        )
        if operation == ca.OP_OUTPUT:
            self.found[targets[0]].nz[targets[1]] = self._within(self.work[sources[0]])
        elif operation == ca.OP_INPUT:
            last = sources[0] == len(self.given) - 1
            self.work[targets[0]] = _Value(self.given[sources[0]].nz[sources[1]], parametric=last)
        elif operation == ca.OP_CONST:
            self.work[targets[0]] = _Value(ca.SX(function.instruction_constant(k)), constant=True)
        else:
            self.work[targets[0]] = self._made(operation, [self.work[source] for source in sources])

    def _made(self, operation: int, values: list[_Value]) -> _Value:
        alone = all(value.parametric or value.constant for value in values)
        if alone:
            own = [value.own for value in values]
            constant = all(value.constant for value in values)
            return _Value(_applied(operation, own), constant=constant, parametric=not constant)
        if operation == ca.OP_DIV and values[1].parametric:
            return _Value(self._within(values[0]) * self._number(values[1], inverse=True))
        return _Value(_applied(operation, [self._within(value) for value in values]))

    def _within(self, value: _Value) -> Any:
        """The value as an expression of arguments and prepared numbers."""
        return self._number(value) if value.parametric else value.own

    def _number(self, value: _Value, inverse: bool = False) -> Any:
        """The symbol of a value, or of its inverse, among the prepared numbers."""
        if inverse not in value.places:
            self.expressions.append(1 / value.own if inverse else value.own)
            self.symbols.append(ca.SX.sym("q"))
            value.places[inverse] = self.symbols[-1]
        return value.places[inverse]


@lru_cache(maxsize=64)
def prepared(function: Any) -> Prepared:
    """Separate the expressions of the last argument alone from a function of scalars."""
    telling = _Telling(function)
    *arguments, parameters = telling.given
    numbers = ca.cse(ca.vertcat(*telling.expressions))
    return Prepared(
        function=ca.Function(function.name(), [*arguments, ca.vertcat(*telling.symbols)], telling.found, {"cse": True}),
        numbers=ca.Function("prepared", [parameters], [numbers]),
    )


def _applied(operation: int, values: list[Any]) -> Any:
    return ca.SX.unary(operation, *values) if len(values) == 1 else ca.SX.binary(operation, *values)
