"""The minimiser and the colour of noise, against closed forms and other people's solvers."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.linalg import toeplitz
from scipy.optimize import lsq_linear
from scipy.stats import norm

from identification.least_squares import NormalEquations, Uncertainty, bounded_least_squares, minimise, uncertainty
from identification.noise import autoregression, colour, colouring, log_likelihood, whiten

Array = NDArray[np.float64]

UNBOUNDED = np.full(2, np.inf)


def coloured_information(jacobian: Array, residuals: Array) -> Array:
    """(n, n) J'RJ, with R the covariance of the residuals (T,) from their autoregression, J the Jacobian (T, n)."""
    coefficients, variance = colouring(residuals)
    coloured = colour(jacobian[::-1], coefficients)  # R = variance C C', C the colouring filter: C' is backwards
    return np.asarray(variance * (coloured.T @ coloured))


def coloured_noise(samples: int = 20_000, pole: float = 0.7, seed: int = 0) -> Array:
    """(samples,) first-order autoregressive noise, driven by white noise of unit variance."""
    return colour(np.random.default_rng(seed).standard_normal(samples), np.array([pole]))


def estimated_uncertainty(residuals: Array, jacobian: Array) -> Uncertainty:
    return uncertainty(jacobian.T @ jacobian, coloured_information(jacobian, residuals), float(np.var(residuals)))


# The colour of noise.


def test_an_autoregression_is_found() -> None:
    found = autoregression(coloured_noise(), order=3)
    assert found == pytest.approx([0.7], abs=0.03)  # and no order more
    assert np.var(whiten(coloured_noise(), found)) == pytest.approx(1.0, rel=0.03)


def test_white_noise_has_no_colour() -> None:
    found = [autoregression(np.random.default_rng(seed).standard_normal(5000)) for seed in range(20)]
    assert sum(each.size > 0 for each in found) <= 1
    second = autoregression(colour(np.random.default_rng(0).standard_normal(5000), np.array([0.5, -0.3])))
    assert second == pytest.approx([0.5, -0.3], abs=0.05)


@given(st.integers(0, 2**32 - 1))
def test_whitening_and_colouring_undo_each_other(seed: int) -> None:
    rng = np.random.default_rng(seed)
    values = rng.standard_normal((200, 3))
    coefficients = autoregression(coloured_noise(500, seed=seed % 100), order=5)
    assert whiten(colour(values, coefficients), coefficients) == pytest.approx(values, abs=1e-9)


def test_information_counts_the_covariance_of_the_residuals() -> None:
    residuals, time = coloured_noise(), np.linspace(0.0, 1.0, 400)
    jacobian = np.column_stack((time, np.sin(30.0 * time)))
    found = coloured_information(jacobian, residuals)
    assert np.diag(found) == pytest.approx(
        np.diag(jacobian.T @ toeplitz(0.7 ** np.arange(400)) @ jacobian) / (1 - 0.7**2), rel=0.25
    )
    # to the last digit: residuals are C w, with w white and the columns of C the answers to single innovations
    coefficients = autoregression(residuals)
    answers = colour(np.eye(400), coefficients)
    level = np.mean(whiten(residuals, coefficients) ** 2)
    assert found == pytest.approx(level * jacobian.T @ answers @ answers.T @ jacobian, rel=1e-9)


def test_standard_errors_under_coloured_noise_match_repetitions() -> None:
    time = np.linspace(0.0, 4.0, 500)
    jacobian = np.column_stack((np.ones(500), np.sin(time)))
    noises = [coloured_noise(500, seed=seed) for seed in range(300)]
    spread = np.std([np.linalg.lstsq(jacobian, noise, rcond=None)[0] for noise in noises], axis=0)
    estimated = [estimated_uncertainty(noise, jacobian) for noise in noises[:30]]
    assert np.median([np.sqrt(np.diag(u.covariance)) for u in estimated], axis=0) == pytest.approx(spread, rel=0.2)
    assert np.all(np.median([np.sqrt(np.diag(u.white)) for u in estimated], axis=0) < 0.7 * spread)


def test_a_parameter_without_effect_is_undetermined() -> None:
    rng = np.random.default_rng(0)
    jacobian = np.column_stack((rng.standard_normal(300), np.zeros(300), rng.standard_normal(300)))
    assert estimated_uncertainty(rng.standard_normal(300), jacobian).undetermined.tolist() == [False, True, False]
    twins = jacobian[:, [0, 2, 2]]
    assert estimated_uncertainty(rng.standard_normal(300), twins).undetermined.tolist() == [False, True, True]


def test_an_overflowing_parameter_leaves_the_others_known() -> None:
    """From a real log there was "Eigenvalues did not converge"."""
    rng = np.random.default_rng(0)
    jacobian, residuals = rng.standard_normal((300, 3)), rng.standard_normal(300)
    sound = estimated_uncertainty(residuals, jacobian[:, :2])
    with np.errstate(over="ignore", invalid="ignore"):
        found = estimated_uncertainty(residuals, jacobian * [1.0, 1.0, 1e200])
    assert found.undetermined.tolist() == [False, False, True]
    assert found.covariance[:2, :2] == pytest.approx(sound.covariance)
    assert np.isfinite(found.null_projection).all()


def test_the_likelihood_is_the_gaussian_one() -> None:
    values = np.random.default_rng(0).normal(0.0, 3.0, 50)
    level = np.sqrt(np.mean(values**2))
    assert log_likelihood(float(values @ values), 50) == pytest.approx(float(np.sum(norm.logpdf(values, scale=level))))


# The minimiser.


def rosenbrock(point: Array, most: float = np.inf) -> NormalEquations:
    """Two residuals whose valley is bent; the minimum is at (1, 1)."""
    x, y = point
    residuals = np.array([10.0 * (y - x**2), 1.0 - x, 1e-3])
    return NormalEquations.of(residuals, np.array([[-20.0 * x, 10.0], [-1.0, 0.0], [0.0, 0.0]]))


def test_a_bent_valley_is_followed_downhill() -> None:
    seen: list[NormalEquations] = []

    def evaluate(point: Array, most: float = np.inf) -> NormalEquations:
        seen.append(rosenbrock(point))
        return seen[-1]

    found = minimise(evaluate, np.array([-1.2, 1.0]), -UNBOUNDED, UNBOUNDED, samples=3, iterations=200, tolerance=1e-9)
    assert found.converged
    assert found.point == pytest.approx([1.0, 1.0], abs=1e-4)
    assert found.equations.cost == min(problem.cost for problem in seen)
    assert found.evaluations == len(seen)
    again = minimise(evaluate, found.point, -UNBOUNDED, UNBOUNDED, samples=3, tolerance=1e-3, at_start=found.equations)
    assert again.evaluations == 0
    cut = minimise(rosenbrock, np.array([-1.2, 1.0]), -UNBOUNDED, UNBOUNDED, samples=3, iterations=3)
    assert not cut.converged
    assert cut.evaluations == 3
    assert cut.equations.cost <= seen[0].cost


def test_a_step_that_leads_uphill_is_taken_back() -> None:
    def evaluate(point: Array, most: float) -> NormalEquations:
        # undamped Gauss-Newton on an arc tangent runs away from here
        return NormalEquations.of(np.array([np.arctan(point[0]), 1e-3]), np.array([[1 / (1 + point[0] ** 2)], [0.0]]))

    found = minimise(evaluate, np.array([3.0]), np.array([-np.inf]), np.array([np.inf]), samples=2, tolerance=1e-9)
    assert found.converged
    assert found.point == pytest.approx([0.0], abs=1e-4)


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 8), st.integers(0, 2**32 - 1))
@example(7, 321)  # a coordinate stops at its bound and has to be let go again
def test_bounds_hold_as_in_another_solver(n: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    matrix, target = rng.normal(size=(n + 5, n)), 3.0 * rng.normal(size=n + 5)
    lower, upper = -rng.uniform(0.1, 1, n), rng.uniform(0.1, 1, n)
    found = minimise(
        lambda x, most: NormalEquations.of(matrix @ x - target, matrix),
        rng.normal(size=n),
        lower,
        upper,
        samples=n + 5,
        iterations=60,
        tolerance=1e-9,
    )
    theirs = lsq_linear(matrix, target, (lower, upper), method="bvls", tol=1e-14, max_iter=1000)
    assert np.all((found.point >= lower) & (found.point <= upper))
    assert found.equations.cost <= 2.0 * theirs.cost * (1 + 1e-6) + 1e-9


def test_a_positive_quantity_changes_by_a_factor_of_five_at_most() -> None:
    seen: list[float] = []

    def evaluate(point: Array, most: float = np.inf) -> NormalEquations:
        seen.append(float(point[0]))
        return NormalEquations.of(np.array([point[0] - 1000.0, 1e-3]), np.array([[1.0], [0.0]]))

    found = minimise(evaluate, np.array([1.0]), np.array([1e-9]), np.array([np.inf]), samples=2, tolerance=1e-9)
    assert found.point == pytest.approx([1000.0])
    ratios = np.array(seen[1:]) / np.array(seen[:-1])
    assert np.max(ratios) == pytest.approx(5.0)
    seen.clear()
    minimise(evaluate, np.array([1e6]), np.array([1e-9]), np.array([np.inf]), samples=2, tolerance=1e-9)
    assert np.min(np.array(seen[1:]) / np.array(seen[:-1])) == pytest.approx(0.2)


def test_a_rejected_step_needs_no_derivatives() -> None:
    seen: list[bool] = []

    def arc(point: Array, most: float) -> NormalEquations:
        found = NormalEquations.of(np.array([np.arctan(point[0]), 1e-3]), np.array([[1 / (1 + point[0] ** 2)], [0.0]]))
        seen.append(found.cost < most)
        return found if seen[-1] else NormalEquations.overflowed()

    found = minimise(arc, np.array([3.0]), np.array([-np.inf]), np.array([np.inf]), samples=2, tolerance=1e-9)
    assert found.converged
    assert found.point == pytest.approx([0.0], abs=1e-4)
    assert 0 < sum(not one for one in seen) < len(seen)


def test_a_step_into_overflow_is_taken_back() -> None:
    def evaluate(point: Array, most: float = np.inf) -> NormalEquations:
        # beyond 2 the simulation runs away: its residuals are fine and its derivatives are not
        slope = -1.0 if point[0] < 2.0 else np.inf
        return NormalEquations.of(np.array([4.0 - point[0], 0.1]), np.array([[slope], [0.0]]))

    assert evaluate(np.array([3.0])).cost == np.inf
    found = minimise(evaluate, np.array([0.0]), np.array([-np.inf]), np.array([np.inf]), samples=2)
    assert 1.0 < found.point[0] < 2.0
    assert np.isfinite(found.equations.cost)


def test_slopes_that_all_but_overflow_are_no_silence() -> None:
    """Of a gap in quick succession of impacts they are: across wide bounds there was a warning instead of a fit."""

    def evaluate(point: Array, most: float = np.inf) -> NormalEquations:
        slope = 1e150
        off = slope * (point - 1e-150)
        return NormalEquations(cost=1.0 + float(off @ off), gradient=slope * off, information=np.array([[slope**2]]))

    found = minimise(
        evaluate,
        np.array([0.0]),
        lower=np.array([-1e6]),
        upper=np.array([1e6]),
        samples=100,
        iterations=20,
        tolerance=1e-6,
    )
    assert found.point == pytest.approx(1e-150)
    assert found.converged


@given(marks=st.lists(st.booleans(), min_size=1, max_size=4), seed=st.integers(0, 10**6))
@settings(max_examples=100, deadline=None)
def test_nonnegative_coefficients_match_another_solver(marks: list[bool], seed: int) -> None:
    rng = np.random.default_rng(seed)
    regressors = rng.normal(size=(30, len(marks))) * 10.0 ** rng.integers(-6, 6, len(marks))
    values = rng.normal(size=30)
    found = bounded_least_squares(regressors.T @ regressors, regressors.T @ values, tuple(marks))
    lower = np.where(marks, 0.0, -np.inf)
    size = np.linalg.norm(regressors, axis=0)
    theirs = lsq_linear(regressors / size, values, (lower, np.inf), method="bvls", tol=1e-14, max_iter=1000).x
    assert np.all(found >= lower)
    assert found * size == pytest.approx(theirs, rel=1e-8, abs=1e-8)


def test_collinear_regressors_share_their_coefficient() -> None:
    assert bounded_least_squares(np.full((2, 2), 5.0), np.array([15.0, 15.0])) == pytest.approx([1.5, 1.5])
