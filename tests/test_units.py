"""A fit and a verdict are the same in every unit of torque, angle and time."""

from __future__ import annotations

import pytest
from rescaled import apart, rescaled
from rough_logs import rough_log

from diagnosis import diagnose
from identification.fit import fit

SEEDS = (0, 1, 2, 3, 5, 6, 7, 9, 11, 12, 13, 14, 17, 18, 19, 20, 23, 24, 25, 26)
ON_LINEAR = {"torque": (1e3, 1e-3), "angle": (1e-3, 1e3), "time": (1e-3, 1e3)}
"""Small and large factors by turns; of a rotary axis cos x fixes the unit of the angle."""


def factors(seed: int, axis: str) -> dict[str, float]:
    return {
        name: pair[(seed + place) % 2]
        for place, (name, pair) in enumerate(ON_LINEAR.items())
        if axis == "linear" or name != "angle"
    }


@pytest.mark.parametrize("seed", SEEDS)
def test_a_fit_is_the_same_in_other_units(seed: int) -> None:
    rough = rough_log(seed, longest=600)
    scales, log = factors(seed, rough.axis), rough.log()
    here, there = fit(log), fit(rescaled(log, **scales))
    assert here.failed is None
    assert here.unidentifiable == there.unidentifiable
    assert apart(here, there, **scales) < 1e-6


@pytest.mark.parametrize("seed", [2, 5, 11])
def test_a_verdict_is_the_same_in_other_units(seed: int) -> None:
    rough = rough_log(seed, longest=400)
    scales, log = factors(seed, rough.axis), rough.log()
    here, there = (
        diagnose(one, candidates=("coulomb_friction", "torque_offset")) for one in (log, rescaled(log, **scales))
    )
    assert here.verdict == there.verdict
    assert [c.effect for c in here.causes] == [c.effect for c in there.causes]
    for one, other in zip(here.causes, there.causes, strict=True):
        assert other.probability == pytest.approx(one.probability, abs=1e-3)
        for name, estimate in one.parameters.items():
            assert other.parameters[name].value == pytest.approx(scales["torque"] * estimate.value, rel=1e-3)
