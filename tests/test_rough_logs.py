"""Logs of any scale, with anything wrong, end in a result or in one sentence; see `benchmarks/logs_of_any_scale.py`."""

from __future__ import annotations

import numpy as np
import pytest
from rough_log_outcome import diagnosed, identified
from rough_logs import KINDS, rough_log

from identification.fit import fit

ONCE, AGAIN = range(len(KINDS)), range(len(KINDS), 2 * len(KINDS))


@pytest.mark.parametrize("seed", [*ONCE, *(pytest.param(seed, marks=pytest.mark.long) for seed in AGAIN)])
def test_a_rough_log_ends_in_a_result_or_a_sentence(seed: int) -> None:
    rough = rough_log(seed, longest=400)
    assert identified(rough).faults == ()
    assert diagnosed(rough).faults == ()


@pytest.mark.parametrize("seed", [578, 828])
@pytest.mark.long
def test_of_a_thousand_logs_two_once_ended_otherwise(seed: int) -> None:
    """A model whose motion grew without bound, and a part of a log shorter than a filter's padding."""
    assert diagnosed(rough_log(seed, longest=2000)).faults == ()


def test_rough_logs_are_of_all_kinds_and_scales() -> None:
    drawn = [rough_log(seed, longest=200) for seed in range(120)]
    assert {rough.kind for rough in drawn} == set(KINDS)
    assert {how for rough in drawn for how in rough.spoilt} == {"saturated", "3 % unmodelled", "8 bit"}
    for values, decades in (([r.inertia for r in drawn], 6.0), ([r.level for r in drawn], 5.0)):
        assert np.ptp(np.log10(values)) > decades
    assert all(np.isfinite(rough.angle).all() and np.ptp(rough.time) > 0.2 for rough in drawn)


def test_a_fit_to_the_wrong_torque_fails_with_advice() -> None:
    """No number is made up, and nobody is told that the log were to blame."""
    log = rough_log(14, longest=600).log()
    (run,) = log.runs
    noise = np.random.default_rng(1).standard_normal(len(run))
    found = fit(type(log)(runs=(type(run)(**{**vars(run), "command": noise}),), axis=log.axis))
    assert found.failed is not None
    assert "The fit failed: " in str(found)
    assert "cannot be determined" not in str(found)
