"""Report of the dwell at reversals, compared with the paper's, over backlashes, preloads and speeds."""

from __future__ import annotations

import numpy as np

from antidrive.chart import AFTER, BEFORE, MEASURED, SECOND, THIRD
from antidrive.experiments.outcome import Curve, Outcome, Picture
from antidrive.experiments.reversal_dwell import ONE, PLANNED, DwellSettings, experiment
from antidrive.remaining_time import Tell

PAPER = (35, 12)
"""Samples of dwell with one actuator, and with drive/anti-drive."""


def run(settings: DwellSettings, seed: int, tell: Tell | None = None) -> Outcome:
    """Simulate all motions and report them."""
    found, names = experiment(settings, seed, tell), list(settings.strategies)
    one, planned = names.index(ONE), names.index(PLANNED)
    colours = dict(zip(names, (BEFORE, MEASURED, SECOND, THIRD) * len(names), strict=False)) | {PLANNED: AFTER}
    beyond = found.beyond_gapless
    rows, numbers = [], []
    for f, frequency in enumerate(settings.frequencies):
        for s, strategy in enumerate(names):
            counts = " ".join(f"{count:.0f}" for count in found.samples[f, s])
            loss = np.mean(found.copper_loss[f, s])
            rows.append((f"{strategy}, {frequency:g} Hz", "", f"{counts}, {loss:.3g} N² m²"))
            numbers.append(
                {
                    "strategy": strategy,
                    "frequency": frequency,
                    "gaps": [0.0, *settings.gaps],
                    "dwell": found.samples[f, s].tolist(),
                    "tracking_rms": found.error[f, s].tolist(),
                    "minimum_contact_torque": found.least[f, s].tolist(),
                    "copper_loss": found.copper_loss[f, s].tolist(),
                }
            )
    faster = len(settings.frequencies) > 1
    slow, widest = int(np.argmin(settings.frequencies)), int(np.argmax(settings.gaps))
    parted = bool(np.min(found.least[:, planned, 1:]) <= 0.0)
    parts_at = {
        name: [f for f, row in zip(settings.frequencies, found.least[:, s, 1:], strict=True) if np.min(row) <= 0.0]
        for s, name in enumerate(names)
        if settings.strategies[name]
    }
    losses = found.copper_loss.mean(axis=(0, 2))
    constant = "; ".join(
        f"{settings.strategies[name]:g} N m "
        + (f"loses contact at {', '.join(f'{f:g}' for f in at)} Hz" if at else "keeps contact")
        + f" at {losses[names.index(name)] / losses[planned]:.2g} times the copper loss"
        for name, at in parts_at.items()
    )
    return Outcome(
        title=settings.title,
        results=(
            f"Dwell is the greatest number of successive samples ({1e3 * settings.sample_time:.3g} ms) within "
            f"{settings.band:g} rad. It is compared with that of the same machine without backlash, because a "
            "reversal and dry friction cause dwell too.",
            f"At {settings.frequencies[slow]:g} Hz one drive stands {found.samples[slow, one, 0]:.0f} samples without "
            f"backlash and {', '.join(f'{n:.0f}' for n in found.samples[slow, one, 1:])} with backlash of "
            f"{', '.join(f'{1e3 * g:g}' for g in settings.gaps)} mrad. Its error is {np.max(found.error[:, one]):.2g} "
            f"rad rms at most, {np.max(found.error[:, planned]):.2g} with both drives and a planned preload"
            + (
                "; in faster motions the load coasts over the backlash, and only the error shows it." if faster else "."
            ),
            f"With the preload planned by contact torque, dwell differs from that without backlash by "
            f"{np.max(np.abs(beyond[:, planned])):.0f} at most, at every backlash and speed; contact was "
            f"{'lost' if parted else 'never lost'}." + (f" A constant preload of {constant}." if constant else ""),
            f"The paper has {PAPER[0]} and {PAPER[1]} samples, but not their sample time, motion and backlash. "
            f"Here one drive stands {found.samples[slow, one, 1 + widest]:.0f} samples and two drives "
            f"{found.samples[slow, planned, 1 + widest]:.0f}, and {found.samples[slow, planned, 0]:.0f} where there is "
            "no backlash: the rest is the reversal itself.",
            "The encoder noise is the same throughout. Other noise changes a dwell by one or two samples.",
        ),
        comparison=(
            (
                "samples, one actuator and drive/anti-drive",
                f"{PAPER[0]} and {PAPER[1]}",
                "without, with each backlash; loss:",
            ),
            *rows,
        ),
        found={
            "cases": numbers,
            "most_beyond_gapless": {strategy: float(np.max(beyond[:, s])) for s, strategy in enumerate(names)},
            "planned_differs_at_most": float(np.max(np.abs(beyond[:, planned]))),
            "planned_contact_lost": parted,
            "constant_preload_parts_at": parts_at,
            "copper_loss_over_planned": {name: float(losses[s] / losses[planned]) for s, name in enumerate(names)},
        },
        columns={
            "time": found.time,
            "reference": found.reference,
            **{
                f"angle_{s + 1}_{g}": found.angle[:, s, g]
                for s in range(len(names))
                for g in range(found.angle.shape[2])
            },
        },
        pictures=(
            Picture(
                caption=f"The slowest motion, backlash {1e3 * settings.gaps[widest]:g} mrad: load less reference.",
                x="time [s]",
                y="error [rad]",
                curves=[
                    Curve(
                        name=name,
                        colour=colours[name],
                        x=found.time,
                        y=found.angle[:, s, 1 + widest] - found.reference,
                    )
                    for s, name in enumerate(names)
                ],
            ),
            Picture(
                caption="Dwell beyond that without backlash, at the slowest motion.",
                x="backlash [rad]",
                y="samples",
                curves=[
                    Curve(name=name, colour=colours[name], x=np.array(settings.gaps), y=beyond[slow, s], points=True)
                    for s, name in enumerate(names)
                ],
            ),
        ),
    )
