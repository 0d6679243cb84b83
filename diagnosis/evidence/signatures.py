"""The signatures of all effects at one fitted model.

A signature is the change of the innovations by a small effect. All signatures are calculated once. What one or two
effects explain then follows from inner products, without another pass over the log.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np

from diagnosis.evidence.explained_power import Products, Signature, powers
from diagnosis.evidence.marginal import Explanation
from diagnosis.evidence.prior import forms
from diagnosis.linear import AT_ONCE, response
from diagnosis.nuisance import Nuisance
from identification.least_squares import bounded_least_squares
from identification.threads import in_threads
from plant.effects import Effect, Motion, Regressors
from plant.effects.effect import Array

_CLOSER = 4  # best shapes of an effect that are refined


@dataclass(frozen=True, kw_only=True, eq=False)
class Signatures:
    """Signatures of some effects at a fitted set.

    Attributes:
        shapes: all shapes of all effects.
        plain: products beyond the parameters.
        views: products beyond the parameters and the discrepancy: the most probable one, smaller ones, and none; each
            with its log-likelihood relative to the best of them.
        samples: N.
        catalogue: number of candidate effects.
    """

    shapes: tuple[Signature, ...]
    plain: Products
    views: tuple[tuple[float, Products], ...]
    samples: int
    catalogue: int

    @classmethod
    def at(cls, explanation: Explanation, effects: Mapping[str, type[Effect]], catalogue: int) -> Signatures:
        """Calculate them."""
        screen, discrepancy = explanation.screen, explanation.discrepancy
        parameters = Nuisance(own=discrepancy.own, shared=discrepancy.shared)
        left = parameters.beyond(screen.innovations)
        power = float(left @ left)
        shapes: list[Signature] = []

        def draw(named: Iterable[tuple[str, Regressors]]) -> Array:
            handfuls = list(_handfuls(named))
            ends = np.cumsum([0, *(sum(each.columns.shape[1] for _, each in some) for some in handfuls)])
            found = np.empty((left.size, int(ends[-1])))

            def see(place: int) -> None:
                some = handfuls[place]
                columns = np.hstack([each.columns for _, each in some])
                drawn = response(screen.filters, columns, on_measurement=some[0][1].acts_on == "measurement")
                with np.errstate(over="ignore", invalid="ignore"):
                    bounded = np.where(np.abs(drawn) < 1e100, -drawn, 0.0)
                found[:, ends[place] : ends[place + 1]] = parameters.beyond(bounded)

            in_threads(see, range(len(handfuls)))
            first = shapes[-1].columns.stop if shapes else 0
            for name, each in chain.from_iterable(handfuls):
                last = first + each.columns.shape[1]
                shapes.append(
                    Signature(
                        name=name,
                        columns=slice(first, last),
                        positive=each.positive or (False,) * each.columns.shape[1],
                        searched=each.searched,
                        forms=forms(effects[name]),
                        kind=effects[name],
                        start=each.start,
                    )
                )
                first = last
            return found

        every = in_threads(lambda item: [(item[0], t) for t in item[1].regressors(screen.motion)], effects.items())
        coarse = draw(pair for pair in chain.from_iterable(every) if pair[1].prior is None)
        first = Products(gram=coarse.T @ coarse, pull=coarse.T @ left, power=power)
        fine = draw(_closer(list(shapes), first, screen.motion))
        across = coarse.T @ fine
        plain = Products(
            gram=np.block([[first.gram, across], [across.T, fine.T @ fine]]),
            pull=np.concatenate((first.pull, fine.T @ left)),
            power=power,
        )
        columns = discrepancy.columns
        shared, along = np.hstack((columns.T @ coarse, columns.T @ fine)), columns.T @ left
        views = []
        for likelihood, weights in discrepancy.views():
            beside = Products(
                gram=plain.gram - shared.T @ weights @ shared,
                pull=plain.pull - shared.T @ (weights @ along),
                power=power - float(along @ weights @ along),
            )
            views.append((likelihood, beside))
        at_hand = max(likelihood for likelihood, _ in views)
        views = [(likelihood - at_hand, beside) for likelihood, beside in views]
        samples = explanation.fit.samples
        return cls(shapes=tuple(shapes), plain=plain, views=tuple(views), samples=samples, catalogue=catalogue)


def _closer(shapes: Sequence[Signature], products: Products, motion: Motion) -> Iterator[tuple[str, Regressors]]:
    """Refined regressors, near the shapes of each effect that explain most."""
    by_name: dict[str, list[tuple[float, Signature]]] = {}
    for power, shape in zip(powers(products, products, shapes), shapes, strict=True):
        by_name.setdefault(shape.name, []).append((power, shape))
    for name, own in by_name.items():
        for _, shape in sorted(own, key=lambda pair: -pair[0])[:_CLOSER]:
            at = shape.columns
            sizes = bounded_least_squares(products.gram[at, at], products.pull[at], shape.positive)
            for each in shape.start(sizes).closer(motion):
                yield name, each


def _handfuls(named: Iterable[tuple[str, Regressors]]) -> Iterator[list[tuple[str, Regressors]]]:
    """Groups of regressors with at most `AT_ONCE` columns; torques and measurement errors are in separate groups."""
    some: list[tuple[str, Regressors]] = []
    for name, each in named:
        full = sum(t.columns.shape[1] for _, t in some) + each.columns.shape[1] > AT_ONCE
        if some and (full or each.acts_on != some[0][1].acts_on):
            yield some
            some = []
        some.append((name, each))
    if some:
        yield some
