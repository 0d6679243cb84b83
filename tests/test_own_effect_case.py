"""A model file with an effect of its owner's, as somebody wrote it: in units of their own, behind a byte order mark."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
CASE = ROOT.parent / "shared" / "cases" / "use" / "13-own-effect-file" / "case.py"


@pytest.mark.skipif(not CASE.exists(), reason="the folder of cases is not here")
def test_their_files_are_read_or_refused_with_the_way_out(tmp_path):
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(tmp_path), "CC": ""}
    words = [sys.executable, str(CASE)]
    done = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120)
    messages = {
        line.split()[1] if line[:3] in ("ok ", "ERR") else line.split(":")[0]: line for line in done.stdout.split("\n")
    }
    assert "unknown effect 'windage'" in messages["read back"]
    assert "export with own effect" in messages
    assert messages["BOM"].startswith("ok")
    assert "inertia = 2 kg m^2" in messages["other"]  # 2000 g m^2
    for refused in ("negative", "missing", "twice", "NaN"):
        assert messages[refused].startswith("ERR")
        assert "BadModelFile" in messages[refused]
