"""Runs that repeat one another: a test of what a model leaves that needs no catalogue.

Two runs under the same command have the same physics and different noise. Where what the model leaves of them
correlates, it is not noise; where it does not, nothing deterministic is left to be named.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from identification.fit_result import Fit
from identification.log import Log
from identification.noise import colour
from identification.run import Run
from plant.effects.effect import Array

_ALIKE = 0.01  # rms by which the commands of repeated runs may differ, of the rms command
_SHIFTS = 40  # by which one run is moved against the other, to see how far chance makes them correlate
_SIGNIFICANT = 4.0  # standard deviations of chance
_WORTH_SAYING = 0.05  # share of the variance


@dataclass(frozen=True, kw_only=True)
class Repeats:
    """What repeated runs say about the innovations of a fit.

    Attributes:
        pairs: labels of the runs that repeat one another.
        share: of the innovations' variance that is the same in both, by their correlation [-].
        chance: standard deviation of what it would be by chance, from the same runs shifted against each other [-].
    """

    pairs: tuple[tuple[str, str], ...]
    share: float
    chance: float

    @property
    def deterministic(self) -> bool:
        """Whether what is left repeats, beyond chance and worth saying."""
        return self.share > max(_SIGNIFICANT * self.chance, _WORTH_SAYING)

    def __str__(self) -> str:
        """One sentence."""
        first, second = self.pairs[0]
        more = f" and {len(self.pairs) - 1} pairs more" if len(self.pairs) > 1 else ""
        band = f"{100 * self.share:.0f} +- {200 * self.chance:.0f} %"
        end = "so this part is model error, not noise" if self.deterministic else "as expected of noise"
        return f"{second} repeats {first}{more}: {band} of the remaining error is the same in both, {end}."


def repeated_pairs(log: Log) -> tuple[tuple[int, int], ...]:
    """Places of the runs of a log that were driven by the same command and are about as long."""
    return tuple((a, b) for a, b in combinations(range(len(log.runs)), 2) if _same_command(log.runs[a], log.runs[b]))


def _same_command(a: Run, b: Run) -> bool:
    if abs(len(a) - len(b)) > 0.1 * max(len(a), len(b)) or not np.isclose(a.sample_time, b.sample_time, rtol=0.01):
        return False
    count = min(len(a), len(b))
    level = float(np.sqrt(np.mean(a.command[:count] ** 2)))
    apart = float(np.sqrt(np.mean((a.command[:count] - b.command[:count]) ** 2)))
    same_loop = all(
        np.allclose(getattr(a, law)[:count], getattr(b, law)[:count]) for law in ("servo_gain", "servo_damping")
    )
    return bool(same_loop and np.std(a.command) > 0.0 and apart <= _ALIKE * level)


def repeats(fit: Fit) -> Repeats | None:
    """What repeated runs say about the innovations of a fit; None where no run repeats another.

    A colour of the noise may have been learnt from what is missing, and then takes a part of it out of the innovations.
    So it is also asked before that is taken out; what shows more clearly is told.
    """
    pairs = repeated_pairs(fit.log)
    if not pairs:
        return None
    ends = np.cumsum([len(run) for run in fit.log.runs])
    pieces = np.split(fit.innovations, ends[:-1])  # zero where masked
    ways = [pieces]
    if fit.log.colour:
        errors = [colour(piece, np.array(fit.log.colour)) for piece in pieces]
        ways.append([np.where(run.valid, error, 0.0) for run, error in zip(fit.log.runs, errors, strict=True)])
    found = [shares for way in ways if (shares := _shares(way, pairs)) is not None]
    if not found:
        return None
    share, chance = max(found, key=lambda shares: shares[0] - _SIGNIFICANT * shares[1])
    labels = tuple((fit.log.runs[a].label, fit.log.runs[b].label) for a, b in pairs)
    return Repeats(pairs=labels, share=share, chance=chance)


def _shares(pieces: Sequence[Array], pairs: Sequence[tuple[int, int]]) -> tuple[float, float] | None:
    """The share of the power of some runs that is the same in pairs of them, and what it is by chance."""
    product, power = np.zeros(_SHIFTS + 1), 0.0
    for a, b in pairs:
        count = min(len(pieces[a]), len(pieces[b]))
        first, second = pieces[a][:count], pieces[b][:count]
        steps = np.linspace(0, count, _SHIFTS + 2)[:-1].astype(int)
        product += [float(first @ np.roll(second, step)) for step in steps]
        power += 0.5 * float(first @ first + second @ second)
    if power <= 0.0:
        return None
    share, *shifted = product / power
    return float(share), float(np.sqrt(np.mean(np.square(shifted))))
