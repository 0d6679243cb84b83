"""One self-contained page: a template filled in, with everything that it needs to open offline."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from antidrive.provenance import Provenance


def page(template: str, provenance: Provenance, title: str, **content: Mapping[str, Any] | Sequence[Any]) -> str:
    """The template of that name, filled in."""
    from plotly.offline import get_plotlyjs

    return (
        _environment()
        .get_template(f"{template}.html.j2")
        .render(title=title, provenance=provenance, plotly=Markup(get_plotlyjs()), **content)
    )


def figure_json(figure: Any) -> Markup:
    """A figure as JSON that is safe inside a script element."""
    return Markup(figure.to_json().replace("<", "\u003c"))


@cache
def _environment() -> Environment:
    return Environment(
        loader=PackageLoader("antidrive"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
