"""The version is one, and the licence goes with what is installed."""

from __future__ import annotations

import importlib.metadata
import subprocess
import sys
import tomllib
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest
import yaml
from front_door import antidrive

from antidrive import __version__, version

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def test_command_and_package_report_the_project_version():
    assert __version__ == PROJECT["version"]
    result = antidrive("--version")
    assert (result.code, result.out, result.err) == (0, f"antidrive {PROJECT['version']}\n", "")


def test_the_package_runs_as_the_command_does():
    found = subprocess.run([sys.executable, "-m", "antidrive", "--version"], capture_output=True, text=True, check=True)
    assert (found.stdout, found.stderr) == (f"antidrive {PROJECT['version']}\n", "")


def test_the_version_is_known_installed_uninstalled_and_copied(monkeypatch, tmp_path):
    monkeypatch.setattr(version, "version", lambda name: f"{name} of the metadata")
    assert version._found() == "antidrive of the metadata"

    def not_installed(name: str) -> str:
        raise PackageNotFoundError(name)

    monkeypatch.setattr(version, "version", not_installed)
    monkeypatch.setattr(version, "__file__", str(ROOT / "antidrive" / "version.py"))  # the tests may run installed
    assert version._found() == PROJECT["version"]
    monkeypatch.setattr(version, "__file__", str(tmp_path / "antidrive" / "version.py"))
    assert version._found() == "unknown"


def test_asking_for_the_version_imports_nothing_heavy():
    code = (
        "import sys; from antidrive.cli import main; assert main(['--version']) == 0;"
        "heavy = {'casadi', 'pandas', 'scipy', 'numpy'} & set(sys.modules);"
        "sys.exit(str(heavy) if heavy else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, f"antidrive {PROJECT['version']}\n"), done.stderr


def test_a_command_imports_only_what_it_needs():
    slow = "{'scipy.signal', 'scipy.stats', 'pandas', 'matplotlib', 'plotly'}"
    run = "import sys; from antidrive.cli import main; main(['allocate', '1'])"
    code = f"{run}; sys.exit(str({slow} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stderr.strip() == "set()"


def test_one_licence_is_named_everywhere():
    text = (ROOT / "LICENSE").read_text(encoding="utf-8")
    assert text.startswith("BSD 3-Clause License\n\nCopyright (c) 2026, the antidrive authors\n")
    assert text.count("Redistributions") == 2
    assert "Neither the name of the copyright holder" in text
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert PROJECT["license"] == cited["license"] == "BSD-3-Clause"
    assert PROJECT["license-files"] == ["LICENSE"]
    assert PROJECT["authors"] == cited["authors"] == [{"name": "the antidrive authors"}]
    assert "BSD-3-Clause" in (ROOT / "README.md").read_text(encoding="utf-8")


def test_what_is_installed_carries_the_licence():
    try:
        installed = importlib.metadata.metadata("antidrive")
    except PackageNotFoundError:
        pytest.skip("antidrive runs from its source tree here")
    assert installed["License-Expression"] == "BSD-3-Clause"
    assert installed.get_all("License-File") == ["LICENSE"]
