"""The notebooks run, and print what is saved in them."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1] / "notebooks"
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e-?\d+)?")


def printed(cell):
    return "".join("".join(output["text"]) for output in cell["outputs"] if output["output_type"] == "stream")


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.ipynb")), ids=lambda path: path.stem)
def test_a_notebook_runs_and_ends_in_the_number_it_shows(path, capsys):
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    from matplotlib import pyplot

    assert path.stat().st_size < 500_000
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


def test_there_is_a_notebook():
    assert list(FOLDER.glob("*.ipynb"))
