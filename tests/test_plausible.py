"""Values that no such cause can have take no name: a spring that is soft over half of the travel is no end stop."""

from __future__ import annotations

import numpy as np
import pytest
from machine import Machine, excitation, record

from diagnosis import diagnose
from diagnosis.refit import is_plausible, refit
from diagnosis.round import Contestant, weighed
from identification.fit import base_model, fit
from plant.effects import CableStiffness, Effect, EndStop


@pytest.mark.parametrize(
    ("effect", "plausible"),
    [
        (EndStop(angle=3.0, stiffness=90.0), True),
        (EndStop(angle=-1.0, stiffness=-2.0), True),
        (EndStop(angle=3.0, stiffness=0.003), False),
        (EndStop(angle=3.0, stiffness=0.0), False),
        (CableStiffness(stiffness=0.01), True),
        (CableStiffness(stiffness=-0.01, cubic=0.02), False),
    ],
    ids=lambda value: f"{value.name} {value.stiffness}" if isinstance(value, Effect) else "",
)
def test_what_a_cause_can_be(effect: Effect, plausible: bool) -> None:
    assert effect.plausible(travel=9.0, speed=2.0, inertia=2.0) is plausible


def test_a_soft_spring_over_most_of_the_travel_is_a_cable_and_not_a_stop() -> None:
    """The stop fits as well, and pays for two parameters where the cable pays for three."""
    cable = Machine().hiding(cable_stiffness={"stiffness": 5.54e-6, "cubic": 1.108e-7, "rest_angle": 0.4})
    log, unseen = (record(cable, excitation(24000 + k, duration=30.0), seed=12000 + k).log() for k in (0, 1))
    found = diagnose(log, holdout=unseen)
    stop = next(c for c in found.candidates if c.effect == "end_stop")
    own = next(c for c in found.candidates if c.effect == "cable_stiffness")
    assert own.evidence - 1.0 < stop.evidence < own.evidence + 3.0
    assert not stop.plausible
    assert stop.probability == 0.0
    assert [cause.effect for cause in found.causes] == ["cable_stiffness"]
    assert "End stop would fit only with values that such a cause cannot have." in str(found.explain())


def test_where_none_is_plausible_nothing_is_named() -> None:
    log = record(Machine().hiding(torque_offset={"torque": 0.2}), excitation(2, duration=20.0)).log()
    base = fit(log, base_model(log))
    pulled = refit(base, CableStiffness(stiffness=-1e-3, rest_angle=50.0), fixed=("cable_stiffness.stiffness",))
    assert not is_plausible(pulled, "cable_stiffness")
    own = Contestant.of(pulled, "cable_stiffness", coefficients=3, charge=0.0)
    assert own.visible(pulled, base) > 50.0
    assert weighed({"cable_stiffness": own}, {"cable_stiffness": pulled}, base) == {"none": 1.0, "cable_stiffness": 0.0}
    assert np.isfinite(pulled.log_likelihood)
