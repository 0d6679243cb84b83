"""The house keeps its shape: imports run one way, public names are where the documents say, files stay small."""

from __future__ import annotations

import ast
import importlib
import subprocess
import sys
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MAY_IMPORT = {
    "plant": set(),
    "allocation": {"plant"},
    "identification": {"plant"},
    "diagnosis": {"plant", "identification"},
    "mpc": {"plant", "allocation"},
    "antidrive": {"plant", "allocation", "identification", "diagnosis", "mpc"},
}
PUBLIC = {
    "plant": ("ServoModel", "GearTrain", "Rig", "catalogue"),
    "identification": ("Log", "fit"),
    "diagnosis": ("diagnose",),
    "allocation": ("Allocator", "admissible", "enumerate_admissible"),
    "mpc": ("Controller", "closed_loop"),
}
FOR_TYPES_ALONE = {
    # What an effect leaves behind when the log's clock is gone is a model without it: the one thing that an effect
    # says of the model that it is part of.
    ("plant.effects.effect", "plant.servo"),
    ("plant.effects.payload_change", "plant.servo"),
    ("plant.effects.friction_drift", "plant.servo"),
    # A model is asked for its inverse, whose equations are in a file of their own.
    ("plant.inverse", "plant.servo"),
    # A fleet is of rigs, and a rig is played as a fleet of one.
    ("plant.fleet", "plant.rig"),
}
"""Imports under TYPE_CHECKING that close a circle: (who, what)."""


def imported(file: Path) -> set[str]:
    """First names of everything that a file imports, inside functions too."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            found.add(node.module.split(".")[0])
    return found


@pytest.mark.parametrize("package", MAY_IMPORT)
def test_imports_run_one_way(package):
    files = sorted((ROOT / package).rglob("*.py"))
    assert files
    allowed = MAY_IMPORT[package] | {package}
    wrong = {str(f.relative_to(ROOT)): extra for f in files if (extra := imported(f) & set(MAY_IMPORT) - allowed)}
    assert wrong == {}


@pytest.mark.parametrize("package", PUBLIC)
def test_public_names_come_from_their_package(package):
    module = importlib.import_module(package)
    for name in PUBLIC[package]:
        assert name in module.__all__, name
        assert callable(getattr(module, name)) or name == "catalogue"
    assert sorted(module.__all__) == sorted(set(module.__all__))


@pytest.mark.parametrize("package", MAY_IMPORT)
def test_every_package_is_typed_and_every_file_states_what_it_is(package):
    assert (ROOT / package / "py.typed").exists()
    for file in (ROOT / package).rglob("*.py"):
        assert ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))), file


def name_of(file: Path) -> str:
    """The module's name: that of the folder for an `__init__`."""
    return ".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def imports(node: ast.AST, *, types: bool) -> Iterator[ast.Import | ast.ImportFrom]:
    """All imports of a file, inside functions too; those for types alone only where they are asked for."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Import | ast.ImportFrom):
            yield child
        elif not types and isinstance(child, ast.If) and ast.unparse(child.test).endswith("TYPE_CHECKING"):
            yield from imports(ast.Module(child.orelse, []), types=types)
        else:
            yield from imports(child, types=types)


def needs(package: str, *, types: bool) -> dict[str, set[str]]:
    """Which modules of a package each of its modules imports."""
    files = {name_of(file): file for file in (ROOT / package).rglob("*.py")}
    found: dict[str, set[str]] = {name: set() for name in files}
    for name, file in files.items():
        for statement in imports(ast.parse(file.read_text(encoding="utf-8")), types=types):
            if isinstance(statement, ast.Import):
                found[name] |= {alias.name for alias in statement.names}
            elif statement.module:
                whole = {f"{statement.module}.{alias.name}" for alias in statement.names}
                found[name] |= {one if one in files else statement.module for one in whole}
        found[name] &= set(files)
    return found


def circle(graph: dict[str, set[str]]) -> list[str]:
    """Modules that import each other in a ring, from one back to itself; empty if there are none."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


@pytest.mark.parametrize("package", MAY_IMPORT)
def test_no_modules_of_a_package_import_each_other_in_a_circle(package):
    assert circle(needs(package, types=False)) == []
    graph = needs(package, types=True)
    excepted = {(who, what) for who, what in FOR_TYPES_ALONE if who.split(".")[0] == package}
    for who, what in excepted:
        graph[who].remove(what)
    assert circle(graph) == []
    for who, what in excepted:  # none is excepted that need not be
        assert circle({**graph, who: graph[who] | {what}}), (who, what)


def test_names_of_tests_are_short_and_unique_in_their_file():
    names = [
        (file.name, node.name)
        for file in (ROOT / "tests").glob("test_*.py")
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")
    ]
    assert [name for _, name in names if len(name) > 60] == []
    assert len(set(names)) == len(names)


@pytest.mark.parametrize(
    ("package", "own"),
    [
        ("antidrive", set()),
        ("plant", {"numpy", "casadi", "platformdirs"}),
        ("allocation", {"numpy", "casadi", "platformdirs"}),
        ("mpc", {"numpy", "casadi", "platformdirs"}),
    ],
)
def test_an_import_loads_no_more_than_a_loop_needs(package, own):
    """What only a picture, an analysis or a solver asks for is loaded when it is asked for."""
    listed = (
        f"import sys; before = set(sys.modules); import {package}; "
        "print(*{name.partition('.')[0] for name in set(sys.modules) - before})"
    )
    run = subprocess.run([sys.executable, "-c", listed], cwd=ROOT, capture_output=True, text=True, check=True)
    foreign = set(run.stdout.split()) - set(sys.stdlib_module_names) - set(MAY_IMPORT)
    assert {name for name in foreign if not name.startswith(("_", "swig_runtime"))} <= own
