"""The abstract of the paper: a platform carries a camera that follows a moving target, with one drive and with two.

The controller is always the same; the torque allocation between drive and anti-drive differs. The load angle is
measured coarsely by the camera, and much more finely by the motors' encoders, but through the gear contact. Loss of
contact therefore has two costs: the impact of the teeth, and a motor angle that no longer measures the load.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from allocation import Bounds, least_effort
from antidrive.experiments.outcome import Array
from antidrive.experiments.preload_laws import LAWS, ONE, PreloadLaws, joule
from antidrive.experiments.settings import need_positive, need_samples
from antidrive.experiments.targets import FADE_IN, TARGETS, target
from antidrive.remaining_time import Parts, Tell
from antidrive.simulation import rigid_model
from mpc import Controller
from plant.effects import CoulombFriction
from plant.errors import BadParameter
from plant.fleet import Fleet
from plant.rig import Rig
from plant.servo import ServoModel

GRAVITY = 9.81  # [m/s^2]


@dataclass(frozen=True, kw_only=True)
class CameraSettings:
    """Targets, platform, payload and controller.

    Attributes:
        title: for users.
        span: range of the targets [rad].
        acceleration: greatest one of the targets [rad/s^2].
        targets: number of targets of each kind.
        foresight: how far ahead the path of a target is known [s]; beyond that it is extrapolated linearly.
        duration, sample_time: [s].
        payload_mass, payload_arm: of the camera [kg], and its distance from the axis, horizontal at angle zero [m].
        pixel: width of a pixel in the camera's image [rad].
        picture_noise: standard deviation of the target's position in the image [rad].
        min_torque, max_torque: of each pinion [N m].
        bandwidth, torque_noise, disturbance_rate: of the controller [Hz], [N m], [N m/sqrt(s)].
        rig: fields of `plant.rig.Rig` that differ from the paper-like machine without payload.
    """

    title: str
    span: float
    acceleration: float
    targets: int
    foresight: float
    duration: float
    sample_time: float
    payload_mass: float
    payload_arm: float
    pixel: float
    picture_noise: float
    min_torque: float
    max_torque: float
    bandwidth: float
    torque_noise: float
    disturbance_rate: float
    rig: Mapping[str, float]

    def __post_init__(self) -> None:
        """Check the settings that neither rig nor controller checks."""
        need_positive(self, "span", "acceleration", "sample_time", "pixel", "min_torque", "max_torque")
        need_samples(self.duration - FADE_IN, self.sample_time)
        if self.targets < 2:
            raise BadParameter(f"targets = {self.targets}: an interval needs at least two of each kind.")
        if self.foresight < 0.0:
            raise BadParameter(f"foresight must not be negative, but is {self.foresight:g} s.")
        for name in ("encoder_counts", "encoder_noise"):
            if name in self.rig:
                raise BadParameter(f"rig.{name} is given by pixel and picture_noise here.")
        self.machine((1, 2))

    def machine(self, drives: tuple[int, ...]) -> Rig:
        """The rig with its payload; the camera is the load's encoder."""
        bare = Rig.paper_like(**{**self.rig, "drives": drives})
        numbers = {
            "inertia": bare.inertia + self.payload_mass * self.payload_arm**2,
            "gravity": bare.gravity + self.payload_mass * GRAVITY * self.payload_arm,
            "encoder_counts": round(2.0 * np.pi / self.pixel),
            "encoder_noise": self.picture_noise,
        }
        return Rig.paper_like(**{**self.rig, **numbers, "drives": drives})

    def paths(self, ahead: int, seed: int) -> dict[tuple[str, int], Array]:
        """(T + ahead,) angle of each target [rad], by kind and number."""
        time = np.arange(round(self.duration / self.sample_time) + ahead, dtype=np.float64) * self.sample_time
        limits = {"span": self.span, "acceleration": self.acceleration}
        return {
            (kind, number): target(kind, time, seed + number, **limits)
            for kind, number in product(TARGETS, range(self.targets))
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class Tracked:
    """Results over L laws, K kinds of target and S targets of each kind.

    Attributes:
        laws: the sized preload laws.
        rms: (L, K, S) root mean square of load less target [rad].
        peak: (L, K, S) its greatest magnitude [rad].
        copper_loss: (L, K, S) mean of the sum of xi_i^2 [N^2 m^2].
        watts: (L, K, S) mean copper loss [W].
        least: (L, K, S) minimum contact torque of two drives [N m], at the output gear; of one drive, zero or less if
            contact was lost.
        time: (T,) [s].
        wanted: (T,) first target of the last kind [rad].
        error: (L, T) load less that target [rad].
    """

    laws: PreloadLaws
    rms: Array
    peak: Array
    copper_loss: Array
    watts: Array
    least: Array
    time: Array
    wanted: Array
    error: Array


def experiment(settings: CameraSettings, seed: int, tell: Tell | None = None) -> Tracked:
    """Follow every target with every law."""
    pair = settings.machine((1, 2))
    ahead = _controller(settings, pair, rigid_model(pair)).horizon + 1
    paths = settings.paths(ahead, seed)
    laws, friction = _sized(settings, pair, paths)
    parts = Parts(len(LAWS) * round(settings.duration / settings.sample_time), tell)
    loops = {
        drives: _followed(settings, drives, laws, friction, laws_of_drives, paths, seed, parts)
        for drives, laws_of_drives in (((2,), (ONE,)), ((1, 2), LAWS[1:]))
    }
    merged = {name: np.concatenate([loop[name] for loop in loops.values()]) for name in loops[1, 2]}
    shape = (len(LAWS), len(TARGETS), settings.targets)
    count = round(settings.duration / settings.sample_time)
    shown = paths[list(TARGETS)[-1], 0][:count]
    return Tracked(
        laws=laws,
        **{name: merged[name].reshape(shape) for name in ("rms", "peak", "copper_loss", "watts", "least")},
        time=np.arange(count, dtype=np.float64) * settings.sample_time,
        wanted=shown,
        error=merged["error"].reshape(*shape, count)[:, -1, 0],
    )


def _sized(
    settings: CameraSettings, rig: Rig, paths: Mapping[tuple[str, int], Array]
) -> tuple[PreloadLaws, dict[str, float]]:
    """The laws for the torques of the targets, and the dry friction with each of them [N m]."""
    friction = rig.coulomb_friction + float(np.sum(rig.motor_coulomb * rig.motor_ratios))
    model, torques, accelerations = rigid_model(rig), [], []
    for path in paths.values():
        rate = np.gradient(path, settings.sample_time)
        accelerations.append(np.gradient(rate, settings.sample_time))
        load = model.gravity * np.cos(path) + model.viscous_friction * rate + friction * np.sign(rate)
        torques.append(model.inertia * accelerations[-1] + load)
    torque, acceleration = np.concatenate(torques), np.concatenate(accelerations)
    bounds = Bounds(
        gears=rig.gears,
        min_torque=settings.min_torque,
        max_torque=settings.max_torque,
        rotor_inertia=rig.rotor_inertia,
        motor_friction=rig.motor_coulomb,
    )
    laws, planned = PreloadLaws.for_demand(bounds, torque, acceleration), least_effort(bounds, torque, acceleration)
    shares = {law: np.abs(laws.pinion_torques(law, torque, planned)).sum(axis=1) for law in LAWS}
    passed = {law: float(np.mean(share) * rig.gears.mesh_ratios[0]) for law, share in shares.items()}
    return laws, {law: friction + rig.mesh_friction * each for law, each in passed.items()}


def _controller(settings: CameraSettings, rig: Rig, model: ServoModel) -> Controller:
    """The controller; with a single drive it has no motor encoder, which backlash makes worse than none."""
    return Controller(
        model,
        rig.gears,
        sample_time=settings.sample_time,
        min_torque=settings.min_torque,
        max_torque=settings.max_torque,
        rotor_inertia=rig.rotor_inertia,
        bandwidth=settings.bandwidth,
        torque_noise=settings.torque_noise,
        disturbance_rate=settings.disturbance_rate,
        encoder_resolution=settings.pixel,
        encoder_noise=settings.picture_noise,
        motor_resolution=2.0 * np.pi / rig.motor_encoder_counts if len(rig.drives) == 2 else None,
    )


def _followed(
    settings: CameraSettings,
    drives: tuple[int, ...],
    laws: PreloadLaws,
    friction: Mapping[str, float],
    laws_of_drives: Sequence[str],
    paths: Mapping[tuple[str, int], Array],
    seed: int,
    parts: Parts,
) -> dict[str, Array]:
    """All targets with some laws at once, cases in the order of laws, kinds and numbers."""
    rig = settings.machine(drives)
    cases = list(product(laws_of_drives, paths))
    fleet, count = Fleet([rig] * len(cases)), round(settings.duration / settings.sample_time)
    model = rigid_model(rig)
    controllers = [
        _controller(settings, rig, model.with_effect(CoulombFriction(torque=friction[law]))) for law, _ in cases
    ]
    wanted = np.stack([paths[which] for _, which in cases])
    noise = np.stack([np.random.default_rng((seed + number, 1)).standard_normal(count) for _, (_, number) in cases], 1)
    ahead = wanted.shape[1] - count
    pressed = settings.min_torque * np.array([1.0, -1.0])[-len(drives) :] * (len(drives) == 2)
    state, length, known = fleet.rest(torques=pressed), len(paths), round(settings.foresight / settings.sample_time)
    angle = np.empty((len(cases), count))
    pinions = np.empty((len(cases), count, len(drives)))
    least = np.full(len(cases), np.inf)
    late = np.arange(count) * settings.sample_time >= FADE_IN
    for k in range(count):
        angle[:, k] = state.rows[:, 0]
        seen, motors = fleet.measure(state, noise[k]), fleet.motor_angles(state)
        planned, foreseen = np.empty((len(cases), 2)), _foreseen(wanted, k, ahead, known)
        for i, controller in enumerate(controllers):
            at_motors = None if controller.motor_resolution is None else motors[i]
            planned[i] = controller.step(float(seen[i]), foreseen[i], at_motors).torques
        torque = rig.gears.output_torque(planned)
        for w, law in enumerate(laws_of_drives):
            own = slice(w * length, (w + 1) * length)
            pinions[own, k] = laws.pinion_torques(law, torque[own], planned[own])
        state = fleet.advance(state, pinions[:, k], settings.sample_time)
        if late[k]:
            least = np.minimum(least, fleet.minimum_contact_torques(state).min(axis=1))
        parts.done(len(laws_of_drives))
    error = angle - wanted[:, :count]
    return {
        "rms": np.sqrt(np.mean(error[:, late] ** 2, axis=1)),
        "peak": np.max(np.abs(error[:, late]), axis=1),
        "copper_loss": np.mean(np.sum(pinions[:, late] ** 2, axis=2), axis=1),
        "watts": np.mean(joule(rig, pinions[:, late]), axis=1),
        "least": least,
        "error": error,
    }


def _foreseen(paths: Array, now: int, ahead: int, known: int) -> Array:
    """(B, ahead) the paths from sample `now` on: known for `known` samples, then linear."""
    window = paths[:, now : now + ahead].copy()
    if known < ahead:
        rate = window[:, known] - paths[:, max(now + known - 1, 0)]
        window[:, known:] = window[:, known, None] + rate[:, None] * np.arange(ahead - known)
    return window
