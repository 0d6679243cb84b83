"""Suggestions for an unknown name: the end of an error message."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

_FEW = 8  # names in a short list
_SIMILARITY = 0.6  # least similarity of two names, by difflib, for a suggestion


def suggestion(wrong: str, names: Iterable[str]) -> str:
    """`did you mean cogging?`, or the known names: all of a few, the first of many."""
    known = list(names)
    plain = wrong.strip().lower().replace(" ", "_").replace("-", "_")
    similar = [plain] if plain in known else get_close_matches(plain, known, n=2, cutoff=_SIMILARITY)
    if similar:
        return f"did you mean {' or '.join(similar)}?"
    rest = f" and {len(known) - _FEW} more" if len(known) > _FEW + 1 else ""
    return f"there are {', '.join(known[:_FEW] if rest else known)}{rest}."
