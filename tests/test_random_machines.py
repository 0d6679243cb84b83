"""Randomly drawn machines on which causes were missed or misnamed."""

import pytest
from hidden_effects import CASES
from random_machines import Bench, shaped

from diagnosis import Diagnosis, diagnose

LAGS = ["input_delay", "actuator_lag", "sensor_lag"]


def diagnosed_with(effect: str, seed: int, size: float, candidates: list[str]) -> Diagnosis:
    """What is told of an effect that is hidden in the machine of a seed."""
    bench = Bench.drawn(seed)
    case = shaped(next(case for case in CASES if case.effect == effect), bench, seed)
    machine = case.machine(size)
    held_out = bench.log(machine, seed + 1, duration=15.0)
    return diagnose(
        bench.stretched(bench.log(machine, seed)), case.base, bench.stretched(held_out), candidates=candidates
    )


@pytest.mark.parametrize(
    ("effect", "seed", "size"),
    [
        pytest.param("input_delay", 40030, 0.000308, id="slow, from starts of ten samples", marks=pytest.mark.long),
        pytest.param("sensor_lag", 41021, 0.00222, id="of a load that could fall, behind three observers"),
    ],
)
def test_of_lags_of_equal_length_none_is_reported_alone(effect: str, seed: int, size: float) -> None:
    found = diagnosed_with(effect, seed, size, LAGS)
    assert found.verdict in ("ambiguous", "unknown")
    assert all(cause.probability < 0.9 for cause in found.causes)


@pytest.mark.long
@pytest.mark.parametrize("gap", [0.0033, 0.007])
def test_backlash_half_as_wide_again_as_the_noise_is_found(gap: float) -> None:
    """The noise is 0.0022 rad rms."""
    found = diagnosed_with("backlash", 41073, gap, ["backlash"])
    (cause,) = found.causes
    assert (found.verdict, cause.effect) == ("named" if gap > 0.005 else "ambiguous", "backlash")
    assert cause.parameters["gap"].value == pytest.approx(gap, rel=0.2)


@pytest.mark.long
def test_backlash_as_narrow_as_the_noise_is_unknown() -> None:
    """Its gain in log-likelihood, about 40, is not more than that of a small error of the measurement."""
    found = diagnosed_with("backlash", 41073, 0.00194, ["backlash"])
    assert (found.verdict, found.causes) == ("unknown", ())
    assert found.unknown.measurement_error > 0.9


@pytest.mark.long
def test_a_cause_that_leaves_an_observer_nothing_to_do_is_named() -> None:
    """Restarts from noisy states hid it, and the last quarter of the log does not come by the stop."""
    found = diagnosed_with("end_stop", 40061, 0.01, ["end_stop", "payload_change"])
    (cause,) = found.causes
    assert (found.verdict, cause.effect) == ("named", "end_stop")
    assert (found.base.bandwidth > 0.0, found.extended.bandwidth) == (True, 0.0)


@pytest.mark.long
def test_back_emf_is_searched_inside_the_dead_zone() -> None:
    """Smaller ones are viscous friction on that log, and a descent from there sees no slope."""
    found = diagnosed_with("back_emf", 41098, 0.389, ["back_emf", "quadratic_drag"])
    (cause,) = found.causes
    assert (found.verdict, cause.effect) == ("named", "back_emf")
