"""What a recursion's instructions are is built once for all programs, and built anew where it may have changed."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from plant import ServoModel, file_cache, machine_code, recursion_cache, symbolic, tape_loops
from plant.discrete import Structure
from plant.effects import CoulombFriction
from plant.effects.effect import Array
from plant.recursion import Recursion

pytestmark = pytest.mark.skipif(machine_code.compiler() is None, reason="no C compiler here")
PAPER = ServoModel.paper()


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tape_loops.loops()  # for all tests of this process, which would else stay without one
    monkeypatch.setattr(file_cache, "_cache", lambda: tmp_path)


def another_program(monkeypatch: pytest.MonkeyPatch, times: list[int], number: int = 2) -> Any:
    """The same builder as another program would have it; `times` counts how often it builds."""

    def built(structure: Structure, factor: int) -> Any:
        assert symbolic._building._is_owned()  # no other thread builds meanwhile
        times.append(factor)
        state, row = ca.SX.sym("state", len(structure.model.states)), ca.SX.sym("row")
        return ca.Function("built", [state, row], [number * ca.sin(state) + factor * row, ca.sumsqr(state)])

    monkeypatch.setattr(built, "__module__", "plant.somewhere")
    return recursion_cache.recursion(carried=1)(built)


def followed(recursion: Recursion) -> list[Array]:
    carried, shown = recursion((np.array([0.3, -0.2]),), np.linspace(-1.0, 1.0, 20)[:, None])
    return [*carried, *shown]


def test_another_program_builds_nothing_and_has_the_same_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    times = list[int]()
    first = followed(another_program(monkeypatch, times)(Structure(PAPER), 3))
    again = followed(another_program(monkeypatch, times)(Structure(PAPER), 3))
    assert times == [3]
    assert all(np.array_equal(one, other) for one, other in zip(first, again, strict=True))


def test_it_is_compiled_from_there_too(monkeypatch: pytest.MonkeyPatch) -> None:
    times = list[int]()
    first = followed(another_program(monkeypatch, times)(Structure(PAPER), 3))
    again = another_program(monkeypatch, times)(Structure(PAPER), 3)
    assert again.wait()
    assert times == [3, 3]  # for its source
    assert all(np.array_equal(one, other) for one, other in zip(first, followed(again), strict=True))


def test_other_arguments_equations_or_code_are_something_else(monkeypatch: pytest.MonkeyPatch) -> None:
    times = list[int]()
    another_program(monkeypatch, times)(Structure(PAPER), 3)
    another_program(monkeypatch, times)(Structure(PAPER), 4)
    another_program(monkeypatch, times)(Structure(PAPER.with_effect(CoulombFriction(torque=0.2))), 3)
    monkeypatch.setattr(recursion_cache, "_code", lambda: "another version")
    other = another_program(monkeypatch, times, number=7)(Structure(PAPER), 3)
    assert times == [3, 4, 3, 3]
    assert followed(other)[0][0] != followed(another_program(monkeypatch, [], number=2)(Structure(PAPER), 4))[0][0]


def test_numbers_of_a_model_are_not_built_in(monkeypatch: pytest.MonkeyPatch) -> None:
    times = list[int]()
    another_program(monkeypatch, times)(Structure(PAPER), 3)
    another_program(monkeypatch, times)(Structure(PAPER.with_values(2.0 * PAPER.values)), 3)
    assert times == [3]


def test_an_effect_of_ones_own_is_built_each_time(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Its equations may call anything, which may change without our code."""

    @dataclass(frozen=True, kw_only=True)
    class Own(CoulombFriction):
        name = "own"

    times = list[int]()
    for _ in range(2):
        another_program(monkeypatch, times)(Structure(PAPER.with_effect(Own(torque=0.2))), 3)
    assert times == [3, 3]
    assert not list(tmp_path.glob("built-*"))


@pytest.mark.parametrize("left", [0.0, 0.5, 0.99])
def test_a_file_that_was_cut_short_is_built_anew(left: float, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    times = list[int]()
    whole = followed(another_program(monkeypatch, times)(Structure(PAPER), 3))
    (path,) = tmp_path.glob("built-*/*.npz")
    path.write_bytes(path.read_bytes()[: int(left * path.stat().st_size)])
    again = followed(another_program(monkeypatch, times)(Structure(PAPER), 3))
    assert times == [3, 3]
    assert all(np.array_equal(one, other) for one, other in zip(whole, again, strict=True))


def test_a_cache_that_cannot_be_written_costs_only_time(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(file_cache, "_cache", lambda: tmp_path / "file" / "below")
    times = list[int]()
    for _ in range(2):
        followed(another_program(monkeypatch, times)(Structure(PAPER), 3))
    assert times == [3, 3]


def test_what_nobody_has_used_for_long_is_thrown_away(tmp_path: Path) -> None:
    for name in ("used", "unused"):
        file_cache.keep(name, b"content", "txt")
        os.utime(tmp_path / name, (0.0, time.time() - 91 * 86400.0))
    assert file_cache.kept("used", "txt") is not None
    file_cache._swept.cache_clear()
    file_cache.keep("new", b"content", "txt")
    assert {path.name for path in tmp_path.iterdir()} == {"used", "new"}


def test_what_was_used_last_is_kept_where_there_is_much(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(file_cache, "_MOST", 3)
    for age, name in enumerate("abcd"):
        file_cache.keep(name, b"content", "txt")
        os.utime(tmp_path / name, (0.0, time.time() - 1000.0 - age))
    file_cache._swept.cache_clear()
    file_cache.keep("new", b"content", "txt")
    assert {path.name for path in tmp_path.iterdir()} == {"new", "a", "b"}


def test_the_mark_of_our_code_reads_it() -> None:
    recursion_cache._code.cache_clear()
    assert len(recursion_cache._code()) == 24


def test_every_effect_of_the_catalogue_can_be_kept() -> None:
    from plant.effects import catalogue

    for kind in catalogue.values():
        assert recursion_cache._text(kind) == f"{kind.__module__}.{kind.__qualname__}"
