"""Docstrings for the reference: fields that are told together, "angle, velocity: ...", become entries of their own."""

from __future__ import annotations

import re
from typing import Any

import griffe

_TOGETHER = re.compile(r"^( +)(\w+(?:, \w+)+):((?: .*)?(?:\n\1 +\S.*)*)", re.MULTILINE)


class Apart(griffe.Extension):
    """Write each such entry once a name."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Change the docstring of an object before it is parsed."""
        if obj.docstring:
            obj.docstring.value = _TOGETHER.sub(_apart, obj.docstring.value)


def _apart(found: re.Match[str]) -> str:
    return "\n".join(f"{found[1]}{name}:{found[3]}" for name in found[2].split(", "))
