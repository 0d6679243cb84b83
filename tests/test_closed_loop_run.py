"""A closed loop in numbers: what the summary says is what the arrays hold; scenarios drive the rig as they say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

import antidrive.simulation
from antidrive.closed_loop_run import ClosedLoopRun
from antidrive.drive_loss import loop_with_drive_loss
from antidrive.scenario import Disturbance, DriveLoss, Scenario
from antidrive.simulation import rigid_model, run_scenario
from mpc import ClosedLoopResult, Controller
from plant.errors import BadParameter
from plant.gears import GearTrain
from plant.rig import Rig

Array = NDArray[np.float64]

DT = 0.005
COUNT = 100
SHORT = Scenario(
    name="short",
    title="Short",
    duration=COUNT * DT,
    sample_time=DT,
    reference={"kind": "constant", "level": 0.2},
    rig={},
    controller={},
)


def result(**changes: object) -> ClosedLoopResult:
    """A loop of 100 samples whose every channel is another one; the flanks are pressed throughout."""
    k = np.arange(COUNT, dtype=np.float64)
    loop = ClosedLoopResult(
        time=k * DT,
        reference=np.full(COUNT, 0.2),
        angle=0.2 + 1e-3 * (k - 30),
        measured_angle=np.full(COUNT, 7.0),
        velocity=k + 100,
        torques=np.column_stack((0.1 + k / 1e3, -0.05 - k / 1e3)),
        disturbance=k + 200,
        margin=k + 300,
        contact_torques=np.column_stack((1.0 + k / COUNT, 0.5 + k / COUNT)),
        status=("optimal",) * COUNT,
    )
    return replace(loop, **changes)


def trial(scenario: Scenario = SHORT, **changes: object) -> ClosedLoopRun:
    return ClosedLoopRun(title="a trial", scenario=scenario, result=result(**changes), min_torque=0.02, max_torque=0.3)


def test_the_summary_agrees_with_the_arrays() -> None:
    simulated = trial(status=("optimal",) * 97 + ("degraded: a",) * 3)
    summary = simulated.summary()
    error = 1e-3 * (np.arange(COUNT) - 30)
    assert summary["tracking_rms"] == pytest.approx(np.sqrt(np.mean(error**2)))
    assert summary["largest_error"] == pytest.approx(0.069)
    assert summary["final_error"] == pytest.approx(np.mean(error[-20:]))
    assert summary["least_preload_margin"] == 0.5
    assert summary["contact_lost"] is False
    assert (summary["samples"], summary["degraded_samples"]) == (100, 3)
    assert simulated.sentences()[-1] == "3 of 100 samples were not optimal (degraded: a)."


def test_one_flank_that_opens_once_is_reported() -> None:
    flanks = result().contact_torques.copy()
    flanks[40, 1] = 0.0
    parted = trial(contact_torques=flanks)
    assert parted.summary()["contact_lost"] is True
    assert parted.summary()["least_preload_margin"] == 0.0
    assert "contact was lost" in parted.sentences()[1]


def test_the_loss_of_a_drive_divides_the_numbers() -> None:
    flanks = result().contact_torques.copy()
    flanks[60:, 0] = -3.0  # only after the loss
    lossy = trial(replace(SHORT, drive_loss=DriveLoss(drive=1, time=0.3)), contact_torques=flanks)
    error = 1e-3 * (np.arange(COUNT) - 30)
    assert lossy.summary()["least_preload_margin"] == 0.5
    assert lossy.summary()["contact_lost"] is True
    assert lossy.summary()["tracking_rms_after_loss"] == pytest.approx(np.sqrt(np.mean(error[60:] ** 2)))
    assert "while both drives worked" in lossy.sentences()[1]
    never_preloaded = trial(replace(SHORT, drive_loss=DriveLoss(drive=1, time=0.0)))
    assert never_preloaded.summary()["least_preload_margin"] is None


def test_one_drive_alone_is_counted_by_its_own_flank() -> None:
    flanks = np.full((COUNT, 2), -9.0)  # the second drive is not there; what its flank does says nothing
    flanks[:, 0] = np.where(np.arange(COUNT) < 7, 0.0, 1.0)
    flanks[50, 0] = -2.5
    both = replace(trial(), single=result(contact_torques=flanks))
    alone = both.summary()["single_drive"]
    assert both.summary()["samples_without_contact"] == 0
    assert alone["samples_without_contact"] == 7
    assert alone["impact_on_opposite_flank"] == 2.5
    assert "samples_without_contact_single_drive" in dict(both.numbers())


def test_a_machine_of_one_drive_needs_no_preload() -> None:
    flanks = np.where(np.arange(COUNT) < 7, -0.5, 1.0)[:, None]
    one = trial(torques=np.full((COUNT, 1), 0.1), contact_torques=flanks)
    assert one.sentences()[1] == f"A single drive has no preload: contact is lost in 7 of {COUNT} samples."


def test_the_table_names_every_channel_once() -> None:
    made = result()
    table = replace(trial(), single=result(angle=np.full(COUNT, 5.0))).table()
    channels = {
        "time": made.time,
        "reference": made.reference,
        "angle": made.angle,
        "measured_angle": made.measured_angle,
        "velocity": made.velocity,
        "torque_1": made.torques[:, 0],
        "torque_2": made.torques[:, 1],
        "contact_torque_1": made.contact_torques[:, 0],
        "contact_torque_2": made.contact_torques[:, 1],
        "disturbance_estimate": made.disturbance,
        "single_drive_angle": np.full(COUNT, 5.0),
        "single_drive_torque": made.torques[:, 0],
    }
    assert set(table.columns) == {*channels, "status"}
    for name, values in channels.items():
        np.testing.assert_array_equal(table[name], values, err_msg=name)


def test_numbers_carry_their_units() -> None:
    numbers = dict(trial().numbers())
    error = trial().result.angle - trial().result.reference
    assert numbers["tracking_rms"] == f"{np.sqrt(np.mean(error**2)):.4g} rad"
    assert numbers["least_preload_margin"] == "0.5 N m"
    assert numbers["copper_loss"].endswith("N² m²")
    assert numbers["contact_lost"] == "no"


def test_numbers_of_repeated_runs_have_their_scatter() -> None:
    flanks = result().contact_torques.copy()
    flanks[40, 1] = 0.0
    others = [
        trial(angle=0.2 + level * np.ones(COUNT), contact_torques=flanks).summary() for level in (0.1, 0.11, 0.12)
    ]
    repeated = replace(trial(angle=np.full(COUNT, 0.29)), again=tuple(others))
    sizes = [0.09, 0.1, 0.11, 0.12]
    assert repeated.scatter()["tracking_rms"] == pytest.approx(np.std(sizes, ddof=1))
    assert repeated.summary()["std"] == repeated.scatter()
    assert repeated.summary()["runs"] == 4
    assert "schema" not in repeated.scatter()
    table = dict(repeated.numbers())
    assert table["tracking_rms"] == "0.090 ± 0.013 rad"
    assert table["least_preload_margin"] == "0.50 ± 0.25 N m"
    assert table["contact_lost"] == "no, in 1 of 4 runs"
    assert table["samples"] == "100"
    assert repeated.sentences()[0].startswith("Tracking error 0.090 ± 0.013 rad rms, 0.090 ± 0.013 rad at most")
    assert "over 4 runs" in repeated.sentences()[-1]


def test_what_one_drive_does_scatters_too() -> None:
    one = result(angle=np.full(COUNT, 0.5))
    both = replace(trial(), single=one)
    other = replace(trial(), single=replace(one, angle=np.full(COUNT, 0.52)))
    table = dict(replace(both, again=(other.summary(),)).numbers())
    assert table["tracking_rms_single_drive"] == "0.300 ± 0.014 rad"


def test_runs_that_are_repeated_differ_in_their_noise() -> None:
    scenario = replace(SHORT, rig={"encoder_noise": 1e-4})
    alone = run_scenario(scenario, seed=3)
    again = run_scenario(scenario, seed=3, repetitions=2)
    assert again.summary()["tracking_rms"] == alone.summary()["tracking_rms"]
    errors = {found["tracking_rms"] for found in (alone.summary(), *again.again)}
    assert len(errors) == 3


# Scenarios.


def test_references_and_pushes_are_those_of_the_file() -> None:
    time = np.array([0.0, 0.49, 0.5, 0.99, 1.0, 9.0])
    stairs = replace(SHORT, reference={"kind": "steps", "levels": [0.1, -0.2, 0.3], "hold": 0.5})
    np.testing.assert_array_equal(stairs.wanted(time), [0.1, 0.1, -0.2, -0.2, 0.3, 0.3])
    swing = replace(SHORT, reference={"kind": "sine", "amplitude": 0.3, "frequency": 2.0})
    assert swing.wanted(np.array([0.0, 0.125, 0.25, 0.5])) == pytest.approx([0.0, 0.3, 0.6, 0.0])
    pushed = replace(SHORT, disturbance=Disturbance(torque=0.4, start=0.1, stop=0.2)).pushes()
    assert pushed.shape == (COUNT,)
    assert np.flatnonzero(pushed).tolist() == list(range(20, 40))
    assert np.all(pushed[20:40] == 0.4)


def test_the_model_from_the_drawings_has_the_motors_friction() -> None:
    rig = Rig.paper_like(motor_viscous=1e-5)
    ratio = 161 / 20 * 46 / 18 * 41 / 17 * 42 / 21
    model = rigid_model(rig)
    assert model.inertia == pytest.approx(2.0 + 2 * 4e-6 * ratio**2)
    assert model.viscous_friction == pytest.approx(0.8 + 2 * 1e-5 * ratio**2)
    assert model.gravity == 0.5


@pytest.mark.parametrize("loss", [None, DriveLoss(drive=1, time=9.0)])
def test_a_push_reaches_the_load(loss: DriveLoss | None) -> None:
    scenario = replace(SHORT, duration=0.4, disturbance=Disturbance(torque=0.6, start=0.2, stop=9.0), drive_loss=loss)
    moved = run_scenario(scenario).result
    calm = run_scenario(replace(scenario, disturbance=None)).result
    np.testing.assert_array_equal(moved.angle[:41], calm.angle[:41])
    assert np.all(moved.angle[42:] > calm.angle[42:])
    assert moved.disturbance[-1] == pytest.approx(calm.disturbance[-1] + 0.6, abs=0.15)


def test_seeds_count_and_the_single_drive_is_the_first() -> None:
    scenario = replace(SHORT, duration=0.1, compare_single_drive=True)
    one, again, other = (run_scenario(scenario, seed=seed).result.measured_angle for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, again)
    assert not np.array_equal(one, other)
    single = run_scenario(scenario).single
    assert single is not None
    assert np.all(single.torques[:, 1] == 0.0)
    assert np.any(single.torques[:, 0] != 0.0)


def test_the_drive_that_is_left_keeps_its_limit() -> None:
    # the slow gear of drive 1 is lost: the other one would need 0.44 N m for what both of them can give
    gears = GearTrain(pinion_teeth=(20, 31), output_teeth=161, stages=GearTrain.paper().stages)
    rig = Rig(gears=gears, inertia=2.0)
    reference = np.where(np.arange(40) < 2, 0.0, -1.0)
    played = loop_with_drive_loss(
        Controller(rigid_model(rig), gears), rig, reference, np.zeros(40), drive=1, time=0.0, seed=0
    )
    assert np.all(played.torques[:, 0] == 0.0)
    assert np.max(np.abs(played.torques[:, 1])) == 0.3
    assert played.time == pytest.approx(np.arange(40) * DT)


def test_a_rig_that_runs_away_is_no_result(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(antidrive.simulation, "closed_loop", lambda *_, **__: result(angle=np.full(COUNT, np.nan)))
    with pytest.raises(BadParameter, match="short: the simulated machine diverged"):
        run_scenario(SHORT)
