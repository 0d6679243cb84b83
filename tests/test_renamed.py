"""Old names still work, with a warning that says the new one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import plant.effects
from plant import GearTrain, Rig, ServoModel, read_model
from plant.effects import Effect, Regressors, SetpointRateLimit, Stage
from plant.model_file import write_model


def test_an_attribute_is_found_under_its_old_name() -> None:
    gears, rig = GearTrain.paper(), Rig.paper_like()
    state = rig.rest()
    with pytest.warns(DeprecationWarning, match="follower_torque is now called output_torque"):
        assert gears.follower_torque([0.1, -0.2]) == gears.output_torque([0.1, -0.2])
    with pytest.warns(DeprecationWarning, match="minimum_contact_torques"):
        np.testing.assert_array_equal(state.least_flank_torques, state.minimum_contact_torques)


def test_a_model_file_with_the_old_name_of_an_effect_is_read(tmp_path: Path) -> None:
    path, model = tmp_path / "model.json", ServoModel(effects=(SetpointRateLimit(rate=3.0),))
    write_model(model, path)
    path.write_text(path.read_text().replace("setpoint_rate_limit", "goal_rate_limit"))
    assert read_model(path).model == model


def test_an_effect_may_define_its_parts_under_their_old_names() -> None:
    with pytest.warns(DeprecationWarning, match="Trace is now called Regressors"):
        old = plant.effects.Trace
    assert old is Regressors
    with pytest.warns(DeprecationWarning, match=r"Fan\.(trace|traces|reading) is now called"):

        class Fan(Effect):
            name, title, stage, equation, trace = "fan", "fan", Stage.LOAD, "", "cubic over velocity"

            @classmethod
            def traces(cls, motion):  # type: ignore[no-untyped-def]
                return iter(())

            def reading(self, angle, state):  # type: ignore[no-untyped-def]
                return angle + 1.0

    assert Fan.signature == "cubic over velocity"
    assert list(Fan.regressors(None)) == []  # type: ignore[arg-type]
    assert Fan().measurement(1.0, 0.0) == 2.0
