"""The step with its derivatives against the step itself, differentiated as a whole."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from test_plant_discrete import HIDDEN

from plant import ServoModel, catalogue, sample_step
from plant.discrete import INPUTS, integration_steps
from plant.sensitivity import step_with_slopes

MODELS = {
    "bare": (),
    "split by a delay": ("input_delay",),
    "finer behind a ramp": ("rate_limit",),
    "finer behind a lag, split by a delay": ("input_delay", "actuator_lag"),
    "finer behind a goal's ramp, stiff, split by a delay": ("input_delay", "setpoint_rate_limit", "compliance"),
    "stiff": ("backlash",),
    "with memory on the load": ("presliding_hysteresis",),
    "with memory in the sensor": ("coulomb_friction", "sensor_lag"),
    "with a clock": ("payload_change",),
    "with a clock, stiff, split by a delay": ("input_delay", "periodic_disturbance", "compliance"),
    "with a measured torque that rises, stiff": ("torque_measurement_lag", "compliance"),
}


@pytest.mark.parametrize("names", MODELS.values(), ids=MODELS)
@pytest.mark.parametrize("positioned", [True, False])
def test_state_and_slopes_are_those_of_the_step(names: tuple[str, ...], positioned: bool) -> None:
    model = ServoModel.paper().with_effect(catalogue["dead_zone"](half_width=0.1))
    for name in names:
        model = model.with_effect(catalogue[name](**HIDDEN[name]))
    n, count, substeps = len(model.states), len(model.names), integration_steps(model, 0.005)
    free, columns = tuple(range(1, count)), count + 1
    state, inputs, parameters = ca.SX.sym("state", n), ca.SX.sym("inputs", len(INPUTS)), ca.SX.sym("p", count)
    end = sample_step(model, substeps=substeps)(state, inputs, parameters)
    jacobians = [ca.jacobian(end, state), ca.jacobian(end, parameters[list(free)])]
    whole = ca.Function("whole", [state, inputs, parameters], [end, *jacobians])
    step = step_with_slopes(model, free, columns, substeps=substeps, positioned=positioned)
    rng, gain = np.random.default_rng(3), 0.7 if positioned else 0.0
    values = model.values
    for k in range(20):
        if "input_delay.time" in model.names:
            values[model.names.index("input_delay.time")] = 0.002 if k else 0.0  # inside the sample, and at its edge
        start, before = rng.normal(size=n), rng.normal(size=(n, columns))
        row = np.array([3.0 * rng.normal(), 3.0 * rng.normal(), gain, 50.0, 3.14, 0.005, 0.0, 0.4 * gain])
        expected, by_state, by_parameter = (np.array(value) for value in whole(start, row, values))
        found, slopes = (np.array(value) for value in step(start, before, row, values))
        chained = by_state @ before + np.pad(by_parameter, ((0, 0), (0, columns - len(free))))
        assert found == pytest.approx(expected, rel=1e-13, abs=1e-13)
        assert slopes == pytest.approx(chained, rel=1e-9, abs=1e-9 * np.abs(chained).max())


def test_without_position_loop_torque_is_computed_once_a_step() -> None:
    model = ServoModel.paper().with_effect(catalogue["actuator_lag"](**HIDDEN["actuator_lag"]))

    def operations(positioned: bool) -> int:
        step = step_with_slopes(model, (0, 1), 4, substeps=1, positioned=positioned)
        generator = ca.CodeGenerator("step.c")
        generator.add(step)
        return len(generator.dump())

    assert operations(False) < 0.6 * operations(True)


def test_the_code_of_a_step_occurs_once_however_many_there_are() -> None:
    model = ServoModel.paper().with_effect(catalogue["backlash"](**HIDDEN["backlash"]))
    sizes = []
    for substeps in (4, 40):
        step = step_with_slopes(model, (0, 1), 4, substeps=substeps)
        generator = ca.CodeGenerator("step.c")
        generator.add(step)
        sizes.append(len(generator.dump()))
    assert sizes[1] < 2 * sizes[0]
