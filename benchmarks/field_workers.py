"""Work on many seeds in separate processes, each with a limit: hanging processes are ended, crashes are reported.

The limit is in seconds of processor time, so that other load on the machine has no influence. The system ends a process
at its limit; one that sleeps is ended after ten times as long in wall-clock time.
"""

from __future__ import annotations

import multiprocessing
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import Connection, wait
from typing import Any

Work = Callable[[int], dict[str, Any]]
_CONTEXT = multiprocessing.get_context("spawn")


class Worker:
    """A process that works on one seed after the other."""

    def __init__(self, work: Work, limit: float) -> None:
        self.limit = limit
        self.pipe, theirs = _CONTEXT.Pipe()
        self.process = _CONTEXT.Process(target=_serve, args=(theirs, work, limit), daemon=True)
        self.process.start()
        theirs.close()
        self.seed: int | None = None
        self.since = 0.0

    def begin(self, seed: int) -> None:
        self.seed, self.since = seed, time.monotonic()
        self.pipe.send(seed)

    def end(self) -> None:
        self.process.kill()
        self.process.join()
        self.pipe.close()


def _serve(pipe: Connection, work: Work, limit: float) -> None:
    while True:
        seed = pipe.recv()
        signal.setitimer(signal.ITIMER_PROF, limit)
        answer = work(seed)
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        pipe.send(answer)


def results(seeds: Sequence[int], work: Work, processes: int, limit: float) -> Iterator[tuple[int, dict[str, Any]]]:
    """Each seed with the result of `work`, as it comes.

    A seed that takes longer than `limit` [s of processor time], or whose process dies, gives {"failed": ...}, and a new
    process continues with the next seed.
    """
    left = list(reversed(seeds))
    workers = [Worker(work, limit) for _ in range(min(processes, len(left)))]
    try:
        for worker in workers:
            worker.begin(left.pop())
        while any(worker.seed is not None for worker in workers):
            busy = [worker for worker in workers if worker.seed is not None]
            ready = wait([worker.pipe for worker in busy], timeout=1.0)
            for place, worker in enumerate(workers):
                received = _received(worker, worker.pipe in ready)
                if worker.seed is None or received is None:
                    continue
                seed = worker.seed
                if "ended" in received:
                    worker.end()
                    workers[place] = worker = Worker(work, limit)
                worker.seed = None
                if left:
                    worker.begin(left.pop())
                yield seed, {key: value for key, value in received.items() if key != "ended"}
    finally:
        for worker in workers:
            worker.end()


def _received(worker: Worker, ready: bool) -> dict[str, Any] | None:
    """The result of a worker, if there is one."""
    if ready:
        try:
            answer: dict[str, Any] = worker.pipe.recv()
            return answer
        except EOFError:
            worker.process.join()
            late = worker.process.exitcode == -signal.SIGPROF
            return _ended(worker, "no end" if late else f"the process died ({worker.process.exitcode})")
    if worker.seed is not None and time.monotonic() - worker.since > 10.0 * worker.limit:
        return _ended(worker, "no end")
    return None


def _ended(worker: Worker, why: str) -> dict[str, Any]:
    return {"failed": why, "seconds": time.monotonic() - worker.since, "ended": True}
