"""Run work on many items with any executor of `concurrent.futures`: results in order, even if a worker is lost."""

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
        work: the function; if the workers are processes it is pickled, with items and results.
        items: its arguments.
        executor: a pool of threads or processes, a `dask.distributed.Client().get_executor()`, or any other; None runs
            the items here, one after the other. If a worker is killed, dask passes its items to another one; a pool of
            processes breaks, and its unfinished items are then run here.

    Yields:
        The results in the order of the items, each as soon as it and those before it are ready. Pending items are
        cancelled when the generator is closed.

    Raises:
        Any exception of the function, in its item's turn.
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
    """The future of an item; of an executor that is already broken, one with that exception."""
    try:
        return executor.submit(work, item)
    except BrokenExecutor as broken:
        future: Future[Result] = Future()
        future.set_exception(broken)
        return future
