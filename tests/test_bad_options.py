"""Options, models and scenarios that cannot be used: one sentence on stderr, exit code 2, nothing written."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from front_door import PLAIN, antidrive, columns, listing, write_csv, write_model
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from antidrive.scenario import NAMES, parse_scenario, read_scenario
from antidrive.simulation import run_scenario
from plant import AntidriveError, BadModelFile, read_model
from plant.model_file import ModelFile


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Path:
    """A folder with a log, a good and many bad files, and an output folder that somebody already uses."""
    folder = tmp_path_factory.mktemp("bad")
    table = columns(PLAIN, duration=4.0)
    write_csv(folder / "log.csv", table)
    write_csv(folder / "still.csv", table | {"torque": 0 * table["time"], "angle": 0 * table["time"]})
    write_csv(folder / "short.csv", {name: column[:5] for name, column in table.items()})
    write_csv(folder / "back.csv", table | {"time": table["time"][::-1]})
    write_csv(folder / "nameless.csv", {"a": table["time"], "b": table["torque"], "c": table["angle"]})
    write_model(folder / "model.json")
    (folder / "empty.csv").write_text("")
    (folder / "header.csv").write_text("time,torque,angle\n")
    (folder / "words.csv").write_text("time,torque,angle\n0,1,2\n0.01,oops,3\n0.02,1,2\n")
    (folder / "log.xyz").write_text("time,torque,angle\n")
    (folder / "noise.mat").write_bytes(bytes(range(256)) * 8)
    (folder / "noise.npz").write_bytes(b"PK\x03\x04" + bytes(100))
    (folder / "noise.parquet").write_bytes(b"PAR1" + bytes(50))
    (folder / "hollow").mkdir()
    (folder / "file-in-the-way").write_text("mine")
    for name, text in BAD_MODELS.items():
        (folder / f"{name}.json").write_text(text)
    for name, text in BAD_SCENARIOS.items():
        (folder / f"{name}.toml").write_text(text)
    (folder / "out").mkdir()
    (folder / "out" / "model.json").write_text("mine")
    return folder


def model_with(**changes: object) -> str:
    content = ModelFile(model=PLAIN, std={}).to_dict() | changes
    return json.dumps({key: value for key, value in content.items() if value != "gone"})


OWN = {"inertia": 1.0, "gravity": 0.5, "viscous_friction": 0.1}
BAD_MODELS = {
    "no-json": "inertia = 2",
    "list": "[1, 2]",
    "no-schema": model_with(schema="gone"),
    "newer": model_with(schema=99),
    "no-parameters": model_with(parameters="gone"),
    "missing-inertia": model_with(parameters={"gravity": 1.0, "viscous_friction": 0.1}),
    "nan-inertia": model_with(parameters=OWN | {"inertia": float("nan")}),
    "text-inertia": model_with(parameters=OWN | {"inertia": {"value": "two"}}),
    "negative-inertia": model_with(parameters=OWN | {"inertia": -1.0}),
    "extra-parameter": model_with(parameters=OWN | {"mass": 1.0}),
    "unknown-effect": model_with(effects=[{"name": "gremlins", "parameters": {}}]),
    "effect-without-number": model_with(effects=[{"name": "coulomb_friction", "parameters": {}}]),
    "negative-friction": model_with(effects=[{"name": "coulomb_friction", "parameters": {"torque": -1.0}}]),
    "twice": model_with(effects=[{"name": "coulomb_friction", "parameters": {"torque": 1.0}}] * 2),
    "effects-no-list": model_with(effects={"name": "cogging"}),
    "odd-axis": model_with(axis="curved"),
    "heavy-linear": model_with(axis="linear"),
    "zero-sample-time": model_with(sample_time=0),
    "deep": "[" * 100_000,
}
HEAD = 'duration = 1.0\nsample_time = 0.005\nreference = { kind = "constant", level = 0.0 }\n'
BAD_SCENARIOS = {
    "no-toml": "duration == 3",
    "unknown-key": HEAD + "speed = 3\n",
    "no-reference": "duration = 1.0\nsample_time = 0.005\n",
    "odd-reference": HEAD.replace("constant", "spiral"),
    "reference-key": HEAD.replace("level = 0.0", "level = 0.0, frequency = 1.0"),
    "no-level": HEAD.replace(", level = 0.0", ""),
    "empty-levels": HEAD.replace('"constant", level = 0.0', '"steps", levels = [], hold = 1.0'),
    "text-duration": HEAD.replace("1.0", '"long"'),
    "nan-duration": HEAD.replace("1.0", "nan"),
    "negative-duration": HEAD.replace("1.0", "-1.0"),
    "endless": HEAD.replace("1.0", "1e9"),
    "true-duration": HEAD.replace("1.0", "true"),
    "rig-key": HEAD + "[rig]\nweight = 3\n",
    "rig-negative": HEAD + "[rig]\ninertia = -3\n",
    "rig-no-table": HEAD + "rig = 3\n",
    "stiff": HEAD + "[rig]\nflank_stiffness = 1e12\n",
    "controller-key": HEAD + "[controller]\ngain = 3\n",
    "crossed-limits": HEAD + "[controller]\nmin_torque = 0.4\nmax_torque = 0.3\n",
    "half-horizon": HEAD + "[controller]\nhorizon = 2.5\n",
    "third-drive": HEAD + "[drive_loss]\ndrive = 3\ntime = 0.5\n",
    "half-disturbance": HEAD + "[disturbance]\ntorque = 1.0\n",
    "maybe": HEAD + 'compare_single_drive = "maybe"\n',
}

CASES: dict[str, tuple[str, str]] = {
    # the words of the command line
    "unknown command": ("fly log.csv", "fly"),
    "unknown option": ("identify log.csv --speed 3 --out out", "--speed"),
    "option without value": ("identify log.csv --out", "--out"),
    "no log": ("identify --out out", "No log is given"),
    "no model": ("predict", "MODEL.json"),
    "no torque": ("allocate", "TORQUE"),
    "negative seed": ("identify log.csv --seed -1 --out out", "--seed"),
    "text seed": ("identify log.csv --seed x --out out", "--seed"),
    "text window": ("predict model.json log.csv --window x --out out.csv", "--window"),
    "text joint": ("diagnose --dataset ur10e --data hollow --joint x --out out", "--joint"),
    "a word with what comes near": ("diagnoze log.csv", "diagnose"),
    "a missing word": ("table friction", "See `antidrive table --help`"),
    # options that mean nothing where they stand
    "no candidates": ("diagnose log.csv --candidates , --out out", "--candidates is empty"),
    "parameter with what comes near": ("identify log.csv --fixed Inertia=1 --out out", "did you mean inertia?"),
    "effect by its title": ("effects Coulomb-friction", "did you mean coulomb_friction?"),
    "held-out log that is fitted": ("diagnose log.csv --holdout log.csv --out out", "validates nothing"),
    "prediction as a text": ("predict model.json log.csv --out p.txt", "name it p.csv, p.parquet, p.json or p.xlsx"),
    "prediction as a compressed file": ("predict model.json log.csv --out p.csv.gz", "name it p.csv, p.parquet"),
    "page as a workbook": ("predict model.json log.csv --out p.csv --report p.xlsx", "name it p.html"),
    **{
        f"folder named {name}": (f"{words} --out {name}", "name a folder")
        for name, words in {
            "model.json": "identify log.csv",
            "log.toml": "inspect log.csv",
            "report.html": "diagnose log.csv",
            "loop.csv": "simulate tracking",
            "table.h": "table friction model.json",
            "servo.urdf": "export model.json --urdf",
        }.items()
    },
    "page into a folder": ("predict model.json log.csv --report out --out p.csv", "--report out"),
    "controller's option for MuJoCo": ("export model.json --mujoco --bandwidth 3 --out out", "--bandwidth"),
    "precision of a URDF": ("export model.json --urdf --single --out out", "--single"),
    "gears of a feedforward": ("export model.json --feedforward --gears 20,20:161 --out out", "--gears"),
    "name with a quotation mark": ('export model.json --urdf --name a"b --out out', "--name"),
    **{
        f"{form} of 300 letters": (f"export model.json --{form} --name {'a' * 300} --out out", "up to 40 letters")
        for form in ("feedforward", "mujoco", "urdf", "modelica", "plant", "fmu")
    },
    "name that begins with a digit": ("export model.json --mujoco --name 3x --out out", "--name"),
    "points of a number": ("table dead-time model.json --points 5 --out out", "--points"),
    "range of a number": ("table backlash model.json --range 0:1 --out out", "--range"),
    "loop without a sample time": ("simulate tracking --sample-time 0 --out out", "sample_time"),
    "loop of a nan sample time": ("simulate tracking --sample-time nan --out out", "sample_time"),
    "loop of less than a sample": ("simulate tracking --sample-time 1000 --out out", "samples"),
    "loop that never ends": ("simulate tracking --sample-time 1e-9 --out out", "samples"),
    "torque that nothing gives": ("allocate 1e300", "beyond what a servo can have"),
    "ratio that no gear has": ("allocate 1 --ratio 1e-300", "beyond what a servo can have"),
    "turns that no gear has": ("allocate 1 --pre-reduction 1e300", "1e+300"),
    "limit that no drive has": ("capability --max-torque 1e300 --out out", "max_torque"),
    "table without end": ("table friction model.json --points 1000000000 --out out", "between 2 and"),
    "plan without end": ("plan --limits torque=2 --rate 1e9 --out plan.csv", "at most"),
    "angle that no sensor shows": ("predict model.json log.csv --scale angle=1e-300 --out p.csv", "no sensor"),
    "horizon without end": ("export model.json --horizon 1000000000 --out out", "horizon"),
    "bandwidth of nothing": ("export model.json --bandwidth 1e-9 --out out", "bandwidth"),
    "numbers that do not go together": ("export model.json --sample-time 1000 --out out", "out of proportion"),
    "plan as a workbook": ("plan --limits torque=2 --out plan.xlsx", "name it plan.csv"),
    "plan too slow": ("plan --limits torque=2 --rate 1 --out plan.csv", "at least 20"),
    # names, units, scales
    "map without equals": ("identify log.csv --map angle --out out", "column=value"),
    "map without name": ("identify log.csv --map =qm --out out", "column=value"),
    "map without target": ("identify log.csv --map angle= --out out", "column=value"),
    "map of one column to two": (
        "identify log.csv --map angle=torque --map torque=torque --out out",
        "both 'torque' and",
    ),
    "map twice": ("identify log.csv --map angle=a --map angle=b --out out", "twice"),
    "map of no column": ("identify log.csv --map speed=v --out out", "speed"),
    "map to a missing column": ("identify log.csv --map angle=qm --out out", "qm"),
    "unknown unit": ("identify log.csv --unit angle=furlong/fortnight/cat --out out", "angle"),
    "wrong kind of unit": ("identify log.csv --unit angle=kg --out out", "kg"),
    "scale is text": ("identify log.csv --scale torque=big --out out", "not a number"),
    "scale is divided by zero": ("identify log.csv --scale torque=1/0 --out out", "not a number"),
    "scale is zero": ("identify log.csv --scale torque=0 --out out", "torque"),
    "scale is nan": ("identify log.csv --scale torque=nan --out out", "torque"),
    # logs
    "missing log": ("identify absent.csv --out out", "absent.csv"),
    "log is a folder": ("identify hollow --out out", "hollow"),
    "empty log": ("identify empty.csv --out out", "empty.csv"),
    "header only": ("identify header.csv --out out", "header.csv"),
    "words in a column": ("diagnose words.csv --out out", "words.csv"),
    "nameless columns": ("diagnose nameless.csv --out out", "nameless.csv"),
    "unknown format": ("diagnose log.xyz --out out", "log.xyz"),
    "broken MAT": ("identify noise.mat --out out", "noise.mat"),
    "broken NPZ": ("identify noise.npz --out out", "noise.npz"),
    "broken Parquet": ("identify noise.parquet --out out", "noise.parquet"),
    "nothing moves": ("diagnose still.csv --out out", "still.csv"),
    "too short": ("diagnose short.csv --out out", "short.csv"),
    "missing held-out log": ("diagnose log.csv --holdout absent.csv --out out", "absent.csv"),
    # known data sets
    "unknown data set": ("diagnose --dataset moon --data hollow --out out", "moon"),
    "data set without folder": ("diagnose --dataset emps --out out", "--data"),
    "folder without data set": ("diagnose --data hollow --out out", "--dataset"),
    "joint without data set": ("diagnose log.csv --joint 2 --out out", "--joint 2"),
    "missing folder": ("diagnose --dataset emps --data absent --out out", "absent"),
    "hollow folder": ("diagnose --dataset emps --data hollow --out out", "hollow"),
    "data set and map": ("diagnose --dataset emps --data hollow --map a=b --out out", "--map"),
    "data set and held-out log": ("diagnose --dataset emps --data hollow --holdout log.csv --out out", "--holdout"),
    "joint that is not there": ("diagnose --dataset ur10e --data hollow --joint 99 --out out", ""),
    # numbers and places
    "negative window": ("predict model.json log.csv --window -1 --out out.csv", "window"),
    "window shorter than its start": ("predict model.json log.csv --window 0.1 --out out.csv", "window"),
    "model of another axis": ("predict axis.json log.csv --out out.csv", "axis"),
    "window is nan": ("predict model.json log.csv --window nan --out out.csv", "window"),
    "torque is nan": ("allocate 1 nan", "finite"),
    "torque is infinite": ("allocate inf", "finite"),
    "torque is text": ("allocate much", "TORQUE"),
    "limits cross": ("allocate 1 --min-torque 2 --max-torque 1", "min_torque"),
    "limit is negative": ("allocate 1 --min-torque -2", "min_torque"),
    "out is a file": ("identify log.csv --out file-in-the-way", "file-in-the-way"),
    "out is below a file": ("identify log.csv --out file-in-the-way/out", "file-in-the-way"),
    "prediction into a folder": ("predict model.json log.csv --out out", "folder"),
    "unknown scenario": ("simulate loop-the-loop --out out", "loop-the-loop"),
    "missing scenario": ("simulate absent.toml --out out", "absent.toml"),
    "scenario with missing model": ("simulate tracking --model absent.json --out out", "absent.json"),
    "missing base": ("diagnose log.csv --base absent.json --out out", "absent.json"),
    "base of another axis": ("identify log.csv --base axis.json --out out", "axis"),
    **{f"model {name}": (f"predict {name}.json log.csv --out out.csv", f"{name}.json") for name in BAD_MODELS},
    **{f"scenario {name}": (f"simulate {name}.toml --out out", "") for name in BAD_SCENARIOS},
}
BAD_MODELS["axis"] = json.dumps({"schema": 1, "axis": "linear", "parameters": OWN | {"gravity": 0.0}})


@pytest.mark.parametrize("case", CASES)
def test_prints_one_sentence_and_writes_nothing(case, place, monkeypatch):
    words, expected = CASES[case]
    monkeypatch.chdir(place)
    before = listing(place), sorted(place.rglob("*"))
    result = antidrive(*words.split())
    assert result.code == 2, result.err
    assert result.out == ""
    assert result.err.startswith("antidrive: ")
    sentence, *table = result.err.splitlines()
    assert not table or table[-1].startswith("Name them, for example: antidrive ")  # below the columns of the file
    assert "Traceback" not in result.err
    assert len(sentence) < 500
    assert expected in result.err
    assert (listing(place), sorted(place.rglob("*"))) == before


@pytest.mark.parametrize("name", BAD_SCENARIOS)
def test_a_bad_scenario_is_named(name, place):
    with pytest.raises(AntidriveError) as caught:
        run_scenario(read_scenario(str(place / f"{name}.toml")))
    assert str(caught.value).endswith((".", ")."))


@pytest.mark.parametrize("name", NAMES)
def test_the_scenarios_of_the_package_are_sound(name):
    plan = read_scenario(name)
    assert plan.name == name
    assert np.isfinite(plan.wanted(np.linspace(0.0, plan.duration, 50))).all()
    assert plan.machine().inertia == 2.0


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(list(OWN)) | st.text(max_size=5), inner)
    ),
    max_leaves=6,
)
keys = st.sampled_from(["schema", "axis", "parameters", "effects", "sample_time", "source", "x"])


@given(st.dictionaries(keys, values))
@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_json_is_a_model_or_one_sentence(tmp_path, changes):
    file = tmp_path / "model.json"
    file.write_text(json.dumps(json.loads(model_with()) | changes))
    sentence = ""
    try:
        found = read_model(file)
    except BadModelFile as error:
        sentence = str(error)
    assert sentence.startswith(str(file)) or np.isfinite(found.model.values).all()
    assert "\n" not in sentence


@given(st.text(max_size=60) | st.builds(lambda extra: HEAD + extra, st.text(max_size=40)))
@settings(max_examples=200, deadline=None)
def test_any_text_is_a_scenario_or_one_sentence(text):
    sentence = ""
    try:
        plan = parse_scenario("text.toml", text)
    except AntidriveError as error:
        sentence = str(error)
    assert sentence.startswith("text.toml: ") or plan.duration > 0
