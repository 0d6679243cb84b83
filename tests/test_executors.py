"""Any executor gives what one after the other gives, to the last bit, also when a worker is killed half-way."""

from __future__ import annotations

import math
import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial

import numpy as np
import pytest
from distributed import Client
from raised_load import BY_FLANK, RIG, swing

from mpc import MonteCarlo, monte_carlo
from plant.executors import in_order

RUNS = 16
Kill = Callable[[], None]


@contextmanager
def processes() -> Iterator[tuple[Executor, Kill]]:
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:
        worker = pool.submit(os.getpid).result()
        yield pool, partial(os.kill, worker, signal.SIGKILL)


@contextmanager
def dask() -> Iterator[tuple[Executor, Kill]]:
    with Client(n_workers=2, threads_per_worker=1, dashboard_address=":0") as client:
        workers = list(client.run(os.getpid).values())
        assert len(set(workers)) == 2
        yield client.get_executor(), partial(os.kill, workers[0], signal.SIGKILL)


def run(
    executor: Executor | None = None, runs: int = RUNS, progress: Callable[[str], None] | None = None
) -> MonteCarlo:
    return monte_carlo(BY_FLANK, RIG, swing(20.0, 0.5), 0.5, runs=runs, seed=3, executor=executor, progress=progress)


@pytest.fixture(scope="module")
def alone() -> MonteCarlo:
    return run()


@pytest.mark.parametrize("workers", [processes, dask])
def test_a_killed_worker_costs_no_result_and_no_bit(workers: object, alone: MonteCarlo) -> None:
    lines: list[str] = []

    def tell(line: str) -> None:
        lines.append(line)
        if len(lines) == 1:
            kill()

    with workers() as (executor, kill):  # type: ignore[operator]
        few, found = run(executor, 4), run(executor, progress=tell)
        if workers is processes:
            with pytest.raises(BrokenExecutor):
                executor.submit(math.sqrt, 1.0).result()
    for name in ("factors", "tracking_rms", "minimum_contact_torque", "degraded", "copper_loss"):
        assert np.array_equal(getattr(few, name), getattr(alone, name)[:4]), name
        assert np.array_equal(getattr(found, name), getattr(alone, name)), name
    assert [line.split(":")[0] for line in lines] == [f"{n} of {RUNS}" for n in range(1, RUNS + 1)]


def test_an_executor_that_was_broken_before_costs_nothing_either() -> None:
    with processes() as (executor, kill):
        kill()
        assert isinstance(executor.submit(time.sleep, 60.0).exception(), BrokenExecutor)
        assert list(in_order(math.sqrt, [1.0, 4.0, 9.0], executor)) == [1.0, 2.0, 3.0]


def test_results_come_in_order_and_errors_in_their_turn() -> None:
    with ThreadPoolExecutor(2) as executor:
        for some in (None, executor):
            results = in_order(math.sqrt, [4.0, 9.0, -1.0, 16.0], some)
            assert [next(results), next(results)] == [2.0, 3.0]
            with pytest.raises(ValueError, match="math domain"):
                next(results)


class Idle(Executor):
    """Never begins."""

    def __init__(self) -> None:
        self.given: list[Future[float]] = []

    def submit(self, *args: object, **kwargs: object) -> Future[float]:  # type: ignore[override]
        self.given.append(Future())
        if len(self.given) == 1:
            self.given[0].set_result(7.0)
        return self.given[-1]


def test_what_nobody_waits_for_is_called_off() -> None:
    executor = Idle()
    results = in_order(math.sqrt, [1.0, 2.0, 3.0], executor)
    assert next(results) == 7.0
    results.close()
    assert [future.cancelled() for future in executor.given] == [False, True, True]
