"""What a person says of parameters and effects, on a command line or in a log.toml, reaches fit and diagnosis."""

from __future__ import annotations

import json
import tomllib
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from front_door import PLAIN, antidrive, columns, write_csv, write_model
from windage import Windage

from antidrive.fit_options import FitOptions
from antidrive.own_effects import read_effects
from plant import BadParameter, catalogue, read_model

OWN = Path(__file__).with_name("windage.py")
MODEL = PLAIN.with_effect(Windage(drag=0.4))
SHORT = 'duration = 0.1\nsample_time = 0.005\nreference = { kind = "constant", level = 0.1 }\n'


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("own")
    write_csv(folder / "log.csv", columns(MODEL, duration=6.0))
    write_model(folder / "own.json", MODEL)
    write_model(folder / "plain.json", PLAIN)
    (folder / "short.toml").write_text(SHORT)
    return folder


def test_words_and_toml_agree(tmp_path: Path) -> None:
    typed = FitOptions.typed(
        fixed=["gravity,inertia=0.2"],
        bounds=["viscous_friction=0:0.3", "coulomb_friction.torque=-1e-3:2"],
        prior=["cogging.order=12:0.5"],
        exclude=["backlash", "dead_zone"],
        candidates=["cogging,coulomb_friction"],
        effects=tmp_path / "mine.py",
    )
    text = """
    [fit]
    fixed = ["gravity", "inertia=0.2"]
    bounds = { viscous_friction = [0, 0.3], coulomb_friction.torque = [-1e-3, 2] }
    prior = { "cogging.order" = [12.0, 0.5] }
    exclude = ["backlash", "dead_zone"]
    candidates = ["cogging", "coulomb_friction"]
    effects = "mine.py"
    """
    assert FitOptions.of(tomllib.loads(text)["fit"], tmp_path) == typed
    assert typed.fixed == {"gravity": None, "inertia": 0.2}
    assert FitOptions.of({}) == FitOptions.typed() == FitOptions()


def test_the_command_line_wins() -> None:
    table = {"fixed": ["gravity"], "bounds": {"inertia": [0.1, 0.3]}, "prior": {"inertia": [0.2, 0.1]}}
    filed = FitOptions.of({**table, "exclude": ["cogging"], "candidates": ["backlash"]})
    assert filed.merged(FitOptions()) == filed
    assert FitOptions().merged(filed) == filed
    both = filed.merged(FitOptions.typed(bounds=["inertia=1:2", "gravity=0:1"], exclude=["end_stop"]))
    assert both.bounds == {"inertia": (1.0, 2.0), "gravity": (0.0, 1.0)}
    assert both.fixed == {}  # what is bounded on the command line is no longer fixed
    assert (both.prior, both.exclude, both.candidates) == ({"inertia": (0.2, 0.1)}, ("end_stop",), ("backlash",))
    fixed = filed.merged(FitOptions.typed(fixed=["inertia=0.2"]))
    assert (fixed.fixed, fixed.bounds, fixed.prior) == ({"gravity": None, "inertia": 0.2}, {}, {})


@pytest.mark.parametrize(
    ("table", "expected"),
    [
        ({"bound": {}}, "has no 'bound'; it may have fixed, bounds, prior, per_run, exclude, candidates, effects"),
        ({"bounds": [0.1, 0.3]}, "must be a table"),
        ({"bounds": {"inertia": 0.3}}, r"write inertia = \[0.1, 0.3\]"),
        ({"fixed": 3}, "must be a list of names"),
        ({"fixed": ["inertia=two"]}, "inertia=0.2"),
        ({"exclude": [3]}, "must be a list of names"),
        ({"effects": 3}, "must be the path"),
    ],
)
def test_a_table_that_is_written_wrongly_is_refused(table, expected) -> None:
    with pytest.raises(BadParameter, match=expected):
        FitOptions.of(table)


@pytest.mark.parametrize("command", ["identify", "diagnose"])
def test_the_words_reach_the_work(command, place, monkeypatch, tmp_path) -> None:
    heard = {}

    def listen(*_, progress, **words):
        heard.update(words)
        raise BadParameter("heard.")

    monkeypatch.setattr(import_module("diagnosis.diagnose"), "diagnose", listen)
    monkeypatch.setattr(import_module("identification.fit"), "fit", listen)
    words = ["--fixed", "gravity=0.6", "--bounds", "inertia=0.1:0.9", "--prior", "viscous_friction=0.5:0.1"]
    choice = ["--exclude", "cogging", "--effects", OWN] if command == "diagnose" else ["--effects", OWN]
    result = antidrive(command, place / "log.csv", *words, *choice, "--out", tmp_path / "out")
    assert (result.code, result.err) == (2, "antidrive: heard.\n")
    assert heard["fixed"] == {"gravity": 0.6}
    assert (heard["bounds"], heard["prior"]) == ({"inertia": (0.1, 0.9)}, {"viscous_friction": (0.5, 0.1)})
    if command == "diagnose":
        assert heard["exclude"] == ("cogging",)
        assert heard["candidates"][:-1] == list(catalogue)
        assert heard["candidates"][-1].name == "windage"


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("--bounds inertia=1", "--bounds inertia=0.1:0.3"),
        ("--bounds inertia=a:b", "--bounds inertia=0.1:0.3"),
        ("--prior inertia=1:2:3", "--prior inertia=0.2:0.05"),
        ("--prior inertia=1:2 --prior inertia=1:2", "names 'inertia' twice"),
        ("--bounds mass=1:2", "there are inertia, gravity, viscous_friction, dead_zone.half_width"),
        ("--bounds inertia=2:1", "the first must be below"),
        ("--fixed inertia", "inertia has no value to keep"),
        ("--fixed inertia=-1", "inertia = -1 is outside"),
        ("--effects absent.py", "no such file"),
        ("--effects log.csv", "is no Python file"),
        ("--effects broken.py", "broken.py: line 2: ZeroDivisionError"),
        ("--effects wrong.py", "wrong.py: line 1: SyntaxError"),
        ("--effects hollow.py", "defines no effect"),
        ("--effects nameless.py", "Nameless does not say its name, title, stage, equation, signature"),
        ("--effects known.py", "'cogging' is an effect of the catalogue"),
        ("--effects plain.py", "@dataclass(frozen=True, kw_only=True) above Plain"),
    ],
)
def test_words_that_cannot_be_are_reported_in_one_sentence(words, expected, place, monkeypatch) -> None:
    monkeypatch.chdir(place)
    head = "from plant import Effect\nfrom plant.effects import Stage\n"
    body = '    title = equation = signature = "x"\n    stage = Stage.LOAD\n'
    files = {
        "broken": "x = 1\ny = x / 0\n",
        "wrong": "def (",
        "hollow": head,
        "nameless": head + "class Nameless(Effect):\n    pass\n",
        "known": head + 'class Known(Effect):\n    name = "cogging"\n' + body,
        "plain": head + 'class Plain(Effect):\n    name = "plain"\n' + body,
    }
    for name, text in files.items():
        Path(f"{name}.py").write_text(text)
    result = antidrive("identify", "log.csv", *words.split(), "--out", "bad")
    assert (result.code, result.out) == (2, "")
    assert result.err.count("\n") == 1
    assert expected in result.err
    assert not Path("bad").exists()


def test_effects_of_ones_own_are_read_in_the_order_of_their_file(tmp_path: Path) -> None:
    text = OWN.read_text()
    again = text[text.index("@dataclass") :].replace("Windage", "Second").replace('"windage"', '"second"')
    (tmp_path / "two.py").write_text(f"{text}\n\n{again}")
    assert [kind.name for kind in read_effects(tmp_path / "two.py")] == ["windage", "second"]


def test_every_command_reads_a_model_with_an_own_effect(place, monkeypatch, tmp_path) -> None:
    monkeypatch.chdir(place)
    known = ("--effects", OWN)
    for words in (
        ("identify", "log.csv", "--base", "own.json", "--out", tmp_path / "fit"),
        ("predict", "own.json", "log.csv", "--out", tmp_path / "path.csv"),
        ("simulate", "short.toml", "--model", "own.json", "--out", tmp_path / "loop"),
        ("export", "own.json", "--max-torque", 0.4, "--out", tmp_path / "code"),
    ):
        result = antidrive(*words)
        assert result.code == 2
        assert "--effects FILE.py" in result.err
        result = antidrive(*words, *known, "--json")
        assert result.code == 0, result.err
        if words[0] == "predict":
            assert json.loads(result.out)["runs"][0]["rms"] < 1e-3
    found = read_model(tmp_path / "fit" / "model.json", read_effects(OWN)).model
    np.testing.assert_allclose(found.values, MODEL.values, rtol=0.02, atol=0.002)


def test_an_effect_of_ones_own_is_named(place, tmp_path) -> None:
    words = ("--base", place / "plain.json", "--effects", OWN, "--candidates", "windage,coulomb_friction")
    result = antidrive("diagnose", place / "log.csv", *words, "--out", tmp_path / "out")
    assert result.code == 0, result.err
    assert "Windage: probability > 99.9 %" in result.out
    assert "windage" in (tmp_path / "out" / "report.html").read_text()


def test_a_parameter_may_have_a_value_in_each_run(tmp_path: Path) -> None:
    one = columns(MODEL, duration=6.0)
    two = {name: np.concatenate((values, values)) for name, values in one.items()}
    write_csv(tmp_path / "two.csv", two | {"run": np.repeat((1, 2), len(one["time"]))})
    result = antidrive("identify", tmp_path / "two.csv", "--per-run", "inertia", "--json", "--out", tmp_path / "out")
    assert result.code == 0, result.err
    named = [name for name in json.loads(result.out)["parameters"] if name.startswith("inertia[")]
    assert len(named) == 2
