"""model.json: what is written is read again, and what cannot be read is refused in one sentence."""

from __future__ import annotations

import copy
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plant import BadModelFile, ModelFile, ServoModel, catalogue, read_model
from plant.effects import Effect, Stage
from plant.effects.effect import parameter
from plant.units import factor

EVERY = {
    "input_delay": {"time": 0.0123},
    "actuator_lag": {"time_constant": 0.03},
    "dead_zone": {"half_width": 0.5},
    "torque_offset": {"torque": -0.2},
    "coulomb_friction": {"torque": 0.15},
    "asymmetric_friction": {"forward": 0.2, "backward": 0.1, "viscous_difference": -0.05},
    "stribeck_friction": {"coulomb": 0.2, "excess": 0.1, "velocity": 0.05},
    "quadratic_drag": {"drag": 0.02},
    "gravity_offset": {"beta": -0.1},
    "cogging": {"amplitude": 0.1, "order": 14.0, "phase": 0.3},
}


def effects() -> tuple[Effect, ...]:
    return tuple(catalogue[name](**values) for name, values in EVERY.items())


@pytest.mark.parametrize("effect", effects(), ids=lambda effect: effect.name)
def test_a_model_comes_back_to_the_last_digit(effect: Effect, tmp_path: Path) -> None:
    model = ServoModel(inertia=1 / 3, gravity=0.1, viscous_friction=2 / 7, effects=(effect,))
    std = {name: (None if i % 2 else 0.1 * (i + 1)) for i, name in enumerate(model.names)}
    source = ({"file": "log.csv", "sha256": "0" * 64},)
    ModelFile(model=model, std=std, sample_time=0.005, source=source).write(tmp_path / "model.json")
    found = read_model(tmp_path / "model.json")
    assert found.model == model
    assert (found.std, found.sample_time, found.source) == (std, 0.005, source)
    assert [path.name for path in tmp_path.iterdir()] == ["model.json"]


def test_a_disk_that_fills_up_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "model.json"
    ModelFile(model=ServoModel.paper(), std={}).write(path)
    before = path.read_bytes()

    def full(self: Path, text: str) -> int:
        with self.open("w") as file:
            file.write(text[:20])
        raise OSError("no space left")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(OSError, match="no space"):
        ModelFile(model=ServoModel(inertia=7.0, gravity=0.0), std={}).write(path)
    assert path.read_bytes() == before


def test_a_linear_axis_comes_back(tmp_path: Path) -> None:
    model = ServoModel(inertia=95.0, gravity=0.0, viscous_friction=200.0, axis="linear")
    ModelFile(model=model, std={}).write(tmp_path / "model.json")
    assert read_model(tmp_path / "model.json").model == model
    assert json.loads((tmp_path / "model.json").read_text())["parameters"]["inertia"]["unit"] == "kg"


GOOD: dict[str, Any] = ModelFile(model=ServoModel(effects=effects()), std={}, sample_time=0.005).to_dict()


def broken(*path: Any, value: Any = None, drop: bool = False) -> Any:
    content = copy.deepcopy(GOOD)
    place = content
    for step in path[:-1]:
        place = place[step]
    if drop:
        del place[path[-1]]
    else:
        place[path[-1]] = value
    return content


BAD: dict[str, tuple[Any, str]] = {
    "a list": ([1, 2], "object"),
    "nothing": (None, "object"),
    "no schema": (broken("schema", drop=True), "schema"),
    "schema of the future": (broken("schema", value=99), "schema is 99"),
    "schema is a flag": (broken("schema", value=True), "schema"),
    "no parameters": (broken("parameters", drop=True), "parameters"),
    "parameters are a list": (broken("parameters", value=[]), "parameters"),
    "inertia is missing": (broken("parameters", "inertia", drop=True), "'inertia' is missing"),
    "inertia is text": (broken("parameters", "inertia", "value", value="2"), "inertia"),
    "inertia is a flag": (broken("parameters", "inertia", "value", value=True), "inertia"),
    "inertia is negative": (broken("parameters", "inertia", "value", value=-2.0), "inertia"),
    "inertia is too long for a float": (broken("parameters", "inertia", value=10**400), "inertia"),
    "an unknown parameter": (broken("parameters", "mass", value=1.0), "mass"),
    "an unknown effect": (broken("effects", 0, "name", value="magic"), "magic"),
    "the name of an effect is a list": (broken("effects", 0, "name", value=[]), "unknown effect"),
    "the name of an effect is a number": (broken("effects", 0, "name", value=3), "unknown effect"),
    "effects are an object": (broken("effects", value={}), "effects"),
    "an effect is text": (broken("effects", 1, value="dead_zone"), r"effects\[1\]"),
    "an effect twice": (broken("effects", value=[GOOD["effects"][2]] * 2), "dead_zone"),
    "an effect out of its bounds": (
        broken("effects", 2, "parameters", "half_width", value={"value": -1.0}),
        "half_width",
    ),
    "an effect without parameters": (broken("effects", 2, "parameters", drop=True), "parameters"),
    "no such axis": (broken("axis", value="spiral"), "spiral"),
    "sample time zero": (broken("sample_time", value=0), "sample_time"),
    "sample time in words": (broken("sample_time", value="5 ms"), "sample_time"),
    "source is text": (broken("source", value="log.csv"), "source"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_file_is_refused_where_it_is_bad(name: str, tmp_path: Path) -> None:
    content, match = BAD[name]
    path = tmp_path / "model.json"
    path.write_text(json.dumps(content))
    with pytest.raises(BadModelFile, match=match) as caught:
        read_model(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["", "{", "NaN", "[" * 100_000, '{"schema": 1, "parameters": {"inertia": NaN}}'])
def test_what_is_not_json_is_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "model.json"
    path.write_text(text)
    with pytest.raises(BadModelFile):
        read_model(path)


def test_bytes_and_folders_are_refused(tmp_path: Path) -> None:
    (tmp_path / "model.json").write_bytes(b"\xff\xfe\x00")
    for path in (tmp_path / "model.json", tmp_path, tmp_path / "absent.json"):
        with pytest.raises(BadModelFile):
            read_model(path)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_a_byte_order_mark_is_no_part_of_the_model(encoding: str, tmp_path: Path) -> None:
    (tmp_path / "model.json").write_bytes(json.dumps(GOOD).encode(encoding))
    assert read_model(tmp_path / "model.json").model.values == pytest.approx(ServoModel(effects=effects()).values)


@pytest.mark.parametrize(
    ("place", "unit", "value", "std"),
    [
        (("parameters", "inertia"), "g m^2", 2e-3, 1e-4),
        (("parameters", "inertia"), "N m s^2/rad", 2.0, 0.1),
        (("parameters", "viscous_friction"), "mNm s/rad", 2e-3, 1e-4),
        (("effects", 0, "parameters", "time"), "ms", 2e-3, 1e-4),
        (("parameters", "gravity"), "kg", None, None),
        (("parameters", "gravity"), "V", None, None),
        (("parameters", "gravity"), "furlong", None, None),
        (("parameters", "gravity"), "9**9**9", None, None),
        (("parameters", "gravity"), "", None, None),
        (("parameters", "gravity"), 3, None, None),
    ],
)
def test_another_unit_is_converted_or_refused(
    place: tuple[Any, ...], unit: Any, value: float | None, std: float | None, tmp_path: Path
) -> None:
    (tmp_path / "model.json").write_text(json.dumps(broken(*place, value={"value": 2.0, "std": 0.1, "unit": unit})))
    if value is None:
        with pytest.raises(BadModelFile, match=r"gravity: the unit .* 'N m'.*\.$"):
            read_model(tmp_path / "model.json")
        return
    found = read_model(tmp_path / "model.json")
    name = place[-1] if place[0] == "parameters" else f"input_delay.{place[-1]}"
    assert found.model.values[found.model.names.index(name)] == pytest.approx(value)
    assert found.std[name] == pytest.approx(std)


@pytest.mark.parametrize(("unit", "own"), [("Hz", "rad/s"), ("rad/s", "Hz"), ("rpm", "Hz")])
def test_turns_a_second_are_not_taken_for_radians(unit: str, own: str) -> None:
    with pytest.raises(BadModelFile):
        factor(unit, own)


@dataclass(frozen=True, kw_only=True)
class Windage(Effect):
    """A fan on the shaft."""

    name = "windage"
    title = "windage"
    stage = Stage.LOAD
    drag: float = parameter("{torque} s^3/{angle}^3", "drag", lower=0.0)


def test_an_own_effect_is_restored_with_its_class(tmp_path: Path) -> None:
    model = ServoModel(effects=(Windage(drag=0.02),))
    ModelFile(model=model, std={"windage.drag": 0.001}).write(tmp_path / "model.json")
    found = read_model(tmp_path / "model.json", effects=[Windage])
    assert (found.model, found.std["windage.drag"]) == (model, 0.001)
    with pytest.raises(BadModelFile, match=r"unknown effect 'windage'.*--effects FILE\.py"):
        read_model(tmp_path / "model.json")


scalars = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5)
anything = st.recursive(
    scalars, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3)
)


@settings(max_examples=150, deadline=None)
@given(place=st.sampled_from([*GOOD, "parameters/inertia", "effects/0/name", "effects/2/parameters"]), junk=anything)
def test_any_junk_gives_a_model_or_one_sentence(tmp_path_factory: Any, place: str, junk: Any) -> None:
    steps = [int(s) if s.isdigit() else s for s in place.split("/")]
    path = tmp_path_factory.getbasetemp() / "junk.json"
    path.write_text(json.dumps(broken(*steps, value=junk)))
    message = ""
    try:
        read_model(path)
    except BadModelFile as error:
        message = str(error).replace(repr(junk), "junk")
    assert "\n" not in message


@pytest.mark.parametrize(("key", "kind"), [("verdict", "a diagnosis"), ("log_likelihood", "a fit")])
def test_another_file_of_ours_is_called_by_its_name(key: str, kind: str, tmp_path: Path) -> None:
    path = tmp_path / "diagnosis.json"
    path.write_text(json.dumps({"schema": 2, key: 1}))
    with pytest.raises(BadModelFile, match=f"this is {kind}; give the model.json"):
        read_model(path)


def test_a_model_that_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "taken").mkdir()
    with pytest.raises(OSError, match="taken"):
        ModelFile(model=ServoModel(), std={}).write(tmp_path / "taken")
    assert [each.name for each in tmp_path.iterdir()] == ["taken"]
