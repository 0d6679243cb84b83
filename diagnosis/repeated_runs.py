"""Repeated runs: a test of the innovations that needs no catalogue.

Two runs with the same command have the same physics and different noise. If their innovations are correlated, they are
not only noise; if not, no deterministic model error is left.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from diagnosis.levels import SIGNIFICANT
from identification.fit_result import Fit
from identification.log import Log
from identification.noise import colour
from identification.run import Run
from plant.effects.effect import Array

_SAME_COMMAND = 0.01  # largest rms difference of the commands of repeated runs, as a share of the rms command
_SHIFTS = 40  # number of shifts of one run against the other, to estimate the correlation by chance
_RELEVANT = 0.05  # least relevant share of the variance


@dataclass(frozen=True, kw_only=True)
class Repeats:
    """Correlation of the innovations of a fit between repeated runs.

    Attributes:
        pairs: labels of the runs that repeat one another.
        share: of the innovations' variance that is common to both runs [-].
        chance: standard deviation of this share by chance, from the same runs shifted against each other [-].
    """

    pairs: tuple[tuple[str, str], ...]
    share: float
    chance: float

    @property
    def deterministic(self) -> bool:
        """Whether the common share is significant and relevant."""
        return self.share > max(SIGNIFICANT * self.chance, _RELEVANT)

    def __str__(self) -> str:
        """One sentence."""
        first, second = self.pairs[0]
        more = f" and {len(self.pairs) - 1} pairs more" if len(self.pairs) > 1 else ""
        band = f"{100 * self.share:.0f} ± {200 * self.chance:.0f} %"
        end = "so this part is model error, not noise" if self.deterministic else "as expected of noise"
        return f"{second} repeats {first}{more}: {band} of the remaining error is the same in both, {end}."


def repeated_pairs(log: Log) -> tuple[tuple[int, int], ...]:
    """Indices of pairs of runs with the same command and about the same length."""
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
    return bool(same_loop and np.std(a.command) > 0.0 and apart <= _SAME_COMMAND * level)


def repeats(fit: Fit) -> Repeats | None:
    """Correlation of the innovations between repeated runs; None if no run repeats another.

    The colour of the noise may have been estimated from a model error; whitening then removes a part of this error. So
    the errors before whitening are also compared, and the more significant result is returned.
    """
    pairs = repeated_pairs(fit.log)
    if not pairs:
        return None
    ends = np.cumsum([len(run) for run in fit.log.runs])
    pieces = np.split(fit.innovations, ends[:-1])  # zero where masked
    error_sets = [pieces]
    if fit.log.colour:
        errors = [colour(piece, np.array(fit.log.colour)) for piece in pieces]
        error_sets.append([np.where(run.valid, error, 0.0) for run, error in zip(fit.log.runs, errors, strict=True)])
    found = [shares for way in error_sets if (shares := _shares(way, pairs)) is not None]
    if not found:
        return None
    share, chance = max(found, key=lambda shares: shares[0] - SIGNIFICANT * shares[1])
    labels = tuple((fit.log.runs[a].label, fit.log.runs[b].label) for a, b in pairs)
    return Repeats(pairs=labels, share=share, chance=chance)


def _shares(pieces: Sequence[Array], pairs: Sequence[tuple[int, int]]) -> tuple[float, float] | None:
    """Share of the power that is common to pairs of runs, and its standard deviation by chance; None without power."""
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
