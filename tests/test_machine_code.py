"""Machine code gives the same numbers as the virtual machine, and its absence costs time alone."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from identification import predictor
from plant import ServoModel, machine_code
from plant.effects import StribeckFriction
from plant.machine_code import MachineCode

with_compiler = pytest.mark.skipif(machine_code.compiler() is None, reason="no C compiler here")


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine_code, "_cache", lambda: tmp_path / "cache")


def example() -> ca.Function:
    x = ca.SX.sym("x", 3)
    return ca.Function("example", [x], [ca.sin(x) * ca.exp(-x[0]) / (1 + x**2), ca.dot(x, x)])


@with_compiler
def test_both_forms_agree_to_the_last_bit() -> None:
    model = ServoModel.paper().with_effect(StribeckFriction(coulomb=0.1, excess=0.1, velocity=0.3))
    code = predictor._code.__wrapped__(predictor._Key(model, (0, 1, 2, 3), 1, True))
    time = 0.005 * np.arange(predictor.CHUNK)
    command, measured = 5.0 * np.sin(8.0 * time), 0.1 * np.sin(7.0 * time)
    constant = np.ones_like(time)
    rows = (
        command,
        command,
        0 * time,
        np.inf * constant,
        time,
        0.005 * constant,
        0 * time,
        measured,
        0.1 * constant,
        constant,
    )
    parameters = np.tile(model.values[:, None], predictor.CHUNK)
    arguments = (np.array([0.1, -0.3]), np.eye(2, 6), np.stack(rows), parameters)
    by_machine = code.function(*arguments)
    assert code.wait()
    compiled = code.function(*arguments)
    for slow, fast in zip(by_machine, compiled, strict=True):
        assert np.isfinite(np.array(slow)).all()
        assert np.array_equal(np.array(slow), np.array(fast))


@with_compiler
def test_what_was_compiled_is_found_again() -> None:
    first = MachineCode(example())
    assert not first.function.is_a("External")  # the compiler has just begun
    assert first.wait()
    assert MachineCode(example()).function.is_a("External")


@with_compiler
def test_another_function_of_the_same_name_is_not_taken_for_it() -> None:
    assert MachineCode(example()).wait()
    x = ca.SX.sym("x", 3)
    other = MachineCode(ca.Function("example", [x], [2 * x, ca.sum1(x)]))
    assert other.wait()
    assert np.array(other.function(np.ones(3))[0]).ravel() == pytest.approx([2.0, 2.0, 2.0])


@pytest.mark.parametrize("command", [None, ("/bin/false",), ("/nowhere/cc",)])
def test_without_a_working_compiler_the_function_serves(
    command: tuple[str, ...] | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine_code, "compiler", lambda: command)
    code = MachineCode(example())
    assert not code.wait()
    assert float(code.function(np.ones(3))[1]) == 3.0


@with_compiler
def test_a_cache_that_cannot_be_written_costs_only_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(machine_code, "_cache", lambda: tmp_path / "file" / "below")
    code = MachineCode(example())
    assert not code.wait()
    assert float(code.function(np.ones(3))[1]) == 3.0


@with_compiler
def test_a_spoilt_library_is_built_anew(tmp_path: Path) -> None:
    assert MachineCode(example()).wait()
    (library,) = (tmp_path / "cache").glob("example-*.so")
    library.write_bytes(b"not a library")
    code = MachineCode(example())
    assert float(code.function(np.ones(3))[1]) == 3.0
    assert code.wait()


def test_the_environment_names_the_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    machine_code.compiler.cache_clear()
    monkeypatch.setenv("CC", "")
    assert machine_code.compiler() is None
    machine_code.compiler.cache_clear()
