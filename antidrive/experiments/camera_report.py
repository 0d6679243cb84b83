"""Tracking errors of the camera: means with intervals over targets, copper-loss index, and the best law."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from antidrive.chart import AFTER, BEFORE, MEASURED, SECOND, THIRD
from antidrive.experiments.camera_tracking import CameraSettings, Tracked, experiment
from antidrive.experiments.outcome import Array, Curve, Outcome, Picture
from antidrive.experiments.preload_laws import LAWS, ONE, PLANNED, SHAPED, SIZED, WARM
from antidrive.experiments.targets import TARGETS
from antidrive.remaining_time import Tell
from diagnosis.explanation.wording import measured

COLOURS = {ONE: MEASURED, SIZED: BEFORE, WARM: THIRD, SHAPED: SECOND, PLANNED: AFTER}
MICRO = 1e6  # microradians in a radian


@dataclass(frozen=True, kw_only=True)
class Mean:
    """Mean over targets, with half the width of its 95 % interval (Student)."""

    value: float
    half: float

    @classmethod
    def of(cls, values: Array) -> Mean:
        """Of values (S,), independent and approximately normal."""
        spread = float(np.std(values, ddof=1)) / np.sqrt(values.size)
        return cls(value=float(np.mean(values)), half=float(stdtrit(values.size - 1, 0.975)) * spread)

    def text(self, unit: str) -> str:
        """Text with as many digits as the interval justifies."""
        return measured(self.value, self.half, unit)

    def __str__(self) -> str:
        """Text in microradians."""
        return f"{MICRO * self.value:.0f} ± {MICRO * self.half:.0f} µrad"


def verdict(found: Tracked, kind: int) -> str:
    """Error of each law compared with least effort at one kind of target, from the differences per target."""
    planned = LAWS.index(PLANNED)
    words: dict[str, list[str]] = {"more": [], "less": [], "the same": []}
    for law, name in enumerate(LAWS):
        more = Mean.of(found.rms[law, kind] - found.rms[planned, kind])
        if law != planned:
            words["the same" if abs(more.value) <= more.half else "more" if more.value > 0 else "less"].append(name)
    parts = [
        f"{', '.join(names)} {'has' if len(names) == 1 else 'have'} {how}" for how, names in words.items() if names
    ]
    return f"Error at a {list(TARGETS)[kind]} target, compared with least effort: {'; '.join(parts)}."


def run(settings: CameraSettings, seed: int, tell: Tell | None = None) -> Outcome:
    """Run the camera experiment and report it."""
    return sentences_of(settings, experiment(settings, seed, tell))


def sentences_of(settings: CameraSettings, found: Tracked) -> Outcome:
    """Results in sentences, tables and figures."""
    kinds = list(TARGETS)
    errors = {(law, kind): Mean.of(found.rms[a, b]) for a, law in enumerate(LAWS) for b, kind in enumerate(kinds)}
    heats = {(law, kind): Mean.of(found.watts[a, b]) for a, law in enumerate(LAWS) for b, kind in enumerate(kinds)}
    watts = dict(zip(LAWS, found.watts.mean(axis=(1, 2)).tolist(), strict=True))
    overall = dict(zip(LAWS, np.sqrt(np.mean(found.rms**2, axis=(1, 2))).tolist(), strict=True))
    least = dict(zip(LAWS, found.least.min(axis=(1, 2)).tolist(), strict=True))
    best, kept = min(LAWS, key=lambda law: overall[law]), [law for law in LAWS[1:] if least[law] > 0.0]
    return Outcome(
        title=settings.title,
        results=(
            f"A camera of {settings.payload_mass:g} kg follows {settings.targets} targets of each kind over "
            f"{settings.span:g} rad for {settings.duration:g} s. The image measures the angle "
            f"with {MICRO * settings.picture_noise:.0f} µrad of noise. The motor encoders are finer, but the backlash "
            f"is between them and the load; with one drive the error is smaller without its encoder. The next "
            f"{settings.foresight:g} s of the target are known.",
            f"The error over all targets is {MICRO * overall[PLANNED]:.0f} µrad rms with least effort by contact "
            f"torque, {MICRO * overall[SIZED]:.0f} with constant preload, {MICRO * overall[ONE]:.0f} with one drive. "
            f"At the copper loss of least effort it is {MICRO * overall[WARM]:.0f} with a constant preload, and "
            f"{MICRO * overall[SHAPED]:.0f} with one that falls with the load. Smallest error: {best}.",
            f"The copper losses are {watts[PLANNED]:.2f} W with least effort, {watts[SIZED]:.2f} W with a constant "
            f"preload that is enough for the peak, {watts[ONE]:.2f} W with one drive. Contact was never lost with: "
            f"{', '.join(kept) or 'none'}.",
            *(verdict(found, kind) for kind in range(len(kinds))),
            "Least effort and a constant preload for the peak both keep contact, and then the motor encoders measure "
            "the load. A constant preload has more copper loss, and more gear friction because "
            "the gears carry more load than they need. The controller knows the mean friction of each.",
        ),
        comparison=[
            (f"{law}, {kind} target", "", f"{errors[law, kind]}, {heats[law, kind].text('W')}")
            for a, law in enumerate(LAWS)
            for b, kind in enumerate(kinds)
        ],
        found={
            "cases": [
                {
                    "law": law,
                    "target": kind,
                    "tracking_rms": errors[law, kind].value,
                    "tracking_rms_half_interval": errors[law, kind].half,
                    "largest_error": float(found.peak[a, b].max()),
                    "copper_loss": float(found.copper_loss[a, b].mean()),
                    "joule_heat_watts": float(found.watts[a, b].mean()),
                    "minimum_contact_torque": float(found.least[a, b].min()),
                }
                for a, law in enumerate(LAWS)
                for b, kind in enumerate(kinds)
            ],
            "tracking_rms": overall,
            "joule_heat_watts": watts,
            "minimum_contact_torque": least,
            "least_error": best,
            "preload": {SIZED: found.laws.sized, WARM: found.laws.warm, SHAPED: found.laws.full},
            "targets_of_each_kind": settings.targets,
        },
        columns={
            "time": found.time,
            "target": found.wanted,
            **{f"error_{a + 1}": found.error[a] for a in range(len(LAWS))},
        },
        pictures=(
            Picture(
                caption="Tracking error and copper loss, a point for each kind of target. In the table ± is the 95 % "
                "interval of the mean over targets.",
                x="copper loss [W]",
                y="tracking error [rad rms]",
                curves=[
                    Curve(
                        name=law,
                        colour=COLOURS[law],
                        x=found.watts[a].mean(axis=1),
                        y=found.rms[a].mean(axis=1),
                        points=True,
                    )
                    for a, law in enumerate(LAWS)
                ],
            ),
            Picture(
                caption=f"Load less target, {kinds[-1]}.",
                x="time [s]",
                y="error [rad]",
                curves=[
                    Curve(name=law, colour=COLOURS[law], x=found.time, y=found.error[a]) for a, law in enumerate(LAWS)
                ],
            ),
            Picture(
                caption="That target.",
                x="time [s]",
                y="angle [rad]",
                curves=[Curve(name="target", colour=MEASURED, x=found.time, y=found.wanted)],
            ),
        ),
    )
