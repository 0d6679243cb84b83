"""Scenarios that repeat the paper: their numbers, against the paper's and against what the machine was built with."""

from __future__ import annotations

import json
import re
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from antidrive.cli import main
from antidrive.experiments.outcome import Outcome
from antidrive.html_page import printed
from antidrive.scenario import scenario_text
from antidrive.scenario_file import read_scenario_file
from plant.errors import BadParameter
from plant.servo import ServoModel

NAMES = ("section3", "section4", "figure5", "figure6")
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e-?\d+)?")


@cache
def outcome(name: str) -> Outcome:
    result = read_scenario_file(name).run(None, 0)
    assert isinstance(result, Outcome)
    return result


def number(name: str, key: str) -> Any:
    return outcome(name).summary()[key]


def changed(name: str, folder: Path, *changes: tuple[str, str]) -> str:
    """A copy of a scenario with lines replaced, as a user would make it."""
    text = scenario_text(name)
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / "own.toml").write_text(text)
    return str(folder / "own.toml")


# Section 3.1.


def test_section_3_prints_the_papers_numbers() -> None:
    assert f"{number('section3', 'ratio'):.3f}" == "99.231"
    assert f"{number('section3', 'no_load_speed_deg'):.1f}" == "120.9"


def test_the_envelope_is_that_of_the_motors() -> None:
    """Oracle: U = R i + k w by hand; the rig is played, the formula is not asked."""
    table = outcome("section3").table()
    ratio, k, R, U = 161 / 20 * 46 / 18 * 41 / 17 * 42 / 21, 36 / (2000 * np.pi / 30), 20.0, 36.0
    friction, drag = 5e-4 * ratio, 1e-7 * ratio**2
    for row in table.itertuples():
        w = row.speed_both_rig
        motor = ratio * k / R * (U - k * ratio * w)
        assert 2 * (motor - friction - drag * w) == pytest.approx(row.load_torque, abs=1e-3)
        w = row.speed_held_rig
        motor = ratio * k / R * (U - k * ratio * w) - 0.02 * 161 / 20
        assert motor - 2 * (friction + drag * w) == pytest.approx(row.load_torque, abs=1e-3)
    assert number("section3", "largest_difference") < 1e-4
    assert number("section3", "stall_torque_preloaded") < 0.5 * number("section3", "stall_torque_both")


def test_section_4_asks_for_speeds_that_section_3_excludes() -> None:
    over = number("section3", "section4_speeds_over_limit")
    assert over == pytest.approx(np.array([5.65, 11.89, 18.12]) / (2000 * np.pi / 30 / 99.231), rel=1e-4)
    assert min(over) > 2.5


def test_another_train_has_another_envelope(tmp_path: Path) -> None:
    own = changed("section3", tmp_path, ("[46, 18, 41, 17, 42, 21]", "[46, 18, 41, 17]"), ("20.0, 25.0, 30.0", "12.0"))
    found = read_scenario_file(own).run(None, 0).summary()
    assert found["ratio"] == pytest.approx(99.2307 / 2, rel=1e-5)
    assert found["stall_torque_both"] == pytest.approx(number("section3", "stall_torque_both") / 2)
    assert found["largest_difference"] < 1e-4


# Section 4.


def test_the_papers_table_is_met_to_its_printed_digits() -> None:
    angles, speeds = number("section4", "angles"), number("section4", "speeds")
    assert [f"{angles[0]:.1f}", f"{angles[1]:.2f}", f"{angles[2]:.2f}"] == ["111.5", "236.05", "360.48"]
    assert speeds == pytest.approx([5.65, 11.89, 18.12], abs=0.02)  # nowhere nearer while the angles are these
    assert number("section4", "paper")["alpha"] == pytest.approx(0.0047, abs=2e-4)
    assert number("section4", "paper")["K"] == pytest.approx(0.80, abs=0.005)
    assert number("section4", "paper")["gamma"] == pytest.approx(0.47, abs=0.005)


def test_alpha_is_right_only_with_both_causes_corrected() -> None:
    assert abs(number("section4", "angles_in_radians")["alpha"]) < 0.02
    assert abs(number("section4", "inertia_torque_taken_along")["alpha"] - 0.5) > 0.1
    both = number("section4", "both")
    assert (both["alpha"], both["K"], both["gamma"]) == pytest.approx((0.5, 0.8, 0.5), abs=1e-6)
    # J x'' of the motion itself, by differences of the recorded speeds
    table = outcome("section4").table()
    row = round(22.4 / 0.005)
    for k in range(3):
        v = table[f"velocity_{k + 1}"].to_numpy()
        assert number("section4", "inertia_torques")[k] == pytest.approx(
            2.0 * (v[row + 1] - v[row - 1]) / 0.01, abs=5e-3
        )


def test_the_six_printed_numbers_alone_hold_alpha() -> None:
    found = number("section4", "fit_to_the_table")
    assert found["alpha"] == pytest.approx(0.5, abs=0.15)
    assert found["alpha_std"] < 0.2
    assert (found["K"], found["gamma"]) == pytest.approx((0.8, 0.5), abs=0.01)
    assert found["instant"] == pytest.approx(22.4, abs=0.02)


def test_the_trajectories_hold_alpha_to_a_percent() -> None:
    found = number("section4", "fit_to_the_trajectories")
    assert (found["alpha"], found["K"], found["gamma"]) == pytest.approx((0.5, 0.8, 0.5), rel=0.01)
    assert abs(found["alpha"] - 0.5) < 4 * found["alpha_std"] < 0.01


# Figures 4, 5 and equation (5).


def test_the_model_fits_the_machine_but_for_its_dry_friction() -> None:
    table = outcome("figure5").table()
    measured = table.measured_angle
    fit = 100 * (1 - np.linalg.norm(measured - table.angle_found_model) / np.linalg.norm(measured - measured.mean()))
    assert number("figure5", "fit_percent_found") == pytest.approx(fit)
    assert 85 < number("figure5", "fit_percent_paper") < 95 < fit < 99
    assert number("figure5", "fit_percent_dry_friction") > 99.9
    assert number("figure5", "dry_friction") == pytest.approx(2 * 5e-4 * 99.2307, rel=0.02)
    assert number("figure5", "inertia") == pytest.approx(2.0 + 2 * 4e-6 * 99.2307**2, rel=0.01)
    assert number("figure5", "contact_lost") is False


def test_equation_5_is_equation_4_to_first_order() -> None:
    assert number("figure5", "equation5_order") == pytest.approx(1.0, abs=0.05)
    # the printed recursion itself, at the longest step, from rest
    J, alpha, K, T = 2.0, 0.5, 0.8, 0.02
    t = np.arange(1000) * T
    tau = 4.0 * np.sin(2 * np.pi * (0.05 * t + 0.5 * 0.95 / 20.0 * t**2))
    x = [0.0, 0.0]
    for torque in tau:
        new = 2 * x[-1] - x[-2]
        for _ in range(20):
            new = (-alpha * T**2 * np.cos(new) + (2 * J + K * T) * x[-1] - J * x[-2] + T**2 * torque) / (J + K * T)
        x.append(new)
    exact = ServoModel(inertia=J, gravity=alpha, viscous_friction=K)
    from plant.simulation import simulate

    difference = np.max(np.abs(np.array(x[1:]) - simulate(exact, command=tau, dt=T, substeps=8)[:, 0]))
    assert number("figure5", "equation5_differences")[0] == pytest.approx(difference, rel=1e-3)


# Figure 6.


def test_backlash_is_read_off_the_curve_to_a_percent() -> None:
    assert number("figure6", "gaps") == pytest.approx([0.29e-3, 1.16e-3, 4.65e-3], rel=0.01)
    assert number("figure6", "stiffnesses") == pytest.approx([2e4] * 3, rel=0.02)


def test_the_dead_zone_in_torque_is_friction_and_not_backlash() -> None:
    assert number("figure6", "true_torque_dead_zone") == pytest.approx(5e-4 * 99.2307, rel=1e-5)
    assert number("figure6", "torque_dead_zones") == pytest.approx([5e-4 * 99.2307] * 3, abs=0.02)
    table = outcome("figure6").table()
    loading = (table.torque > 1.0) & (table.torque.diff() > 0.0) & (table.time > 4.0)
    for k in range(3):  # what is passed falls short by the friction, whatever the gap
        short = table.torque[loading] - table[f"passed_torque_{k + 1}"][loading]
        assert np.median(short) == pytest.approx(5e-4 * 99.2307, abs=0.012)


def test_what_backlash_costs_at_a_reversal_is_time() -> None:
    crossing, flight = number("figure6", "crossing_times"), number("figure6", "flight_times")
    J, rate = 4e-6 * 99.2307**2, 8.0  # a free rotor under a torque that grows evenly
    assert flight == pytest.approx(np.cbrt(6 * J * np.array([0.29e-3, 1.16e-3, 4.65e-3]) / rate), rel=1e-4)
    assert crossing == pytest.approx(flight, abs=0.003)  # samples of 2 ms


def test_more_friction_widens_one_dead_zone_and_not_the_other(tmp_path: Path) -> None:
    own = changed(
        "figure6",
        tmp_path,
        ("[rig]", "[rig]\nmotor_coulomb = 4e-3"),
        ("gaps = [0.29e-3, 1.16e-3, 4.65e-3]", "gaps = [2e-3]"),
    )
    found = read_scenario_file(own).run(None, 3).summary()
    assert found["torque_dead_zones"] == pytest.approx([4e-3 * 99.2307], rel=0.1)
    assert found["gaps"] == pytest.approx([2e-3], rel=0.01)


# All of them.


@pytest.mark.parametrize("name", NAMES)
def test_the_command_writes_numbers_trajectory_and_page(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["simulate", name, "--out", str(tmp_path / "out"), "--json"]) == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary == json.loads(capsys.readouterr().out)
    assert summary["synthetic"] is True
    assert set(summary) == set(outcome(name).summary())
    path = pd.read_csv(tmp_path / "out" / "trajectory.csv")
    assert np.isfinite(path.to_numpy()).all()
    assert len(path) == len(outcome(name).table())
    page = (tmp_path / "out" / "report.html").read_text()
    for row in outcome(name).comparison:
        for text in row:
            assert printed(text) in page
    assert page.count('class="plot"') == len(outcome(name).pictures) > 0


@pytest.mark.parametrize("name", NAMES)
def test_the_claims_table_matches_the_scenarios(name: str) -> None:
    table = Path(__file__).parents[1] / "benchmarks" / "results" / "paper_claims.txt"
    part = re.search(rf"^{name}: .*?\n\n(.*?)\n(?:\n|\Z)", table.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    assert part is not None
    outcome_text, kept = " ".join(outcome(name).sentences()), " ".join(part[1].split())
    assert NUMBER.sub("#", outcome_text) == NUMBER.sub("#", kept)
    found, written = ([float(n) for n in NUMBER.findall(text)] for text in (outcome_text, kept))
    assert found == pytest.approx(written, rel=0.02, abs=1e-3)


def test_every_file_of_the_package_is_a_scenario() -> None:
    names = [file.name.removesuffix(".toml") for file in files("antidrive").joinpath("scenarios").iterdir()]
    assert set(NAMES) < set(names)
    for name in names:
        assert read_scenario_file(name).name == name
    with pytest.raises(BadParameter, match="section4"):
        read_scenario_file("section5")


@pytest.mark.parametrize(
    ("name", "old", "new", "complaint"),
    [
        ("section3", 'kind = "gear_train"', 'kind = "perpetuum"', "perpetuum"),
        ("section3", 'kind = "gear_train"', "kind = 3", "kind is 3"),
        ("section3", "[46, 18, 41, 17, 42, 21]", "[46, 18, 41]", "pairs"),
        ("section3", "winding_resistance = 20.0", "winding_resistance = 0.0", "winding_resistance"),
        ("section3", "25.0, 30.0]", "25.0, 90.0]", "stalls"),
        ("section3", "pinion_teeth = 20", "pinion_teeth = 20.5", "whole number"),
        ("section3", "current_bandwidth", "bandwith", "bandwith"),
        ("section4", "[5.0, 10.0, 15.0]", "[5.0, 10.0]", "three numbers"),
        ("section4", "instant = 22.4", "instant = 99.0", "instant"),
        ("section4", "noise = 1e-3", "", "noise is missing"),
        ("section4", "noise = 1e-3", "noise = 1e-3\nspeed = 3", "speed"),
        ("figure5", "0.005, 0.0025]", "0.007]", "steps"),
        ("figure5", "sample_time = 0.005", "sample_time = 1e-9", "samples"),
        ("figure5", "[rig]", "[rig]\ninertia = 'heavy'", "inertia"),
        ("figure6", "brake = 12.0", "brake = 2.0", "brake"),
        ("figure6", "[0.29e-3, 1.16e-3, 4.65e-3]", "[]", "gaps"),
        ("figure6", "duration = 12.0", "duration = 1.0", "period"),
    ],
)
def test_a_bad_experiment_is_named(name: str, old: str, new: str, complaint: str, tmp_path: Path) -> None:
    own = changed(name, tmp_path, (old, new))
    with pytest.raises(BadParameter, match=complaint) as caught:
        read_scenario_file(own).run(None, 0)
    assert "\n" not in str(caught.value)


def test_an_experiment_takes_no_model() -> None:
    with pytest.raises(BadParameter, match="takes no --model"):
        read_scenario_file("section4").run(ServoModel.paper(), 0)
