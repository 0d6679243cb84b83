"""The house keeps its shape: imports run one way, public names are where the documents say, files stay small."""

from __future__ import annotations

import ast
import importlib
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
def test_every_package_is_typed_and_every_file_says_what_it_is(package):
    assert (ROOT / package / "py.typed").exists()
    for file in (ROOT / package).rglob("*.py"):
        assert ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))), file
