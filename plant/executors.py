"""Work on many items by any executor of `concurrent.futures`: results in order, none lost with a worker."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def in_order(
    work: Callable[[Item], Result], items: Sequence[Item], executor: Executor | None = None
) -> Generator[Result, None, None]:
    """The results of a function for each of the items.

    Args:
        work: the function; where the workers are processes it is pickled, with items and results.
        items: what it is called with.
        executor: a pool of threads or processes, a `dask.distributed.Client().get_executor()`, any other; None works
            on one after the other here. When a worker is killed, dask gives its items to another one; a pool of
            processes is broken by it, and what it has not finished is then done here.

    Yields:
        The results in the order of the items, each as soon as it and those before it are there. What has not begun is
        called off when nobody asks for more.

    Raises:
        What the function raises, in its item's turn.
    """
    if executor is None:
        yield from map(work, items)
        return
    waiting = [_given(executor, work, item) for item in items]
    try:
        for item, future in zip(items, waiting, strict=True):
            try:
                result = future.result()
            except BrokenExecutor:
                result = work(item)
            yield result
    finally:
        for future in waiting:
            future.cancel()


def _given(executor: Executor, work: Callable[[Item], Result], item: Item) -> Future[Result]:
    """The future of an item; of an executor that is broken already, one that says so."""
    try:
        return executor.submit(work, item)
    except BrokenExecutor as broken:
        future: Future[Result] = Future()
        future.set_exception(broken)
        return future
