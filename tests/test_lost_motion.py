"""Lost motion from sweeps of the preload: right within its standard error, and silent where the log is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm
from swept_preload import ARCMIN, GEARS, Teeth, swept

from identification import Log, LostMotion, MalformedLog, Unidentifiable, lost_motion
from identification.lost_motion.quantised_likelihood import quantised_likelihood


def found(teeth: Teeth, seed: int = 0, **sweep: float) -> LostMotion:
    return lost_motion(swept(teeth, seed, **sweep), GEARS)  # type: ignore[arg-type]


# The likelihood of a rounded reading.


def test_the_likelihood_is_that_of_a_count() -> None:
    likelihood = quantised_likelihood(np.array([0.0, 2.0, 9.0]), np.array([0.2, 0.2, -1.0]), count=1.0, noise=0.7)
    edges = [(0.3, -0.7), (2.3, 1.3)]
    expected = [np.log(norm.cdf(b / 0.7) - norm.cdf(a / 0.7)) for b, a in edges]
    assert likelihood.value[:2] == pytest.approx(expected, rel=1e-12)
    far = norm.logsf(9.5 / 0.7) + np.log(-np.expm1(norm.logsf(10.5 / 0.7) - norm.logsf(9.5 / 0.7)))
    assert likelihood.value[2] == pytest.approx(far, rel=1e-12)  # nothing is lost far from the mean
    fine = quantised_likelihood(np.array([0.3]), np.array([0.0]), count=1e-4, noise=0.7)
    assert fine.value[0] == pytest.approx(norm.logpdf(0.3, scale=0.7) + np.log(1e-4), abs=1e-8)


def test_its_derivatives_are_those_of_differences() -> None:
    rng = np.random.default_rng(0)
    reading, expected, step = rng.integers(-3, 4, 50).astype(float), rng.normal(0, 1.5, 50), 1e-5

    def at(m: float, s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        likelihood = quantised_likelihood(reading, expected + m, count=1.0, noise=0.6 * np.exp(s))
        return likelihood.value, likelihood.slope, likelihood.curvature

    for place, way in enumerate([(step, 0.0), (0.0, step)]):
        ahead, behind = at(*way), at(-way[0], -way[1])
        np.testing.assert_allclose((ahead[0] - behind[0]) / (2 * step), at(0, 0)[1][:, place], rtol=1e-6, atol=1e-7)
        np.testing.assert_allclose((ahead[1] - behind[1]) / (2 * step), at(0, 0)[2][:, place], rtol=1e-5, atol=1e-5)


# The estimate.


def test_every_number_of_either_drive_is_found() -> None:
    teeth = Teeth(noise=2e-6, bits=21, motor_bits=21)
    drives = found(teeth, visits=16).drives
    for name, truth in {
        "gap": teeth.gaps,
        "stiffness": teeth.stiffness,
        "friction": teeth.friction,
        "friction_coefficient": teeth.coefficient,
    }.items():
        for drive, true in zip(drives, truth, strict=True):
            line = getattr(drive, name)
            assert abs(line.value - true) < 4 * line.std, name
            assert line.std < 0.08 * true, name


@pytest.mark.parametrize(
    ("bits", "motor_bits", "noise", "load_speed"),
    [(17, 17, 1e-6, 4e-7), (17, 17, 5e-6, 2e-7), (17, 17, 2e-5, 0.0), (23, 23, 5e-6, 0.0), (17, 12, 2e-6, 2e-7)],
    ids=["rounding", "both", "standing", "noise", "coarse motors"],
)
def test_the_standard_error_is_that_of_repeated_logs(
    bits: int, motor_bits: int, noise: float, load_speed: float
) -> None:
    teeth = Teeth(gaps=(0.1 * ARCMIN, 0.1 * ARCMIN), bits=bits, motor_bits=motor_bits, noise=noise)
    tries = [found(teeth, seed, load_speed=load_speed) for seed in range(60)]
    gaps = [each.drives[0].gap for each in tries]
    scores = np.array([(each.value - teeth.gaps[0]) / each.std for each in gaps])
    assert 0.7 < np.sqrt(np.mean(scores**2)) < 1.3  # 60 draws: 0.82 to 1.18 at 95 %
    assert np.mean(np.abs(scores) < 1.96) > 0.88
    assert abs(np.mean(scores)) < 0.45
    totals = np.array([(each.total_gap.value - sum(teeth.gaps)) / each.total_gap.std for each in tries])
    assert 0.1 < np.sqrt(np.mean(totals**2)) < 1.3  # where the load moves, visits repeat less than is allowed for


def test_modelled_quantisation_beats_quantisation_as_noise() -> None:
    """Oracle: a count of width c taken as noise of c/sqrt(12) would leave three times the error."""
    quiet = Teeth(gaps=(0.1 * ARCMIN, 0.1 * ARCMIN), noise=5e-7)
    count = 2 * np.pi / 2**17
    as_noise = replace(quiet, bits=30, noise=count / np.sqrt(12))
    assert found(quiet, load_speed=4e-7).drives[0].gap.std < found(as_noise, load_speed=4e-7).drives[0].gap.std / 3


def test_the_motors_alone_determine_the_total_backlash() -> None:
    motors_only = found(Teeth(noise=1e-4))
    assert motors_only.drives[0].gap.std > 0.02 * ARCMIN
    assert motors_only.total_gap.value == pytest.approx(2.5 * ARCMIN, rel=2e-3)
    assert abs(motors_only.total_gap.value - 2.5 * ARCMIN) < 3 * motors_only.total_gap.std < 0.03 * ARCMIN


def test_standstill_within_a_count_leaves_the_division_open() -> None:
    log = swept(Teeth(noise=0.0), 3, load_speed=0.0)
    with pytest.raises(Unidentifiable, match="never changes"):
        lost_motion(log, GEARS)
    run, count = log.runs[0], 2 * np.pi / 2**17
    assert run.drive_angles is not None
    moved = np.where(np.arange(len(run)) < len(run) // 2, 0.0, count)  # to the same place within the next count
    shafts = run.drive_angles + moved[:, None] * GEARS.pre_reduction * GEARS.angle_map
    stepped = replace(run, output=run.output + moved, drive_angles=shafts)
    still = lost_motion(Log(runs=(stepped,), axis="rotary"), GEARS)
    assert still.drives[0].gap.std > 10 * ARCMIN
    assert still.total_gap.value == pytest.approx(2.5 * ARCMIN, rel=1e-3)


def test_backlash_does_not_depend_on_the_scale_of_torque() -> None:
    log = swept(Teeth(), 0)
    run = log.runs[0]
    assert run.torques is not None
    doubled = lost_motion(Log(runs=(replace(run, torques=2 * run.torques),), axis="rotary"), GEARS)
    for once, twice in zip(lost_motion(log, GEARS).drives, doubled.drives, strict=True):
        assert twice.gap.value == pytest.approx(once.gap.value, rel=1e-6)
        assert twice.stiffness.value == pytest.approx(2 * once.stiffness.value, rel=1e-6)


def test_a_log_that_does_not_determine_it_is_refused() -> None:
    run = swept(Teeth(), 0).runs[0]
    with pytest.raises(MalformedLog, match="angle_1"):
        lost_motion(Log(runs=(replace(run, drive_angles=None),), axis="rotary"), GEARS)
    with pytest.raises(Unidentifiable, match="in both directions"):
        lost_motion(Log(runs=(run.slice(0, 500),), axis="rotary"), GEARS)
    assert run.torques is not None
    together = replace(run, torques=np.abs(run.torques))  # both drives push the load the same way
    with pytest.raises(Unidentifiable, match="only 0 samples"):
        lost_motion(Log(runs=(together,), axis="rotary"), GEARS)


def test_repeated_quantisation_adds_no_information() -> None:
    smooth = Teeth(friction=(0.0, 0.0), coefficient=(0.0, 0.0))  # so that the load's encoder has no say in it
    few, many = (found(smooth, visits=visits, load_speed=0.0).total_gap.std for visits in (8, 32))
    assert many > 0.8 * few  # as independent visits they would say half
