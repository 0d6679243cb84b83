"""The size of an effect for a given lambda, by a few secant steps in logarithms."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

_SECANTS = 4
_NEAR = 0.2  # tolerance of the logarithm of lambda


def reaching(
    begin: Mapping[float, float], lambda_of: Callable[[float], float], bounds: tuple[float, float]
) -> dict[float, tuple[float, float]]:
    """The sizes that come closest to each lambda, with their lambdas.

    The search for each lambda starts at the size given with it; later searches use the earlier evaluations.
    """
    lowest, highest = np.log(bounds)
    known: list[tuple[float, float]] = []  # logarithms of size and lambda
    for wanted, size in begin.items():
        for _ in range(_SECANTS):
            at = np.clip(_next_size(known, np.log(wanted), np.log(size)), lowest, highest)
            if any(at == tried or abs(reached - np.log(wanted)) < _NEAR for tried, reached in known):
                break
            known.append((float(at), np.log(max(lambda_of(float(np.exp(at))), 1.0))))
    closest = {wanted: min(known, key=lambda one: abs(one[1] - np.log(wanted))) for wanted in begin}
    return {wanted: (float(np.exp(at)), float(np.exp(reached))) for wanted, (at, reached) in closest.items()}


def _next_size(known: list[tuple[float, float]], wanted: float, begin: float) -> float:
    """The size at a lambda on the line through the two nearest known sizes; all values are logarithms."""
    if not known:
        return begin
    (at, reached), *others = sorted(known, key=lambda one: abs(one[1] - wanted))[:2]
    slope = 2.0  # initial slope, as for a small size
    if others and others[0][0] != at:
        slope = float(np.clip((reached - others[0][1]) / (at - others[0][0]), 0.5, 6.0))
    return at + float(np.clip((wanted - reached) / slope, -2.0, 2.0))
