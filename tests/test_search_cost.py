"""What a search over shapes costs: the log of their number, as often as peaks beside them are higher than chance's."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from machine import Machine, excitation, record
from scipy.signal import lfilter

from diagnosis import diagnose
from diagnosis import refit as refits
from diagnosis.model_probability import search_charge
from diagnosis.score_test import Screen, excess_of_neighbouring_peaks
from identification.fit import fit
from plant import ServoModel, catalogue
from plant.effects import (
    Backlash,
    Cogging,
    CoulombFriction,
    EncoderEccentricity,
    PayloadChange,
    PeriodicDisturbance,
    Trace,
)
from plant.effects.spectral_lines import neighbouring

WAVE = {"amplitude": 0.2, "frequency": 3.3, "phase": 0.4}


def swinging(seed: int, swing: float, frequency: float, samples: int) -> np.ndarray:
    """(T, 1) a load torque that swings at random about a frequency [Hz], which no observer makes white noise."""
    pole = 0.99 * np.exp(2j * np.pi * frequency * 0.005)
    pushes = swing * np.random.default_rng([seed, 1]).standard_normal((samples, 1))
    return np.asarray(lfilter([1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], pushes, axis=0))


def peaks_on(seed: int, swing: float) -> float:
    """Beside a wave, where the load also swings about its frequency."""
    commands = excitation(seed, duration=30.0)
    load = swinging(seed, swing, WAVE["frequency"], commands.size)
    machine = Machine().hiding(periodic_disturbance=WAVE)
    log = record(machine, commands, seed=seed, noise=1e-3, load_torque=load).log()
    model = ServoModel.paper().with_effect(PeriodicDisturbance(**WAVE))
    peaks = excess_of_neighbouring_peaks(
        fit(log, model, fixed=["periodic_disturbance.frequency"]), "periodic_disturbance"
    )
    assert peaks is not None
    return peaks


def test_neighbouring_lines_explain_no_less_than_chance() -> None:
    white = [peaks_on(seed, 0.0) for seed in range(2)]
    assert np.mean(white) == pytest.approx(1.0, abs=0.25)
    assert np.mean([peaks_on(seed, 0.01) for seed in range(1, 4)]) > 1.8


def test_search_charge_grows_with_the_number_of_higher_peaks() -> None:
    once = np.log(5000)
    for peaks, cost in ((None, 2.0), (0.3, 1.0), (1.5, 1.5), (9.0, 9.0)):
        assert search_charge(searched=5000, catalogue=1, peaks=peaks) == pytest.approx(cost * once)
    assert search_charge(searched=1, catalogue=24) == pytest.approx(np.log(24))


@pytest.mark.parametrize(
    "effect",
    [
        Cogging(amplitude=0.1, order=11.0, phase=0.7),
        EncoderEccentricity(amplitude=1e-3, order=11.0, phase=0.7),
        PeriodicDisturbance(amplitude=0.1, frequency=11.0 / (2.0 * np.pi), phase=0.7),
    ],
    ids=lambda effect: effect.name,
)
def test_neighbouring_lines_surround_that_of_the_effect(effect: Any) -> None:
    place = np.linspace(-3.0, 9.0, 4001)
    motion: Any = SimpleNamespace(angle=place, time=place, sample_time=0.0)
    traces = list(effect.neighbours(motion))
    own = np.sin(11.0 * place)
    assert len(traces) == 32
    assert {trace.acts_on for trace in traces} == {"reading" if effect.name == "encoder_eccentricity" else "torque"}
    for trace in traces:
        seen = trace.columns @ np.linalg.lstsq(trace.columns, own, rcond=None)[0]
        assert seen @ seen < 0.05 * own @ own


def test_a_line_is_tried_under_a_slow_observer_despite_drift() -> None:
    """Six lines of the spectrum are higher than the one that is hidden, and none of them explains more."""
    hidden = {"amplitude": 0.002279, "order": 11.0, "phase": 0.7}
    machine = Machine().hiding(cogging=hidden)
    base = fit(record(machine, excitation(18006, duration=30.0), seed=9003, noise=1e-3).log(), ServoModel.paper())
    screen, _ = Screen.views(base)[0]
    orders = [trace.start(np.ones(2)) for trace in Cogging.traces(screen.motion)]
    assert any(abs(effect.order - 11.0) < 0.25 for effect in orders if isinstance(effect, Cogging))


def test_neighbouring_lines_span_two_periods() -> None:
    place = np.linspace(0.0, 10.0, 1001)
    rates = neighbouring(place, 2.5)
    assert rates.min() >= 2.0 * 2.0 * np.pi / 10.0
    assert len(rates) < 32
    assert neighbouring(place, 1e135).size == 0


def test_effects_without_a_search_have_none() -> None:
    log = record(Machine(), excitation(1, duration=5.0), seed=1, noise=1e-3).log()
    found = fit(log, ServoModel.paper().with_effect(CoulombFriction(torque=0.1)))
    assert excess_of_neighbouring_peaks(found, "coulomb_friction") is None
    assert excess_of_neighbouring_peaks(found, "cogging") is None


def peaks_beside_payload(seed: int, swing: float) -> float | None:
    """Beside a payload that changes, where the load also swings slowly."""
    change = {"time": 23.1416, "inertia": 0.05, "gravity": 0.02}
    commands = excitation(seed, duration=30.0)
    load = swinging(seed, swing, 1.0, commands.size)
    log = record(Machine().hiding(payload_change=change), commands, seed=seed, noise=1e-3, load_torque=load).log()
    return excess_of_neighbouring_peaks(
        fit(log, ServoModel.paper().with_effect(PayloadChange(**change))), "payload_change"
    )


def test_only_similar_shapes_that_explain_little_count() -> None:
    white = [peaks_beside_payload(seed, 0.0) for seed in (0, 1)]
    assert all(peaks is not None and 0.3 < peaks < 2.0 for peaks in white)
    assert peaks_beside_payload(0, 0.05) is None


def test_a_shape_is_charged_once_as_search_or_as_parameter() -> None:
    log = record(Machine(), excitation(2, duration=10.0), seed=2, noise=1e-3).log()
    suspects = Screen.views(fit(log, ServoModel.paper()))[0][0].ask(catalogue)
    found = {suspect.name: (suspect.coefficients, suspect.searched > 1) for suspect in suspects}
    paid = {
        "torque_offset": (1, False),
        "end_stop": (2, False),  # its angle
        "presliding_hysteresis": (2, False),  # its stiffness
        "stribeck_friction": (3, False),  # its velocity
        "cogging": (2, True),
        "payload_change": (2, True),
        "compliance": (1, True),
    }
    assert {name: found[name] for name in paid} == paid


def test_unsearched_shapes_are_not_refitted() -> None:
    """Once round the turn is asked for alone; what is a little better among thousands would not have paid."""

    def regress(traces: Any) -> Any:
        return ((trace, evidence, np.ones(2)) for trace, evidence in zip(traces, (20.0, 24.0), strict=True))

    first, among = CoulombFriction(torque=1.0), CoulombFriction(torque=2.0)
    traces = [
        Trace(columns=np.zeros((1, 2)), start=lambda c, s=start: s, searched=searched)
        for start, searched in ((first, 2), (among, 5000))
    ]
    kind = SimpleNamespace(name="any", multimodal=True, traces=lambda motion: traces)
    screen: Any = SimpleNamespace(regress=regress, motion=None, innovations=[0.0], _sharpened=lambda shapes: shapes)
    found = Screen._suspect(screen, kind)  # type: ignore[arg-type]
    assert found is not None
    assert found.starts == (first,)
    assert (found.evidence, found.searched) == (20.0, 2)


@pytest.mark.parametrize("seed", [9000, 9005])
def test_a_disturbance_of_barely_more_than_chance_is_named(seed: int) -> None:
    """About 24 in log-likelihood, of which some 9 are the price of 6,000 frequencies."""
    hidden = WAVE | {"amplitude": 0.0966}
    log = record(
        Machine().hiding(periodic_disturbance=hidden), excitation(2 * seed, duration=30.0), seed=seed, noise=1e-3
    ).log()
    found = diagnose(log)
    assert [cause.effect for cause in found.causes] == ["periodic_disturbance"]
    assert found.causes[0].parameters["frequency"].value == pytest.approx(3.3, abs=0.02)


@pytest.mark.parametrize(
    ("bandwidth", "rise", "begun"), [(0.0, -5.0, 2), (0.0, 5.0, 1), (19.0, -5.0, 2), (21.0, -5.0, 1)]
)
def test_search_restarts_only_after_finding_nothing(
    monkeypatch: pytest.MonkeyPatch, bandwidth: float, rise: float, begun: int
) -> None:
    """Behind an observer nearly as fast as the sampling, 5 ms here, what hardly shows is nothing."""
    starts: list[float] = []

    def come_to(_: Any, some: Any, __: Any) -> Any:
        starts.append(some[0].gap)
        return SimpleNamespace(log_likelihood=rise)

    monkeypatch.setattr(refits, "_from_the_best", come_to)
    fit: Any = SimpleNamespace(
        log_likelihood=0.0, noise_std=1e-3, bandwidth=bandwidth, log=SimpleNamespace(sample_time=0.005)
    )
    refits.refit(fit, Backlash(gap=0.2, motor_share=0.3))
    assert len(starts) == begun
    assert starts[1:] == [5e-4][: begun - 1]
