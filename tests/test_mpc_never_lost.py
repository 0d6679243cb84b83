"""Whatever happens to the controller: bounds to the last bit, an honest status, and back again. 100,000 samples of it
are run by benchmarks/mpc_never_lost.py."""

from __future__ import annotations

from itertools import islice

import pytest
from mishaps import GEARS, MISHAPS, PATIENCE, broken_promises, life

from mpc import Controller
from plant import ServoModel
from plant.effects import InputDelay

LATE = ServoModel().with_effect(InputDelay(time=0.012))


@pytest.mark.parametrize(
    ("model", "rotor", "compiled"),
    [(ServoModel.paper(), 0.0, True), (ServoModel(), 1e-5, True), (LATE, 0.0, True), (ServoModel.paper(), 0.0, False)],
    ids=["paper", "heavy rotors", "delay", "without machine code"],
)
def test_it_is_never_lost(model: ServoModel, rotor: float, compiled: bool) -> None:
    controller = Controller(model, GEARS, rotor_inertia=rotor)
    if not compiled:
        controller._step = controller._interpreted
    met = set()
    for sample in islice(life(model, controller, seed=1), 5000 if compiled else 2500):
        met.add(sample.mishap)
        assert broken_promises(controller, sample) == []
        assert sample.calm < PATIENCE
    assert met >= set(MISHAPS) or not compiled
