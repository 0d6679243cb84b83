"""Where no effect is probable, the extended model may still describe the log; the summary says that this is no name."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest
from hanging_pendulum import hanging_pendulum
from machine import Machine, excitation, record

from diagnosis import diagnose, diagnose_once
from diagnosis.description import better_description, likeliest, worse_description
from diagnosis.evidence.posterior import Posterior
from diagnosis.explanation.summary import _described
from diagnosis.refit import fitted_from, problem_near
from identification.fit import base_model
from identification.fit_result import Fit
from identification.log import Log
from identification.prior_knowledge import PriorKnowledge
from identification.slower_observer import behind_a_slower_observer
from plant.effects import catalogue


@pytest.fixture(scope="module")
def fits() -> tuple[Fit, Fit, Log]:
    """The base model of a pendulum that hangs at zero, the model with the gravity it lacks, and validation data."""
    log = hanging_pendulum(1, 4.0)
    base = behind_a_slower_observer(log, base_model(log), PriorKnowledge(), lambda fit: True)
    assert base is not None
    hangs = base.model.with_effect(catalogue["gravity_offset"](beta=0.13))
    return base, fitted_from(base, problem_near(base, hangs)), hanging_pendulum(2, 5.0)


def test_what_predicts_better_is_the_better_description(fits: tuple[Fit, Fit, Log]) -> None:
    base, hanging, validation = fits
    assert better_description(base, hanging, validation)
    assert not better_description(hanging, base, validation)
    assert not better_description(base, base, validation)


def test_a_likelier_model_that_predicts_no_better_is_none(fits: tuple[Fit, Fit, Log]) -> None:
    """One step ahead, a faster observer alone makes a model likelier."""
    base, _, validation = fits
    assert not better_description(base, replace(base, log_likelihood=base.log_likelihood + 1e4), validation)


def test_a_model_that_predicts_worse_than_the_base_model_is_none(fits: tuple[Fit, Fit, Log]) -> None:
    base, hanging, validation = fits
    assert worse_description(hanging, base, validation)
    assert not worse_description(base, hanging, validation)
    assert not worse_description(base, base, validation)


def test_too_many_parameters_are_no_better_description(fits: tuple[Fit, Fit, Log]) -> None:
    base, hanging, validation = fits
    assert not better_description(base, replace(hanging, log_likelihood=base.log_likelihood + 1.0), validation)


def test_the_likeliest_set_has_the_observer_that_it_needs(fits: tuple[Fit, Fit, Log]) -> None:
    base, hanging, _ = fits
    first = SimpleNamespace(names=frozenset({"gravity_offset"}), fit=hanging)
    found = likeliest(Posterior(sets=(first,), probabilities=(1.0,), reported={}), base)
    assert found.model.holds("gravity_offset")
    assert found.log_likelihood > hanging.log_likelihood
    alone = SimpleNamespace(names=frozenset(), fit=hanging)
    assert likeliest(Posterior(sets=(alone,), probabilities=(1.0,), reported={}), base) is base


def test_a_description_is_told_as_one(fits: tuple[Fit, Fit, Log]) -> None:
    base, hanging, _ = fits

    def told(extended: Fit, without: dict[str, Fit]) -> str:
        return _described(SimpleNamespace(base=base, extended=extended, model=extended.model, without=without))

    assert told(hanging, {}) == "gravity offset"
    assert told(hanging, {"gravity_offset": base}) == ""
    assert told(base, {}) == ""


def test_a_diagnosis_carries_the_description(monkeypatch: pytest.MonkeyPatch) -> None:
    described = list[Fit]()

    def marked(posterior: Posterior, base: Fit) -> Fit:
        described.append(replace(base))
        return described[-1]

    monkeypatch.setattr(diagnose_once, "likeliest", marked)
    monkeypatch.setattr(diagnose_once, "better_description", lambda fit, other, held_out: other in described)
    log = record(Machine(), excitation(4, duration=15.0), seed=4).log()
    found = diagnose(log, candidates=["quadratic_drag"])
    assert not found.without
    assert found.extended is described[-1]
    monkeypatch.setattr(diagnose_once, "worse_description", lambda base, fit, held_out: fit in described)
    found = diagnose(log, candidates=["quadratic_drag"])
    assert found.extended is found.base
