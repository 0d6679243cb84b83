"""The inverse model as code for a drive: C99, and a function block in Structured Text of IEC 61131-3."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca

from plant.code_dialects import Dialect, c99, structured_text
from plant.code_text import Symbolic, Text, text_of
from plant.drive_table import harmonics
from plant.effects.parameter import Parameter
from plant.errors import BadParameter
from plant.inverse import (
    InverseEquations,
    inverse_equations,
    moving,
    strength,
    time_lead,
    torque_unit,
    unmodelled_effects,
)
from plant.servo import ServoModel
from plant.symbolic import one_at_a_time
from plant.units import printed

_ROUNDING = 2e-7  # relative error of a product of two numbers in single precision, each of them rounded
_NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")


def _comment(spec: Parameter) -> str:
    """Unit and meaning of a parameter, for a code comment."""
    return ": ".join(filter(None, (printed(spec.unit), spec.meaning)))


@dataclass(frozen=True, kw_only=True)
class Feedforward:
    """The feed-forward of a model as code.

    Attributes:
        files: content of each file, by name.
        shares: names of the torque's components in the code.
        unit: of the torque.
        lead: how far ahead the set-points should lie [s].
        left_out: what is not compensated, a sentence each.
        single: whether it calculates in single precision.
    """

    files: Mapping[str, str]
    shares: tuple[str, ...]
    unit: str
    lead: float
    left_out: tuple[str, ...]
    single: bool

    def sentences(self) -> list[str]:
        """A description in sentences."""
        precision = "single" if self.single else "double"
        return [f"Feedforward [{self.unit}] in {precision} precision: {', '.join(self.shares)}.", *self.left_out]

    def summary(self) -> dict[str, Any]:
        """The description as a dictionary, for scripts."""
        return {
            "schema": 1,
            "files": list(self.files),
            "precision": "single" if self.single else "double",
            "unit": self.unit,
            "shares": list(self.shares),
            "lead": self.lead,
            "left_out": list(self.left_out),
        }


def feedforward_code(model: ServoModel, *, single: bool = False, name: str = "antidrive") -> Feedforward:
    """The inverse of a model as C99 and as Structured Text: set-points in, torque and its components out.

    Args:
        model: the servo.
        single: numbers of 4 bytes instead of 8.
        name: of the axis, prefix of files and functions: small letters, digits and single underscores.

    Raises:
        BadParameter: a name that is no identifier in both languages.
    """
    if not _NAME.fullmatch(name):
        raise BadParameter(f"name {name!r}: write small letters, digits and single underscores, such as elbow_2.")
    code = _Code.of(model, single, name)
    files = {
        f"{name}_feedforward.h": code.header(),
        f"{name}_feedforward.c": code.source(),
        f"{name}_feedforward.st": code.block(),
    }
    return Feedforward(
        files=files,
        shares=tuple(code.equations.shares),
        unit=torque_unit(model),
        lead=time_lead(model),
        left_out=tuple(unmodelled_effects(model)),
        single=single,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Code:
    """Common source of both languages."""

    model: ServoModel
    name: str
    single: bool
    equations: InverseEquations
    symbols: list[Any]
    parameters: list[tuple[str, Parameter, float]]
    notes: list[str]

    @classmethod
    @one_at_a_time
    def of(cls, original: ServoModel, single: bool, name: str) -> _Code:
        """Physical parameters stay symbols, readable and adjustable in the code; knots of a curve are numbers."""
        model = original.without_clock()
        own = Symbolic.of(model)
        equations = inverse_equations(model.bound(own.values))
        needed = ca.vertcat(*equations.shares.values(), *equations.after)
        used = [ca.depends_on(needed, symbol) for symbol in own.symbols]
        return cls(
            model=model,
            name=name,
            single=single,
            equations=equations,
            symbols=own.symbols,
            parameters=[entry for entry, is_used in zip(own.parameters, used, strict=True) if is_used],
            notes=unmodelled_effects(original),
        )

    def text(self, dialect: Dialect) -> Text:
        """Text of the components, and of the memory after the sample, in a language."""
        found = self.equations
        expressions = dict(found.shares)
        if found.remembered:
            expressions |= {f"after {name}": e for name, e in zip(found.remembered, found.after, strict=True)}
        return text_of(expressions, [*found.motion, *found.memory, *self.symbols], dialect)

    @property
    def units(self) -> dict[str, str]:
        """Units of the motion."""
        return moving(self.model)

    @property
    def what(self) -> str:
        """Torque, or force."""
        return strength(self.model)

    def description(self) -> list[str]:
        """Header lines of each file."""
        moving = ", ".join(f"{name} [{unit}]" for name, unit in self.units.items())
        unit, lines = torque_unit(self.model), []
        lines.append(f"Feedforward of a servo: the {self.what} [{unit}] that a motion of the load takes.")
        lines.append(f"In: {moving}.")
        lines.append("Give the set-point's values, not measured ones: friction follows the sign of the velocity.")
        if self.equations.remembered:
            lines.append("Presliding follows the travel of the load: call it once in every sample.")
        return lines + self.notes + self.rounding()

    def rounding(self) -> list[str]:
        """How fast a periodic effect loses digits in single precision, a sentence."""
        orders = {e.title: max((wave[0] for wave in harmonics(e)), default=0.0) for e in self.model.effects}
        title = max(orders, key=lambda name: orders[name], default="")
        if not (self.single and title and orders[title] > 0.0):
            return []
        place, unit = next(iter(self.units.items()))
        return [
            f"Single precision rounds the phase of the {title}, by up to {_ROUNDING * orders[title]:.1g} rad for each "
            f"{unit} of the {place} from zero."
        ]

    def header(self) -> str:
        """The C header."""
        name, unit, real = self.name, torque_unit(self.model), f"{self.name}_real"
        guard, place = f"{name}_FEEDFORWARD_H".upper(), next(iter(self.units))
        shares = [f"    {real} {share}; /* {unit} */" for share in self.equations.shares]
        begins = f": presliding starts unloaded at this {place}" if self.equations.remembered else ""
        memory = [f"    {real} {one}; /* remembered */" for one in self.equations.remembered]
        return "\n".join(
            [
                f"/* {name}_feedforward.h",
                *(f" * {line}" for line in self.description()),
                " */",
                f"#ifndef {guard}",
                f"#define {guard}",
                "",
                f"typedef {'float' if self.single else 'double'} {real};",
                f"#define {name.upper()}_LEAD {_seconds(time_lead(self.model))} /* s to give set-points ahead */",
                "",
                f"struct {name}_feedforward {{ /* shares of the {self.what}; the function returns their sum */",
                *shares,
                *memory,
                "};",
                "",
                f"/* Before the first call{begins}. */",
                f"void {name}_feedforward_init(struct {name}_feedforward *self, {real} {place});",
                "",
                f"/* The {self.what} [{unit}] for this set-point. */",
                f"{real} {name}_feedforward(struct {name}_feedforward *self,",
                f"    {self._arguments()});",
                "",
                "#endif",
                "",
            ]
        )

    def _arguments(self) -> str:
        return ", ".join(f"{self.name}_real {quantity}" for quantity in self.units)

    def source(self) -> str:
        """The C code."""
        name, real, text = self.name, f"{self.name}_real", self.text(c99(self.single))
        dialect, place = c99(self.single), next(iter(self.units))
        helpers = {
            "square(": f"static {real} square({real} x) {{ return x * x; }}",
            "sign(": f"static {real} sign({real} x) {{ return ({real})((x > 0) - (x < 0)); }}",
        }
        lines = [f"    const {'int' if w.condition else real} {w.name} = {w.text};" for w in text.between]
        for share in self.equations.shares:
            lines.append(f"    self->{share} = {text.results[share]};")
        lines += [f"    const {real} next_{one} = {text.results[f'after {one}']};" for one in self.equations.remembered]
        lines += [f"    self->{one} = next_{one};" for one in self.equations.remembered]
        total = " + ".join(f"self->{share}" for share in self.equations.shares)
        body = "\n".join(lines)  # stored values are members of the struct
        for one in self.equations.remembered:
            body = re.sub(rf"(?<![\w>]){one}\b", f"self->{one}", body)
        begun = [f"    self->{one} = {place if not k else 0};" for k, one in enumerate(self.equations.remembered)]
        return "\n".join(
            [
                f"/* {name}_feedforward.c: see the header. */",
                f'#include "{name}_feedforward.h"',
                "",
                "#include <math.h>",
                "",
                *(
                    f"static const {real} {own} = {dialect.number(value)}; /* {_comment(spec)} */"
                    for own, spec, value in self.parameters
                ),
                "",
                *(helper for call, helper in helpers.items() if re.search(rf"\b{re.escape(call)}", body)),
                "",
                f"void {name}_feedforward_init(struct {name}_feedforward *self, {real} {place}) {{",
                f"    *self = (struct {name}_feedforward){{0}};",
                *(begun or [f"    (void){place};"]),
                "}",
                "",
                f"{real} {name}_feedforward(struct {name}_feedforward *self,",
                f"    {self._arguments()}) {{",
                *(f"    (void){quantity};" for quantity in self.units if not re.search(rf"\b{quantity}\b", body)),
                body,
                f"    return {total};",
                "}",
                "",
            ]
        )

    def block(self) -> str:
        """The function block in Structured Text."""
        kind, dialect = "REAL" if self.single else "LREAL", structured_text(self.single)
        text, unit, place = self.text(dialect), torque_unit(self.model), next(iter(self.units))
        block = "FB_" + "".join(part.capitalize() for part in f"{self.name}_feedforward".split("_"))
        lines = [f"{w.name} := {w.text};" for w in text.between]
        lines += [f"share_{share} := {text.results[share]};" for share in self.equations.shares]
        if self.equations.remembered:  # all of them are calculated before the first is overwritten
            lines += [f"next_{one} := {text.results[f'after {one}']};" for one in self.equations.remembered]
            lines += [f"{one} := next_{one};" for one in self.equations.remembered]
        lines.append(f"{self.what} := {' + '.join(f'share_{share}' for share in self.equations.shares)};")
        first = [
            "IF NOT begun THEN",
            f"    {place}_before := {place};",
            "    begun := TRUE;",
            "END_IF;",
        ]
        memory = [line for one in self.equations.remembered for line in (f"{one} : {kind};", f"next_{one} : {kind};")]
        return "\n".join(
            [
                *(f"(* {line} *)" for line in self.description()),
                f"FUNCTION_BLOCK {block}",
                "VAR_INPUT",
                *(f"    {quantity} : {kind}; (* {unit_of} *)" for quantity, unit_of in self.units.items()),
                "END_VAR",
                "VAR_OUTPUT",
                f"    {self.what} : {kind}; (* {unit}: all shares together *)",
                *(f"    share_{share} : {kind}; (* {unit} *)" for share in self.equations.shares),
                "END_VAR",
                "VAR",
                *(
                    f"    {own} : {kind} := {dialect.number(value)}; (* {_comment(spec)} *)"
                    for own, spec, value in self.parameters
                ),
                *(f"    {line}" for line in (["begun : BOOL;", *memory] if memory else [])),
                *(f"    {w.name} : {'BOOL' if w.condition else kind};" for w in text.between),
                "END_VAR",
                *(first if memory else []),
                *lines,
                "END_FUNCTION_BLOCK",
                "",
            ]
        )


def _seconds(time: float) -> str:
    return repr(round(time, 9))
