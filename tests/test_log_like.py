"""Whatever holds a log may stand where one is asked for, and what holds none is refused in one sentence."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from front_door import PLAIN, columns, write_csv

from diagnosis import diagnose
from identification import Log, fit, log_of
from plant import BadParameter, ServoModel

TABLE = columns(PLAIN, duration=3.0)


@pytest.fixture(scope="module")
def path(tmp_path_factory) -> Path:
    return write_csv(tmp_path_factory.mktemp("log") / "log.csv", TABLE)


def test_a_path_a_frame_and_arrays_are_the_same_log(path):
    lists = {name: list(column) for name, column in TABLE.items()}
    sources = (path, str(path), [path], (str(path),), pd.DataFrame(TABLE), TABLE, lists, Log.from_arrays(**TABLE))
    for source in sources:
        (run,) = log_of(source).runs
        np.testing.assert_allclose(run.output, TABLE["angle"], atol=1e-9)
        np.testing.assert_allclose(run.command, TABLE["torque"], atol=1e-9)
    log = Log.read(path)
    assert log_of(log) is log


def test_fit_and_diagnosis_take_them(path, monkeypatch):
    assert fit(path, PLAIN)["inertia"].value == pytest.approx(fit(TABLE, PLAIN)["inertia"].value, rel=1e-6)
    heard = []

    def listen(log, *_, **__):
        heard.append(log)
        raise BadParameter("heard.")

    monkeypatch.setattr(import_module("diagnosis.diagnose_once"), "fit_with_prior", listen)
    for source in (path, pd.DataFrame(TABLE), TABLE):
        with pytest.raises(BadParameter, match="heard"):
            diagnose(source, holdout=source)
    assert [type(log) for log in heard] == [Log] * 3


@pytest.mark.parametrize(
    "source", [None, 3, ServoModel.paper(), np.zeros((5, 3)), [], [1.0, 2.0], b"log.csv"], ids=repr
)
@pytest.mark.parametrize("task", [fit, diagnose, log_of])
def test_anything_else_is_refused_with_what_to_pass(task, source):
    with pytest.raises(BadParameter, match=r"pass a path or several, a DataFrame, arrays by name.*, not an? \w+\.$"):
        task(source)
