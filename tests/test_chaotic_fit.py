"""A fit of a model in which small errors grow has the likelihood of its own observer."""

from dataclasses import replace

import pytest
from machine import Machine, excitation, record

from diagnosis.refit import fitted_from, problem_near
from identification.fit import fit
from identification.noise import log_likelihood
from plant.effects import Backlash


def test_its_likelihood_is_that_of_its_own_observer() -> None:
    """It began with a faster observer, and kept the likelihood of that one."""
    base = replace(fit(record(Machine(), excitation(4, duration=8.0), seed=4).log()), bandwidth=1.0)
    problem = problem_near(base, base.model.with_effect(Backlash(gap=0.003, motor_share=0.3)))
    found = fitted_from(base, problem, 3)
    cost = problem.cost(problem.pack(found.model.values, found.initial), found.bandwidth, 0.0)
    assert found.log_likelihood == pytest.approx(log_likelihood(cost, found.samples))
