"""The conclusion of the paper: the mechanism is fail-safe. Either drive fails at several moments of a move.

Each loss is compared with the same run, with the same noise, without a loss, over the same samples.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from antidrive.chart import AFTER, BEFORE, MEASURED
from antidrive.drive_loss import loop_with_drive_loss
from antidrive.experiments.outcome import Array, Curve, Outcome, Picture
from antidrive.experiments.settings import need_positive, need_samples
from antidrive.experiments.targets import least_jerk
from antidrive.remaining_time import Parts, Tell
from antidrive.simulation import rigid_model
from diagnosis.explanation.wording import measured
from mpc import ClosedLoopResult, Controller
from plant.effects import CoulombFriction
from plant.errors import BadParameter
from plant.rig import Rig

REST = 1.0
"""Rest before, between and after the two moves [s]."""

MOMENTS = {"at standstill": None, "accelerating": 0.2113, "in mid motion": 0.5, "braking": 0.7887}
"""Time of the loss, as a fraction of the first move: greatest acceleration, speed and deceleration of minimum jerk."""

KNOWN = "backlash control with it"
"""Part of the status of a pair with one drive lost."""


@dataclass(frozen=True, kw_only=True)
class LossSettings:
    """The move, the machine and the controller.

    Attributes:
        title: for users.
        span: of the move there and back [rad].
        acceleration: its greatest one [rad/s^2].
        sample_time: [s].
        detection: delay until a loss is detected [s].
        runs: number of seeds of the encoders' noise.
        min_torque, max_torque: of each pinion [N m].
        bandwidth, torque_noise, disturbance_rate: of the controller [Hz], [N m], [N m/sqrt(s)].
        rig: fields of `plant.rig.Rig` that differ from the paper-like machine.
    """

    title: str
    span: float
    acceleration: float
    sample_time: float
    detection: float
    runs: int
    min_torque: float
    max_torque: float
    bandwidth: float
    torque_noise: float
    disturbance_rate: float
    rig: Mapping[str, float]

    def __post_init__(self) -> None:
        """Check the settings that neither rig nor controller checks."""
        need_positive(self, "span", "acceleration", "sample_time", "min_torque", "max_torque")
        if self.detection < 0.0:
            raise BadParameter(f"detection must not be negative, but is {self.detection:g} s.")
        if self.runs < 1:
            raise BadParameter(f"runs must be at least 1, not {self.runs}.")
        need_samples(self.move, self.sample_time)
        rig = self.machine()
        if rig.encoder_counts == 0 or rig.motor_encoder_counts == 0:
            raise BadParameter("rig.encoder_counts and rig.motor_encoder_counts must be above zero here.")

    @property
    def move(self) -> float:
        """Duration of one minimum-jerk move [s]: its greatest acceleration is 10/sqrt(3) span/duration^2."""
        return float(np.sqrt(10.0 / np.sqrt(3.0) * self.span / self.acceleration))

    def machine(self) -> Rig:
        """The rig."""
        return Rig.paper_like(**self.rig)

    def reference(self) -> tuple[Array, Array]:
        """(T,) time [s] and reference angle [rad]: rest, there, rest, back, rest."""
        time = np.arange(round((3.0 * REST + 2.0 * self.move) / self.sample_time), dtype=np.float64) * self.sample_time
        there, back = (time - REST) / self.move, (time - 2.0 * REST - self.move) / self.move
        return time, self.span * (least_jerk(np.clip(there, 0.0, 1.0)) - least_jerk(np.clip(back, 0.0, 1.0)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Losses:
    """Results over D = 2 drives, M moments and R runs.

    Attributes:
        loss: (M,) time of the loss [s].
        rms, intact: (D, M, R) root mean square of the error after the loss, and without it [rad].
        peak, intact_peak: (D, M, R) its greatest magnitude [rad].
        final: (D, M, R) mean error of the last 20 samples [rad].
        stated: whether the status reports the loss of backlash control in every sample from the detection on, and in
            none before.
        kept: (D, M, R) whether contact was kept until the loss.
        parted: (D, M, R) whether the remaining drive lost contact after it.
        time, reference: (T,) [s], [rad].
        error: (M, T) error when drive 2 is lost, in the last run [rad].
        error_intact: (T,) error without a loss, in the last run [rad].
    """

    loss: Array
    rms: Array
    intact: Array
    peak: Array
    intact_peak: Array
    final: Array
    stated: bool
    kept: Array
    parted: Array
    time: Array
    reference: Array
    error: Array
    error_intact: Array


def experiment(settings: LossSettings, seed: int, tell: Tell | None = None) -> Losses:
    """Run with the loss of either drive at every moment, and without a loss."""
    time, reference = settings.reference()
    moments = np.array([REST / 2 if share is None else REST + settings.move * share for share in MOMENTS.values()])
    still = [_played(settings, reference, 1, np.inf, seed + run) for run in range(settings.runs)]
    shape = (2, moments.size, settings.runs)
    names = ("rms", "intact", "peak", "intact_peak", "final")
    numbers, flags = {name: np.empty(shape) for name in names}, np.empty((2, *shape), dtype=bool)
    stated, errors = True, np.empty((moments.size, time.size))
    parts = Parts(2 * moments.size * settings.runs, tell)
    for d, m, r in product(*(range(size) for size in shape)):
        played = _played(settings, reference, d + 1, float(moments[m]), seed + r)
        first = round(float(moments[m]) / settings.sample_time)
        known = round((float(moments[m]) + settings.detection) / settings.sample_time)
        error, spared = (each.angle - each.reference for each in (played, still[r]))
        of_all = {
            "rms": _rms(error[first:]),
            "intact": _rms(spared[first:]),
            "peak": np.max(np.abs(error[first:])),
            "intact_peak": np.max(np.abs(spared[first:])),
            "final": np.mean(error[-20:]),
        }
        for name, value in of_all.items():
            numbers[name][d, m, r] = value
        flags[:, d, m, r] = (
            np.min(played.contact_torques[:first]) > 0.0,
            np.min(played.contact_torques[first:, 1 - d]) <= 0,
        )
        stated &= [KNOWN in status for status in played.status] == [k >= known for k in range(time.size)]
        errors[m] = error
        parts.done()
    return Losses(
        loss=moments,
        **numbers,
        stated=stated,
        kept=flags[0],
        parted=flags[1],
        time=time,
        reference=reference,
        error=errors,
        error_intact=still[-1].angle - reference,
    )


def _played(settings: LossSettings, reference: Array, drive: int, time: float, seed: int) -> ClosedLoopResult:
    rig = settings.machine()
    friction = rig.coulomb_friction + float(np.sum(rig.motor_coulomb * rig.motor_ratios))
    controller = Controller(
        rigid_model(rig).with_effect(CoulombFriction(torque=friction)),
        rig.gears,
        sample_time=settings.sample_time,
        min_torque=settings.min_torque,
        max_torque=settings.max_torque,
        rotor_inertia=rig.rotor_inertia,
        bandwidth=settings.bandwidth,
        torque_noise=settings.torque_noise,
        disturbance_rate=settings.disturbance_rate,
        encoder_resolution=2.0 * np.pi / rig.encoder_counts,
        encoder_noise=rig.encoder_noise,
        motor_resolution=2.0 * np.pi / rig.motor_encoder_counts,
    )
    never = min(time, reference.size * settings.sample_time + 1.0)
    still = np.zeros(reference.size)
    return loop_with_drive_loss(
        controller, rig, reference, still, drive=drive, time=never, detection=settings.detection, seed=seed
    )


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _mean(runs: Array, unit: str = "") -> str:
    """The mean over runs with its standard error."""
    std = float(np.std(runs, ddof=1)) / np.sqrt(runs.size) if runs.size > 1 else None
    return measured(float(np.mean(runs)), std, unit)


def run(settings: LossSettings, seed: int, tell: Tell | None = None) -> Outcome:
    """Run the drive losses and report them."""
    found = experiment(settings, seed, tell)
    before, after = found.intact.mean(axis=2), found.rms.mean(axis=2)
    growth = after / before
    cases: list[dict[str, Any]] = [
        {
            "drive": d + 1,
            "moment": moment,
            "tracking_rms_after_loss": float(after[d, m]),
            "tracking_rms_without_loss": float(before[d, m]),
            "error_growth": float(growth[d, m]),
            "largest_error_after_loss": float(found.peak[d, m].max()),
            "largest_error_without_loss": float(found.intact_peak[d, m].max()),
            "final_error": float(np.max(np.abs(found.final[d, m]))),
        }
        for d, (m, moment) in product(range(2), enumerate(MOMENTS))
    ]
    worst = max(cases, key=lambda case: case["largest_error_after_loss"])
    return Outcome(
        title=settings.title,
        results=(
            f"One drive fails {', '.join(MOMENTS)}; the controller detects it after {1e3 * settings.detection:g} ms. "
            f"The motion continues. The final error is at most {np.max(np.abs(found.final)):.2g} rad.",
            f"After the loss the error is {growth.min():.2g} to {growth.max():.2g} times that of the same run without "
            f"a loss ({before.min():.2g} to {before.max():.2g} rad rms). The largest error is "
            f"{worst['largest_error_after_loss']:.2g} rad (drive {worst['drive']} fails {worst['moment']}); without a "
            f"loss it is {worst['largest_error_without_loss']:.2g} rad.",
            f"Before the loss contact was {'never lost' if found.kept.all() else 'lost'}; after it the remaining drive "
            f"loses contact in {np.mean(found.parted):.0%} of the runs. The status "
            f"{'reports' if found.stated else 'does not report'} in every sample after detection that backlash control "
            "is lost.",
        ),
        comparison=[
            (
                f"drive {d + 1} lost {moment}: rms error after, without; mean of {settings.runs} runs",
                "“can continue to function”",
                f"{_mean(found.rms[d, m], 'rad')}, {_mean(found.intact[d, m], 'rad')}: "
                f"times {_mean(found.rms[d, m] / found.intact[d, m])}",
            )
            for d, (m, moment) in product(range(2), enumerate(MOMENTS))
        ],
        found={
            "cases": cases,
            "backlash_control_said_lost": found.stated,
            "contact_kept_until_loss": bool(found.kept.all()),
            "contact_lost_share_after_loss": float(np.mean(found.parted)),
            "detection": settings.detection,
        },
        columns={
            "time": found.time,
            "reference": found.reference,
            "error_without_loss": found.error_intact,
            **{f"error_drive_2_lost_{name.replace(' ', '_')}": found.error[m] for m, name in enumerate(MOMENTS)},
        },
        pictures=[
            Picture(
                caption=f"Drive 2 is lost {moment}, at {found.loss[m]:.2f} s.",
                x="time [s]",
                y="error [rad]",
                curves=[
                    Curve(name="drive 2 lost", colour=BEFORE, x=found.time, y=found.error[m]),
                    Curve(name="nothing lost", colour=AFTER, x=found.time, y=found.error_intact),
                ],
            )
            for m, moment in enumerate(MOMENTS)
        ]
        + [
            Picture(
                caption="The move.",
                x="time [s]",
                y="angle [rad]",
                curves=[Curve(name="reference", colour=MEASURED, x=found.time, y=found.reference)],
            )
        ],
    )
