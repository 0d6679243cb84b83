"""Hide an effect in an independent machine, and the diagnosis must name it; hide none, and it must name none.

The whole table, three sizes of each, is printed by benchmarks/hidden_effects.py.
"""

from __future__ import annotations

import pytest
from hidden import CASES, Hidden, logs_of, oracle
from machine import Machine

from diagnosis import Diagnosis, diagnose
from identification.simulation import free_simulation


def rms_held_out(diagnosis: Diagnosis, case: Hidden, size: float, seed: int) -> tuple[float, float]:
    """Held-out error of the extended model and of the oracle's, in the same simulation [rad]."""
    import numpy as np

    log, held_out = logs_of(case.machine(size), seed=seed)
    run = held_out.runs[0]
    errors = [
        float(np.sqrt(np.mean((free_simulation(held_out, model)[0] - run.output) ** 2)))
        for model in (diagnosis.model, oracle(case, size, log).model)
    ]
    return errors[0], errors[1]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.effect)
def test_the_hidden_effect_is_named_and_its_size_recovered(case: Hidden) -> None:
    size, seed = case.sizes[1], 11
    log, held_out = logs_of(case.machine(size), seed=seed)
    found = diagnose(log, case.base, held_out)
    assert [cause.effect for cause in found.causes][:1] == [case.effect]
    assert found.verdict in ("named", "ambiguous")
    first = found.causes[0]
    for name in case.judged:
        true, line = case.at(size)[name], first.parameters[name]
        assert line.std is not None
        assert line.value == pytest.approx(true, abs=max(0.2 * abs(true), 4 * line.std)), name
    mine, best = rms_held_out(found, case, size, seed)
    assert mine < max(1.5 * best, best + 5e-4)


@pytest.mark.parametrize("seed", [21, 22])
def test_nothing_is_named_when_nothing_is_hidden(seed: int) -> None:
    log, held_out = logs_of(Machine(), seed=seed)
    found = diagnose(log, None, held_out)
    assert found.verdict == "nothing_missing"
    assert found.causes == ()
    assert found.gain is not None
    assert found.gain.held_out_rms_after == found.gain.held_out_rms_before
