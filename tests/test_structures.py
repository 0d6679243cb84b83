"""Structures of redundant unidirectional drives: the theorem, known machines, the enumeration by brute force."""

from __future__ import annotations

from itertools import combinations, combinations_with_replacement, permutations, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from allocation import Structure, admissible, admissible_directions, enumerate_admissible, null_space
from plant.errors import BadParameter
from plant.gears import GearTrain

Array = NDArray[np.float64]
Signs = NDArray[np.int64]

PAPER = GearTrain.paper()


def balanced(pattern: Signs, rng: np.random.Generator) -> Array:
    """Random sizes for sign patterns (..., n, m) whose rows sum to zero."""
    sizes = rng.uniform(0.5, 2.0, pattern.shape)
    positive, negative = sizes * (pattern > 0), sizes * (pattern < 0)
    return np.asarray(positive / positive.sum(-1, keepdims=True) - negative / negative.sum(-1, keepdims=True))


def both_signs(patterns: Signs) -> NDArray[np.bool_]:
    """Whether patterns (..., n, m) have both signs in each row and a sign in each column: necessary in any case."""
    rows = np.any(patterns > 0, axis=-1) & np.any(patterns < 0, axis=-1)
    return np.asarray(np.all(rows, axis=-1) & np.all(np.any(patterns, axis=-2), axis=-1))


def class_numbers(patterns: Signs) -> Signs:
    """(K,) one number for each class of patterns (K, n, m) that differ only by the order of rows and columns."""
    n, m = patterns.shape[1:]
    orders = []
    for order in permutations(range(n)):
        columns = np.tensordot(3 ** np.arange(n), patterns[:, list(order)] + 1, axes=(0, 1))
        orders.append(np.sort(columns, axis=1) @ (3**n) ** np.arange(m))
    return np.asarray(np.min(orders, axis=0))


# The theorem.


@settings(deadline=None)
@given(st.integers(1, 4), st.integers(0, 2**32 - 1))
def test_the_minors_are_the_null_vector_with_one_extra_drive(n: int, seed: int) -> None:
    A = np.random.default_rng(seed).normal(size=(n, n + 1))
    minors = np.array([(-1) ** k * np.linalg.det(np.delete(A, k, axis=1)) for k in range(n + 1)])
    result = admissible(A)
    if np.min(np.abs(minors)) < 1e-3 * np.max(np.abs(minors)):
        return  # too close to call in floating point
    assert result.admissible == bool(np.all(minors > 0) or np.all(minors < 0))
    if result.admissible:
        assert result.null_vector == pytest.approx(minors / minors.sum(), rel=1e-6)
        assert result.score == pytest.approx(np.min(minors / minors.sum()), rel=1e-6)


@settings(deadline=None)
@given(st.integers(1, 3), st.integers(1, 3), st.integers(0, 2**32 - 1))
def test_only_admissible_structures_give_every_torque(n: int, more: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, n + more))
    result = admissible(A)
    if 0 < result.score < 1e-3:
        return  # too close to call in floating point
    # Farkas: drives that push reach every torque if and only if no direction of torque is out of reach of all of them.
    directions = rng.normal(size=(4000, n))
    out_of_reach = bool(np.any(np.all(directions @ A <= 0, axis=1)))
    assert not (result.admissible and out_of_reach)
    if result.admissible:
        assert A @ result.null_vector == pytest.approx(np.zeros(n), abs=1e-9)
        assert np.min(result.null_vector) == pytest.approx(result.score)


def test_the_papers_mechanism_is_admissible_its_variants_are_not() -> None:
    opposed = PAPER.torque_map * [1, -1]
    assert admissible([opposed]).admissible
    assert admissible([opposed]).null_vector == pytest.approx([0.5, 0.5])
    same_sense = admissible([PAPER.torque_map])
    assert not same_sense.admissible
    assert same_sense.score == 0.0


@pytest.mark.parametrize(
    ("A", "why"),
    [
        ([[1, -1, 0], [0, 0, 1]], "row of one sign"),
        ([[1, -1, 0], [1, -1, 0]], "rank"),
        ([[1.0]], "too few drives"),
        ([[1, -1, 0]], "a drive without part"),
        ([[1, -1, 1], [2, -2, 2]], "rank"),
    ],
)
def test_structures_that_are_not_admissible(A: list[list[float]], why: str) -> None:
    assert not admissible(A).admissible, why
    assert admissible(A).score == 0.0


@pytest.mark.parametrize("A", [[[1, 2], [3]], [1.0, 2.0], [[np.nan, 1]], [["a", "b"]], []])
def test_a_structure_is_a_matrix_of_numbers(A: object) -> None:
    for ask in (admissible, null_space, admissible_directions, Structure):
        with pytest.raises(BadParameter):
            ask(A)  # type: ignore[operator]


# The null space, and the directions of a given machine.


@settings(deadline=None)
@given(st.integers(1, 4), st.integers(0, 4), st.integers(0, 2**32 - 1))
def test_the_null_space_moves_nothing_and_is_all_that_does(n: int, more: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, n + more)) * 10.0 ** rng.uniform(-3, 3, (n, 1))
    basis = null_space(A)
    assert basis.shape == (n + more, more)
    assert basis.T @ basis == pytest.approx(np.eye(more), abs=1e-12)
    assert np.max(np.abs(A @ basis) / np.linalg.norm(A, axis=1, keepdims=True), initial=0.0) < 1e-12


def test_the_null_space_of_the_paper_is_its_direction_of_preload() -> None:
    unequal = GearTrain(pinion_teeth=(20, 31), output_teeth=161)
    direction = null_space([unequal.torque_map])[:, 0]
    assert direction / direction[0] == pytest.approx(unequal.null_vector / unequal.null_vector[0])
    structure = Structure.of(unequal)
    assert structure.null_space[:, 0] * np.sign(direction[0]) == pytest.approx(direction * np.sign(direction[0]))
    assert structure.null_vector == pytest.approx(unequal.null_vector / 31)


def test_the_paper_has_two_senses() -> None:
    assert [s.tolist() for s in admissible_directions([PAPER.torque_map])] == [[1, -1], [-1, 1]]


def test_senses_are_the_signs_of_null_vectors() -> None:
    rng = np.random.default_rng(5)
    A = rng.normal(size=(2, 4))
    listed = {tuple(s.tolist()) for s in admissible_directions(A)}
    seen = {tuple(np.sign(null_space(A) @ rng.normal(size=2)).astype(int).tolist()) for _ in range(2000)}
    assert seen == listed
    assert admissible_directions([[1, 1, 0]]) == []
    with pytest.raises(BadParameter, match="12"):
        admissible_directions(np.ones((1, 13)))


@pytest.mark.parametrize(
    "bad", [{"directions": (1, 2)}, {"directions": (1,)}, {"reduction": 0.0}, {"reduction": np.inf}]
)
def test_a_structure_checks_its_fields(bad: dict[str, object]) -> None:
    with pytest.raises(BadParameter):
        Structure([[1.0, -1.0]], **bad)  # type: ignore[arg-type]


# The enumeration.


def test_one_joint_has_the_two_senses_of_the_paper() -> None:
    assert [p.tolist() for p in enumerate_admissible(1, 2)] == [[[1, -1]], [[-1, 1]]]


@pytest.mark.parametrize(("m", "trials"), [(3, 6), (4, 1)])
def test_enumeration_lists_each_class_once_and_misses_none(m: int, trials: int) -> None:
    def orbit(columns: list[tuple[int, int]]) -> frozenset[tuple[tuple[int, int], ...]]:
        return frozenset((tuple(sorted(columns)), tuple(sorted((b, a) for a, b in columns))))

    listed = [orbit([tuple(c) for c in p.T.tolist()]) for p in enumerate_admissible(2, m)]
    assert len(set(listed)) == len(listed)
    rng = np.random.default_rng(1)
    for columns in combinations_with_replacement(product((-1, 0, 1), repeat=2), m):
        pattern = np.array(columns).T
        if any(admissible(pattern * rng.uniform(0.2, 3.0, (2, m))).admissible for _ in range(trials)):
            assert orbit(list(columns)) in listed
    for pattern in enumerate_admissible(2, m):
        assert admissible(balanced(pattern, rng)).admissible


def test_three_joints_and_four_drives_by_brute_force() -> None:
    every = np.array(np.unravel_index(np.arange(3**12), (3,) * 12), dtype=np.int64).T.reshape(-1, 3, 4) - 1
    every = every[both_signs(every)]
    A = balanced(every, np.random.default_rng(2))
    # with four drives the null vector is the alternating minors, here all alike: rank 3 if they are not zero
    possible = every[np.abs(np.linalg.det(A[:, :, 1:])) > 1e-9]
    listed = np.array(enumerate_admissible(3, 4))
    numbers = class_numbers(listed)
    assert len(set(numbers.tolist())) == len(listed)
    assert set(numbers.tolist()) == set(class_numbers(possible).tolist())


@pytest.mark.parametrize("m", [5, pytest.param(6, marks=pytest.mark.long)])
def test_three_joints_and_more_drives_by_brute_force(m: int) -> None:
    signs = np.array(list(product((-1, 0, 1), repeat=3)), dtype=np.int64)
    every = signs[np.array(list(combinations_with_replacement(range(27), m)))].transpose(0, 2, 1)
    every = every[both_signs(every)]
    A = balanced(every, np.random.default_rng(3))
    # with the null vector at hand admissible is what has rank 3: some three of the columns are independent
    minors = [np.linalg.det(A[:, :, list(three)]) for three in combinations(range(m), 3)]
    possible = every[np.max(np.abs(minors), axis=0) > 1e-9]
    numbers = class_numbers(np.array(enumerate_admissible(3, m)))
    assert len(np.unique(numbers)) == len(numbers)
    assert np.array_equal(np.sort(numbers), np.unique(class_numbers(possible)))
    assert len(possible) < len(every)


@pytest.mark.parametrize("m", [5, 6])
def test_three_joints_and_more_drives_by_samples(m: int) -> None:
    rng = np.random.default_rng(m)
    numbers = class_numbers(np.array(enumerate_admissible(3, m)))
    assert len(np.unique(numbers)) == len(numbers)
    drawn = rng.integers(-1, 2, (400, 3, m))
    drawn[:200] = drawn[:200] * (rng.uniform(size=(200, 3, m)) < 0.5)  # many zeros: the rank may fail
    right = both_signs(drawn)
    verdicts = np.zeros(len(drawn), dtype=bool)
    verdicts[right] = [admissible(A).admissible for A in balanced(drawn[right], rng)]
    assert np.array_equal(np.isin(class_numbers(drawn), numbers), verdicts)
    assert 0.1 < np.mean(verdicts) < 0.9


def test_a_pair_of_drives_for_each_joint_is_listed() -> None:
    for n in (2, 3):
        pairs = np.kron(np.eye(n, dtype=np.int64), np.array([[1, -1]]))
        numbers = class_numbers(np.array(enumerate_admissible(n, 2 * n)))
        assert class_numbers(pairs[None])[0] in numbers
        rest = pairs.copy()
        rest[0, 0] = 0  # a drive that turns nothing
        assert class_numbers(rest[None])[0] not in numbers


@pytest.mark.parametrize(("n", "m"), [(0, 1), (4, 5), (2, 2), (2, 5)])
def test_enumeration_reports_its_range(n: int, m: int) -> None:
    with pytest.raises(BadParameter):
        enumerate_admissible(n, m)
