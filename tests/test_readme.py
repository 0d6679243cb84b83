"""The examples of the README print what the README says they print."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from front_door import antidrive

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
CHANCE = re.compile(r"(?:> )?[\d.]+ %, evidence \w+ \(log Bayes factor [\d.]+\)")  # differs between processors
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e-?\d+)?")


def test_the_example_prints_what_is_shown(tmp_path):
    code, shown = re.search(r"```python\n(.*?)```\n```\n(.*?)```", README, re.DOTALL).groups()
    assert len(code.strip().splitlines()) <= 16
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert NUMBER.sub("#", done.stdout) == NUMBER.sub("#", shown)
    found, written = ([float(n) for n in NUMBER.findall(text)] for text in (done.stdout, shown))
    assert found == pytest.approx(written, rel=0.1)


def test_the_commands_for_the_cart_print_what_is_said(tmp_path, monkeypatch):
    words, said = re.search(r"```\n(antidrive inspect axis.*?)```\n```text\n(.*?)```", README, re.DOTALL).groups()
    for log in (ROOT / "notebooks" / "data").glob("*.csv"):
        shutil.copy(log, tmp_path)
    monkeypatch.chdir(tmp_path)
    done = [antidrive(*shlex.split(line)[1:]) for line in words.splitlines()]
    assert [spoken.code for spoken in done] == [0, 0], done
    printed = "\n".join(done[-1].out.splitlines()[: said.count("\n")])
    assert NUMBER.sub("#", CHANCE.sub("", printed)) == NUMBER.sub("#", CHANCE.sub("", said.rstrip()))
    found, told = ([float(n) for n in NUMBER.findall(CHANCE.sub("", text))] for text in (printed, said))
    assert found == pytest.approx(told, rel=0.1, abs=2e-3)
