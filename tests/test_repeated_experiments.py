"""An experiment that is run again: numbers that noise moves have their scatter, and the others stand as they are."""

from __future__ import annotations

import re

import pytest

from antidrive.experiments.outcome import Outcome
from antidrive.experiments.scatter import with_scatter
from antidrive.scenario_file import read_scenario_file


def told(*said: str, cell: str = "") -> Outcome:
    return Outcome(title="", said=said, comparison=[("a", "", cell)], found={}, columns={}, pictures=[])


def test_numbers_that_differ_have_their_scatter() -> None:
    runs = [told(f"Of 3 gaps {gap} mrad, {sure} +- 0.2 s, is {sign} N.", cell=f"{gap} mrad") for gap, sure, sign in (
        ("1.10", "7.1", "+0.4"), ("1.20", "7.2", "+0.6"), ("1.30", "7.3", "+0.2"))]  # fmt: skip
    merged = with_scatter(runs)
    assert merged.said[0] == "Of 3 gaps 1.10 ± 0.10 mrad, 7.1 +- 0.2 s, is +0.40 ± 0.20 N."
    assert merged.comparison == [("a", "", "1.10 ± 0.10 mrad")]
    assert "over 3 runs" in merged.said[1]


@pytest.mark.parametrize("others", [[], [told("Held for 12 samples.")], [told("Lost after 12 samples.")]])
def test_what_does_not_differ_or_says_something_else_stays(others: list[Outcome]) -> None:
    first = told("Held for 12 samples.")
    assert with_scatter([first, *others]).said == list(first.said) if others else first.said


def test_a_measurement_on_the_rig_says_how_sure_it_is() -> None:
    one = read_scenario_file("figure6").run(None, 0)
    assert re.search(r"measured as (\S+ ± \S+, ){2}\S+ ± \S+ mrad", one.sentences()[0])
    for gap, found in zip((0.29, 1.16, 4.65), re.findall(r"(\S+) ± (\S+?),? ", one.sentences()[0])[:3], strict=True):
        value, std = map(float, found)
        assert abs(value - gap) < 5.0 * std < 0.1 * max(gap, 1.0)
