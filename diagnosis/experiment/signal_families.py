"""Families of test signals with few parameters each, the start of the design of an experiment."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from plant import signals
from plant.effects.effect import Array

_FASTEST = 0.2  # highest frequency in cycles per sample: a torque held over each sample still approximates a sine
_LINES = 12  # frequencies of a multisine


@dataclass(frozen=True, kw_only=True)
class Signal:
    """A torque signal: `bias` plus a waveform of a family.

    Attributes:
        family: its name in `FAMILIES`.
        amplitude: of the waveform [N m].
        bias: constant torque, against gravity [N m].
        numbers: parameters of the waveform, in s or Hz.
        seed: of its random numbers.
    """

    family: str
    amplitude: float
    bias: float
    numbers: Mapping[str, float]
    seed: int = 0

    def torque(self, duration: float, sample_time: float) -> Array:
        """(T,) the command [N m]."""
        wave = FAMILIES[self.family].wave(self.numbers, duration, sample_time, self.seed)
        return np.asarray(self.bias + self.amplitude * wave, dtype=float)

    def slower(self, factor: float) -> Signal:
        """The same signal slower: times are multiplied, and frequencies divided, by a factor."""
        rates = {name: value / factor for name, value in self.numbers.items() if name in _RATES}
        times = {name: value * factor for name, value in self.numbers.items() if name not in _RATES}
        return replace(self, numbers={name: (rates | times)[name] for name in self.numbers})

    def playable(self, sample_time: float) -> Signal:
        """The same signal with frequencies and times limited to what a torque held over each sample can follow."""
        fastest = _FASTEST / sample_time
        rates = {name: min(value, fastest) for name, value in self.numbers.items() if name in _RATES}
        times = {name: max(value, sample_time) for name, value in self.numbers.items() if name not in _RATES}
        return replace(self, numbers={name: (rates | times)[name] for name in self.numbers})

    def __str__(self) -> str:
        """Family, amplitude, bias and parameters in words."""
        numbers = ", ".join(
            f"{name} {value:.3g} {'Hz' if name in _RATES else 's'}" for name, value in self.numbers.items()
        )
        beside = f" about {self.bias:.3g}" if self.bias else ""
        return f"{self.family.replace('_', ' ')} of {self.amplitude:.3g}{beside}, {numbers}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Family:
    """A kind of waveform with a peak of one: the function that generates it, and a grid of its parameters."""

    wave: Callable[[Mapping[str, float], float, float, int], Array]
    grid: tuple[Mapping[str, float], ...]


_RATES = ("start", "stop", "frequency", "low", "high")


def _multisine(numbers: Mapping[str, float], duration: float, sample_time: float, seed: int) -> Array:
    low, high = numbers["low"], max(numbers["high"], 1.01 * numbers["low"])
    lines = tuple(np.geomspace(low, high, _LINES))
    return signals.multisine(amplitude=1.0, frequencies=lines, duration=duration, sample_time=sample_time, seed=seed)


def _plain(
    kind: Callable[..., Array], *, drawn: bool = False
) -> Callable[[Mapping[str, float], float, float, int], Array]:
    def wave(numbers: Mapping[str, float], duration: float, sample_time: float, seed: int) -> Array:
        more = {"seed": seed} if drawn else {}
        return kind(amplitude=1.0, duration=duration, sample_time=sample_time, **numbers, **more)

    return wave


def _grid(**numbers: tuple[float, ...]) -> tuple[Mapping[str, float], ...]:
    return tuple(dict(zip(numbers, values, strict=True)) for values in zip(*numbers.values(), strict=True))


FAMILIES: Mapping[str, Family] = MappingProxyType(
    {
        "chirp": Family(
            wave=_plain(signals.chirp), grid=_grid(start=(0.05, 0.1, 0.5, 2.0), stop=(1.0, 5.0, 20.0, 30.0))
        ),
        "pseudo_random_binary": Family(
            wave=_plain(signals.pseudo_random_binary, drawn=True), grid=_grid(hold=(0.03, 0.1, 0.3, 0.8))
        ),
        "random_levels": Family(wave=_plain(signals.random_levels, drawn=True), grid=_grid(hold=(0.15, 0.5, 1.2))),
        "pulses": Family(
            wave=_plain(signals.pulses), grid=_grid(width=(0.05, 0.15, 0.3, 0.5), rest=(0.2, 0.35, 0.7, 2.0))
        ),
        "triangle": Family(wave=_plain(signals.triangle), grid=_grid(frequency=(0.1, 0.4, 1.5))),
        "plateaus": Family(wave=_plain(signals.plateaus), grid=_grid(hold=(0.15, 0.5, 1.0))),
        "growing_sine": Family(wave=_plain(signals.growing_sine), grid=_grid(frequency=(0.2, 0.7, 2.0, 6.0))),
        "multisine": Family(wave=_multisine, grid=_grid(low=(0.1, 0.5, 2.0), high=(2.0, 10.0, 30.0))),
    }
)
"""Every family by its name."""


def shapes(bias: float, slower: float = 1.0) -> Iterator[Signal]:
    """One signal of amplitude 1 for each grid point of each family, with a bias [N m], slower by a factor."""
    for name, family in FAMILIES.items():
        for numbers in family.grid:
            yield Signal(family=name, amplitude=1.0, bias=bias, numbers=numbers).slower(slower)
