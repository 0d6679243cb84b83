"""An experiment that is run again: numbers that noise moves have their scatter, and the others stand as they are."""

from __future__ import annotations

import re

import pytest

from antidrive.experiments.outcome import Outcome
from antidrive.experiments.scatter import with_scatter
from antidrive.scenario_file import read_scenario_file


def outcome(*sentences: str, cell: str = "") -> Outcome:
    return Outcome(title="", results=sentences, comparison=[("a", "", cell)], found={}, columns={}, pictures=[])


def test_numbers_that_differ_have_their_scatter() -> None:
    runs = [outcome(f"Of 3 gaps {gap} mrad, {sure} +- 0.2 s, is {sign} N.", cell=f"{gap} mrad") for gap, sure, sign in (
        ("1.10", "7.1", "+0.4"), ("1.20", "7.2", "+0.6"), ("1.30", "7.3", "+0.2"))]  # fmt: skip
    merged = with_scatter(runs)
    assert merged.results[0] == "Of 3 gaps 1.10 ± 0.10 mrad, 7.1 +- 0.2 s, is +0.40 ± 0.20 N."
    assert merged.comparison == [("a", "", "1.10 ± 0.10 mrad")]
    assert "over 3 runs" in merged.results[1]


@pytest.mark.parametrize("others", [[], [outcome("Held for 12 samples.")], [outcome("Lost after 12 samples.")]])
def test_what_does_not_differ_or_reads_otherwise_stays(others: list[Outcome]) -> None:
    first = outcome("Held for 12 samples.")
    assert with_scatter([first, *others]).results == list(first.results) if others else first.results


def test_a_measurement_on_the_rig_has_a_standard_error() -> None:
    one = read_scenario_file("figure6").run(None, 0)
    assert re.search(r"measured as (\S+ ± \S+, ){2}\S+ ± \S+ mrad", one.sentences()[0])
    for gap, found in zip((0.29, 1.16, 4.65), re.findall(r"(\S+) ± (\S+?),? ", one.sentences()[0])[:3], strict=True):
        value, std = map(float, found)
        assert abs(value - gap) < 5.0 * std < 0.1 * max(gap, 1.0)
