"""Preload sizing: the least T_min that keeps contact on the rig, compared with the static formulas.

With p the preload of each drive, at the load side, and a the acceleration, stiff gears keep contact for

    equal split, each motor accelerates its rotor     p >= |J_L a + tau_L|/2 + T_min
    constant slave, the master does the rest          p >= (J_L + n^2 J) |a| + |tau_L| + f + T_min

with T_min = 0. Elastic gears, encoder noise in the loop's torque, and friction that changes its direction need more.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np
from numpy.typing import NDArray

from antidrive.experiments.outcome import Array
from antidrive.experiments.settings import need_positive, need_samples
from antidrive.remaining_time import Parts, Tell
from plant.errors import BadParameter
from plant.fleet import Fleet
from plant.rig import Rig

STRATEGIES: Final = ("equal split", "constant slave")
SHARES: Final = np.array([[0.5, 0.5], [0.0, 1.0]])
"""(2, 2) share of the output torque of drives 1 and 2 in each strategy."""
FROM, FASTER, DAMPING = (
    1.0,
    10.0,
    0.7,
)  # periods not counted; speed filter over loop bandwidth; damping ratio
_MOST = 200.0  # T_min [N m] above which the search stops


@dataclass(frozen=True, kw_only=True)
class SizingSettings:
    """Motion, machines and loops.

    Attributes:
        title: for users.
        frequency: the load follows amplitude (1 - cos) [Hz].
        peak_acceleration: [rad/s^2].
        periods: simulated ones; contact counts after the first.
        load_torque: constant torque against the load [N m].
        stiffnesses: of the gear contact [N m/rad].
        noises: of the motors' angles, standard deviation, at the load side [rad].
        bandwidths: of the loop over the motors' angles [Hz].
        damping_ratio: of a rotor on its contact stiffness against the load.
        sample_time: of the loop [s].
        resolution: of T_min [N m].
        rig: fields of `plant.rig.Rig` that differ from the paper-like machine.
    """

    title: str
    frequency: float
    peak_acceleration: float
    periods: float
    load_torque: float
    stiffnesses: tuple[float, ...]
    noises: tuple[float, ...]
    bandwidths: tuple[float, ...]
    damping_ratio: float
    sample_time: float
    resolution: float
    rig: Mapping[str, float]

    def __post_init__(self) -> None:
        """Check the settings that the rig does not check."""
        need_positive(self, "frequency", "peak_acceleration", "periods", "stiffnesses", "bandwidths", "sample_time")
        need_positive(self, "resolution")
        need_samples(self.periods / self.frequency, self.sample_time)
        if self.periods < 1.0 + FROM:
            raise BadParameter(
                f"periods = {self.periods:g} must be {1.0 + FROM:g} or more: a whole one after the first."
            )
        if min(self.noises) < 0.0:
            raise BadParameter(f"noises must not be negative, not {self.noises!r}.")
        named = {"flank_stiffness", "flank_damping", "motor_encoder_noise", "torque_offset"} & set(self.rig)
        if named:
            raise BadParameter(f"rig.{min(named)} is given by stiffnesses, damping_ratio, noises and load_torque here.")
        self.machine(self.stiffnesses[0], self.noises[0])

    def machine(self, stiffness: float, noise: float) -> Rig:
        """A rig with a contact stiffness [N m/rad] and a noise of its motors' angles, at the load side [rad]."""
        plain = Rig.paper_like(**self.rig)
        rotor = float(plain.rotor_inertias[0])
        reduced = rotor * plain.inertia / (rotor + plain.inertia)
        return Rig.paper_like(
            **self.rig,
            flank_stiffness=stiffness,
            flank_damping=2.0 * self.damping_ratio * np.sqrt(stiffness * reduced),
            motor_encoder_noise=noise * plain.gears.ratio,
            torque_offset=-self.load_torque,
        )

    def formulas(self) -> Array:
        """(2,) preload [N m] of each strategy by its formula with T_min = 0."""
        rig, a, load = self.machine(self.stiffnesses[0], 0.0), self.peak_acceleration, abs(self.load_torque)
        friction = float(rig.motor_coulomb * rig.motor_ratios[0])
        slave = (rig.inertia + rig.rotor_inertias[0]) * a + load + friction
        return np.array([0.5 * (rig.inertia * a + load), slave])


@dataclass(frozen=True, kw_only=True, eq=False)
class Sizing:
    """Results over the C combinations of mesh, noise and loop, and the two strategies.

    Attributes:
        meshes, noises, bandwidths: (C,) [N m/rad], [rad], [Hz].
        formula: (2,) preload with T_min = 0 [N m].
        least: (C, 2) least T_min that kept contact [N m]; infinite if none did.
        noise_torque: (C,) standard deviation of the output torque caused by the noise through the loop [N m].
        time: (T,) [s].
        flanks: (T, 2, 2) smaller contact torque of the middle combination with the least noise [N m]; by strategy, and
            with the preload of the formula or the least one.
    """

    meshes: Array
    noises: Array
    bandwidths: Array
    formula: Array
    least: Array
    noise_torque: Array
    time: Array
    flanks: Array

    @property
    def preload(self) -> Array:
        """(C, 2) least preload that kept contact [N m]."""
        return self.formula + self.least


def experiment(settings: SizingSettings, seed: int, tell: Tell | None = None) -> Sizing:
    """Find the least T_min of all combinations at once by bisection."""
    cells = np.array(list(product(settings.stiffnesses, settings.noises, settings.bandwidths)))
    rigs = [settings.machine(stiffness, noise) for stiffness, noise, _ in cells]
    loop = _Loop(settings, rigs * 2, np.tile(cells[:, 2], 2), np.repeat(SHARES, len(cells), axis=0), seed)
    formula = np.repeat(settings.formulas(), len(cells))
    low, high, rounds = np.zeros(formula.size), np.ones(formula.size), 1
    while np.any(lost := np.logical_not(loop.keeps(formula + high)) & (high < _MOST)):
        low, high, rounds = np.where(lost, high, low), np.where(lost, 2.0 * high, high), rounds + 1
    never = high >= _MOST
    halvings = np.ceil(np.log2(np.max((high - low)[~never], initial=settings.resolution) / settings.resolution))
    parts = Parts(rounds + float(halvings), tell)
    parts.done(rounds)
    while np.max((high - low)[~never], initial=0.0) > settings.resolution:
        middle = 0.5 * (low + high)
        kept = loop.keeps(formula + middle)
        low, high = np.where(kept, low, middle), np.where(kept, middle, high)
        parts.done()
    least = np.where(never, np.inf, high).reshape(2, -1).T
    one = _middle(cells)
    shown = [settings.formulas(), settings.formulas() + np.where(np.isfinite(least[one]), least[one], 0.0)]
    pair = _Loop(settings, [rigs[one]] * 4, np.full(4, cells[one, 2]), np.repeat(SHARES, 2, axis=0), seed)
    traces = pair.flanks(np.stack(shown, axis=1).ravel())
    return Sizing(
        meshes=cells[:, 0],
        noises=cells[:, 1],
        bandwidths=cells[:, 2],
        formula=settings.formulas(),
        least=least,
        noise_torque=loop.noise_torque(cells[:, 1]),
        time=pair.time,
        flanks=np.min(traces, axis=2).reshape(-1, 2, 2),
    )


def _middle(cells: Array) -> int:
    """The combination in the middle of meshes and loops, with the least noise."""
    wanted = np.median(cells[:, 0]), np.min(cells[:, 1]), np.median(cells[:, 2])
    return int(np.argmin(np.sum(np.abs(cells - wanted) / np.maximum(wanted, 1e-12), axis=1)))


class _Loop:
    """B machines under one reversing motion: their contact torques for given preloads."""

    def __init__(self, settings: SizingSettings, rigs: list[Rig], bandwidths: Array, shares: Array, seed: int) -> None:
        """Motion, feedforward and gains; shares (B, 2) of the output torque for each drive."""
        self._fleet, self._shares, self._dt = Fleet(rigs), shares, settings.sample_time
        rig, w = rigs[0], 2.0 * np.pi * settings.frequency
        self.time = np.arange(round(settings.periods / settings.frequency / self._dt), dtype=np.float64) * self._dt
        size = settings.peak_acceleration / w**2
        self._wanted = size * (1.0 - np.cos(w * self.time))
        self._rate = size * w * np.sin(w * self.time)
        friction = float(np.sum(rig.motor_coulomb * rig.motor_ratios)) + rig.coulomb_friction
        self._feed = rig.total_inertia * settings.peak_acceleration * np.cos(w * self.time) + settings.load_torque
        self._feed += friction * np.sign(self._rate) + rig.viscous_friction * self._rate
        speed = 2.0 * np.pi * bandwidths
        self._stiffness, self._damping = rig.total_inertia * speed**2, 2.0 * DAMPING * rig.total_inertia * speed
        self._forgets = np.exp(-FASTER * speed * self._dt)
        self._noise = np.random.default_rng(seed).standard_normal((self.time.size, 2))  # the same for all machines
        self._from = FROM / settings.frequency

    def flanks(self, preload: Array) -> Array:
        """(T, B, 2) least torque of the required flanks in each sample [N m], for preloads (B,) [N m]."""
        fleet, rig, dt = self._fleet, self._fleet.rigs[0], self._dt
        held = preload[:, None] * rig.directions
        state = fleet.rest(torques=(held + self._shares * self._feed[0]) / rig.torque_map)
        before, rate = np.zeros(len(fleet)), np.zeros(len(fleet))
        start = np.mean(fleet.motor_angles(state) / -rig.motor_ratios, axis=1)
        found = np.empty((self.time.size, len(fleet), 2))
        for k in range(self.time.size):
            angle = np.mean(fleet.motor_angles(state, self._noise[k]) / -rig.motor_ratios, axis=1) - start
            rate = self._forgets * rate + (1.0 - self._forgets) * (angle - before) / dt if k else rate
            before = angle
            torque = self._feed[k] + self._stiffness * (self._wanted[k] - angle)
            torque += self._damping * (self._rate[k] - rate)
            state = fleet.advance(state, (held + self._shares * torque[:, None]) / rig.torque_map, dt)
            found[k] = fleet.minimum_contact_torques(state)
        return found

    def keeps(self, preload: Array) -> NDArray[np.bool_]:
        """(B,) whether contact is kept with preloads (B,) [N m]."""
        counted = self.flanks(preload)[self.time > self._from]
        return np.asarray(np.min(counted, axis=(0, 2)) > 0.0)

    def noise_torque(self, noises: Array) -> Array:
        """(C,) standard deviation of the torque [N m] of the first C loops due to the motors' noises (C,) [rad]."""
        first, mean = slice(0, noises.size), noises / np.sqrt(2.0)
        fresh = (1.0 - self._forgets[first]) / self._dt
        # the filtered difference of white noise: fresh^2 (1 + (1 - a)^2/(1 - a^2)), and its correlation with the noise
        by_speed = fresh**2 * (1.0 + (1.0 - self._forgets[first]) ** 2 / (1.0 - self._forgets[first] ** 2))
        k, d = self._stiffness[first], self._damping[first]
        return np.asarray(mean * np.sqrt(k**2 + d**2 * by_speed + 2.0 * k * d * fresh))
