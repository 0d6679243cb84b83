"""Data that are fitted validate nothing, whatever their file is called."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from front_door import antidrive, write_csv
from machine import Machine, excitation, record

from diagnosis import diagnose


def test_a_log_is_no_validation_of_itself() -> None:
    log = record(Machine(), excitation(3, duration=5.0), seed=3).log()
    found = diagnose(log, holdout=log, candidates=["coulomb_friction"])
    assert sum("is fitted too, so it validates nothing" in warning for warning in found.warnings) == 1


def test_a_copy_of_a_log_is_no_validation(tmp_path: Path) -> None:
    log = record(Machine(), excitation(3, duration=5.0), seed=3).log()
    run = log.runs[0]
    write_csv(tmp_path / "log.csv", {"time": run.time, "torque": run.command, "angle": run.output})
    shutil.copy(tmp_path / "log.csv", tmp_path / "again.csv")
    words = ("--holdout", tmp_path / "again.csv", "--candidates", "coulomb_friction", "--out", tmp_path / "out")
    result = antidrive("diagnose", tmp_path / "log.csv", *words)
    assert (result.code, (tmp_path / "out").exists()) == (2, False)
    assert "validates nothing" in result.err


def test_the_arrays_of_a_log_cannot_be_changed() -> None:
    command = np.sin(np.arange(200) * 0.1)
    log = record(Machine(), command, seed=3).log()
    with pytest.raises(ValueError, match="read-only"):
        log.runs[0].command[0] = 1e9
    command[0] = 2.0  # that of the caller can
