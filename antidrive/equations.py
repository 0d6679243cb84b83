"""Equations of a model typeset, and the kinks in the equations of an effect."""

from __future__ import annotations

import re
import unicodedata

import casadi as ca
from latex2mathml.converter import convert
from markupsafe import Markup

from diagnosis.explanation.wording import on_axis, sentence_case
from plant.effects import Effect, Moment
from plant.effects.parameter import parameters_of
from plant.servo import ServoModel

_KINKS = {
    ca.OP_FABS: "absolute value",
    ca.OP_FMIN: "minimum",
    ca.OP_FMAX: "maximum",
    ca.OP_SIGN: "sign",
    ca.OP_IF_ELSE_ZERO: "case",
    ca.OP_FLOOR: "step",
}
_ADDED = re.compile(r"(\\tau_[^la])\s*(?:=|\\in)")  # a torque on the load; tau_l: drivetrain, tau_a: lag
_GREEK = re.compile(r"\b(?:alpha|gamma|mu)\b")
_STEP = 0.01  # an integration step [s]; a number, so that no guard against a step of zero counts as a kink


def typeset(equation: str) -> Markup:
    """LaTeX as MathML, which browsers display directly."""
    try:
        printed = convert(equation, display="block")
    except Exception:  # the converter may not support it: then the source is shown
        return Markup("<code>{}</code>").format(equation)
    return Markup(printed.replace(' xmlns="http://www.w3.org/1998/Math/MathML"', ""))


def model_equations(model: ServoModel) -> list[tuple[str, Markup, str]]:
    """Title, typeset equation and meaning of the symbols for the rigid body (eq. 4) and each effect of a model."""
    rotary, loose = model.axis == "rotary", model.drivetrain is not None
    names = {effect.name for effect in model.effects}
    torque = r"\tau_a" if "actuator_lag" in names else r"\tau"
    torque = f"h({torque})" if "dead_zone" in names else torque
    added = dict.fromkeys(found[1] for e in model.effects if (found := _ADDED.search(e.equation)))
    resisted = (r" - \alpha\cos x" if rotary else "") + r" - K\dot x" + "".join(f" + {torque}" for torque in added)
    body = rf"J\ddot x = {torque}{resisted}"
    if loose:
        body = rf"(1 - s)\,J\ddot x = \tau_l{resisted}, \quad s\,J\ddot\theta = {torque} - \tau_l"
    own = [spec.meaning for spec in parameters_of(ServoModel) if rotary or spec.name != "gravity"]
    parts = [("Rigid body", body, own)]
    parts += [(sentence_case(e.title), e.equation, [spec.meaning for spec in e.parameters()]) for e in model.effects]
    return [
        (title, typeset(law), _GREEK.sub(_letter, on_axis(", ".join(meanings), model.axis)))
        for title, law, meanings in parts
    ]


def _letter(name: re.Match[str]) -> str:
    return unicodedata.lookup(f"GREEK SMALL LETTER {name[0].upper()}")


def kinks(effect: Effect) -> tuple[str, ...]:
    """Kinks in the equations of an effect, without those of its dry friction."""
    x, v, w, torque, state, time = (ca.SX.sym(name) for name in ("x", "v", "w", "torque", "state", "time"))
    symbols = [ca.SX.sym(spec.name) for spec in effect.parameters()]
    law = effect.bound(symbols)
    at = Moment(angle=x, velocity=v, torque=torque, time=time, travel=w, step=_STEP)
    parts = [
        law.advance(state, torque, _STEP),
        law.command(torque, state, v),
        law.coupling(x, v, 1.0),
        law.load_torque(at, state),
        law.added_inertia(at),
        law.slide(state, w),
        law.measurement(x, state),
        law.advance_sensor(state, x, v, w, _STEP),
    ]
    built = ca.Function("law", [x, v, w, torque, state, time, *symbols], [ca.vertcat(*parts)])
    used = {built.instruction_id(place) for place in range(built.n_instructions())}
    return tuple(name for operation, name in _KINKS.items() if operation in used)


def forms(effect: Effect) -> str:
    """The exact and the smooth form in sentences."""
    found = kinks(effect)
    if effect.dry_friction(Moment()) is not None:
        more = f" What else has a kink ({', '.join(found)}) is exact in the fit too." if found else ""
        return (
            "Exact form, used in simulation and for scores: at rest it holds up to its level, and a reversal is "
            "located within the step. Smooth form, from which a fit begins: it rises linearly with the velocity over a "
            f"width that is reduced to zero in steps.{more}"
        )
    if found:
        return f"Used as it stands in simulation and fit: its kinks ({', '.join(found)}) need no smooth form."
    return "Smooth as it stands: simulation and fit use the same form."
