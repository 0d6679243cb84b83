"""CasADi expressions as lines of code that people read: C99, or Structured Text of IEC 61131-3.

What is used once stands where it is used; what is used more often gets a name. Nothing is reordered, so that the
numbers are those of CasADi as far as the functions of the other language are.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

_BOOLEAN = {ca.OP_LT: "<", ca.OP_LE: "<=", ca.OP_EQ: "==", ca.OP_NE: "!=", ca.OP_AND: "&&", ca.OP_OR: "||"}
_INFIX = {ca.OP_ADD: ("+", 1), ca.OP_SUB: ("-", 1), ca.OP_MUL: ("*", 2), ca.OP_DIV: ("/", 2)}
_CALL = re.compile(r"\w+\(\{0\}(, \{1\})?\)")
_NAME = re.compile(r"\w+")
_ATOM = 4
"""How tightly the parts of a text hold together: 1 for a sum, 2 for a product, 3 for a sign, 4 for what needs none."""


@dataclass(frozen=True, kw_only=True)
class Dialect:
    """How a language writes what is not the same in both.

    Attributes:
        number: a constant.
        functions: by CasADi operation, a template with {0} and {1}, which have brackets in what is no call.
        infix: by C's sign of a comparison or a connective, the language's own.
        choose: one value where a condition holds, and another elsewhere.
        as_number: 1 or 0 for a condition.
        as_condition: whether a number is not zero.
        negated: a condition that does not hold.
    """

    number: Callable[[float], str]
    functions: Mapping[int, str]
    infix: Mapping[str, str]
    choose: str
    as_number: str
    as_condition: str
    negated: str


@dataclass(frozen=True, kw_only=True)
class Named:
    """A value that is used more than once: its name, what it is, and whether it is a condition."""

    name: str
    text: str
    condition: bool


@dataclass(frozen=True, kw_only=True)
class Text:
    """Expressions in a language.

    Attributes:
        between: values that are used more than once, in the order in which they are needed.
        results: the text of each expression by its name.
    """

    between: tuple[Named, ...]
    results: dict[str, str]


def text_of(expressions: Mapping[str, Any], symbols: list[Any], dialect: Dialect) -> Text:
    """Scalar expressions of scalar symbols, which are called by their own names.

    Raises:
        NotImplementedError: an operation that the language has no words for.
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
    """The instructions of a function as nodes, how often each is used, and which of them are its results."""
    nodes: list[_Node] = []
    held: dict[int, int] = {}  # what stands at each place of the function's memory
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
    """The nodes in words, one after another."""

    nodes: list[_Node]
    used: list[int]
    dialect: Dialect
    between: list[Named] = field(default_factory=list)
    known: dict[int, tuple[str, int, bool]] = field(default_factory=dict)

    def of(self, place: int) -> tuple[str, int, bool]:
        """Text of a node, how tightly it holds together, and whether it is a condition."""
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
        """A node as a number, in brackets where it holds together less than that."""
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
            raise NotImplementedError(f"CasADi's operation {operation} has no words in this language.")
        template = say.functions[operation]
        least = 0 if _CALL.fullmatch(template) else _ATOM
        if template.count("{0}") > 1 and not _NAME.fullmatch(self.of(parts[0])[0]):
            self._named(parts[0], self.number(parts[0]), False)
        return template.format(*(self.number(part, least) for part in parts)), _ATOM, False

    def _choice(self, first: int, second: int) -> str:
        """Both halves of an `if_else`, which CasADi adds up, as one; empty where they are something else."""
        here, there = self.nodes[first], self.nodes[second]
        if here.operation == there.operation == ca.OP_IF_ELSE_ZERO and max(self.used[first], self.used[second]) == 1:
            opposite = self.nodes[there.parts[0]]
            if opposite.operation == ca.OP_NOT and opposite.parts == here.parts[:1]:
                values = self.number(here.parts[1]), self.number(there.parts[1])
                return self.dialect.choose.format(self.condition(here.parts[0]), *values)
        return ""


def c99(single: bool) -> Dialect:
    """C99 in double or single precision."""
    f = "f" if single else ""
    plain = {
        ca.OP_EXP: "exp",
        ca.OP_LOG: "log",
        ca.OP_SQRT: "sqrt",
        ca.OP_SIN: "sin",
        ca.OP_COS: "cos",
        ca.OP_TAN: "tan",
        ca.OP_ASIN: "asin",
        ca.OP_ACOS: "acos",
        ca.OP_ATAN: "atan",
        ca.OP_SINH: "sinh",
        ca.OP_COSH: "cosh",
        ca.OP_TANH: "tanh",
        ca.OP_ASINH: "asinh",
        ca.OP_FABS: "fabs",
        ca.OP_FLOOR: "floor",
        ca.OP_CEIL: "ceil",
    }
    double = {ca.OP_FMIN: "fmin", ca.OP_FMAX: "fmax", ca.OP_POW: "pow", ca.OP_CONSTPOW: "pow", ca.OP_ATAN2: "atan2"}
    return Dialect(
        number=lambda value: f"{_decimal(value, single)}{f}",
        functions={
            **{operation: f"{name}{f}({{0}})" for operation, name in plain.items()},
            **{operation: f"{name}{f}({{0}}, {{1}})" for operation, name in double.items()},
            ca.OP_SQ: "square({0})",
            ca.OP_TWICE: f"(2.0{f} * {{0}})",
            ca.OP_INV: f"(1.0{f} / {{0}})",
            ca.OP_SIGN: "sign({0})",
        },
        infix={sign: sign for sign in _BOOLEAN.values()},
        choose="({0} ? {1} : {2})",
        as_number=f"({{0}} ? 1.0{f} : 0.0{f})",
        as_condition=f"({{0}} != 0.0{f})",
        negated="(!{0})",
    )


def structured_text(single: bool) -> Dialect:
    """Structured Text of IEC 61131-3, with no functions but its own."""
    plain = {
        ca.OP_EXP: "EXP",
        ca.OP_LOG: "LN",
        ca.OP_SQRT: "SQRT",
        ca.OP_SIN: "SIN",
        ca.OP_COS: "COS",
        ca.OP_TAN: "TAN",
        ca.OP_ASIN: "ASIN",
        ca.OP_ACOS: "ACOS",
        ca.OP_ATAN: "ATAN",
        ca.OP_FABS: "ABS",
    }
    double = {ca.OP_FMIN: "MIN", ca.OP_FMAX: "MAX", ca.OP_POW: "EXPT", ca.OP_CONSTPOW: "EXPT"}
    number = "REAL" if single else "LREAL"
    whole = f"DINT_TO_{number}(TRUNC({{0}}))"
    return Dialect(
        number=lambda value: _decimal(value, single),
        functions={
            **{operation: f"{name}({{0}})" for operation, name in plain.items()},
            **{operation: f"{name}({{0}}, {{1}})" for operation, name in double.items()},
            ca.OP_SQ: "({0} * {0})",
            ca.OP_TWICE: "(2.0 * {0})",
            ca.OP_INV: "(1.0 / {0})",
            ca.OP_SIGN: "(SEL({0} > 0.0, 0.0, 1.0) - SEL({0} < 0.0, 0.0, 1.0))",
            ca.OP_SINH: "(0.5 * (EXP({0}) - EXP(-{0})))",
            ca.OP_COSH: "(0.5 * (EXP({0}) + EXP(-{0})))",
            ca.OP_TANH: "(1.0 - 2.0 / (EXP(2.0 * {0}) + 1.0))",
            ca.OP_ASINH: "LN({0} + SQRT({0} * {0} + 1.0))",
            ca.OP_FLOOR: f"({whole} - SEL({{0}} < {whole}, 0.0, 1.0))",
        },
        infix={"<": "<", "<=": "<=", "==": "=", "!=": "<>", "&&": "AND", "||": "OR"},
        choose="SEL({0}, {2}, {1})",
        as_number="SEL({0}, 0.0, 1.0)",
        as_condition="({0} <> 0.0)",
        negated="(NOT {0})",
    )


def _decimal(value: float, single: bool) -> str:
    """A number with a decimal point, with as many digits as it has."""
    text = str(np.float32(value)) if single else repr(float(value))
    mantissa, e, exponent = text.partition("e")
    mantissa = mantissa if "." in mantissa else f"{mantissa}.0"
    return f"{mantissa}E{int(exponent)}" if e else mantissa
