"""Many logs: diagnoses on the workers of an executor, in the order of the logs."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import closing
from functools import partial

from diagnosis.candidates import Choice
from diagnosis.diagnose import diagnose
from diagnosis.diagnosis import Diagnosis
from identification.log_like import LogLike
from identification.prior_knowledge import Fixed, Pairs
from plant.executors import in_order
from plant.servo import ServoModel


def diagnose_all(
    logs: Iterable[LogLike],
    base: ServoModel | None = None,
    *,
    executor: Executor | None = None,
    fixed: Fixed = (),
    bounds: Pairs | None = None,
    prior: Pairs | None = None,
    candidates: Sequence[Choice] | None = None,
    exclude: Collection[str] = (),
    progress: Callable[[str], None] | None = None,
) -> Iterator[Diagnosis]:
    """Diagnose many logs independently.

    Args:
        logs: one log per diagnosis, as in `diagnose`.
        base, fixed, bounds, prior, candidates, exclude: as in `diagnose`, the same for all.
        executor: any executor of `concurrent.futures`, also a `dask.distributed.Client().get_executor()`; logs and
            diagnoses are pickled if its workers are processes. With None the logs are diagnosed one after the other in
            this process. If a worker is killed, no diagnosis is lost, see `plant.executors.in_order`.
        progress: called with a line of text for each diagnosis that is returned.

    Yields:
        The diagnoses in the order of the logs, each as soon as it and those before it are finished. If the iteration
        ends early, diagnoses that have not started are cancelled.

    Raises:
        AntidriveError: as from `diagnose`, when the result of that log is due.
    """
    listed = list(logs)
    work = partial(
        diagnose,
        base=base,
        fixed=fixed,
        bounds=bounds,
        prior=prior,
        candidates=candidates,
        exclude=tuple(exclude),
    )
    with closing(in_order(work, listed, executor)) as results:
        for number, found in enumerate(results, start=1):
            yield _with_number(found, number, len(listed), progress)


def _with_number(found: Diagnosis, number: int, together: int, progress: Callable[[str], None] | None) -> Diagnosis:
    if progress is not None:
        names = ", ".join(cause.effect.replace("_", " ") for cause in found.causes)
        progress(f"{number} of {together}: {found.verdict.replace('_', ' ')}{f' ({names})' if names else ''}")
    return found
