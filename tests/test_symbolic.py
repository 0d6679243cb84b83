"""Expressions are built by one thread at a time, wherever they are built."""

from __future__ import annotations

import ast
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from plant.symbolic import one_at_a_time

ROOT = Path(__file__).parent.parent
PACKAGES = ("plant", "identification", "diagnosis")


def test_no_two_threads_build_at_once() -> None:
    within, most = 0, 0
    together = threading.Barrier(2, timeout=0.2)

    @one_at_a_time
    def build(depth: int) -> None:
        nonlocal within, most
        within += 1
        most = max(most, within)
        if depth:
            build(depth - 1)  # a builder may ask another
        else:
            with pytest.raises(threading.BrokenBarrierError):
                together.wait()
        within -= 1

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(build, (1, 1)))
    assert most == 2  # of one thread, which asked itself


ALONE = ("one_at_a_time", "recursion")  # which builds so too, as `test_recursion_cache` asks


def builders(path: Path) -> list[tuple[str, bool]]:
    """Functions of a file that make a CasADi function, and whether they do so one at a time."""
    found = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.FunctionDef):
            makes = any(
                isinstance(call, ast.Call)
                and isinstance(call.func, ast.Attribute)
                and (call.func.attr in ("mapaccum", "fold") or ast.unparse(call.func) == "ca.Function")
                for call in ast.walk(node)
            )
            alone = any(ast.unparse(decorator).split("(")[0] in ALONE for decorator in node.decorator_list)
            found += [(node.name, alone)] if makes else []
    return found


def test_whoever_makes_a_function_for_a_fit_does_so_alone() -> None:
    made = {
        f"{path.relative_to(ROOT)}:{name}": alone
        for package in PACKAGES
        for path in sorted((ROOT / package).rglob("*.py"))
        for name, alone in builders(path)
    }
    assert len(made) > 12
    assert [name for name, alone in made.items() if not alone] == []
