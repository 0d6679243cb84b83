"""How much of the innovations the signatures explain, from inner products alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from identification.least_squares import bounded_least_squares
from plant.effects import Effect
from plant.effects.effect import Array

_RIDGE = 1e-10  # added to a diagonal scaled to ones
_ABSORBED = 1e-6  # share of a signature's power; with less left, it counts as absorbed


@dataclass(frozen=True, kw_only=True, eq=False)
class Signature:
    """One shape of an effect: its columns among all columns, and a function from their sizes to the effect."""

    name: str
    columns: slice
    positive: tuple[bool, ...]
    searched: int
    forms: int
    kind: type[Effect]
    start: Callable[[Array], Effect]


@dataclass(frozen=True, kw_only=True, eq=False)
class Products:
    """Inner products of signatures after projection: (n, n) with one another, (n,) with the innovations."""

    gram: Array
    pull: Array
    power: float

    def beyond(self, columns: slice) -> Products:
        """The same, projected orthogonally to some of the signatures."""
        own = self.gram[columns, columns]
        size = np.sqrt(np.maximum(np.diag(own), 1e-300))
        inverse = np.linalg.pinv(own / np.outer(size, size), rcond=1e-9, hermitian=True) / np.outer(size, size)
        across = inverse @ self.gram[columns]
        return Products(
            gram=self.gram - self.gram[columns].T @ across,
            pull=self.pull - across.T @ self.pull[columns],
            power=self.power - float(self.pull[columns] @ inverse @ self.pull[columns]),
        )


def unbounded(products: Products, plain: Products, shapes: Sequence[Signature]) -> Array:
    """(S,) power of the innovations that each shape explains if its sizes may have any sign."""
    found = np.zeros(len(shapes))
    widths = np.array([len(shape.positive) for shape in shapes])
    first = np.array([shape.columns.start for shape in shapes])
    for width in np.unique(widths):
        places = np.flatnonzero(widths == width)
        own = first[places, None] + np.arange(width)
        gram, pull = products.gram[own[:, :, None], own[:, None, :]], products.pull[own]
        left, whole = np.diagonal(gram, axis1=1, axis2=2), np.diag(plain.gram)[own]
        sound = (left > _ABSORBED * whole).all(axis=1)
        size = np.sqrt(left[sound])
        scaled = gram[sound] / (size[:, :, None] * size[:, None, :]) + _RIDGE * np.eye(width)
        along = pull[sound] / size
        found[places[sound]] = np.einsum("sw,sw->s", along, np.linalg.solve(scaled, along[:, :, None])[:, :, 0])
    return found


def powers(products: Products, plain: Products, shapes: Sequence[Signature]) -> list[float]:
    """(S,) power of the innovations that each shape explains."""
    most = unbounded(products, plain, shapes)
    return [explained(products, plain, shape, float(free)) for shape, free in zip(shapes, most, strict=True)]


def explained(products: Products, plain: Products, shape: Signature, free: float) -> float:
    """Power of the innovations that one signature explains; zero if the signature is absorbed.

    `free` is the power it explains without sign constraints; it is returned if no size has to be positive.
    """
    if not any(shape.positive):
        return free
    own = shape.columns
    gram, pull = products.gram[own, own], products.pull[own]
    if np.any(np.diag(gram) <= _ABSORBED * np.diag(plain.gram[own, own])):
        return 0.0
    if len(pull) == 1:
        return 0.0 if shape.positive[0] and pull[0] <= 0.0 else float(pull[0] ** 2 / gram[0, 0])
    sizes = bounded_least_squares(gram, pull, shape.positive)
    return float(2.0 * pull @ sizes - sizes @ gram @ sizes)
