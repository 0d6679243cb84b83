"""What is carried without a name: when it is asked, how much a second must bring, whose place it takes."""

from __future__ import annotations

from functools import partial
from importlib import import_module
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from machine import Machine, excitation, record

from diagnosis import effects_against_curves, nonparametric_residual, parts_consistency, random_walk_load
from diagnosis.hypothesis import Hypothesis
from diagnosis.nonparametric_residual import ResidualModel, beside_unnamed, residual_model
from diagnosis.overdispersion import Overdispersion
from diagnosis.stepwise_round import Addition
from diagnosis.stepwise_search import Outcome
from plant.effects import CoulombFriction
from plant.effects.effect import Array
from plant.effects.nonparametric_curve import HEIGHTS
from plant.effects.parameter_varying import FrictionOverTurn

BASE, FIRST, SECOND = (SimpleNamespace(name=name, bandwidth=5.0) for name in ("base", "first", "second"))
SAID = (
    "Curve over velocity alone explains as much as these effects together; a log with a different motion would decide."
)


@pytest.mark.parametrize(("brings", "kept"), [(19.0, 1), (21.0, 2)])
def test_a_second_must_bring_a_fifth_of_what_the_first_did(
    monkeypatch: pytest.MonkeyPatch, brings: float, kept: int
) -> None:
    following = {"base": FIRST, "first": SECOND}
    rises = {("first", "base"): 100.0, ("second", "first"): brings}
    monkeypatch.setattr(nonparametric_residual, "_one_more", lambda at, found, known: following[at.name])
    monkeypatch.setattr(nonparametric_residual, "unnamed_dependence", lambda at, *kinds, **bar: ())
    monkeypatch.setattr(nonparametric_residual, "evidence_of", lambda after, before: rises[after.name, before.name])
    assert len(nonparametric_residual.curve_path(BASE)) == kept  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("fast", "worth", "taken"), [(False, 111.0, SECOND), (False, 109.0, FIRST), (True, 500.0, FIRST)]
)
def test_richer_curves_must_explain_clearly_more(
    monkeypatch: pytest.MonkeyPatch, fast: bool, worth: float, taken: Any
) -> None:
    fit: Any = SimpleNamespace(bandwidth=5.0)
    monkeypatch.setattr(nonparametric_residual, "unnamed_dependence", lambda at, *kinds, **bar: ((None, 50.0),))
    monkeypatch.setattr(
        nonparametric_residual,
        "_path",
        lambda at, kinds, *more: (FIRST,) if kinds is nonparametric_residual.plain else (SECOND,),
    )
    monkeypatch.setattr(nonparametric_residual, "follows_anything", lambda at: fast)
    monkeypatch.setattr(nonparametric_residual, "_colour", lambda fits, than: 1.0)
    monkeypatch.setattr(
        nonparametric_residual, "charged_evidence", lambda path, than, over: 100.0 if path == (FIRST,) else worth
    )
    assert residual_model(fit).path == (taken,)


@pytest.mark.parametrize(("bandwidth", "colour", "asked"), [(0.0, (), False), (0.0, (0.5,), True), (5.0, (), True)])
def test_richer_curves_are_tried_if_simple_ones_leave_residuals(
    monkeypatch: pytest.MonkeyPatch, bandwidth: float, colour: tuple[float, ...], asked: bool
) -> None:
    fit: Any = SimpleNamespace(bandwidth=5.0, log=SimpleNamespace(colour=()))
    curve: Any = SimpleNamespace(bandwidth=bandwidth, log=SimpleNamespace(colour=colour))
    kinds: list[Any] = []

    def path(at: Any, which: Any, *more: Any) -> Any:
        kinds.append(which)
        return (curve,) if which is nonparametric_residual.plain else ()

    monkeypatch.setattr(nonparametric_residual, "unnamed_dependence", lambda at, *kinds, **bar: ((None, 50.0),))
    monkeypatch.setattr(nonparametric_residual, "_path", path)
    assert residual_model(fit).path == (curve,)
    assert (len(kinds) == 2) is asked


@pytest.mark.parametrize(("promise", "fitted"), [(9.0, False), (11.0, True)])
def test_richer_curves_need_a_promising_score_to_be_fitted(
    monkeypatch: pytest.MonkeyPatch, promise: float, fitted: bool
) -> None:
    """Names that leave something to an observer explain 100, curves over one variable none of it, the richer 300."""
    names, base = SimpleNamespace(name="names", bandwidth=5.0), SimpleNamespace(name="base")
    rich: Any = SimpleNamespace(name="rich")
    outcome = Outcome(
        base=base,  # type: ignore[arg-type]
        additions=(SimpleNamespace(effect="a", fit=names),),  # type: ignore[arg-type]
        candidates=(),
    )
    explains = {(): 0.0, ("names",): 100.0, ("rich",): 300.0}
    asked: list[str] = []
    beside = ResidualModel(path=(), seen=())
    monkeypatch.setattr(effects_against_curves, "beside_unnamed", lambda base, additions: (additions, beside))
    monkeypatch.setattr(effects_against_curves, "is_plausible", lambda at, name: True)
    monkeypatch.setattr(effects_against_curves, "curve_path", lambda at: ())
    monkeypatch.setattr(effects_against_curves, "best_curve_score", lambda at: promise)
    monkeypatch.setattr(nonparametric_residual, "_colour", lambda fits, than: 1.0)
    for module in (nonparametric_residual, effects_against_curves):
        monkeypatch.setattr(
            module, "charged_evidence", lambda path, than, over=1.0: explains[tuple(fit.name for fit in path)]
        )
    monkeypatch.setattr(
        effects_against_curves,
        "residual_model",
        lambda at: asked.append(at.name) or ResidualModel(path=(rich,), seen=()),
    )
    kept, left, _ = effects_against_curves.supported_effects(outcome)
    assert asked == (["base"] if fitted else [])
    assert (kept.additions, left.path) == (((), (rich,)) if fitted else (outcome.additions, ()))


@pytest.mark.parametrize(("adds", "asked"), [(9.0, []), (11.0, ["base"])])
def test_richer_curves_are_compared_only_if_they_add_a_tenth(
    monkeypatch: pytest.MonkeyPatch, adds: float, asked: list[str]
) -> None:
    """Names explain 100 and leave something that only a law over two variables takes up, which alone explains 300."""
    names, base, both, rich = (
        SimpleNamespace(name=name, bandwidth=0.0, model=SimpleNamespace(effects=(FrictionOverTurn(low=0.0, high=0.0),)))
        for name in ("names", "base", "both", "rich")
    )
    outcome = Outcome(
        base=base,  # type: ignore[arg-type]
        additions=(SimpleNamespace(effect="a", fit=names),),  # type: ignore[arg-type]
        candidates=(),
    )
    explains = {"names": 100.0, "both": 100.0 + adds, "rich": 300.0}
    questions: list[str] = []
    beside, alone = (ResidualModel(path=(fit,), seen=()) for fit in (both, rich))  # type: ignore[arg-type]
    monkeypatch.setattr(effects_against_curves, "beside_unnamed", lambda base, additions: (additions, beside))
    monkeypatch.setattr(effects_against_curves, "is_plausible", lambda at, name: True)
    monkeypatch.setattr(nonparametric_residual, "_colour", lambda fits, than: 1.0)
    monkeypatch.setattr(
        nonparametric_residual, "charged_evidence", lambda path, than, over=1.0: explains[path[-1].name]
    )
    monkeypatch.setattr(effects_against_curves, "residual_model", lambda at: questions.append(at.name) or alone)
    kept, left, _ = effects_against_curves.supported_effects(outcome)
    assert questions == asked
    assert (kept.additions, left.path) == (((), (rich,)) if asked else (outcome.additions, (both,)))


@pytest.mark.parametrize(
    ("names", "ahead", "left"),
    [(2, 50.0, 0.96), (2, 5.0, 0.709), (2, 2.0, 0.116), (2, 1.0, None), (2, -50.0, None), (1, -50.0, 0.96)],
)
def test_several_effects_are_as_sure_as_their_lead_over_curves(
    monkeypatch: pytest.MonkeyPatch, names: int, ahead: float, left: float | None
) -> None:
    """Two names pay 4 more for their search than the curve for its variable. One alone is believed."""
    dry, curve = (SimpleNamespace(name=name, title=name) for name in ("dead_zone", "curve over velocity"))
    models = [SimpleNamespace(effects=(dry,), effect=lambda name: {"dead_zone": dry}.get(name))]
    models.append(SimpleNamespace(effects=(dry, curve)))
    base, alone = (SimpleNamespace(model=model) for model in models)
    own: Any = SimpleNamespace(effect=SimpleNamespace(name="a"), charge=2.0 + 0.5 * np.log(4.0))
    odds = {"a": 0.96, "b": 0.03, "none": 0.01}
    told: Any = SimpleNamespace(bandwidth=0.0)
    addition: Any = partial(Addition, effect="a", fit=told, odds=odds, evidence=9.0, contest=(own,))
    outcome = Outcome(base=base, additions=tuple(addition() for _ in range(names)), candidates=())  # type: ignore[arg-type]
    monkeypatch.setattr(effects_against_curves, "plain", dict.fromkeys("1234"))
    monkeypatch.setattr(effects_against_curves, "evidence_lead", lambda one, other, than: ahead)
    monkeypatch.setattr(effects_against_curves, "curve_path", lambda at: (alone,))
    monkeypatch.setattr(effects_against_curves, "is_plausible", lambda at, name: True)
    monkeypatch.setattr(
        effects_against_curves, "beside_unnamed", lambda base, additions: (additions, ResidualModel(path=(), seen=()))
    )
    found, beside, said = effects_against_curves.supported_effects(outcome)
    assert len(found.additions) == (names if left else 0)
    assert beside.path == (() if left else (alone,))
    for kept in found.additions:
        assert kept.odds["a"] == pytest.approx(left, abs=0.001)
        assert sum(kept.odds.values()) == pytest.approx(1.0)
    assert said == ([SAID] if left in (0.709, 0.116) else [])


def test_what_is_doubted_of_several_names_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    whole: Any = import_module("diagnosis.diagnose")
    monkeypatch.setattr(whole, "supported_effects", lambda outcome: (outcome, ResidualModel(path=(), seen=()), [SAID]))
    log = record(Machine(), excitation(1, duration=10.0), seed=1).log()
    assert SAID in whole.diagnose(log, candidates=["coulomb_friction"]).warnings


def test_the_first_curve_is_fitted_once_for_both_searches(monkeypatch: pytest.MonkeyPatch) -> None:
    fit: Any = SimpleNamespace(bandwidth=5.0, log=SimpleNamespace(colour=()), free=(), samples=100)
    starts = {name: SimpleNamespace(name=name, shape=tuple, variables=()) for name in ("plain", "rich")}
    for start in starts.values():
        start.begun = partial(SimpleNamespace, name=f"{start.name} begun")
    fitted: list[str] = []

    def dependence(at: Any, kinds: Any = nonparametric_residual.plain, *, bar: float = 0.0) -> Any:
        return tuple(
            (start, 50.0)
            for name, start in starts.items()
            if kinds is not nonparametric_residual.plain or name == "plain"
        )

    def refit(at: Any, start: Any, *, fixed: Any) -> Any:
        fitted.append(start.name)
        return SimpleNamespace(free=(), name=start.name)

    monkeypatch.setattr(nonparametric_residual, "unnamed_dependence", dependence)
    monkeypatch.setattr(nonparametric_residual, "may_be_random_walk", lambda at: False)
    monkeypatch.setattr(nonparametric_residual, "_line_charge", lambda at, start: 0.0)
    monkeypatch.setattr(nonparametric_residual, "refit", refit)
    monkeypatch.setattr(nonparametric_residual, "evidence_of", lambda after, before: 100.0)
    monkeypatch.setattr(nonparametric_residual, "passes_validation", lambda before, after, must_show: False)
    assert residual_model(fit).path == ()
    assert fitted == ["plain begun", "rich begun"]


@pytest.mark.parametrize(("peaks", "kept"), [(1.0, True), (4.0, False)])
def test_a_ripple_pays_a_search_charge_by_its_neighbouring_lines(
    monkeypatch: pytest.MonkeyPatch, peaks: float, kept: bool
) -> None:
    fit: Any = SimpleNamespace(bandwidth=5.0, log=SimpleNamespace(colour=()), free=(), samples=100)
    start = SimpleNamespace(
        name="ripple",
        shape=tuple,
        begun=lambda: None,
        of_lines=True,
        traces=lambda motion: iter([SimpleNamespace(searched=1000)]),
    )
    after = SimpleNamespace(free=(), name="ripple")
    monkeypatch.setattr(nonparametric_residual, "may_be_random_walk", lambda at: False)
    monkeypatch.setattr(nonparametric_residual, "refit", lambda *_, fixed: after)
    monkeypatch.setattr(nonparametric_residual, "evidence_of", lambda after, before: 6.91 + 2.0 * np.log(1000.0))
    monkeypatch.setattr(nonparametric_residual, "passes_validation", lambda before, after, must_show: True)
    monkeypatch.setattr(nonparametric_residual, "excess_of_neighbouring_peaks", lambda at, name: peaks)
    monkeypatch.setattr(nonparametric_residual.Screen, "views", lambda at: [(SimpleNamespace(motion=None), 0.0)])
    found: Any = ((start, 50.0),)
    assert (nonparametric_residual._one_more(fit, found, {}) is after) == kept


@pytest.mark.parametrize(("bandwidth", "dispersion"), [(0.0, None), (5.0, 3.0)])
def test_a_name_that_does_not_pay_beside_it_goes(
    monkeypatch: pytest.MonkeyPatch, bandwidth: float, dispersion: float | None
) -> None:
    """Where an observer still follows something, as far as the parts of the log agree about it."""
    counted: list[float | None] = []

    def fit(*names: str) -> Any:
        model = SimpleNamespace(names=names, without_effect=lambda gone: [name for name in names if name != gone])
        return SimpleNamespace(model=model, bandwidth=bandwidth)

    def needed_with(addition: Any, at: Any, less: Any, *, dispersion: float | None) -> float:
        counted.append(dispersion)
        return 0.91 if addition.effect == "true" else 0.89

    near, true = (SimpleNamespace(effect=name, evidence=10.0, fit=fit(name)) for name in ("near", "true"))
    monkeypatch.setattr(
        nonparametric_residual,
        "residual_model",
        lambda at: ResidualModel(path=(fit("near", "true", "curve"),), seen=()),
    )
    monkeypatch.setattr(parts_consistency, "fitted_near", lambda at, names: fit(*names))
    monkeypatch.setattr(parts_consistency, "probability_needed", needed_with)
    monkeypatch.setattr(parts_consistency, "overdispersion", lambda at, name: Overdispersion(3.0, 1.0))
    monkeypatch.setattr(nonparametric_residual, "refitted_path", lambda base, kept, at: kept)
    additions, beside = beside_unnamed(fit(), (near, true))  # type: ignore[arg-type]
    assert [addition.effect for addition in additions] == ["true"]
    assert beside.path[-1].model.names == ("true", "curve")
    assert counted == [dispersion, dispersion]


def test_what_is_carried_beside_names_that_all_go_is_asked_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    def fit(name: str) -> Any:
        return SimpleNamespace(name=name, model=SimpleNamespace(without_effect=lambda gone: gone), bandwidth=0.0)

    asked: list[str] = []
    beside, alone = (ResidualModel(path=(fit(name),), seen=()) for name in ("beside", "alone"))
    near: Any = SimpleNamespace(effect="near", evidence=10.0, fit=fit("near"))
    monkeypatch.setattr(
        nonparametric_residual,
        "residual_model",
        lambda at: asked.append(at.name) or (beside if at.name == "near" else alone),
    )
    monkeypatch.setattr(parts_consistency, "fitted_near", lambda at, model: fit("less"))
    monkeypatch.setattr(parts_consistency, "probability_needed", lambda addition, at, less, dispersion: 0.89)
    assert beside_unnamed(fit("base"), (near,)) == ((), alone)
    assert asked == ["near", "base"]


def test_evidence_counts_as_far_as_the_parts_of_a_log_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    """The charge for a search knows of high peaks; only what goes beyond it, 12 here, is divided."""
    own = Hypothesis(effect=CoulombFriction(torque=0.1), coefficients=1, charge=8.0)
    assert own.discounted(20.0, 4.0) == pytest.approx(11.0)
    assert own.discounted(5.0, 4.0) == pytest.approx(5.0)
    seen: list[float | None] = []
    monkeypatch.setattr(Hypothesis, "visible", lambda self, at, than, evidence: seen.append(evidence) or 0.0)
    monkeypatch.setattr(random_walk_load, "replace", lambda at, **changes: at)
    monkeypatch.setattr(random_walk_load, "evidence_of", lambda at, than, over: 20.0)
    addition: Any = SimpleNamespace(effect="coulomb_friction", contest=(own,))
    fit: Any = SimpleNamespace(model=SimpleNamespace(effect=lambda name: name))
    for dispersion in (None, 4.0):
        random_walk_load.probability_needed(addition, fit, fit, dispersion=dispersion)
    assert seen == [None, pytest.approx(11.0)]


def test_varying_friction_begins_where_none_of_it_is_cut_off() -> None:
    heights = np.array([0.1, -0.2, 0.0, 0.3, 0.1, 0.0, -0.1, 0.2, 0.0])

    def begun(some: Array) -> Array:
        ends = {"low": 0.0, "high": 2.0 * np.pi}
        return np.array(FrictionOverTurn(**ends, **dict(zip(HEIGHTS, some, strict=True))).begun().values[2:])

    assert begun(heights).min() == 0.0
    assert np.ptp(begun(heights)) == pytest.approx(np.ptp(heights))
    assert begun(np.abs(heights)) == pytest.approx(np.abs(heights))


@pytest.mark.parametrize(("likelier", "more"), [("one", True), ("other", False)])
def test_two_ways_are_compared_by_the_colour_of_the_likelier(
    monkeypatch: pytest.MonkeyPatch, likelier: str, more: bool
) -> None:
    """Evidence of 30 and 20 for costs of 5 and 2, twice as wide by the other's colour."""
    fits: Any = {n: SimpleNamespace(name=n, log_likelihood=float(n == likelier)) for n in ("one", "other")}
    rise, cost = {"one": 30.0, "other": 20.0}, {"one": 5.0, "other": 2.0}
    monkeypatch.setattr(nonparametric_residual, "widening", lambda at, than: {"one": 1.0, "other": 2.0}[at.name])
    monkeypatch.setattr(nonparametric_residual, "evidence_of", lambda at, than, over: rise[at.name] / over)
    monkeypatch.setattr(nonparametric_residual, "parameter_cost", lambda at, than: cost[at.name])
    assert nonparametric_residual.is_clearly_likelier((fits["one"],), (fits["other"],), BASE, times=1.3) is more  # type: ignore[arg-type]
