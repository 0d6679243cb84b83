"""What to write in place of a name that does not exist: the end of a sentence that refuses it."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

_FEW = 8  # names that are read at a glance
_ALIKE = 0.6  # similarity of two names, as difflib counts it, from which one may stand for the other


def suggestion(wrong: str, names: Iterable[str]) -> str:
    """`did you mean cogging?`, or what there is: all of a few names, the first of many."""
    known = list(names)
    plain = wrong.strip().lower().replace(" ", "_").replace("-", "_")
    alike = [plain] if plain in known else get_close_matches(plain, known, n=2, cutoff=_ALIKE)
    if alike:
        return f"did you mean {' or '.join(alike)}?"
    rest = f" and {len(known) - _FEW} more" if len(known) > _FEW + 1 else ""
    return f"there are {', '.join(known[:_FEW] if rest else known)}{rest}."
