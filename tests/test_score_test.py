"""The screen: what it projects out, and how much of the traces it holds at a time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from machine import Machine, excitation, record
from test_sums_over_runs import dense
from threadpoolctl import threadpool_info, threadpool_limits

from diagnosis import diagnose
from diagnosis.nuisance import Nuisance
from diagnosis.score_test import Screen
from identification.fit import fit
from identification.predictor import Prediction
from identification.problem import Problem
from identification.standard_errors import fit_with_errors
from identification.threads import in_threads, without_blas_threads
from plant import ServoModel
from plant.effects import Backlash, Cogging, CoulombFriction, Motion, TorqueOffset, Trace, catalogue
from plant.effects.effect import Array
from plant.effects.spectral_lines import strongest_lines


def prediction(rng: np.random.Generator, samples: int, free: int) -> Prediction:
    return Prediction(
        errors=np.zeros(samples),
        innovations=rng.normal(size=samples),
        jacobian=rng.normal(size=(samples, free + 2)),
        states=np.zeros((2, samples)),
        output=np.zeros(samples),
    )


@pytest.mark.parametrize("free", [0, 3])
def test_each_run_has_its_own_initial_state(free: int) -> None:
    rng = np.random.default_rng(0)
    runs = [prediction(rng, samples, free) for samples in (40, 55, 30)]
    values = rng.normal(size=(125, 4))
    jacobian = dense(runs)
    expected = values - jacobian @ np.linalg.lstsq(jacobian, values, rcond=None)[0]
    nuisance = Nuisance.of(runs)
    assert nuisance.beyond(values) == pytest.approx(expected, abs=1e-12)
    assert nuisance.beyond(values[:, 0]) == pytest.approx(expected[:, 0], abs=1e-12)


@pytest.mark.parametrize("silent", [0, 1, 2])
def test_a_parameter_without_a_trace_takes_nothing_away(silent: int) -> None:
    """As the instant of a payload change does while the load rests; what comes behind it keeps its own."""
    rng = np.random.default_rng(1)
    run = prediction(rng, 50, 3)
    run.jacobian[:, silent] = 0.0
    nuisance = Nuisance.of([run])
    assert nuisance.shared.shape == (50, 2)
    assert nuisance.beyond(run.jacobian) == pytest.approx(np.zeros((50, 5)), abs=1e-12)


@pytest.fixture(scope="module")
def screen() -> Screen:
    log = record(Machine().hiding(coulomb_friction={"torque": 0.05}), excitation(1, duration=10.0)).log()
    found = fit(log, ServoModel.paper())
    return Screen.of(found, Problem.of(log, found.model), bandwidth=found.bandwidth)


def test_traces_are_drawn_a_few_at_a_time(screen: Screen) -> None:
    (trace,) = CoulombFriction.traces(screen.motion)
    drawn = 0

    def many() -> Iterator[Trace]:
        nonlocal drawn
        for _ in range(1000):
            drawn += 1
            yield trace

    answers = [next(iter(screen.regress(many())))]
    assert drawn < 50
    (alone,) = screen.regress([trace])
    assert answers[0][1] == pytest.approx(alone[1], rel=1e-12)


def test_an_effect_is_told_the_same_alone_and_among_all(screen: Screen) -> None:
    together = {suspect.name: suspect for suspect in screen.ask(catalogue)}
    for name in ("coulomb_friction", "payload_change", "cogging", "backlash"):
        (alone,) = screen.ask({name: catalogue[name]})
        assert alone.evidence == pytest.approx(together[name].evidence, rel=1e-9, abs=1e-9)
        assert alone.searched == together[name].searched
    assert max(together.values(), key=lambda suspect: suspect.evidence).name.endswith("friction")


def test_work_side_by_side_keeps_its_order_and_its_errors() -> None:
    assert in_threads(lambda item: item**2, range(20)) == [item**2 for item in range(20)]
    with pytest.raises(ZeroDivisionError):
        in_threads(lambda item: 1 / item, [1, 0])


def test_blas_has_one_thread_during_a_fit() -> None:
    def threads() -> set[int]:
        return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}

    seen: list[set[int]] = []
    log = record(Machine(), excitation(1, duration=2.0), noise=1e-3).log()
    with threadpool_limits(limits=2, user_api="blas"):
        assert threads() == {2}
        without_blas_threads(lambda: seen.append(threads()))()
        diagnose(log, candidates=["coulomb_friction"], progress=lambda line: seen.append(threads()))
        assert threads() == {2}
    assert len(seen) > 3
    assert all(each == {1} for each in seen)


def test_the_colour_of_the_noise_does_not_move_the_load() -> None:
    """Effects draw their traces along the motion, which is the same whatever is believed of the noise."""
    log = record(Machine(), excitation(1, duration=5.0), noise=1e-2).log()
    found = fit(log, ServoModel.paper())

    def motion(colour: tuple[float, ...]) -> Motion:
        return Screen.of(found, Problem.of(replace(log, colour=colour), found.model), bandwidth=20.0).motion

    plain, coloured = motion(()), motion((0.8, -0.1))
    for name in ("angle", "velocity", "acceleration"):
        np.testing.assert_array_equal(getattr(coloured, name), getattr(plain, name))


@pytest.mark.long
def test_backlash_in_the_model_hides_no_other_effect() -> None:
    """Behind a few impacts exact slopes are astronomical; followed by them nothing was seen any more."""
    machine = Machine().hiding(backlash={"gap": 0.005, "motor_share": 0.3}, torque_offset={"torque": 0.15})
    log = record(machine, excitation(4, duration=30.0), seed=1, noise=1e-3).log()
    base = fit(log)
    problem = Problem.of(log, base.model.with_effect(Backlash(gap=0.0045, motor_share=0.35)))
    start = problem.pack(problem.model.values, base.initial)
    loose = fit_with_errors(problem, base.bandwidth, problem.minimise(start, base.bandwidth, 0.0, iterations=6), 0)
    seen = {}
    for found in (base, loose):
        screen = Screen.of(found, Problem.of(log, found.model), bandwidth=found.bandwidth)
        (suspect,) = screen.ask({"torque_offset": TorqueOffset})
        seen[found.model] = suspect.evidence
    assert loose.log_likelihood > base.log_likelihood + 50.0
    assert seen[loose.model] > 0.7 * seen[base.model] > 20.0


def test_a_spectral_line_is_measured_against_white_noise() -> None:
    """Twenty slow lines of chance are each higher than the one that is meant, where chance has next to nothing."""
    rng = np.random.default_rng(4)
    place = np.linspace(0.0, 50.0, 4000)
    slow = 0.5 + 0.3 * np.arange(20)

    def chance() -> Array:
        waves = [rng.normal() * np.sin(w * place) + rng.normal() * np.cos(w * place) for w in slow]
        return np.sum(waves, axis=0) + 0.01 * rng.normal(size=place.size)

    score = chance() + 0.05 * np.sin(29.0 * place)
    draws = np.column_stack([chance() for _ in range(16)])
    apart = 2.0 * np.pi / 50.0
    found, searched = strongest_lines(place, score, draws, 40.0)
    blind, _ = strongest_lines(place, score, draws[:, :0], 40.0)
    assert searched > 1000
    assert min(abs(rate - 29.0) for rate in found) < 0.5 * apart
    assert min(abs(rate - 29.0) for rate in blind) > apart


def test_of_a_narrow_peak_the_top_is_taken(monkeypatch: pytest.MonkeyPatch, screen: Screen) -> None:
    """The search takes steps of a quarter of a line; what lies in between comes from the effect itself."""
    (before,) = screen.ask({"cogging": Cogging})
    top = Cogging(amplitude=0.02, order=1.234, phase=0.0)

    def closer(self: Cogging, motion: Motion) -> Iterator[Trace]:
        yield Trace(columns=motion.score[:, None], start=lambda c: top)

    monkeypatch.setattr(Cogging, "closer", closer)
    (after,) = screen.ask({"cogging": Cogging})
    assert after.evidence > before.evidence
    assert after.starts[0] == top


def test_a_divergent_simulation_gives_no_result_and_no_warning() -> None:
    found = fit(record(Machine(), excitation(1, duration=5.0)).log(), ServoModel.paper())
    screen = Screen.of(found, Problem.of(found.log, found.model), bandwidth=0.0)
    lost = replace(screen, innovations=1e200 * np.cosh(np.linspace(0.0, 9.0, screen.innovations.size)))
    for trace, evidence, coefficients in lost.regress(CoulombFriction.traces(screen.motion)):
        assert evidence == 0.0
        assert not coefficients.any()
        assert coefficients.size == trace.columns.shape[1]
