"""The log of a seed, and the truth about it.

from drawn_machines import drawn
d = drawn(3); d.log, d.truth, d.exclude
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from drawn_machines.confounded import alike, left_out_with
from drawn_machines.detectability import Seen
from drawn_machines.draw import ATTEMPTS, Runs, Setting, basis_of, drawn_runs, drawn_setting, with_hidden
from drawn_machines.hidden import Basis, rms
from drawn_machines.motion import Array, Motion, RunsAway
from drawn_machines.servo import Machine

if TYPE_CHECKING:
    from identification.log import Log

LEFT_OUT = 0.2  # share of the logs with an effect in which one effect is no candidate
NO_TORQUE = {
    *("input_delay", "actuator_lag", "rate_limit", "setpoint_rate_limit"),
    *("compliance", "backlash", "encoder_eccentricity", "sensor_lag"),
}
"""Effects that change the transmission of the torque or the measurement of the angle, and add no torque."""


@dataclass(frozen=True, kw_only=True)
class Hidden:
    """One hidden effect.

    Attributes:
        size: rms of the torque that a model without it lacks along the log [N m].
        rms: the same, None if the effect itself is no torque.
        visible: lambda, about twice the gain in log-likelihood of the log for it, given all other effects.
        alike: sets of effects that are each equivalent to it on this log.
    """

    name: str
    parameters: dict[str, float]
    size: float
    rms: float | None
    visible: float
    alike: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Drawn:
    """A drawn log.

    Attributes:
        truth: hidden effects.
        left_out: the hidden effect that is no candidate.
        exclude: names of all effects that are no candidates.
        level: rms of the torque [N m].
        rest: rms of the unmodelled torque [N m].
        channels: of the log, by the names of the log contract.
    """

    seed: int
    kind: str
    loop: str
    rate: float
    clock: str
    rest_share: float
    level: float
    rest: float
    base: dict[str, float]
    truth: tuple[Hidden, ...]
    left_out: str | None
    exclude: tuple[str, ...]
    gains: dict[str, float]
    channels: dict[str, Array]

    @cached_property
    def log(self) -> Log:
        """The log as antidrive reads it."""
        from identification.log import Log

        return Log.from_arrays(label=f"seed {self.seed}", **self.channels, **self.gains)

    def facts(self) -> dict[str, Any]:
        """Everything but the channels."""
        return {key: value for key, value in asdict(self).items() if key != "channels"}


def drawn(seed: int, folder: Path | None = None) -> Drawn:
    """The log of a seed; cached in a folder if one is given."""
    if folder is not None and (kept := folder / f"{seed}.npz").exists():
        with np.load(kept) as file:
            facts = json.loads(str(file["facts"]))
            channels = {name: file[name] for name in file.files if name != "facts"}
        truth = tuple(Hidden(**{**h, "alike": tuple(map(tuple, h["alike"]))}) for h in facts.pop("truth"))
        return Drawn(**{**facts, "exclude": tuple(facts["exclude"])}, truth=truth, channels=channels)
    for attempt in range(ATTEMPTS):
        try:
            found = _attempt(seed, np.random.default_rng([seed, attempt, 37]))
        except RunsAway:
            continue
        if found is not None:
            break
    else:
        raise RuntimeError(f"seed {seed}: {ATTEMPTS} draws, and none moves sensibly.")
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        partial = folder / f"{seed}.part.npz"
        np.savez(partial, facts=json.dumps(found.facts()), **found.channels)
        partial.rename(folder / f"{seed}.npz")
    return found


def _attempt(seed: int, rng: np.random.Generator) -> Drawn | None:
    setting = drawn_setting(rng)
    if setting is None:
        return None
    runs = drawn_runs(rng, setting)
    machine = setting.machine
    if runs.loop is not None and runs.loop.inner:
        machine = replace(machine, kp=runs.loop.kp, kd=runs.loop.kd)
    if "current" in setting.loop:
        lag = setting.sample_time * 10.0 ** rng.uniform(-0.5, 0.4)
        machine = replace(machine, current_lag=lag, filter_lag=setting.sample_time * 10.0 ** rng.uniform(-0.3, 0.6))
    still = [np.zeros(n) for n in setting.samples]
    basis = basis_of(setting, machine, runs.played(machine, still, 0.0, 2))
    if not _sensible(setting, basis):
        return None
    machine = with_hidden(rng, setting, machine, basis)
    if len(machine.effects) < setting.effects:
        return None
    noise = [setting.noise * rng.standard_normal(n) for n in setting.samples]
    motions = runs.played(machine, noise, setting.count, _substeps(setting, machine))
    moved = basis_of(setting, machine, motions)
    if not _sensible(setting, moved) or not _alike(basis, moved):
        return None
    return _written(seed, rng, setting, runs, machine, moved, motions)


def _substeps(s: Setting, machine: Machine) -> int:
    """Integration steps in a sample: at most a quarter of a radian of the fastest oscillation, at least four steps."""
    swings = [0.0]
    if machine.motor_share:
        swings.append(machine.effects.get("compliance", {"frequency": 2.0 / s.sample_time})["frequency"])
    if "end_stop" in machine.effects:
        swings.append(4.0 / s.sample_time)
    if "presliding_hysteresis" in machine.effects:
        swings.append(2.5 / s.sample_time)
    return min(24, max(4, int(np.ceil(4.0 * max(swings) * s.sample_time))))


def _sensible(s: Setting, b: Basis) -> bool:
    """Whether it moves in every run, by more than encoder steps, and at realistic speeds that the samples resolve.

    A weight that rotates without a loop is chaotic, and no useful experiment.
    """
    if not (np.isfinite(b.angle).all() and np.isfinite(b.torque).all()):
        return False
    ends = np.cumsum(s.samples)
    spans = [np.ptp(part) for part in np.split(b.angle, ends[:-1])]
    followed = rms(b.acceleration) * s.sample_time < 0.4 * b.speed
    turned = float(np.quantile(np.abs(b.velocity), 0.99)) * s.sample_time < 0.4 or not s.machine.gravity
    hangs = s.loop != "open" or not s.machine.gravity or max(spans) < 4.0 * np.pi
    moves = min(spans) > max(60.0 * s.count, 0.03) and np.abs(b.velocity).max() < 900.0
    return bool(moves and followed and turned and hangs)


def _alike(before: Basis, after: Basis) -> bool:
    """Whether hidden effects and the noise in the loop have left the experiment similar."""
    return 0.1 < after.speed / before.speed < 4.0 and after.level < 4.0 * before.level


def _written(
    seed: int,
    rng: np.random.Generator,
    s: Setting,
    runs: Runs,
    machine: Machine,
    moved: Basis,
    motions: list[Motion],
) -> Drawn:
    """The log and the truth about it."""
    torque_noise = moved.level * 10.0 ** rng.uniform(-2.3, -1.7) if "current" in s.loop else 0.0
    channels, gains = _channels(rng, s, runs, motions, torque_noise)
    seen = Seen(machine, moved, motions, torque_noise)
    truth = tuple(
        Hidden(
            name=name,
            parameters=dict(values),
            size=rms(seen.torques[name]),
            rms=None if name in NO_TORQUE else rms(seen.torques[name]),
            visible=seen.visible(name),
            alike=alike(name, machine.effects, seen),
        )
        for name, values in machine.effects.items()
    )
    left_out = str(rng.choice([h.name for h in truth])) if truth and rng.random() < LEFT_OUT else None
    hidden = next((h for h in truth if h.name == left_out), None)
    return Drawn(
        seed=seed,
        kind=s.kind,
        loop=s.loop,
        rate=s.rate,
        clock=s.clock,
        rest_share=s.rest,
        level=moved.level,
        rest=rms(seen.torques["rest"]),
        base={
            "inertia": machine.inertia,
            "gravity": machine.gravity,
            "viscous_friction": machine.viscous_friction,
            "dead_zone": machine.dead_zone,
            "noise": moved.noise,
        },
        truth=truth,
        left_out=left_out,
        exclude=() if hidden is None else left_out_with(hidden.name, hidden.alike),
        gains=gains,
        channels=channels,
    )


def _channels(
    rng: np.random.Generator, s: Setting, runs: Runs, motions: list[Motion], torque_noise: float
) -> tuple[dict[str, Array], dict[str, float]]:
    """The columns of the log, and the gains of a position servo."""
    time = np.concatenate([motion.time for motion in motions])
    if s.clock == "stamps":
        time = time + 0.01 * s.sample_time * rng.standard_normal(time.size)
    command = np.concatenate([motion.command for motion in motions])
    channels = {"time": time, "angle": np.concatenate([motion.reading for motion in motions])}
    if len(motions) > 1:
        channels["run"] = np.repeat(np.arange(len(motions)), s.samples)
    if runs.loop is not None and runs.loop.inner:
        return channels | {"setpoint": command}, {"kp": runs.loop.kp, "kd": runs.loop.kd}
    if "current" in s.loop:
        current = np.concatenate([motion.current for motion in motions])
        command = current + torque_noise * rng.standard_normal(current.size)
    return channels | {"torque": command}, {}
