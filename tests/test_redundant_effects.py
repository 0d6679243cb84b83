"""An effect that gains nothing beside the exact fit of what no effect explains is not named."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

from drawn_machines import drawn

from diagnosis import diagnose


def test_what_a_curve_elsewhere_makes_needless_is_ruled_out() -> None:
    """An eccentric encoder was sure: beside the linearised discrepancy, but not beside a ripple of the torque.

    The ripple is that of a gravity offset, which is no candidate here. The torque offset is there.
    """
    made = drawn(101452)
    assert {each["name"] for each in made.facts()["truth"]} == {"gravity_offset", "torque_offset"}
    found = diagnose(made.log, candidates=["encoder_eccentricity", "torque_offset"])
    assert (found.verdict, [cause.effect for cause in found.causes]) == ("unknown", ["torque_offset"])
    reasons = {each.effect: each.reason for each in found.rejected}
    assert reasons["encoder_eccentricity"] == "it explains nothing beside a ripple over the angle"
