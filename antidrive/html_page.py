"""One self-contained page from a template, which opens offline."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from antidrive.provenance import Provenance


def page(template: str, provenance: Provenance, title: str, **content: Mapping[str, Any] | Sequence[Any]) -> str:
    """The rendered template of that name."""
    return _environment().get_template(f"{template}.html.j2").render(title=title, provenance=provenance, **content)


_UNIT = re.compile(r"(?<=\d) (?=(?:[µmk]?(?:rad|m|s|N|W|A|V|Hz|g)|arcmin)\b|%)|(?<=\bN) (?=m\b)")


def printed(text: str) -> Markup:
    """Plain text in print: superscripts, also of powers of ten, subscripts, arrows.

    A line never breaks between a number, its ± and its unit.
    """
    tens = re.sub(r"(?<=[\d)])e([+-]\d+)\b", lambda found: f" × 10^{int(found[1])}", str(escape(text)))
    raised = re.sub(r"(?<=\w)\^(-?\d+(?:\.\d+)?)", r"<sup>\1</sup>", tens)
    lowered = re.sub(r"\b([A-Za-z])_(\w)\b", r"\1<sub>\2</sub>", raised)
    joined = lowered.replace(" +- ", " ± ").replace(" ± ", "\N{NO-BREAK SPACE}±\N{NO-BREAK SPACE}")
    joined = _UNIT.sub("\N{NO-BREAK SPACE}", joined)
    return Markup(joined.replace(" -&gt; ", " \N{RIGHTWARDS ARROW} "))


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("antidrive"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["printed"] = printed
    return environment
