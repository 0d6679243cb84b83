"""The gallery: each effect with its equation, parameters, figures and confused effects, all from the effect itself."""

from __future__ import annotations

import inspect
import re
import textwrap
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup, escape

from antidrive import figures
from antidrive.collinearity import absorbed_share, collinear_share
from antidrive.equations import forms, typeset
from antidrive.html_page import page
from antidrive.provenance import Provenance
from antidrive.signature import Signature, signature
from diagnosis.explanation.wording import joined_words, percent, sentence_case
from plant.effects import Effect, Parameter, Stage, catalogue
from plant.units import printed

_FLOWS = {"torque": "N m", "angle": "rad", "velocity": "rad/s", "time": "s"}


def gallery_page(
    provenance: Provenance,
    effects: Mapping[str, type[Effect]] = catalogue,
    progress: Callable[[str], None] | None = None,
) -> str:
    """The page of effects by name: the catalogue, or also custom effects; `progress` is called for each."""
    shown = []
    for number, kind in enumerate(effects.values()):
        if progress is not None:
            progress(f"drawing {kind.title}, {number} of {len(effects)} are done")
        shown.append(_entry(kind, effects))
    stages = [(stage.value, [entry for entry in shown if entry["stage"] == stage.value]) for stage in Stage]
    title = f"{len(shown)} effects that a servo's model may lack"
    return page("gallery", provenance, title, stages=[(stage, entries) for stage, entries in stages if entries])


def facts(kind: type[Effect]) -> dict[str, Any]:
    """The properties of an effect, in plain types."""
    return {
        "name": kind.name,
        "title": kind.title,
        "stage": kind.stage.value,
        "about": " ".join(paragraphs(kind)),
        "equation": kind.equation,
        "signature": kind.signature,
        "parameters": [
            {
                "name": spec.name,
                "meaning": spec.meaning,
                "unit": spec.unit_on(_axis(kind)),
                "lower": None if np.isinf(spec.lower) else spec.lower,
                "upper": None if np.isinf(spec.upper) else spec.upper,
            }
            for spec in kind.parameters()
        ],
        "axes": list(kind.axes),
        "confused_with": list(kind.confused_with),
        "contains": list(kind.contains),
    }


def table(effects: Mapping[str, type[Effect]] = catalogue) -> str:
    """Name, stage and signature of each effect, one per line."""
    rows = [(kind.name, kind.stage.value, kind.signature) for kind in effects.values()]
    wide = [max(len(row[place]) for row in rows) for place in (0, 1)]
    left = sum(wide) + 4
    lines = [f"{name:<{wide[0]}}  {stage:<{wide[1]}}  {has_signature}" for name, stage, has_signature in rows]
    return "\n".join(textwrap.fill(line, 80, subsequent_indent=" " * left) for line in lines)


def sheet(kind: type[Effect]) -> str:
    """One effect in plain text."""
    lines = [f"{sentence_case(kind.title)} ({kind.stage.value})", *paragraphs(kind), f"  equation: {kind.equation}"]
    for spec in kind.parameters():
        lines.append(f"  {spec.name} [{units(kind, spec)}], {bounds(spec)}: {spec.meaning}")
    lines.append(f"  shows as: {kind.signature}")
    for label, names in (("confused with", kind.confused_with), ("contains", kind.contains)):
        if names:
            lines.append(f"  {label}: {', '.join(names)}")
    return "\n".join(lines)


def paragraphs(kind: type[Effect]) -> list[str]:
    """Description of an effect, from its class's docstring."""
    return [" ".join(part.split()) for part in (inspect.getdoc(kind) or "").split("\n\n") if part.strip()]


def bounds(spec: Parameter) -> str:
    """The admissible values of a parameter, in words."""
    if not spec.fitted:
        return "stated at first"
    low, high = np.isfinite(spec.lower), np.isfinite(spec.upper)
    if low and high:
        return f"{spec.lower:g} to {spec.upper:g}"
    if low:
        return f"from {spec.lower:g}"
    return f"to {spec.upper:g}" if high else "any"


def _with_code(text: str) -> Markup:
    """The text with backticks as code."""
    return Markup(re.sub(r"`([^`]*)`", r"<code>\1</code>", str(escape(text))))


def units(kind: type[Effect], spec: Parameter) -> str:
    """The unit of a parameter, on either axis if they differ."""
    return joined_words(list(dict.fromkeys(printed(spec.unit_on(axis)) or "-" for axis in kind.axes)), "or")


def _axis(kind: type[Effect]) -> Any:
    return "rotary" if "rotary" in kind.axes else "linear"


def _entry(kind: type[Effect], effects: Mapping[str, type[Effect]]) -> dict[str, Any]:
    """Content of the template for an effect."""
    found = signature(kind)
    return {
        "name": kind.name,
        "title": sentence_case(kind.title),
        "stage": kind.stage.value,
        "equation": typeset(kind.equation),
        "about": [_with_code(part) for part in paragraphs(kind)],
        "signature": kind.signature,
        "parameters": [
            (spec.name.replace("_", " "), spec.meaning, units(kind, spec), bounds(spec)) for spec in kind.parameters()
        ],
        "forms": "" if found is None else forms(found.effect),
        "contains": [(name, effects[name].title) for name in kind.contains if name in effects],
        "confused": [_confounded(kind, effects[name]) for name in kind.confused_with if name in effects],
        "size": "" if found is None else _size(found),
        "absorbed": "" if found is None else percent(absorbed_share(found.effect, found.excitation)),
        "pictures": () if found is None else _pictures(found),
    }


def _confounded(kind: type[Effect], other: type[Effect]) -> dict[str, str]:
    share = collinear_share(kind, other)
    return {
        "name": other.name,
        "title": sentence_case(other.title),
        "signature": other.signature,
        "share": "" if share is None else percent(share),
    }


def _size(found: Signature) -> str:
    """The size at which an effect is drawn, and the kind of servo."""
    specs, axis = found.effect.parameters(), found.excitation.model.axis
    values = [
        f"{spec.name.replace('_', ' ')} {value:.3g} {printed(spec.unit_on(axis))}".rstrip()
        for spec, value in zip(specs, found.effect.values, strict=True)
    ]
    servo = "position servo" if found.excitation.servo_gain else "servo that is given a torque"
    return f"{joined_words(values)}, on a {servo}"


def _pictures(found: Signature) -> Sequence[tuple[Any, str]]:
    sensor = found.effect.stage is Stage.SENSOR
    lacking = "measurement error [rad]" if sensor else "residual torque [N m]"
    variable = found.variable
    what = "The measurement error" if sensor else "The torque that the model lacks without it"
    rms = float(np.sqrt(np.mean(found.change**2)))
    return (
        (
            figures.signature_figure(found, f"{variable} [{_FLOWS[variable]}]", lacking),
            f"{what}, over {variable}.",
        ),
        (
            figures.change_figure(found),
            f"The measurement without it and with it, and the difference: {rms:.2g} rad rms.",
        ),
    )
