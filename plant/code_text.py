"""CasADi expressions as readable lines of code, in one of the languages of `plant.code_dialects`.

A value that is used once is written in place; a value that is used several times is assigned to a variable. Nothing is
reordered, so that the results equal those of CasADi as far as the functions of the language do.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import casadi as ca

from plant.code_dialects import Dialect
from plant.effects.effect import Parameter
from plant.effects.nonparametric_curve import Nonparametric
from plant.servo import ServoModel
from plant.symbolic import one_at_a_time

_BOOLEAN = {ca.OP_LT: "<", ca.OP_LE: "<=", ca.OP_EQ: "==", ca.OP_NE: "!=", ca.OP_AND: "&&", ca.OP_OR: "||"}
_INFIX = {ca.OP_ADD: ("+", 1), ca.OP_SUB: ("-", 1), ca.OP_MUL: ("*", 2), ca.OP_DIV: ("/", 2)}
_CALL = re.compile(r"\w+\(\{0\}(, \{1\})?\)")
_NAME = re.compile(r"\w+")
_ATOM = 4
"""Precedence of a text: 1 for a sum, 2 for a product, 3 for a sign, 4 for what never needs brackets."""


@dataclass(frozen=True, kw_only=True)
class Named:
    """A value that is used more than once: its name, its text, and whether it is a condition."""

    name: str
    text: str
    condition: bool


@dataclass(frozen=True, kw_only=True)
class Text:
    """Expressions as text in a language.

    Attributes:
        between: values that are used more than once, in order of use.
        results: text of each expression, by its name.
    """

    between: tuple[Named, ...]
    results: dict[str, str]


@dataclass(frozen=True, kw_only=True, eq=False)
class Symbolic:
    """The parameters of a model as symbols of a text; those of non-parametric effects stay numbers.

    Attributes:
        values: (P,) values, numbers or symbols, to bind the model to.
        symbols: those of the values that are symbols.
        parameters: for each symbol its name in the text, its `Parameter`, and its value.
    """

    values: list[Any]
    symbols: list[Any]
    parameters: list[tuple[str, Parameter, float]]

    @classmethod
    def of(cls, model: ServoModel) -> Symbolic:
        """Build it for a model."""
        nonparametric = {effect.name for effect in model.effects if isinstance(effect, Nonparametric)}
        found = cls(values=[], symbols=[], parameters=[])
        for spec, value in zip(model.parameters, model.values, strict=True):
            if spec.name.split(".")[0] in nonparametric:
                found.values.append(float(value))
                continue
            name = spec.name.replace(".", "_")
            found.values.append(ca.SX.sym(name))
            found.symbols.append(found.values[-1])
            found.parameters.append((name, spec, float(value)))
        return found


@one_at_a_time
def text_of(expressions: Mapping[str, Any], symbols: list[Any], dialect: Dialect) -> Text:
    """Text of scalar expressions of scalar symbols, with the symbols' names as variables.

    Raises:
        NotImplementedError: the language cannot express an operation.
    """
    outputs = [ca.densify(ca.vertcat(*expressions.values()))]
    function = ca.Function("text", [ca.vertcat(*symbols)], outputs, {"cse": True})
    names = [symbol.name() for symbol in symbols]
    nodes, used, results = _read(function, names)
    written = _Written(nodes=nodes, used=used, dialect=dialect)
    texts = [written.of(node)[0] for node in results]
    return Text(between=tuple(written.between), results=dict(zip(expressions, texts, strict=True)))


@dataclass(frozen=True, kw_only=True)
class _Node:
    operation: int
    parts: tuple[int, ...] = ()
    name: str = ""
    value: float = 0.0


def _read(function: Any, names: list[str]) -> tuple[list[_Node], list[int], list[int]]:
    """The instructions of a function as nodes, how often each is used, and which nodes are its results."""
    nodes: list[_Node] = []
    held: dict[int, int] = {}  # node at each place of the function's memory
    results: dict[int, int] = {}
    for k in range(function.n_instructions()):
        operation, into = function.instruction_id(k), function.instruction_output(k)
        parts = function.instruction_input(k)
        if operation == ca.OP_OUTPUT:
            results[into[1]] = held[parts[0]]
            continue
        if operation == ca.OP_INPUT:
            nodes.append(_Node(operation=operation, name=names[parts[1]]))
        elif operation == ca.OP_CONST:
            nodes.append(_Node(operation=operation, value=function.instruction_constant(k)))
        else:
            nodes.append(_Node(operation=operation, parts=tuple(held[part] for part in parts)))
        held[into[0]] = len(nodes) - 1
    used = [0] * len(nodes)
    for node in nodes:
        for part in node.parts:
            used[part] += 1
    ordered = [results[place] for place in range(len(results))]
    for result in ordered:
        used[result] += 1
    return nodes, used, ordered


@dataclass(kw_only=True)
class _Written:
    """The text of the nodes, written one after another."""

    nodes: list[_Node]
    used: list[int]
    dialect: Dialect
    between: list[Named] = field(default_factory=list)
    known: dict[int, tuple[str, int, bool]] = field(default_factory=dict)

    def of(self, place: int) -> tuple[str, int, bool]:
        """Text of a node, its precedence, and whether it is a condition."""
        if place in self.known:
            return self.known[place]
        node = self.nodes[place]
        found = text, _, condition = self._written(node)
        if self.used[place] > 1 and node.operation not in (ca.OP_INPUT, ca.OP_CONST):
            return self._named(place, text, condition)
        self.known[place] = found
        return found

    def _named(self, place: int, text: str, condition: bool) -> tuple[str, int, bool]:
        name = f"w{len(self.between) + 1}"
        self.between.append(Named(name=name, text=text, condition=condition))
        self.known[place] = name, _ATOM, condition
        return self.known[place]

    def number(self, place: int, least: int = 0) -> str:
        """A node as a number, in brackets if its precedence is below `least`."""
        text, tight, condition = self.of(place)
        if condition:
            return self.dialect.as_number.format(text)
        return text if tight >= least else f"({text})"

    def condition(self, place: int) -> str:
        """A node as a condition."""
        text, _, condition = self.of(place)
        return text if condition else self.dialect.as_condition.format(self.number(place, 2))

    def _written(self, node: _Node) -> tuple[str, int, bool]:
        operation, parts, say = node.operation, node.parts, self.dialect
        if operation == ca.OP_INPUT:
            return node.name, _ATOM, False
        if operation == ca.OP_CONST:
            return say.number(node.value), _ATOM if node.value >= 0.0 else 3, False
        if operation == ca.OP_ADD and (choice := self._choice(*parts)):
            return choice, _ATOM, False
        if operation in _INFIX:
            sign, tight = _INFIX[operation]
            return f"{self.number(parts[0], tight)} {sign} {self.number(parts[1], tight + 1)}", tight, False
        if operation in (ca.OP_AND, ca.OP_OR):
            sign = say.infix[_BOOLEAN[operation]]
            return f"({self.condition(parts[0])} {sign} {self.condition(parts[1])})", _ATOM, True
        if operation in _BOOLEAN:
            sign = say.infix[_BOOLEAN[operation]]
            return f"({self.number(parts[0], 1)} {sign} {self.number(parts[1], 1)})", _ATOM, True
        if operation == ca.OP_NOT:
            return say.negated.format(self.condition(parts[0])), _ATOM, True
        if operation == ca.OP_IF_ELSE_ZERO:
            return say.choose.format(self.condition(parts[0]), self.number(parts[1]), say.number(0.0)), _ATOM, False
        if operation == ca.OP_NEG:
            return f"-{self.number(parts[0], 3)}", 3, False
        if operation not in say.functions:
            raise NotImplementedError(f"CasADi's operation {operation} cannot be written in this language.")
        template = say.functions[operation]
        least = 0 if _CALL.fullmatch(template) else _ATOM
        if template.count("{0}") > 1 and not _NAME.fullmatch(self.of(parts[0])[0]):
            self._named(parts[0], self.number(parts[0]), False)
        return template.format(*(self.number(part, least) for part in parts)), _ATOM, False

    def _choice(self, first: int, second: int) -> str:
        """Text of both halves of an `if_else`, which CasADi adds; empty if the two nodes are not such a pair."""
        here, there = self.nodes[first], self.nodes[second]
        if here.operation == there.operation == ca.OP_IF_ELSE_ZERO and max(self.used[first], self.used[second]) == 1:
            opposite = self.nodes[there.parts[0]]
            if opposite.operation == ca.OP_NOT and opposite.parts == here.parts[:1]:
                values = self.number(here.parts[1]), self.number(there.parts[1])
                return self.dialect.choose.format(self.condition(here.parts[0]), *values)
        return ""
