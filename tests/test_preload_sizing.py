"""Preload sizing on the rig: what T_min must cover, beside what is known of this machine and why it is so."""

from __future__ import annotations

import json
import tomllib
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from antidrive.cli import main
from antidrive.experiments.preload_sizing import STRATEGIES, Sizing, SizingSettings, _Loop, experiment
from antidrive.experiments.settings import read_settings
from antidrive.scenario import scenario_text
from plant.errors import BadParameter

EQUAL, SLAVE = (STRATEGIES.index(name) for name in ("equal split", "constant slave"))
ONE_MESH = {
    "stiffnesses = [2e3, 5e3, 2e4]": "stiffnesses = [5e3]",
    "noises = [0.0, 5e-5, 2e-4]": "noises = [0.0, 2e-4]",
    "bandwidths = [4.0, 8.0, 16.0]": "bandwidths = [8.0, 16.0]",
}


def changed(changes: dict[str, str]) -> str:
    text = scenario_text("preload-sizing")
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    return text


def sized(changes: dict[str, str]) -> SizingSettings:
    return read_settings(SizingSettings, "preload-sizing", tomllib.loads(changed(changes)))


@cache
def found() -> Sizing:
    return experiment(sized(ONE_MESH), 0)


def test_the_formulas_are_those_of_statics() -> None:
    assert found().formula == pytest.approx([0.5 * 0.4 * 60, 0.55 * 60 + 2.0], rel=1e-4)
    pushed = sized({"load_torque = 0.0": "load_torque = -5.0"}).formulas()
    assert pushed == pytest.approx([0.5 * (0.4 * 60 + 5.0), 0.55 * 60 + 5.0 + 2.0], rel=1e-4)


def test_what_is_known_of_this_machine_is_found_again() -> None:
    """Elsewhere an elastic mesh, not stated, lost contact at 12.0 N m and kept it at 12.3; the slave needed 38."""
    quiet = found().noises == 0.0
    assert np.all(found().preload[quiet, EQUAL] > 12.0)
    assert np.all(found().preload[quiet, EQUAL] <= 12.3)
    assert np.all(found().preload[quiet, SLAVE] > 37.0)
    assert np.all(found().preload[quiet, SLAVE] <= 38.1)


def test_less_than_what_was_found_loses_contact() -> None:
    settings = sized(ONE_MESH)
    rigs = [settings.machine(mesh, noise) for mesh, noise in zip(found().meshes, found().noises, strict=True)]
    for strategy, shares in ((EQUAL, [0.5, 0.5]), (SLAVE, [0.0, 1.0])):
        loop = _Loop(settings, rigs * 2, np.tile(found().bandwidths, 2), np.tile(shares, (len(rigs) * 2, 1)), 0)
        least = found().preload[:, strategy]
        kept = loop.keeps(np.concatenate((least + 0.5, least - 0.2)))
        assert kept[: len(rigs)].all()
        assert not kept[len(rigs) :].any()


@pytest.mark.long
def test_preload_beyond_the_formula_is_the_friction_of_the_drive() -> None:
    smooth = experiment(sized({**ONE_MESH, "motor_coulomb = 0.0201551": "motor_coulomb = 0.0"}), 0)
    quiet = found().noises == 0.0
    assert np.all(found().least[quiet, SLAVE] > 2.0)
    assert np.all(smooth.least[quiet, SLAVE] < 0.2)
    assert smooth.formula[SLAVE] == pytest.approx(33.0, rel=1e-4)


def test_noise_asks_for_more() -> None:
    quiet, noisy = (found().least[(found().noises == n) & (found().bandwidths == 16.0), EQUAL] for n in (0.0, 2e-4))
    assert noisy > quiet + 0.2


def test_the_torque_of_the_noise_is_what_the_loop_makes_of_it() -> None:
    """Oracle: the loop's two lines of arithmetic on white noise of two motors."""
    rng, w, dt, inertia = np.random.default_rng(0), 2 * np.pi * 8.0, 5e-4, 0.4 + 2 * 0.15
    noise = 2e-4 * rng.standard_normal((100_000, 2)).mean(axis=1)
    keep, rate = np.exp(-10 * w * dt), np.zeros(noise.size)
    for k in range(1, noise.size):
        rate[k] = keep * rate[k - 1] + (1 - keep) * (noise[k] - noise[k - 1]) / dt
    torque = inertia * w**2 * noise + 1.4 * inertia * w * rate
    place = int(np.flatnonzero((found().noises == 2e-4) & (found().bandwidths == 8.0))[0])
    noise_by_motor = 2e-4 * np.sqrt(0.5)
    assert np.std(noise) == pytest.approx(noise_by_motor, rel=0.02)
    assert found().noise_torque[place] == pytest.approx(np.std(torque), rel=0.02)


def test_the_command_writes_numbers_and_a_page(tmp_path: Path) -> None:
    own = {**ONE_MESH, "noises = [0.0, 2e-4]": "noises = [0.0]", "[8.0, 16.0]": "[8.0]"}
    (tmp_path / "own.toml").write_text(changed(own))
    assert main(["simulate", str(tmp_path / "own.toml"), "--out", str(tmp_path / "out"), "--quiet"]) == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["formula"] == pytest.approx([12.0, 35.0], rel=1e-4)
    (case,) = summary["cases"]
    assert case["least_preload"] == pytest.approx(found().preload[0], abs=0.06)
    assert np.subtract(case["least_preload"], case["least_min_torque"]) == pytest.approx(summary["formula"])
    page = (tmp_path / "out" / "report.html").read_text()
    assert f"{case['least_preload'][EQUAL]:.2f} ({case['least_min_torque'][EQUAL]:+.2f})" in page
    assert "An experiment in the test-bench simulation" in page
    assert ">paper</th>" not in page


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("periods = 2.5", "periods = 1.5", "periods"),
        ("0.0, 5e-5", "-1.0, 5e-5", "noises"),
        ("[rig]", "[rig]\nflank_damping = 3.0", "flank_damping"),
        ("2e3, 5e3", "0.0, 5e3", "stiffnesses"),
    ],
)
def test_a_bad_sizing_is_named(old: str, new: str, complaint: str) -> None:
    with pytest.raises(BadParameter, match=complaint):
        sized({old: new})
