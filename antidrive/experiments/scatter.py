"""Repetition of an experiment with other noise: numbers that differ between runs get their standard deviation."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from antidrive.experiments.outcome import Outcome
from diagnosis.explanation.wording import measured

_NUMBER = re.compile(r"(?<![\w.^])[-+]?\d+(?:\.\d+)?(?:e[-+]\d+)?(?![\w.]*\d)")
_PLUS_MINUS = re.compile(r"\s*(?:\+-|±)\s*")


def with_scatter(runs: Sequence[Outcome]) -> Outcome:
    """The first of several runs of one experiment; numbers in its text that differ between runs get a ± value."""
    first = runs[0]
    if len(runs) < 2:
        return first
    sentences = [_scattered(lines) for lines in zip(*(run.results for run in runs), strict=True)]
    cells = zip(*([found for *_, found in run.comparison] for run in runs), strict=True)
    rows = [(name, paper, _scattered(each)) for (name, paper, _), each in zip(first.comparison, cells, strict=True)]
    if [*sentences, *(cell for *_, cell in rows)] != [*first.results, *(cell for *_, cell in first.comparison)]:
        sentences.append(
            f"± is the standard deviation over {len(runs)} runs with other noise; numbers without it are the same "
            "in all runs."
        )
    return replace(first, results=sentences, comparison=rows)


def _scattered(texts: Sequence[str]) -> str:
    """The first of several texts that differ only in numbers, with a ± value after each number that differs.

    A number that already has a ± value keeps it; texts that differ otherwise are returned as the first one.
    """
    first = texts[0]
    if len({_NUMBER.sub("", text) for text in texts}) > 1:
        return first
    parts, place = [], 0
    for found, *others in zip(*(_NUMBER.finditer(text) for text in texts), strict=True):
        values = [float(match[0]) for match in (found, *others)]
        error = _PLUS_MINUS.match(first, found.end()) or re.search(rf"{_PLUS_MINUS.pattern}$", first[: found.start()])
        parts += [first[place : found.start()], found[0] if error else _with_scatter(found[0], values)]
        place = found.end()
    return "".join([*parts, first[place:]])


def _with_scatter(text: str, values: Sequence[float]) -> str:
    std = float(np.std(values, ddof=1))
    return f"{'+' if text.startswith('+') else ''}{measured(values[0], std)}" if std > 0.0 else text
