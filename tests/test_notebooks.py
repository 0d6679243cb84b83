"""The notebooks begin with a question, put out what is saved in them, and their sentences say what they put out."""

from __future__ import annotations

import math
import re
import shutil
import time
from dataclasses import dataclass
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from run_notebook import FOLDER, Output, cells, lasts, outputs, shell

from plant import catalogue

NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[+-]?\d+)?(?!\w)")
NO_FINDING = re.compile(r"^#+ .*$|\$[^$]*\$|`[^`]*`|\([^()]*\b(?:19|20)\d\d\)", re.MULTILINE)  # headings, papers, names
VERDICTS = {"named", "ambiguous", "unknown", "nothing_missing"}


@dataclass(frozen=True)
class Played:
    """What the code cells of a notebook put out, and how its sliders answer at the end."""

    outputs: list[list[Output]]
    moved: dict[str, list[Output]]
    seconds: list[float]
    processor: float


def played(path: Path) -> Played:
    """Run a notebook."""
    pytest.importorskip("ipywidgets")  # and with it IPython
    pytest.importorskip("matplotlib")
    if path.stem.startswith("06") and shutil.which("cc") is None:
        pytest.skip("no C compiler on this machine")
    begin = time.process_time()
    with shell() as made:
        saved = [outputs(made, "".join(cell["source"])) for cell in cells(path) if cell["cell_type"] == "code"]
        sliders = made.user_ns.get("sliders", {})
        moved = {name: outputs(made, f"sliders[{name!r}].value = sliders[{name!r}].max") for name in sliders}
        return Played(saved, moved, made.user_ns.get("seconds", []), time.process_time() - begin)


def text(output: Output) -> str:
    return "".join(output.get("text", output.get("data", {}).get("text/plain", "")))


def code(path: Path) -> str:
    return "\n".join("".join(cell["source"]) for cell in cells(path) if cell["cell_type"] == "code")


def prose(path: Path) -> str:
    return "\n\n".join("".join(cell["source"]) for cell in cells(path) if cell["cell_type"] == "markdown")


def last_place(number: str) -> float:
    """What one more in the last digit of a number is worth: 0.01 for 0.25, 1 for 600, 1000 for 4.2e4."""
    digits, _, exponent = number.partition("e")
    return float(10.0 ** (int(exponent or 0) - len(digits.partition(".")[2])))


def is_as_saved(found: str, saved: str) -> bool:
    """Whether a text is the same but for numbers that are a tenth, or one in the last decimal, off."""
    pairs = zip(NUMBER.findall(found), NUMBER.findall(saved), strict=False)
    return NUMBER.sub("#", found) == NUMBER.sub("#", saved) and all(
        math.isclose(float(a), float(b), rel_tol=0.1, abs_tol=1.001 * last_place(b) if "." in b else 0.0)
        for a, b in pairs
    )


def missing_numbers(prose: str, outputs_text: str) -> list[str]:
    """Numbers of a prose that no number of what is told is, to the digits written."""
    known = [float(number) for number in NUMBER.findall(outputs_text)]
    return [
        number
        for number in NUMBER.findall(NO_FINDING.sub("", prose))
        if not any(abs(value - float(number)) <= 0.5001 * last_place(number) for value in known)
    ]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_asks_a_question_and_keeps_pictures_not_paths(path):
    title, _, question = "".join(cells(path)[0]["source"]).partition("\n\n")
    assert title.startswith("# ")
    assert re.match(r"\*\*[^*]*\?\*\*", question)
    kept = [output for cell in cells(path) for output in cell.get("outputs", ())]
    assert any("image/png" in output.get("data", {}) for output in kept)
    assert not re.search(r"warning|traceback|/(?:tmp|home|root|usr)/", "".join(map(text, kept)), re.IGNORECASE)
    assert path.stat().st_size < 500_000


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_every_cell_prints_what_is_saved_and_the_text_agrees(path):
    """Numbers, names of effects and verdicts in prose: each is printed by a cell, or set in one."""
    saved, run = [cell for cell in cells(path) if cell["cell_type"] == "code"], played(path)
    assert run.processor < 60.0
    for cell, found in zip(saved, run.outputs, strict=True):
        source, there = "".join(cell["source"]), [output for output in found if lasts(output)]
        assert [o["output_type"] for o in there] == [o["output_type"] for o in cell["outputs"]], source
        for now, before in zip(there, cell["outputs"], strict=True):
            assert is_as_saved(text(now), text(before)), f"{source}\n{text(now)}"
            assert ("image/png" in now.get("data", {})) == ("image/png" in before.get("data", {}))
    printed = "".join(text(output) for found in run.outputs for output in found) + code(path)
    assert missing_numbers(prose(path), printed) == []
    for name, effect in catalogue.items():
        if re.search(rf"\b{re.escape(effect.title)}\b", prose(path), re.IGNORECASE):
            assert any(word.lower() in printed.lower() for word in (name, effect.title, effect.__name__)), name
    for verdict in VERDICTS & set(re.findall(r"`(\w+)`", prose(path))):
        assert re.search(rf"\b{verdict}\b", printed), verdict


def test_a_wrong_sentence_and_a_changed_output_are_seen():
    printed = "named: coulomb_friction, 0.2995 N m in 14.00 s, e^-3"
    assert (
        missing_numbers("## 7. Title\n\n0.30 N m (Janot 2019) of $x_{12}$ in 14 s of `angle_1`, minus -3", printed)
        == []
    )
    assert missing_numbers("0.31 N m, 0.301 N m, 15 s", printed) == ["0.31", "0.301", "15"]
    assert is_as_saved(printed, printed.replace("0.2995", "0.31").replace("14.00", "14.01"))
    assert not is_as_saved(printed, printed.replace("0.2995", "0.34"))
    assert not is_as_saved(printed, printed.replace("coulomb", "stribeck"))
    assert not is_as_saved("0.4 N m off", "0 N m off")


def test_every_slider_moves_its_own_picture_and_quickly():
    """Also when the notebook has been run to its end, and other pictures have been drawn."""
    run = played(next(FOLDER.glob("03*.ipynb")))
    pictures = [o for found in run.outputs for o in found if o.get("transient", {}).get("display_id")]
    own, seen = pictures[0], {pictures[0]["data"]["image/png"]}
    assert own["output_type"] == "display_data"
    assert len(run.moved) == 3
    for name, answer in run.moved.items():
        assert [output["output_type"] for output in answer] == ["update_display_data"], name
        assert answer[0]["transient"] == own["transient"]
        assert text(answer[0]) == text(own)
        assert answer[0]["data"]["image/png"] not in seen
        seen.add(answer[0]["data"]["image/png"])
    assert np.median(run.seconds) < 1.0  # on a slow processor too


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
