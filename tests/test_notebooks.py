"""The notebooks begin with a question, run, and print what is saved in them, a number at last."""

from __future__ import annotations

import json
import re
import shutil
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

FOLDER = Path(__file__).parents[1] / "notebooks"
NEEDS = {"03": ("ipywidgets",), "06": ("cc",)}
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e-?\d+)?")


NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))


def printed(cell):
    return "".join("".join(output["text"]) for output in cell["outputs"] if output["output_type"] == "stream")


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_asks_a_question_and_keeps_its_pictures_and_no_paths(path):
    notebook = json.loads(path.read_text(encoding="utf-8"))
    title, _, question = "".join(notebook["cells"][0]["source"]).partition("\n\n")
    assert title.startswith("# ")
    assert re.match(r"\*\*[^*]*\?\*\*", question)
    outputs = [output for cell in notebook["cells"] for output in cell.get("outputs", ())]
    assert any("image/png" in output.get("data", {}) for output in outputs)
    said = [text for o in outputs for text in (o.get("text"), o.get("data", {}).get("text/plain")) if text]
    assert not re.search(r"warning|traceback|/(?:tmp|home|root|usr)/", "".join(map("".join, said)), re.IGNORECASE)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_and_ends_in_the_number_it_shows(path, capsys, monkeypatch):
    monkeypatch.chdir(FOLDER)
    monkeypatch.delenv("EMPS", raising=False)
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    from matplotlib import pyplot

    assert path.stat().st_size < 500_000
    for needed in NEEDS.get(path.stem[:2], ()):
        if needed == "cc" and shutil.which("cc") is None:
            pytest.skip("no C compiler on this machine")
        elif needed != "cc":
            pytest.importorskip(needed)
    notebook = json.loads(path.read_text(encoding="utf-8"))
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    pictures = [output for cell in cells for output in cell["outputs"] if "image/png" in output.get("data", {})]
    names: dict[str, object] = {}
    try:
        with matplotlib.rc_context():
            for cell in cells:
                exec(compile("".join(cell["source"]), path.name, "exec"), names)
                last = capsys.readouterr().out
            assert len(pictures) == len(pyplot.get_fignums())
    finally:
        pyplot.close("all")
    saved = printed(cells[-1])
    assert NUMBER.sub("#", last) == NUMBER.sub("#", saved)
    found, told = ([float(n) for n in NUMBER.findall(text)] for text in (last, saved))
    assert told
    assert found == pytest.approx(told, rel=0.1)
    if "seconds" in names:  # that a move of a slider takes
        assert np.median(names["seconds"]) < 0.5


def test_there_are_notebooks():
    assert [path.stem[:2] for path in NOTEBOOKS] == ["01", "02", "03", "04", "05", "06"]


def test_the_bundled_logs_are_what_their_script_writes():
    spec = spec_from_file_location("make_axis_logs", FOLDER / "data" / "make_axis_logs.py")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    for name, seed, pulses in (("axis", 0, 0.0), ("axis_pulses", 1, 60.0)):
        made, bundled = module.record(seed, pulses), pd.read_csv(FOLDER / "data" / f"{name}.csv")
        assert list(made.columns) == list(bundled.columns)
        np.testing.assert_allclose(made, bundled, rtol=0, atol=0.02)
