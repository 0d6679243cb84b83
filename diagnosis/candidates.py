"""The candidates of a diagnosis: the catalogue, a selection from it, or custom effects."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import TypeAlias

from plant.effects import Effect, catalogue
from plant.errors import BadParameter

Choice: TypeAlias = "str | type[Effect]"


def chosen(candidates: Sequence[Choice] | None, exclude: Collection[str]) -> Mapping[str, type[Effect]]:
    """The candidate effects, by name.

    Args:
        candidates: names from the catalogue or classes of effects, custom ones included; None is the whole catalogue.
        exclude: names to leave out.

    Raises:
        BadParameter: an unknown name, a class that is no effect, or no candidate left.
    """
    for word, given in (("candidates", candidates), ("exclude", exclude)):
        if isinstance(given, str):
            raise BadParameter(f"{word} is one text; give a list, as in [{given!r}].")
    candidate_kinds: dict[str, type[Effect]] = dict(catalogue) if candidates is None else {}
    for choice in candidates or ():
        kind = catalogue.get(choice) if isinstance(choice, str) else choice
        if not (isinstance(kind, type) and issubclass(kind, Effect)):
            raise BadParameter(f"candidates: {choice!r} is no effect; the catalogue has {', '.join(catalogue)}.")
        candidate_kinds[kind.name] = kind
    unknown = sorted(set(exclude) - set(candidate_kinds) - set(catalogue))
    if unknown:
        raise BadParameter(f"exclude: {unknown[0]!r} is no effect; the catalogue has {', '.join(catalogue)}.")
    left = {name: kind for name, kind in candidate_kinds.items() if name not in exclude}
    if not left:
        raise BadParameter("No effect is left to test: give at least one candidate, or exclude fewer.")
    return left
