"""Runs that repeat one another tell noise from what is still missing, without a catalogue."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from machine import Machine, excitation, load_fluctuation, record

from diagnosis import diagnose
from diagnosis.repeated_runs import repeated_pairs, repeats
from identification.fit import fit
from identification.log import Log


def log_of(*seeds: int, load: float = 0.0, duration: float = 15.0, **hidden: dict[str, float]) -> Log:
    """One run for each seed; equal seeds are the same experiment again, with noise of its own."""
    commands = np.column_stack([excitation(seed, duration=duration) for seed in seeds])
    pushed = load_fluctuation(1, load, commands.shape) if load else 0.0
    return record(Machine().hiding(**hidden), commands, seed=5, load_torque=pushed).log_of_runs()


def test_runs_under_the_same_command_are_recognised() -> None:
    log = log_of(3, 4, 3, 3)
    assert repeated_pairs(log) == ((0, 2), (0, 3), (2, 3))
    shorter = replace(log.runs[2], **{
        name: getattr(log.runs[2], name)[:-900] for name in ("time", "command", "output", "valid", "servo_gain")
    })  # fmt: skip
    assert repeated_pairs(replace(log, runs=(log.runs[0], shorter))) == ()
    louder = replace(log.runs[2], command=1.05 * log.runs[2].command)
    assert repeated_pairs(replace(log, runs=(log.runs[0], louder))) == ()


@pytest.mark.parametrize("load", [0.0, 0.05], ids=["quiet", "a fluctuating load"])
def test_noise_does_not_repeat(load: float) -> None:
    found = repeats(fit(log_of(3, 3, load=load)))
    assert found is not None
    assert not found.deterministic
    assert abs(found.share) < 4.0 * found.chance
    assert 0.0 < found.chance < 0.05


def test_what_is_missing_repeats() -> None:
    hidden = {"compliance": {"frequency": 60.0, "damping": 0.05, "motor_share": 0.3}}
    found = repeats(fit(log_of(3, 4, 3, **hidden)))
    assert found is not None
    assert found.pairs == (("machine 0 run 0", "machine 2 run 2"),)
    assert found.deterministic
    assert 0.05 < found.share < 0.5
    assert "this part is model error, not noise" in str(found)


def test_without_repeats_nothing_is_reported() -> None:
    assert repeats(fit(log_of(3, 4))) is None


@pytest.mark.long
def test_what_repeats_and_has_no_name_is_unknown() -> None:
    swing = {"frequency": 60.0, "damping": 0.05, "motor_share": 0.3}
    log, holdout = log_of(3, 3, compliance=swing), log_of(4, duration=5.0, compliance=swing)
    found = diagnose(log, candidates=["torque_offset"], holdout=holdout)
    assert found.verdict == "unknown"
    assert any("machine 1 run 1 repeats machine 0 run 0" in warning for warning in found.warnings)
    named = diagnose(log, candidates=["compliance"], holdout=holdout)
    assert named.verdict == "named"
    assert any("as expected of noise" in warning for warning in named.warnings)
