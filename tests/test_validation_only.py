"""What happens in the validation data alone is said, and learnt from; other motion of the same machine is no cause."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from machine import Machine, excitation, record

from diagnosis import diagnose
from diagnosis.explanation.summary import headline
from diagnosis.validation_only import _by_chance, is_of_parameters, only_in_validation
from diagnosis.validation_split import split, split_otherwise
from identification import fit
from identification.fit_result import Fit
from identification.log import Log

DURATION = 15.0


def log_of(seed: int, machine: Machine, scale: float = 1.0) -> Log:
    return record(machine, scale * excitation(seed, duration=DURATION), seed=seed).log()


@pytest.fixture(scope="module")
def fitted() -> Fit:
    return fit(log_of(1, Machine()))


@pytest.mark.parametrize("scale", [0.5, 1.0, 1.5])
@pytest.mark.parametrize("seed", [2, 3])
def test_other_motion_of_the_same_machine_is_no_cause(fitted: Fit, seed: int, scale: float) -> None:
    assert only_in_validation(fitted, log_of(seed, Machine(), scale)) is None


@pytest.mark.parametrize(
    ("machine", "of_parameters"),
    [(replace(Machine(), inertia=2.5), True), (Machine().hiding(coulomb_friction={"torque": 0.5}), False)],
    ids=["payload", "friction"],
)
def test_a_machine_that_has_changed_is_noticed(fitted: Fit, machine: Machine, of_parameters: bool) -> None:
    log = log_of(2, machine)
    found = only_in_validation(fitted, log)
    assert found is not None
    assert found.ratio > 2.0
    assert 0.0 <= found.begin < found.end <= DURATION
    assert is_of_parameters(fitted, log) is of_parameters


STOP = 8.4  # rad


def test_errors_that_do_not_scatter_are_no_numbers_out_of_range() -> None:
    same, larger = np.zeros(5), np.ones(4)
    assert _by_chance(same, larger) < 1e-3 < _by_chance(same, same[:4])
    rng = np.random.default_rng(0)
    usual, one = rng.normal(size=20), np.append(rng.normal(size=9), 12.0)
    assert _by_chance(usual, one) < 1e-3 < _by_chance(usual, rng.normal(size=10))
    assert _by_chance(usual, 1.5 + 0.1 * rng.normal(size=10)) < 1e-3  # none of them is out of the way


def test_a_little_more_noise_is_no_cause(fitted: Fit) -> None:
    """However sure it is: other motion has other errors."""
    log = record(Machine(), excitation(2, duration=DURATION), seed=2, noise=1.6e-3).log()
    assert only_in_validation(fitted, log) is None
    louder = record(Machine(), excitation(2, duration=DURATION), seed=2, noise=3e-3).log()
    assert only_in_validation(fitted, louder) is not None


def late() -> Log:
    """One run that reaches an end stop in its last third only."""
    time = 0.005 * np.arange(4000)
    torque = 12.0 * np.sin(1.2 * time) + 8.0 * np.sin(3.1 * time)
    torque[time < 14.4] *= 0.4
    return record(Machine().hiding(end_stop={"angle": STOP, "stiffness": 300.0}), torque, seed=4).log()


def test_the_worst_window_is_where_it_happens() -> None:
    estimation, validation, _ = split(late())
    found = only_in_validation(fit(estimation), validation)
    assert found is not None
    (run,) = validation.runs
    inside = (run.time - run.start >= found.begin) & (run.time - run.start <= found.end)
    assert run.output[inside].max() > STOP


def test_what_happens_there_alone_is_learnt_from() -> None:
    reported = list[str]()
    found = diagnose(late(), candidates=("end_stop", "coulomb_friction", "cogging"), progress=reported.append)
    assert [cause.effect for cause in found.causes] == ["end_stop"]
    assert found.only_in_validation is None
    (warning,) = [line for line in found.warnings if "So that part is used for estimation" in line]
    assert warning in reported
    assert "Validation data: the first 30 % of the only run, until 5.995 s." in found.warnings


def test_beside_what_is_named_it_is_learnt_from_too() -> None:
    """A late payload is a small part of the base model's error: the offset is named, and nothing seems to remain."""
    hidden = Machine().hiding(
        torque_offset={"torque": 2.0}, payload_change={"time": 31.0, "inertia": 0.1, "gravity": 0.05}
    )
    time = 0.005 * np.arange(8000)
    log = record(hidden, 12.0 * np.sin(1.2 * time) + 8.0 * np.sin(3.1 * time), seed=4).log()
    few = ("torque_offset", "payload_change", "cogging")
    estimation, validation, _ = split(log)
    chosen = diagnose(estimation, holdout=validation, candidates=few)
    assert (chosen.verdict, [cause.effect for cause in chosen.causes]) == ("named", ["torque_offset"])
    assert chosen.unexplained.share < 0.1
    found = diagnose(log, candidates=few)
    assert (found.verdict, {cause.effect for cause in found.causes}) == ("named", {"torque_offset", "payload_change"})
    assert any("So that part is used for estimation" in line for line in found.warnings)


def test_validation_data_that_somebody_chose_stay_what_they_are() -> None:
    estimation, validation, _ = split(late())
    found = diagnose(estimation, holdout=validation, candidates=("coulomb_friction", "cogging"))
    assert found.verdict == "unknown"
    assert headline(found) == (
        "The model has an error that no effect of the catalogue explains; it shows in the validation data alone."
    )
    assert any("Use that part for estimation" in line for line in found.warnings)
    assert found.base.log.runs[0].output.size == estimation.runs[0].output.size


def test_a_changed_machine_is_reported_as_such() -> None:
    runs = log_of(1, Machine()), log_of(2, replace(Machine(), inertia=2.5))
    both = replace(runs[0], runs=(runs[0].runs[0], replace(runs[1].runs[0], label="later")))
    found = diagnose(both, candidates=("coulomb_friction",))
    assert found.verdict == "unknown"
    assert any("follows it with other values of its parameters" in line for line in found.warnings)
    assert any("inertia" in line and "instead of" in line for line in found.warnings)


def test_what_is_named_is_kept_beside_a_smaller_change() -> None:
    friction = Machine().hiding(coulomb_friction={"torque": 0.5})
    log, later = log_of(1, friction), log_of(2, replace(friction, inertia=2.1))
    found = diagnose(log, holdout=later, candidates=("coulomb_friction",))
    assert only_in_validation(found.extended, later) is not None
    assert found.unexplained.share < 0.5
    assert (found.verdict, found.only_in_validation) == ("named", None)


def test_other_parts_are_held_out_the_second_time() -> None:
    log = log_of(1, Machine())
    log = replace(log, runs=tuple(replace(log.runs[0], label=str(k)) for k in range(3)))
    held = [tuple(run.label for run in parts[1].runs) for parts in (split(log), split_otherwise(log)) if parts]
    assert held == [("2",), ("0",)]
    single = replace(log, runs=log.runs[:1])
    first, other = split(single), split_otherwise(single)
    assert other is not None
    assert other[1].runs[0].time[0] == single.runs[0].time[0]
    assert len(other[1].runs[0]) == len(first[1].runs[0])
    (run,) = single.runs
    for rest in (run.time < 5.0, run.time > DURATION - 5.0):
        assert split_otherwise(replace(single, runs=(replace(run, output=np.where(rest, 0.3, run.output)),))) is None
