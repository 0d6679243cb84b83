"""Many logs through executors: the same diagnoses, in order, and nothing left running."""

from __future__ import annotations

import multiprocessing
import pickle
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager

import pytest
from machine import Machine, excitation, record

from diagnosis import Diagnosis, diagnose, diagnose_all
from identification.log import Log
from plant import BadParameter, ServoModel

HIDDEN = ({}, {"coulomb_friction": {"torque": 0.3}}, {"torque_offset": {"torque": 0.2}})
CANDIDATES = ("coulomb_friction", "torque_offset")


@pytest.fixture(scope="module")
def logs() -> list[Log]:
    return [record(Machine().hiding(**hidden), excitation(2, duration=8.0)).log() for hidden in HIDDEN]


@pytest.fixture(scope="module")
def alone(logs: list[Log]) -> list[Diagnosis]:
    return [diagnose(log, candidates=CANDIDATES) for log in logs]


def same(one: Diagnosis, other: Diagnosis) -> bool:
    return one.to_dict() == other.to_dict() and (one.extended.innovations == other.extended.innovations).all()


def processes() -> Executor:
    return ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn"))


@contextmanager
def dask() -> Iterator[Executor]:
    from distributed import Client

    with Client(n_workers=2, threads_per_worker=1, dashboard_address=":0") as client:
        yield client.get_executor()


@pytest.mark.parametrize(
    "workers",
    [lambda: ThreadPoolExecutor(2), processes, pytest.param(dask, marks=pytest.mark.long)],
    ids=["threads", "processes", "dask"],
)
def test_an_executor_gives_the_same_diagnoses_in_order(
    workers: object, logs: list[Log], alone: list[Diagnosis]
) -> None:
    lines: list[str] = []
    with workers() as executor:
        found = list(diagnose_all(logs, executor=executor, candidates=CANDIDATES, progress=lines.append))
    assert [d.verdict for d in found] == ["nothing_missing", "named", "named"]
    assert all(same(one, other) for one, other in zip(found, alone, strict=True))
    assert lines == [
        "1 of 3: nothing missing",
        "2 of 3: named (coulomb friction)",
        "3 of 3: named (torque offset)",
    ]


def test_without_executor_logs_are_diagnosed_on_demand(logs: list[Log], alone: list[Diagnosis]) -> None:
    found = diagnose_all(logs, candidates=CANDIDATES)
    assert same(next(found), alone[0])
    assert same(next(found), alone[1])


def test_base_and_choice_reach_every_log(logs: list[Log]) -> None:
    base = ServoModel(inertia=1.5, gravity=0.4, viscous_friction=0.5)
    (found,) = diagnose_all(logs[1:2], base, fixed=["inertia"], exclude=["torque_offset"], candidates=CANDIDATES)
    assert found.base.fixed == ("inertia",)
    considered = {*(name for each in found.sets for name in each.effects), *(each.effect for each in found.rejected)}
    assert considered == {"coulomb_friction"}


def test_logs_and_diagnoses_survive_pickling(logs: list[Log], alone: list[Diagnosis]) -> None:
    again = pickle.loads(pickle.dumps(logs[1]))
    assert same(diagnose(again, candidates=CANDIDATES), alone[1])
    assert same(pickle.loads(pickle.dumps(alone[1])), alone[1])


class Slow(Executor):
    """Never begins."""

    def __init__(self) -> None:
        self.given: list[Future[Diagnosis]] = []

    def submit(self, *args: object, **kwargs: object) -> Future[Diagnosis]:  # type: ignore[override]
        self.given.append(Future())
        return self.given[-1]


def test_what_nobody_waits_for_is_called_off(logs: list[Log], alone: list[Diagnosis]) -> None:
    executor = Slow()
    found = diagnose_all(logs, executor=executor)
    with ThreadPoolExecutor(1) as pool:
        first = pool.submit(next, found)
        while len(executor.given) < len(logs):
            pass
        executor.given[0].set_result(alone[0])
        assert first.result() is alone[0]
    found.close()
    assert [future.cancelled() for future in executor.given] == [False, True, True]


def test_an_error_comes_in_its_turn(logs: list[Log]) -> None:
    with ThreadPoolExecutor(1) as executor, pytest.raises(BadParameter, match="no effect"):
        list(diagnose_all(logs[:1], executor=executor, candidates=["gremlins"]))
