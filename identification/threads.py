"""Work on several things at once, in threads: compiled loops and array operations do not hold one another up.

The threads of a BLAS do: they wait for one another by spinning, so two pools of them on one machine, ours or another
program's, take each other's time. Its matrices here are long and thin, on which they gain nothing.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import wraps
from typing import ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

Item = TypeVar("Item")
Result = TypeVar("Result")
Arguments = ParamSpec("Arguments")

_MOST = 4  # threads; each holds what it works on in memory


def in_threads(work: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """Results of the work on each item, in their order; with one processor one after the other."""
    todo = list(items)
    threads = min(len(todo), _MOST, _processors())
    if threads < 2:
        return [work(item) for item in todo]
    pool = ThreadPoolExecutor(threads)
    try:
        return list(pool.map(work, todo))
    except BaseException as error:
        # what has not begun is called off; who stops the program waits for nothing
        pool.shutdown(wait=isinstance(error, Exception), cancel_futures=True)
        raise
    finally:
        pool.shutdown(wait=False)


def _processors() -> int:
    """How many this process may use, which on a shared machine are fewer than there are."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def without_blas_threads(work: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """The work with one BLAS thread as long as it lasts."""

    @wraps(work)
    def alone(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        with threadpool_limits(limits=1, user_api="blas"):
            return work(*args, **kwargs)

    return alone
