"""The claim of figure 7 of the paper: duration of the output's dwell at a reversal, with one drive and with two.

Dwell is the greatest number of successive samples whose measurements lie within a band of given width. A slow reversal
causes some dwell without any backlash, and dry friction causes more; so each machine is compared with the same machine
without backlash.

The loop is closed over the motors' encoders, as in servo drives: a single drive reverses while the load, held by
friction, waits until the backlash is crossed.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from allocation import Bounds, least_effort
from antidrive.experiments.outcome import Array
from antidrive.experiments.settings import need_positive, need_samples
from antidrive.remaining_time import Parts, Tell
from plant.errors import BadParameter
from plant.fleet import Fleet
from plant.rig import Rig

PERIODS, FROM = 2.2, 0.3  # number of periods, and the instant in periods from which dwell counts
TICKS = 5  # samples of the loop per output sample
ONE, PLANNED = "one drive", "both, planned by contact torque"


@dataclass(frozen=True, kw_only=True)
class DwellSettings:
    """Motions, machines and loop.

    Attributes:
        title: for users.
        amplitude, frequencies: the load follows amplitude (1 - cos) [rad], [Hz].
        gaps: backlashes [rad]; a machine without backlash is added.
        sample_time: of the measurements that are counted [s]; the loop is five times as fast.
        band: width within which the output counts as standing still [rad].
        stiffness, damping: of the loop [N m/rad], [N m s/rad].
        friction_feed: feed-forward torque against friction, in the direction of the motion [N m].
        preloads: constant ones, of each pinion [N m]; zero is none.
        min_torque: minimum torque of each flank in the plan, at the pinion [N m].
        rig: fields of `plant.rig.Rig` that differ from the paper-like machine.
    """

    title: str
    amplitude: float
    frequencies: tuple[float, ...]
    gaps: tuple[float, ...]
    sample_time: float
    band: float
    stiffness: float
    damping: float
    friction_feed: float
    preloads: tuple[float, ...]
    min_torque: float
    rig: Mapping[str, float]

    def __post_init__(self) -> None:
        """Check the settings that the rig does not check."""
        need_positive(self, "amplitude", "frequencies", "gaps", "sample_time", "band", "stiffness", "damping")
        need_positive(self, "min_torque")
        if min(self.preloads) < 0.0:
            raise BadParameter(f"preloads must not be negative, but are {self.preloads!r}.")
        need_samples(PERIODS / min(self.frequencies), self.sample_time / TICKS)
        need_samples(PERIODS / max(self.frequencies), self.sample_time)
        if "backlash" in self.rig:
            raise BadParameter("rig.backlash is given by gaps here.")
        self.machines(drives=(1, 2))

    @property
    def strategies(self) -> dict[str, float | None]:
        """Names, and the constant preload of each, None if it has none [N m]."""
        constant = {
            f"both, preload {preload:g} N m" if preload else "both, no preload": preload for preload in self.preloads
        }
        return {ONE: None, **constant, PLANNED: None}

    def machines(self, drives: tuple[int, ...]) -> list[Rig]:
        """A rig without backlash, and one for each backlash."""
        return [
            Rig.paper_like(**{**self.rig, "drives": drives, "backlash": backlash}) for backlash in (0.0, *self.gaps)
        ]


@dataclass(frozen=True, kw_only=True, eq=False)
class Dwell:
    """Results over F frequencies, S strategies and G machines, the first one without backlash.

    Attributes:
        samples: (F, S, G) dwell [samples].
        error: (F, S, G) rms of load angle less reference [rad].
        least: (F, S, G) minimum contact torque [N m], output side.
        copper_loss: (F, S, G) mean of the sum of xi_i^2 [N^2 m^2].
        time: (T,) of the slowest motion, in samples [s].
        angle: (T, S, G) measured load angle in it [rad].
        reference: (T,) [rad].
    """

    samples: Array
    error: Array
    least: Array
    copper_loss: Array
    time: Array
    angle: Array
    reference: Array

    @property
    def beyond_gapless(self) -> Array:
        """(F, S, G - 1) dwell in excess of that of the machine without backlash [samples]."""
        return self.samples[:, :, 1:] - self.samples[:, :, :1]


def dwell(reading: Array, band: float) -> int:
    """Greatest number of successive measurements (T,) whose largest and smallest differ by at most `band`."""
    longest, first = 0, 0
    low: deque[int] = deque()  # places of the smallest measurements since `first`, rising
    high: deque[int] = deque()
    for last, value in enumerate(reading):
        while low and reading[low[-1]] >= value:
            low.pop()
        while high and reading[high[-1]] <= value:
            high.pop()
        low.append(last)
        high.append(last)
        while reading[high[0]] - reading[low[0]] > band:
            first += 1
            if low[0] < first:
                low.popleft()
            if high[0] < first:
                high.popleft()
        longest = max(longest, last - first + 1)
    return longest


def experiment(settings: DwellSettings, seed: int, tell: Tell | None = None) -> Dwell:
    """Simulate every motion with every strategy on every machine."""
    parts = Parts(len(settings.strategies) * sum(_ticks(settings, each) for each in settings.frequencies), tell)
    results = [
        [_simulated(settings, frequency, way, seed, parts) for way in settings.strategies]
        for frequency in settings.frequencies
    ]
    slowest = results[int(np.argmin(settings.frequencies))]
    samples, error, least, copper_loss = (
        np.array([[result[name] for result in row] for row in results])
        for name in ("dwell", "error", "least", "copper_loss")
    )
    time = np.arange(len(slowest[0]["angle"]), dtype=np.float64) * settings.sample_time
    return Dwell(
        samples=samples,
        error=error,
        least=least,
        copper_loss=copper_loss,
        time=time,
        angle=np.stack([result["angle"] for result in slowest], axis=1),
        reference=settings.amplitude * (1.0 - np.cos(2.0 * np.pi * min(settings.frequencies) * time)),
    )


def _ticks(settings: DwellSettings, frequency: float) -> int:
    """Loop samples of one motion."""
    return round(PERIODS / frequency * TICKS / settings.sample_time)


def _simulated(settings: DwellSettings, frequency: float, strategy: str, seed: int, parts: Parts) -> dict[str, Array]:
    """One motion on all machines: PD control of the motors' mean angle, with feed-forward of model and friction."""
    fleet = Fleet(settings.machines((2,) if strategy == ONE else (1, 2)))
    rig, dt = fleet.rigs[0], settings.sample_time / TICKS
    allocated, w = _allocating(settings, rig, strategy), 2.0 * np.pi * frequency
    time = np.arange(_ticks(settings, frequency)) * dt
    wanted = settings.amplitude * (1.0 - np.cos(w * time))
    rate, acceleration = settings.amplitude * w * np.sin(w * time), settings.amplitude * w**2 * np.cos(w * time)
    feed = rig.total_inertia * acceleration + rig.viscous_friction * rate + settings.friction_feed * np.sign(rate)
    noise = np.random.default_rng(seed).standard_normal((time.size, len(fleet)))
    state, lag = fleet.rest(torques=allocated(0.0, 0.0)), 3
    at_rest = _motor_side(fleet, fleet.motor_angles(state))
    angle, motors, least, loss = [], [], np.full(len(fleet), np.inf), np.zeros(len(fleet))
    for k in range(time.size):
        angle.append(fleet.measure(state, noise[k]))
        motors.append(_motor_side(fleet, fleet.motor_angles(state)) - at_rest)
        before = max(k - lag, 0)
        speed = (motors[k] - motors[before]) / (max(k - before, 1) * dt)
        torque = feed[k] + settings.stiffness * (wanted[k] - motors[k]) + settings.damping * (rate[k] - speed)
        pinions = allocated(torque, acceleration[k])
        state = fleet.advance(state, pinions, dt)
        if time[k] > FROM / frequency:
            least = np.minimum(least, fleet.minimum_contact_torques(state).min(axis=1))
            loss += np.sum(pinions**2, axis=1)
        parts.done()
    read = np.array(angle)[::TICKS]
    late = time[::TICKS] > FROM / frequency
    return {
        "dwell": np.array([dwell(column, settings.band) for column in read[late].T], dtype=np.float64),
        "error": np.sqrt(np.mean((read - wanted[::TICKS, None])[late] ** 2, axis=0)),
        "least": least,
        "copper_loss": loss / np.sum(time > FROM / frequency),
        "angle": read,
    }


def _motor_side(fleet: Fleet, motors: Array) -> Array:
    """(B,) mean of the motors' angles (B, m), at the load side [rad]."""
    return np.asarray(np.mean(motors / -fleet.rigs[0].motor_ratios, axis=1))


def _allocating(settings: DwellSettings, rig: Rig, strategy: str) -> Callable[[Array | float, float], Array]:
    """Function that allocates output torques (B,) at an acceleration to the pinions (B, m)."""
    if strategy == ONE:
        return lambda torque, _: np.asarray(torque)[..., None] / rig.torque_map
    constant = settings.strategies[strategy]
    if constant is not None:
        preload = constant / rig.gears.null_vector[0]
        return lambda torque, _: rig.gears.pinion_torques(torque, preload)
    bounds = Bounds(
        gears=rig.gears,
        min_torque=settings.min_torque,
        max_torque=10.0,
        rotor_inertia=rig.rotor_inertia,
        motor_friction=rig.motor_coulomb,
    )
    return lambda torque, acceleration: least_effort(bounds, torque, acceleration)
