"""Confusion matrix: one row per hidden effect, one column per answer."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

_NOTHING, _UNKNOWN = "nothing_missing", "unknown"


def leading(given: dict[str, Any]) -> str:
    """The most probable effect, also if the verdict is ambiguous; without an effect the verdict."""
    causes = given["causes"]
    return str(max(causes, key=lambda cause: cause["probability"])["effect"] if causes else given["verdict"])


def matrix(given: Sequence[dict[str, Any]], effects: Sequence[str]) -> str:
    """Counts of the truth against the most probable effect; the diagonal is correct, a dot is zero."""
    counts = Counter((t["truth"][0], leading(t)) for t in given)
    answers = [*effects, _UNKNOWN, _NOTHING, *sorted({answer for _, answer in counts} - {*effects, _UNKNOWN, _NOTHING})]
    heads = [*(str(place) for place in range(1, len(effects) + 1)), "unk", "-", *answers[len(effects) + 2 :]]
    lines = [
        "confusion matrix: rows the truth, columns the likeliest name (unk: unknown, -: nothing missing)",
        " " * 29 + "".join(f"{head:>4}" for head in heads),
    ]
    for place, truth in enumerate(effects, start=1):
        cells = "".join(f"{counts[truth, answer] or '.':>4}" for answer in answers)
        lines.append(f"{place:2} {truth:26}{cells}")
    return "\n".join(lines)
