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
    """Diagnose many logs, each by itself.

    Args:
        logs: one log a diagnosis, as in `diagnose`.
        base, fixed, bounds, prior, candidates, exclude: as in `diagnose`, the same for all.
        executor: any executor of `concurrent.futures`, also a `dask.distributed.Client().get_executor()`; logs and
            diagnoses are pickled where its workers are processes. None works on one log after the other here. A killed
            worker costs no diagnosis, see `plant.executors.in_order`.
        progress: called with a line of text as each diagnosis is handed out.

    Yields:
        The diagnoses in the order of the logs, each as soon as it and those before it are there. What has not begun is
        called off when nobody asks for more.

    Raises:
        AntidriveError: as `diagnose` raises it, in its log's turn.
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
            yield _told(found, number, len(listed), progress)


def _told(found: Diagnosis, number: int, together: int, progress: Callable[[str], None] | None) -> Diagnosis:
    if progress is not None:
        names = ", ".join(cause.effect.replace("_", " ") for cause in found.causes)
        progress(f"{number} of {together}: {found.verdict.replace('_', ' ')}{f' ({names})' if names else ''}")
    return found
