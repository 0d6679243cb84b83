"""Parallel work in threads: compiled loops and array operations do not block one another.

BLAS threads do: they wait for one another in spin loops. So two of their pools on one machine slow each other down,
also if one belongs to another program. The matrices here are long and thin, so BLAS threads gain nothing.
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

_MOST = 4  # threads; each keeps its data in memory


def in_threads(work: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """Results of the work on each item, in the order of the items; on one processor one after the other."""
    todo = list(items)
    threads = min(len(todo), _MOST, _processors())
    if threads < 2:
        return [work(item) for item in todo]
    pool = ThreadPoolExecutor(threads)
    try:
        return list(pool.map(work, todo))
    except BaseException as error:
        # work that has not begun is cancelled; an interrupt of the program does not wait for running work
        pool.shutdown(wait=isinstance(error, Exception), cancel_futures=True)
        raise
    finally:
        pool.shutdown(wait=False)


def _processors() -> int:
    """Number of processors that this process may use; on a shared machine fewer than the machine has."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def without_blas_threads(work: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """The function `work`, run with a single BLAS thread."""

    @wraps(work)
    def alone(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        with threadpool_limits(limits=1, user_api="blas"):
            return work(*args, **kwargs)

    return alone
