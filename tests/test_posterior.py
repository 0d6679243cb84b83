"""From sets of effects to what is said of each name."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from machine import Machine, excitation, record

from diagnosis import falsification
from diagnosis.evidence.fitted_sets import FittedSets, fitted
from diagnosis.evidence.marginal import families_along
from diagnosis.evidence.posterior import Posterior, beside_discrepancy, beside_names
from diagnosis.falsification import tenable
from diagnosis.verdict import alternatives, judged
from identification.fit import fit
from plant.effects import Compliance, PayloadChange, StribeckFriction, TorqueOffset, catalogue


def believing(**shares: float) -> Posterior:
    """A posterior over sets, whose names are joined by two underscores; fitted are all."""
    sets = {frozenset(filter(None, names.split("__"))): p for names, p in shares.items()}
    fits: Any = tuple(SimpleNamespace(names=names) for names in sets)
    return Posterior(sets=fits, probabilities=tuple(sets.values()), reported=sets)


def test_the_model_holds_names_likelier_there_than_not() -> None:
    """Also where no set of them alone is the likeliest, as that of one name is here."""
    posterior = believing(a=0.3, a__b__c=0.25, a__b=0.2, b=0.15, c=0.1)
    assert posterior.leading == {"a", "b"}
    assert posterior.best.names == {"a", "b"}


def test_without_a_likely_name_the_model_is_the_likeliest_set() -> None:
    assert believing(a=0.4, b=0.35, c=0.25).leading == {"a"}


def test_a_fit_that_holds_the_leading_names_is_the_model() -> None:
    posterior = believing(a=0.3, a__b__c=0.25, a__b=0.2, b=0.15, c=0.1)
    rest = tuple(each for each in posterior.sets if each.names != {"a", "b"})
    fitted = replace(posterior, sets=rest, probabilities=tuple(posterior.reported[each.names] for each in rest))
    assert fitted.best.names == {"a", "b", "c"}


def test_one_of_confounded_effects_is_in_model_beside_a_cause() -> None:
    """None of three lags is likely by itself, but without any of them the model lacks what is surely there."""
    posterior = believing(a__lag=0.35, a__delay=0.33, a__filter=0.32)
    assert posterior.leading == {"a", "lag"}
    assert believing(a=0.6, a__lag=0.2, a__delay=0.2).leading == {"a"}


def test_what_is_likely_by_the_evidence_alone_is_in_no_model() -> None:
    """It is as large as what is unexplained, and may be a part of that."""
    posterior = replace(believing(a=0.5, a__b=0.3, a__c=0.2), probabilities=(0.0, 0.8, 0.2))
    assert posterior.leading == {"a"}


def test_an_alternative_is_likelier_without_an_effect() -> None:
    """`b` stands in the place of `a`; `c` is about as likely in any case."""
    posterior = believing(a=0.5, b=0.25, a__c=0.15, b__c=0.07, c=0.03)
    shares = dict(alternatives(posterior, "a"))
    assert shares["b"] == pytest.approx(0.32)
    found = dict(alternatives(believing(a=0.5, b=0.3, a__c=0.18, b__c=0.02), "a"))
    assert "c" not in found


@pytest.mark.parametrize(("nothing", "verdict"), [(0.3, "ambiguous"), (0.55, "nothing_missing")])
def test_confounded_effects_together_mean_that_one_is_missing(nothing: float, verdict: str) -> None:
    """None of three is likely by itself, but that it is one of them is likelier than that nothing is missing."""
    each = (1.0 - nothing) / 3.0
    shares = {frozenset[str](): nothing} | {
        frozenset({name}): each for name in ("input_delay", "sensor_lag", "back_emf")
    }
    quiet = SimpleNamespace(something=0.0, at_its_limit=False)
    fits: Any = tuple(SimpleNamespace(names=n, discrepancy=SimpleNamespace(posterior=quiet)) for n in shares)
    posterior = Posterior(sets=fits, probabilities=tuple(shares.values()), reported=shares)
    missing: Any = SimpleNamespace(excess=0.0)
    found = judged(posterior, missing, shows=False, ruled_out=None)
    assert found.verdict == verdict
    assert bool(found.causes) == (verdict == "ambiguous")


@pytest.mark.parametrize(("sure", "verdict"), [(0.95, "ambiguous"), (0.99, "named")])
def test_reported_probabilities_are_tempered(sure: float, verdict: str) -> None:
    """What is likely is decided before; how sure it is, by odds to the power of the learning rate."""
    quiet = SimpleNamespace(something=0.0, at_its_limit=False)
    shares = {frozenset({"input_delay"}): sure, frozenset({"back_emf"}): 1.0 - sure}
    fits: Any = tuple(SimpleNamespace(names=n, discrepancy=SimpleNamespace(posterior=quiet)) for n in shares)
    posterior = Posterior(sets=fits, probabilities=tuple(shares.values()), reported=shares)
    found = judged(posterior, cast(Any, SimpleNamespace(excess=0.0)), shows=False, ruled_out=None)
    odds = (sure / (1.0 - sure)) ** 0.7
    assert found.causes == {"input_delay": pytest.approx(odds / (1.0 + odds))}
    assert sum(posterior.tempered.reported.values()) == pytest.approx(1.0)
    assert dict(alternatives(posterior.tempered, "input_delay")) == {"back_emf": pytest.approx(1.0 / (1.0 + odds))}
    assert found.verdict == verdict


def test_confounded_effects_do_not_remove_each_other() -> None:
    """Each changes little beside the other, and one of them alone much: one of them is there."""
    small = {"a": 0.3, "b": 0.6}

    def beyond(name: str, without: frozenset[str] = frozenset()) -> float:
        return 5.0 if without else small[name]

    sizes = SimpleNamespace(
        beyond=beyond, beyond_special={}, unexplained=1.0, to_exceed=lambda name: 1.0, is_left=lambda *_: 1.0
    )
    sound = SimpleNamespace(posterior=SimpleNamespace(at_its_limit=False))
    explanation: Any = SimpleNamespace(names=frozenset(small), sizes=sizes, discrepancy=sound)
    found = beside_discrepancy(explanation, 1.0)
    assert sum(found.values()) == pytest.approx(1.0)
    assert found.get(frozenset(), 0.0) < 0.05
    assert found[frozenset({"b"})] > 0.85


def explored_of(**hidden: dict[str, float]) -> FittedSets:
    null = fit(record(Machine().hiding(**hidden) if hidden else Machine(), excitation(3, duration=12.0), seed=3).log())
    families = families_along(null)
    assert families is not None
    return FittedSets(null=null, effects=dict(catalogue), tell=lambda line: None, families=families)


def test_a_wider_form_may_come_out_as_its_special_case() -> None:
    found = explored_of(coulomb_friction={"torque": 0.3})
    narrow = StribeckFriction(coulomb=0.3, excess=0.01, velocity=1e-9)
    wide = fitted(found.null, [found.null.model.with_effect(narrow)], found.null.bandwidth)
    explained_set = found.explanation_of(replace(wide, model=wide.model.with_effect(narrow)))
    assert explained_set is not None
    assert explained_set.names == {"coulomb_friction"}


@pytest.mark.parametrize("swing", [{"at_bound": True}, {"value": None, "std": None}])
def test_a_spring_whose_swing_the_log_cannot_show_is_ruled_out(swing: dict[str, Any]) -> None:
    found = explored_of()
    spring = Compliance(frequency=50.0, damping=0.2, motor_share=0.3)
    soft = fitted(found.null, [found.null.model.with_effect(spring)], found.null.bandwidth)
    kept = [replace(p, value=1.0, std=0.1, at_bound=False) for p in soft.parameters]
    lines = [replace(p, **swing) if p.name == "compliance.frequency" else p for p in kept]
    explained_set = found.explanation_of(replace(soft, parameters=tuple(lines), converged=True))
    base = found.explanation_of(found.null)
    assert explained_set is not None
    assert base is not None
    wanted = replace(explained_set, log_marginal=base.log_marginal + 100.0)
    left = tenable(found.null, [base, wanted], found.null.log)
    assert left.falsified["compliance"] == "its resonance is faster than this log can show"
    assert np.isfinite(left.lost)
    assert left.posterior.best.names == frozenset()
    swinging = replace(soft, model=found.null.model.with_effect(spring), parameters=tuple(kept), converged=True)
    other = found.explanation_of(swinging)
    assert other is not None
    left = tenable(found.null, [base, wanted, replace(other, log_marginal=base.log_marginal - 5.0)], found.null.log)
    assert "compliance" not in left.falsified  # for its values only where no set can have it


def test_what_changes_before_anything_is_seen_is_no_effect() -> None:
    """How much the load was before trades places with what it is after. An instant, which is told, is no size."""
    found = explored_of()
    begun = PayloadChange(time=0.4 * found.null.log.sample_time, inertia=0.1, gravity=0.2)
    soon = fitted(found.null, [found.null.model.with_effect(begun)], found.null.bandwidth)
    lines = [replace(p, value=0.1, std=0.01) if p.name == "payload_change.time" else p for p in soon.parameters]
    base, wanted = found.explanation_of(found.null), found.explanation_of(replace(soon, parameters=tuple(lines)))
    assert base is not None
    assert wanted is not None
    left = tenable(found.null, [base, replace(wanted, log_marginal=base.log_marginal + 20.0)], found.null.log)
    assert left.falsified["payload_change"] == "this log does not separate its parameters from the other parameters"


VALIDATION = {
    "object": np.full(20, -2.0),
    "silent": np.zeros(20),
    "favour": np.full(20, 2.0),
    "mixed": np.full(20, -10.0),
}
VALIDATION["mixed"][0] = 400.0  # on the whole they favour it


@pytest.mark.parametrize("validation", VALIDATION)
def test_evidence_of_validation_data_counts_against_an_effect(monkeypatch: pytest.MonkeyPatch, validation: str) -> None:
    """An effect of 20 in log odds, to which they object with 40 in log-likelihood; or not, or that they favour."""
    stays = validation != "object"
    found = explored_of()
    offset = fitted(found.null, [found.null.model.with_effect(TorqueOffset(torque=0.01))], found.null.bandwidth)
    base, wanted = found.explanation_of(found.null), found.explanation_of(offset)
    assert base is not None
    assert wanted is not None
    monkeypatch.setattr(falsification, "_impossible", lambda *_: None)
    rejection = falsification._Rejection(worse=0.0, against=VALIDATION[validation])
    monkeypatch.setattr(falsification, "_rejection", lambda *_: rejection)
    sure = replace(wanted, log_marginal=base.log_marginal + 20.0)
    left = tenable(found.null, [base, sure], found.null.log)
    assert (left.posterior.best.names == {"torque_offset"}) == stays
    assert (left.posterior.of("torque_offset") > 0.9) == stays


def test_a_wider_form_beside_a_sure_name_is_not_taken_for_it() -> None:
    posterior = believing(
        coulomb_friction=0.3, coulomb_friction__asymmetric_friction=0.4, coulomb_friction__stribeck_friction=0.3
    )
    assert posterior.leading == {"coulomb_friction"}


@pytest.mark.parametrize(("more", "kept"), [(-3.0, 0.0), (0.0, 0.0), (0.5, 0.5), (50.0, 100.0 / 101.0)])
def test_what_has_no_name_explains_more_than_a_law_may_err_by(more: float, kept: float) -> None:
    """Friction that changes the innovations by 1 rad may err by 0.01; half a unit of log-likelihood is worth that."""

    def explained_set(log_likelihood: float, **sizes: float) -> Any:
        noise = SimpleNamespace(posterior=SimpleNamespace(variance=1e-4))
        sizes_of_set = SimpleNamespace(effects=sizes)
        by = SimpleNamespace(log_likelihood=log_likelihood)
        return SimpleNamespace(names=frozenset(sizes), likelihood=by, sizes=sizes_of_set, discrepancy=noise)

    named, nothing = explained_set(7.0, coulomb_friction=1.0, torque_offset=0.2), explained_set(7.0)
    beside, alone = (
        explained_set(7.0 + more, friction_over_velocity=1.0),
        explained_set(7.0 + more, stribeck_friction=1.0),
    )
    assert beside_names(beside, named) == pytest.approx(kept)
    assert beside_names(beside, nothing) == 1.0  # there is no law that could err
    assert beside_names(alone, named) == 1.0  # it has a name
    assert beside_names(beside, explained_set(7.0, backlash=np.inf)) == 1.0  # its size is not known


@pytest.mark.parametrize(("more", "share"), [(0.5, 0.5), (50.0, 100.0 / 101.0)])
def test_what_a_law_may_err_by_goes_to_the_names(more: float, share: float) -> None:
    """The set without a name is far likelier by its evidence; what it does not keep is the friction's."""

    def explained_set(name: str, log_likelihood: float, log_marginal: float) -> Any:
        sizes = {"effects": {name: 1.0}, "beyond_special": {}, "unexplained": 0.0}
        sizes_of_set = SimpleNamespace(
            **sizes, beyond=lambda name, out: 1.0, to_exceed=lambda name: 0.0, is_left=lambda *_: 1.0
        )
        by = SimpleNamespace(log_likelihood=log_likelihood, by_block=np.zeros)
        noise = SimpleNamespace(posterior=SimpleNamespace(variance=1e-4, at_its_limit=False))
        names = frozenset({name})
        return SimpleNamespace(
            names=names, log_marginal=log_marginal, likelihood=by, sizes=sizes_of_set, discrepancy=noise
        )

    sets = [explained_set("coulomb_friction", 7.0, 0.0), explained_set("friction_over_velocity", 7.0 + more, 90.0)]
    posterior = Posterior.over(sets)
    assert posterior.nonparametric() == pytest.approx(share)
    assert posterior.probability("coulomb_friction") == pytest.approx(1.0 - share, abs=1e-9)
    assert posterior.of("friction_over_velocity") == pytest.approx(1.0)
