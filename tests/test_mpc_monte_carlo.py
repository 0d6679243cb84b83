"""Many closed loops: machines that depend only on seed and number, and worst cases as predicted."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from four_hertz import four_hertz
from raised_load import BY_FLANK, BY_MOTOR, GEARS, LEAST, MESH, MODEL, MOST, MOTOR, RIG, ROTOR, swing

from mpc import MonteCarlo, Sweep, Trial, closed_loop, monte_carlo, sweep
from plant import BadParameter, ServoModel
from plant.machine_code import compiler

A = 10.0
REFERENCE = swing(A, 1.0)


def run(runs: int, design: object = BY_FLANK, **options: object) -> MonteCarlo:
    return monte_carlo(design, RIG, REFERENCE, 1.0, runs=runs, **options)  # type: ignore[arg-type]


def same(one: Sweep, other: Sweep) -> bool:
    names = ("tracking_rms", "minimum_contact_torque", "degraded", "copper_loss")
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in names)


def test_a_run_is_the_closed_loop_of_its_machine() -> None:
    found = run(3, spread=0.1, names=("inertia", "backlash"), seed=5)
    assert found.factors.shape == (3, 2)
    assert np.all(np.abs(found.factors - 1) <= 0.1)
    assert np.ptp(found.factors, axis=0).min() > 0.01
    rng = np.random.default_rng([5, 2])
    inertia, backlash = rng.uniform(0.9, 1.1, 2)
    machine = replace(RIG, inertia=inertia * RIG.inertia, backlash=backlash * RIG.backlash)
    alone = closed_loop(BY_FLANK(), machine, REFERENCE, 1.0, seed=int(rng.integers(2**63)))
    assert found.tracking_rms[2] == alone.tracking_rms
    assert found.minimum_contact_torque[2] == alone.minimum_contact_torque
    assert found.copper_loss[2] == alone.copper_loss
    assert found.degraded[2] == alone.degraded


def test_a_machine_depends_on_seed_and_number_alone() -> None:
    few, more, other = run(2), run(3), run(2, seed=1)
    assert np.array_equal(few.factors, more.factors[:2])
    assert np.array_equal(few.tracking_rms, more.tracking_rms[:2])
    assert not np.any(few.factors == other.factors)
    assert not np.any(few.tracking_rms == other.tracking_rms)


@pytest.mark.skipif(compiler() is None, reason="there is no compiler")
def test_models_of_one_structure_share_machine_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    designs = [
        partial(
            four_hertz, ServoModel(inertia=j, gravity=12.0), GEARS, min_torque=eps, max_torque=MOST, rotor_inertia=r
        )
        for j, eps, r in ((0.7, 0.2, MOTOR), (0.8, 0.1, 0.0))
    ]
    trials = [Trial(design=d, rig=RIG, reference=REFERENCE, duration=0.1, seed=i) for i, d in enumerate(designs)]
    sweep(trials)
    assert len(list(tmp_path.rglob("controller-*/*.so"))) == 1


def test_contact_needs_the_margin_that_covers_the_unknown() -> None:
    # a rotor heavier than in the model takes 0.2 n^2 J_m a more; 0.2 N m cover friction, feedback and vibration
    unknown = 0.2 * ROTOR * A
    enough, little = ((unknown + spare) / MESH for spare in (0.2, -0.25))
    kept, lost = (
        run(12, partial(four_hertz, MODEL, GEARS, min_torque=least, max_torque=MOST, rotor_inertia=MOTOR))
        for least in (enough, little)
    )
    assert not np.any(kept.contact_lost)
    assert 0 < np.sum(lost.contact_lost) < 12
    rotor = lost.factors[:, lost.names.index("rotor_inertia")]
    assert np.mean(rotor[lost.contact_lost]) > np.mean(rotor[~lost.contact_lost]) + 0.1
    assert np.array_equal(lost.contact_lost, lost.minimum_contact_torque <= 0)
    assert np.corrcoef(rotor, kept.minimum_contact_torque)[0, 1] < -0.7


def test_a_sweep_takes_trials_as_they_come() -> None:
    trials = [
        Trial(design=design, rig=RIG, reference=swing(14.0, 1.2), duration=1.2, seed=0)
        for design in (BY_FLANK, BY_MOTOR)
    ]
    lines: list[str] = []
    found = sweep(trials, progress=lines.append)
    assert found.contact_lost.tolist() == [False, True]
    assert found.minimum_contact_torque[0] > 0.8 * LEAST * MESH
    assert [line.split(":")[0] for line in lines] == ["1 of 2", "2 of 2"]
    assert f"{found.minimum_contact_torque[0]:.3g} N m" in lines[0]


@pytest.mark.parametrize(
    "wrong",
    [
        {"runs": 0},
        {"runs": True},
        {"spread": 1.0},
        {"spread": -0.1},
        {"spread": float("nan")},
        {"seed": -1},
        {"names": ("mass",)},
        {"names": ("gears",)},
        {"names": ("encoder_counts",)},
    ],
)
def test_refuses_what_cannot_be_drawn(wrong: dict[str, object]) -> None:
    with pytest.raises(BadParameter):
        run(**{"runs": 1, **wrong})  # type: ignore[arg-type]


def test_a_sweep_of_nothing_is_refused() -> None:
    with pytest.raises(BadParameter):
        sweep([])
