"""Whatever happens to the controller: bounds to the last bit, an honest status, and back again. 100,000 samples of it
are run by benchmarks/mpc_never_lost.py."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest
from mishaps import GEARS, MISHAPS, PATIENCE, broken_promises, life

from mpc import Controller
from plant import ServoModel, machine_code
from plant.effects import InputDelay

FORMS = [False] if machine_code.compiler() is None else [True, False]
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


@pytest.mark.parametrize("compiled", FORMS)
@pytest.mark.parametrize("value", [np.nan, np.inf, -1e300, 1e5])
@pytest.mark.parametrize("name", ["plan", "path", "numbers", "load", "bounds", "belief", "preload"])
def test_a_spoilt_memory_heals(name: str, value: float, compiled: bool) -> None:
    controller = Controller(ServoModel(), GEARS, preload_rate=1.0)
    if not compiled:
        controller._step = controller._interpreted
    for _ in range(3):
        controller.step(0.1, np.full(31, 0.1))
    controller._arrays[name][:] = value
    for k in range(25):
        control = controller.step(0.1, np.full(31, 0.1) if k % 2 else 0.1)
        assert np.all(control.predicted_torques * [1, -1] >= 0.02)
        assert np.all(control.predicted_torques * [1, -1] <= 0.3)
        assert np.isfinite(control.margin)
    assert control.status == "optimal"
    assert control.predicted_angle == pytest.approx(np.full(31, 0.1), abs=1e-3)
