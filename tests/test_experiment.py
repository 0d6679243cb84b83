"""The separating experiment: within the limits, better than a chirp, and right on a machine of other equations."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from machine import Machine, excitation, record

import diagnosis.experiment.separating as separating
from diagnosis import Experiment, Limits, competing_fits, separating_experiment
from diagnosis.experiment.reshaping import rearranged, reshaped
from diagnosis.experiment.separation import CompetingModel, Trial, noise_factor
from diagnosis.experiment.signal_design import Design
from diagnosis.experiment.signal_families import Signal, shapes
from identification.errors import MalformedLog
from identification.fit_result import Fit
from identification.log import Log
from identification.observer_gain import observer_gain
from identification.problem import Problem
from identification.reading.files import read_table
from identification.standard_errors import fit_with_errors
from plant import BadParameter, ServoModel, catalogue, simulate
from plant.simulation import beginning

LIMITS = Limits(torque=4.0, speed=5.0, travel=(-3.5, 3.5))
SAMPLE_TIME = 0.005
DURATION = 1.5
PAIRS = {  # the hidden truth and its rival
    "presliding": (
        ("presliding_hysteresis", {"torque": 0.1, "stiffness": 10.0}),
        ("coulomb_friction", {"torque": 0.1}),
    ),
    "lag": (("actuator_lag", {"time_constant": 0.004}), ("input_delay", {"time": 0.004})),
    "load": (("load_dependent_friction", {"coefficient": 0.05}), ("coulomb_friction", {"torque": 0.1})),
}


def near(model: ServoModel, log: Log) -> Fit:
    """The fit of a model whose values are nearly right already."""
    problem = Problem.of(log, model)
    start = problem.minimise(problem.pack(model.values, np.zeros((1, 2))), 30.0, 0.0, iterations=6)
    return problem.descend(fit_with_errors(problem, 30.0, start, 0))


@lru_cache
def competing(pair: str) -> tuple[Machine, Fit, Fit]:
    """A machine that hides the first of a pair, and fits of both to a short log of it."""
    (name, values), (other, wrong) = PAIRS[pair]
    machine = Machine().hiding(**{name: values})
    log = record(machine, excitation(3, duration=8.0), seed=1).log()
    paper = ServoModel.paper()
    first, second = (paper.with_effect(catalogue[n](**v)) for n, v in ((name, values), (other, wrong)))
    return machine, near(first, log), near(second, log)


PROGRESS: dict[str, list[str]] = {}


@lru_cache
def designed(pair: str) -> Experiment:
    PROGRESS[pair] = []
    return separating_experiment(*competing(pair)[1:], LIMITS, duration=DURATION, progress=PROGRESS[pair].append)


def task(pair: str, duration: float = DURATION) -> Design:
    _, first, second = competing(pair)
    both, start = (CompetingModel.of(first), CompetingModel.of(second)), float(first.initial[0, 0])
    return Design(competing=both, limits=LIMITS, duration=duration, sample_time=SAMPLE_TIME, start=start)


def with_experiment(fit: Fit, experiment: Experiment, machine: Machine) -> Fit:
    """The refit to the log and the recorded experiment."""
    run = record(machine, experiment.torque, seed=7, angle=experiment.start).run(number=1)
    log = Log.merge([fit.log, Log(runs=(run,), axis="rotary")])
    start = replace(fit, initial=np.vstack((fit.initial, [[experiment.start, 0.0]])))
    return Problem.of(log, fit.model).descend(start)


@pytest.mark.parametrize(
    "pair", [pytest.param(pair, marks=[pytest.mark.long] if pair == "load" else []) for pair in PAIRS if pair != "lag"]
)
def test_limits_hold_under_both_competing_models(pair: str) -> None:
    experiment = designed(pair)
    assert experiment.time.shape == experiment.torque.shape == (300,)
    assert np.abs(experiment.torque).max() <= LIMITS.torque
    for fit, shown in zip(competing(pair)[1:], experiment.predictions, strict=True):
        begin = beginning(fit.model, angle=experiment.start, torque=experiment.torque[0])
        states = simulate(fit.model, command=experiment.torque, dt=SAMPLE_TIME, state=begin)
        assert np.abs(states[:-1, 1]).max() <= LIMITS.speed
        assert LIMITS.travel[0] <= states[:-1, 0].min() <= states[:-1, 0].max() <= LIMITS.travel[1]
        assert states[:-1, 0] == pytest.approx(shown, abs=1e-6)


@pytest.mark.parametrize(
    "pair", [pytest.param(pair, marks=[pytest.mark.long] if pair == "lag" else []) for pair in PAIRS]
)
def test_it_separates_better_than_a_chirp(pair: str) -> None:
    experiment = designed(pair)
    assert experiment.separable
    assert experiment.separation > 1.3 * experiment.chirp_separation
    assert set(experiment.competing) == {PAIRS[pair][0][0], PAIRS[pair][1][0]}


@pytest.mark.parametrize(
    "pair", [pytest.param(pair, marks=[pytest.mark.long] if pair == "lag" else []) for pair in PAIRS]
)
def test_the_recorded_experiment_supports_what_is_hidden(pair: str) -> None:
    machine, right, wrong = competing(pair)
    before = right.log_likelihood - wrong.log_likelihood
    after = [with_experiment(fit, designed(pair), machine).log_likelihood for fit in (right, wrong)]
    assert after[0] - after[1] > before + 0.4 * designed(pair).separation


@pytest.mark.long
def test_reshaping_goes_beyond_every_family() -> None:
    assert designed("lag").separation > 1.2 * task("lag").leaders()[0].log_odds


def test_a_reshaped_signal_changes_by_the_requested_size() -> None:
    torque = np.linspace(-1.0, 2.0, 400)
    assert reshaped(torque, 0.0, np.random.default_rng(0)) == pytest.approx(torque, abs=1e-12)
    rng = np.random.default_rng(1)
    moves = np.array([reshaped(torque, 0.1, rng) - torque for _ in range(400)])
    assert 0.02 < np.abs(moves).max(axis=1).mean() < 0.2
    moved = (np.abs(moves) > 1e-9).mean(axis=1)
    assert (moved < 0.1).any()
    assert (moved > 0.9).any()


def test_what_is_rearranged_has_the_same_levels_in_other_places() -> None:
    torque = np.repeat([1.0, -2.0, 1.0, 1.0, -2.0], 80)
    rng = np.random.default_rng(2)
    moved = np.array([rearranged(torque, rng) for _ in range(400)])
    assert moved.min() == -2.0
    assert moved.max() == 1.0
    assert 0.02 < (np.abs(moved - torque) > 1e-9).mean() < 0.5
    assert (np.isin(moved, (1.0, -2.0))).mean() > 0.95


@pytest.mark.long
def test_a_signal_at_its_limits_still_gets_better() -> None:
    """A random switching between the limits: what is added to it is cut off again, and it was left as it was."""
    design = task("load", duration=3.0)
    switching = Signal(family="pseudo_random_binary", amplitude=4.0, bias=0.0, numbers={"hold": 0.3})
    found = design.attempt(switching)
    assert found is not None
    begun = design.settled(found)
    assert design.refined(begun, np.random.default_rng(0)).log_odds > 1.3 * begun.log_odds


@pytest.mark.long
@pytest.mark.parametrize("pair", ["load", pytest.param("lag", marks=pytest.mark.long)])
def test_it_reports_which_durations_it_tries(pair: str) -> None:
    designed(pair)
    progress = PROGRESS[pair]
    assert progress[0] == "signals of 1.5 s, 0 of 12 durations are tried"
    assert [int(line.split(", ")[1].split()[0]) for line in progress] == list(range(len(progress)))
    assert len(progress) > 3


def test_without_a_duration_it_is_as_short_as_settles_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def separation(rate: float) -> Any:
        return lambda design, *_: SimpleNamespace(log_odds=rate * design.duration)

    monkeypatch.setattr(Design, "promising", lambda design: [separation(2.0)(design)])
    monkeypatch.setattr(Design, "chirps", lambda design: [separation(0.5)(design)])
    monkeypatch.setattr(Design, "settled", lambda design, found, **_: found)
    monkeypatch.setattr(Design, "best", separation(3.0))
    design = task("load")
    ladder = separating.durations(SAMPLE_TIME)
    found = separating._shortest(lambda length: replace(design, duration=length), ladder, 0)
    assert found.log_odds == 3.0 * 4.0  # 6 s without reshaping; 3 s would be worth 9, and 9.3 is asked for
    assert separating._chirp_duration(lambda length: replace(design, duration=length), ladder) == 24.0
    monkeypatch.setattr(Design, "best", separation(0.1))
    monkeypatch.setattr(Design, "promising", lambda design: [separation(0.1)(design)])
    monkeypatch.setattr(Design, "chirps", lambda design: [separation(0.1)(design)])
    weak = separating._shortest(lambda length: replace(design, duration=length), ladder, 0)
    assert weak.log_odds == pytest.approx(3.2)
    assert separating._chirp_duration(lambda length: replace(design, duration=length), ladder) == np.inf


def test_experiments_scale_with_the_speed_of_the_servo() -> None:
    """Once its signals were a chirp to 30 Hz or a few samples long, whatever the log."""
    slower = 40.0
    _, *quick = competing("lag")
    slow = [fit_slower(found, slower) for found in quick]
    limits = replace(LIMITS, speed=LIMITS.speed / slower)
    first, second = (replace(CompetingModel.of(found), substeps=1) for found in slow)
    design = replace(
        task("lag"),
        competing=(first, second),
        limits=limits,
        duration=slower * DURATION,
        sample_time=slower * SAMPLE_TIME,
    )
    mine, theirs = ({f.signal.family: f.separation.log_odds for f in d.promising()} for d in (design, task("lag")))
    assert mine == pytest.approx(theirs, rel=0.1)
    mine, theirs = next(design.chirps()), next(task("lag").chirps())
    assert mine.separation.log_odds == pytest.approx(theirs.separation.log_odds, rel=0.1)
    (ours, *_), (quickest, *_) = (found.trial._tasks(design.start) for found in (mine, theirs))
    assert np.multiply(slower, ours.bandwidths) == pytest.approx(quickest.bandwidths)
    ladder = separating.durations(slower * SAMPLE_TIME)
    assert ladder == pytest.approx([slower * length for length in separating.durations(SAMPLE_TIME)])
    assert separating.durations(0.1 * SAMPLE_TIME) == separating.durations(SAMPLE_TIME)


def fit_slower(found: Fit, slower: float) -> Fit:
    """The fit of a model to its log, stretched in time."""
    runs = tuple(replace(run, time=slower * run.time) for run in found.log.runs)
    powers = {"inertia": 2, "viscous_friction": 1, "time": 1, "time_constant": 1}
    scale = np.array([slower ** powers.get(name.split(".")[-1], 0) for name in found.model.names])
    problem = Problem.of(replace(found.log, runs=runs), found.model.with_values(scale * found.model.values))
    initial = found.initial / np.array([1.0, slower])
    begin = replace(found, model=problem.model, initial=initial, bandwidth=found.bandwidth / slower)
    return problem.descend(begin)


def test_a_plain_chirp_has_the_best_of_its_amplitudes() -> None:
    design = task("presliding")
    chirp = design.plain_chirp()
    assert chirp is not None
    others = []
    for share in np.geomspace(1.0, 0.05, 10):
        amplitude = float(share) * (LIMITS.torque - abs(chirp.signal.bias))
        found = design.attempt(replace(chirp.signal, amplitude=amplitude))
        if found is not None:
            others.append(design.settled(found).log_odds)
    assert chirp.log_odds == pytest.approx(max(others), rel=1e-9)
    assert max(others) > 1.2 * others[0]


def test_order_of_refits_changes_only_the_time() -> None:
    design = task("presliding")
    found = design.leaders()[0]
    log_odds, weakest = found.trial.settled(design.start)
    assert (log_odds, weakest) == (found.log_odds, found.weakest)
    assert any(weakest)
    assert found.trial.settled(design.start, weakest=weakest) == (pytest.approx(log_odds, rel=1e-9), weakest)
    assert found.trial.settled(design.start, above=0.99 * log_odds)[0] == pytest.approx(log_odds, rel=1e-9)
    given_up, tried = found.trial.settled(design.start, above=np.inf)
    assert given_up > log_odds
    assert not any(tried)


def test_an_experiment_does_for_every_truth_that_the_log_allows() -> None:
    design = task("presliding")
    found = design.leaders()[0]
    first, second = design.competing

    stiff = first.model.values
    stiff[first.model.names.index("presliding_hysteresis.stiffness")] *= 1e3  # close to Coulomb friction
    other = replace(first, model=first.model.with_values(stiff))

    def log_odds_of(model: CompetingModel, *drawn: np.ndarray) -> float:
        trial = Trial.play(
            (replace(model, drawn_values=drawn), second), found.torque, sample_time=SAMPLE_TIME, start=design.start
        )
        return trial.settled(design.start)[0]

    assert log_odds_of(first, first.model.values) == pytest.approx(log_odds_of(first), rel=1e-9)
    cell = found.trial._tasks(design.start)[0].under(stiff)
    played = Trial.play((other, second), found.torque, sample_time=SAMPLE_TIME, start=design.start)
    assert cell.run.output == pytest.approx(played.runs[0].output)
    alone = min(cell.settled(bandwidth) for bandwidth in cell.bandwidths)
    assert alone < 0.5 * log_odds_of(first)
    assert log_odds_of(first, stiff) == pytest.approx(
        (0.5 * np.sqrt(log_odds_of(first)) + 0.5 * np.sqrt(alone)) ** 2, rel=1e-9
    )


def test_doubts_are_what_the_log_allows() -> None:
    _, fit, _ = competing("load")
    deviations = (np.array(CompetingModel.of(fit).drawn_values) - fit.model.values)[:, list(fit.free)]
    std = np.sqrt(np.diag(fit.covariance))
    assert (np.abs(deviations) < 4.0 * std).all()
    assert (np.abs(deviations).max(axis=0) > 0.05 * std).all()


def test_what_the_log_left_open_is_free() -> None:
    _, fit, _ = competing("load")
    covariance = fit.covariance.copy()
    covariance[2], covariance[:, 2] = 0.0, 0.0
    information = CompetingModel.of(replace(fit, covariance=covariance)).information
    assert not information[2].any()
    assert not information[:, 2].any()
    others = [place for place in range(len(covariance)) if place != 2]
    kept = np.ix_(others, others)
    assert information[kept] @ covariance[kept] == pytest.approx(np.eye(len(others)), abs=1e-4)


def test_one_model_against_itself_is_reported_as_inseparable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Design, "refined", lambda design, found, rng: found)
    first = competing("load")[1]
    experiment = separating_experiment(first, first, LIMITS, duration=0.1)
    assert not experiment.separable
    assert str(experiment).startswith("No signal")
    sure = replace(CompetingModel.of(first), drawn_values=())
    design = replace(task("load"), competing=(sure, sure))
    trial = design.play(np.full(200, 3.0))
    assert trial.first_order(design.start).log_odds == 0.0
    assert trial.settled(design.start)[0] == 0.0


def test_the_file_plays_what_was_designed(tmp_path: Path) -> None:
    experiment = designed("load")
    experiment.write(tmp_path / "experiment.csv")
    with pytest.raises(BadParameter, match=r"name it experiment\.csv\.$"):
        experiment.write(tmp_path / "experiment.xlsx")
    columns = read_table(tmp_path / "experiment.csv").columns
    assert list(columns) == ["time", "torque"]
    assert columns["time"] == pytest.approx(experiment.time, abs=1e-9)
    assert columns["torque"] == pytest.approx(experiment.torque, rel=1e-9, abs=1e-9)
    with pytest.raises(MalformedLog, match="angle"):
        Log.read(tmp_path / "experiment.csv")
    entry = json.loads(json.dumps(experiment.to_dict()))
    assert entry["rivals"] == list(experiment.competing)
    assert (entry["duration"], entry["sample_time"]) == pytest.approx((DURATION, SAMPLE_TIME))
    assert entry["expected_log_odds"] > entry["chirp_log_odds"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"torque": 0.0}, "torque limit must be a positive number"),
        ({"torque": np.nan}, "torque limit must be a positive number"),
        ({"torque": 1.0, "speed": -1.0}, "speed limit must be positive"),
        ({"torque": 1.0, "travel": (1.0, 1.0)}, "travel must go from a lower to a higher angle"),
    ],
)
def test_limits_that_leave_no_room_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(BadParameter, match=words):
        Limits(**options)


@pytest.mark.parametrize(
    ("limits", "duration", "words"),
    [
        (Limits(torque=4.0, travel=(1.0, 2.0)), 1.0, "outside of the travel"),
        (Limits(torque=4.0, speed=1e-9), 1.0, "No signal keeps the machine within"),
        (LIMITS, 0.01, "at least ten samples"),
    ],
)
def test_impossible_experiments_are_refused(limits: Limits, duration: float, words: str) -> None:
    _, first, second = competing("lag")
    with pytest.raises(BadParameter, match=words):
        separating_experiment(first, second, limits, duration=duration)


def test_a_signal_below_breakaway_separates_nothing() -> None:
    _, first, second = competing("load")
    experiment = separating_experiment(first, second, Limits(torque=4.0, speed=1e-9), duration=1.0)
    assert np.ptp(experiment.predictions[0]) < 1e-9
    assert not experiment.separable


def test_a_position_servo_is_refused() -> None:
    _, first, second = competing("load")
    run = replace(first.log.runs[0], servo_gain=np.ones(len(first.log.runs[0])))
    servo = replace(first, log=replace(first.log, runs=(run,)))
    with pytest.raises(BadParameter, match="position servo"):
        separating_experiment(servo, second, LIMITS)


@pytest.mark.parametrize("signal", list(shapes(0.1)), ids=str)
def test_waves_have_a_peak_of_one_and_the_requested_length(signal: Signal) -> None:
    torque = replace(signal, amplitude=2.0).playable(0.01).torque(8.0, 0.01)
    assert torque.shape == (800,)
    assert np.abs(torque - 0.1).max() <= 2.0 * (1 + 1e-9)
    assert np.abs(torque - 0.1).max() > 1.5


def test_a_true_special_case_equals_its_general_form() -> None:
    _, general, special = (CompetingModel.of(fit) if isinstance(fit, Fit) else fit for fit in competing("presliding"))
    assert general.contains(special)
    assert not special.contains(general)


def test_observer_noise_matches_filtered_white_noise() -> None:
    bandwidth, step, count = 20.0, 0.005, 200_000
    noise = np.random.default_rng(3).standard_normal(count)
    alpha, beta = observer_gain(bandwidth, np.array([step]))[:, 0]
    x = v = 0.0
    errors = np.empty(count)
    for k in range(count):
        errors[k] = noise[k] - x
        x, v = x + alpha * errors[k] + step * (v + beta * errors[k]), v + beta * errors[k]
    assert noise_factor(bandwidth, step) == pytest.approx(np.var(errors), rel=0.02)
    assert noise_factor(0.0, step) == 1.0


def test_competing_models_are_best_sets_with_and_without_a_cause() -> None:
    _, lag, delay = competing("lag")
    cause = SimpleNamespace(effect="actuator_lag", probability=0.6)
    one, other = (
        SimpleNamespace(effects=("actuator_lag",), fit=lag),
        SimpleNamespace(effects=("input_delay",), fit=delay),
    )
    nothing = SimpleNamespace(effects=(), fit=lag)
    diagnosis: Any = SimpleNamespace(causes=(cause,), sets=(one, other, nothing))
    assert competing_fits(diagnosis) == (lag, delay)
    diagnosis.sets = (one, nothing, other)  # against nothing a signal tells no more than a longer log
    assert competing_fits(diagnosis) is None
    diagnosis.sets, cause.probability = (one, other, nothing), 0.99
    assert competing_fits(diagnosis) is None
