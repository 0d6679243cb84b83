"""A number is a number, whichever library it comes from, and is kept as Python's own."""

from __future__ import annotations

import json

import numpy as np
import pytest

from allocation import Allocator, Bounds
from mpc import Controller
from mpc.trajectory import minimum_copper_loss
from plant import BadParameter, GearTrain, ModelFile, Rig, ServoModel, simulate
from plant.effects import CoulombFriction

FLOATS = (float, np.float16, np.float32, np.float64, np.longdouble)
WHOLE = (int, np.uint8, np.int32, np.int64)
GEARS = GearTrain.paper()
LIMITS = Bounds(gears=GEARS, min_torque=0.1, max_torque=1.0)


@pytest.mark.parametrize("kind", [*FLOATS, *WHOLE])
def test_a_model_takes_any_number(kind: type) -> None:
    model = ServoModel(inertia=kind(2), gravity=kind(1), viscous_friction=kind(1)).with_effect(
        CoulombFriction(torque=kind(1))
    )
    model = model.with_payload(inertia=kind(1), gravity=kind(0))
    assert [type(value) for value in (model.inertia, model.effects[0].torque)] == [float, float]
    content = ModelFile(model=model, std={"inertia": kind(1)}, sample_time=kind(1)).to_dict()
    assert json.loads(json.dumps(content))["parameters"]["inertia"] == {"value": 3.0, "std": 1.0, "unit": "kg m^2"}
    assert np.isfinite(simulate(model, command=np.ones(5), dt=float(kind(1)) / 100)).all()
    assert Rig.paper_like(inertia=kind(2)).inertia == 2


@pytest.mark.parametrize("kind", WHOLE)
def test_what_counts_takes_any_whole_number(kind: type) -> None:
    assert GearTrain(pinion_teeth=(kind(20), kind(20)), output_teeth=kind(161)).ratio == 161 / 20
    controller = Controller(ServoModel.paper(), GEARS, horizon=kind(20), sqp_iterations=kind(2), max_torque=kind(4))
    assert (type(controller.horizon), controller.horizon, controller.sqp_iterations) == (int, 20, 2)
    assert Allocator(GEARS, min_torque=kind(1), max_torque=kind(3)).allocate(kind(2)).status == "optimal"


@pytest.mark.parametrize("value", [True, "2", None, float("nan"), np.inf, np.array([2.0]), 1j])
def test_what_is_no_number_is_refused(value: object) -> None:
    with pytest.raises(BadParameter, match="finite number"):
        ServoModel(inertia=value)


@pytest.mark.parametrize("value", [True, 20.0, np.float64(20), "20", None, 1])
def test_what_is_no_count_is_refused(value: object) -> None:
    if value is not None:  # left out: the horizon is then chosen
        with pytest.raises(BadParameter, match="whole number"):
            Controller(ServoModel.paper(), GEARS, horizon=value)
    with pytest.raises(BadParameter, match="whole number"):
        minimum_copper_loss(ServoModel.paper(), LIMITS, 0.0, 1.0, 5.0, intervals=value)
