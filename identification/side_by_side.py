"""Work on several things at once, in threads: compiled loops and array operations do not hold one another up."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

_MOST = 4  # threads; each holds what it works on in memory


def side_by_side(work: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """Results of the work on each item, in their order; with one processor one after the other."""
    todo = list(items)
    threads = min(len(todo), _MOST, os.cpu_count() or 1)
    if threads < 2:
        return [work(item) for item in todo]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(work, todo))
