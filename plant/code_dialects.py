"""How C99, Structured Text of IEC 61131-3, Python and Modelica write an expression."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

COMPARED = ("<", "<=", "==", "!=", "&&", "||")
"""Operators of C whose result is a condition."""


@dataclass(frozen=True, kw_only=True)
class Dialect:
    """The parts of an expression's syntax that differ between languages.

    Attributes:
        number: text of a constant.
        functions: by CasADi operation, a template with {0} and {1}, in brackets unless it is a function call.
        infix: the language's operator, by C's comparison or logical operator.
        choose: one value where a condition holds, and another elsewhere.
        as_number: 1 or 0 for a condition.
        as_condition: whether a number is not zero.
        negated: negation of a condition.
    """

    number: Callable[[float], str]
    functions: Mapping[int, str]
    infix: Mapping[str, str]
    choose: str
    as_number: str
    as_condition: str
    negated: str


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
        infix={sign: sign for sign in COMPARED},
        choose="({0} ? {1} : {2})",
        as_number=f"({{0}} ? 1.0{f} : 0.0{f})",
        as_condition=f"({{0}} != 0.0{f})",
        negated="(!{0})",
    )


def structured_text(single: bool) -> Dialect:
    """Structured Text of IEC 61131-3, with its standard functions only."""
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


def python() -> Dialect:
    """Python with its module `math`."""
    names = (
        "exp",
        "log",
        "sqrt",
        "sin",
        "cos",
        "tan",
        "asin",
        "acos",
        "atan",
        "sinh",
        "cosh",
        "tanh",
        "asinh",
        "floor",
    )
    plain = {getattr(ca, f"OP_{name.upper()}"): f"math.{name}({{0}})" for name in (*names, "ceil")}
    return Dialect(
        number=lambda value: repr(float(value)),
        functions={
            **plain,
            ca.OP_FABS: "abs({0})",
            ca.OP_FMIN: "min({0}, {1})",
            ca.OP_FMAX: "max({0}, {1})",
            ca.OP_POW: "math.pow({0}, {1})",
            ca.OP_CONSTPOW: "math.pow({0}, {1})",
            ca.OP_SQ: "({0} * {0})",
            ca.OP_TWICE: "(2.0 * {0})",
            ca.OP_INV: "(1.0 / {0})",
            ca.OP_SIGN: "sign({0})",
        },
        infix={"<": "<", "<=": "<=", "==": "==", "!=": "!=", "&&": "and", "||": "or"},
        choose="({1} if {0} else {2})",
        as_number="float({0})",
        as_condition="({0} != 0.0)",
        negated="(not {0})",
    )


def modelica() -> Dialect:
    """Modelica, with its built-in functions only."""
    names = ["exp", "log", "sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "floor", "ceil"]
    plain = {getattr(ca, f"OP_{name.upper()}"): f"{name}({{0}})" for name in names}
    return Dialect(
        number=lambda value: repr(float(value)),
        functions={
            **plain,
            ca.OP_FABS: "abs({0})",
            ca.OP_FMIN: "min({0}, {1})",
            ca.OP_FMAX: "max({0}, {1})",
            ca.OP_POW: "({0} ^ {1})",
            ca.OP_CONSTPOW: "({0} ^ {1})",
            ca.OP_SQ: "({0} ^ 2)",
            ca.OP_TWICE: "(2.0 * {0})",
            ca.OP_INV: "(1.0 / {0})",
            ca.OP_SIGN: "sign({0})",
            ca.OP_ASINH: "log({0} + sqrt({0} ^ 2 + 1.0))",
        },
        infix={"<": "<", "<=": "<=", "==": "==", "!=": "<>", "&&": "and", "||": "or"},
        choose="(if {0} then {1} else {2})",
        as_number="(if {0} then 1.0 else 0.0)",
        as_condition="({0} <> 0.0)",
        negated="(not {0})",
    )


def _decimal(value: float, single: bool) -> str:
    """A number with a decimal point and all of its digits."""
    text = str(np.float32(value)) if single else repr(float(value))
    mantissa, e, exponent = text.partition("e")
    mantissa = mantissa if "." in mantissa else f"{mantissa}.0"
    return f"{mantissa}E{int(exponent)}" if e else mantissa
