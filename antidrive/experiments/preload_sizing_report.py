"""Report of the preload sizing."""

from __future__ import annotations

import numpy as np

from antidrive.chart import AFTER, BEFORE, MEASURED, SECOND
from antidrive.experiments.outcome import Array, Curve, Outcome, Picture
from antidrive.experiments.preload_sizing import STRATEGIES, Sizing, SizingSettings, experiment
from antidrive.remaining_time import Tell

COLOURS = (BEFORE, SECOND, AFTER, MEASURED)


def run(settings: SizingSettings, seed: int, tell: Tell | None = None) -> Outcome:
    """Least T_min of every mesh, noise and loop, compared with the formulas."""
    found = experiment(settings, seed, tell)
    quiet = found.noises == np.min(found.noises)
    equal, slave = found.formula
    rows = list(zip(found.meshes, found.noises, found.bandwidths, found.preload, found.least, strict=True))
    return Outcome(
        title=settings.title,
        results=(
            f"At a greatest acceleration of {settings.peak_acceleration:g} rad/s^2 the formulas with T_min = 0 give "
            f"{equal:.1f} N m of preload where both motors share and each carries its own rotor, and {slave:.1f} "
            "N m with one constant torque.",
            f"In simulation with the least noise, contact needs {_range(found.preload[quiet, 0])} N m with equal "
            f"split and {_range(found.preload[quiet, 1])} N m with one constant torque, for mesh stiffnesses of "
            f"{_list(settings.stiffnesses)} N m/rad and loop bandwidths of {_list(settings.bandwidths)} Hz. T_min must "
            f"be {_range(found.least[quiet, 0])} and {_range(found.least[quiet, 1])} N m.",
            "With equal split every motor compensates its own friction at once. A constant torque does not: at the "
            "greatest acceleration the friction of its drive changes sign, and the gears vibrate after that step.",
            f"Encoder noise of {max(settings.noises):g} rad at the motors (seen from the load) becomes a torque noise "
            f"of {_range(found.noise_torque[found.noises == np.max(found.noises)])} N m rms. T_min must then be "
            f"{_range(found.least[found.noises == np.max(found.noises), 0])} and "
            f"{_range(found.least[found.noises == np.max(found.noises), 1])} N m; the rotor inertia filters most of "
            f"the noise. T_min is searched to {settings.resolution:g} N m with one noise sequence. The first period is "
            "not counted.",
        ),
        comparison=(
            ("least preload [N m] by the formulas: equal split, one constant torque", "", f"{equal:.2f}, {slave:.2f}"),
            *(
                (
                    f"{mesh:g} N m/rad, noise {noise:g} rad, loop {bandwidth:g} Hz",
                    "",
                    f"{preload[0]:.2f} ({least[0]:+.2f}), {preload[1]:.2f} ({least[1]:+.2f})",
                )
                for mesh, noise, bandwidth, preload, least in rows
            ),
        ),
        found={
            "strategies": list(STRATEGIES),
            "formula": found.formula.tolist(),
            "cases": [
                {
                    "stiffness": mesh,
                    "noise": noise,
                    "bandwidth": bandwidth,
                    "least_preload": _finite(preload),
                    "least_min_torque": _finite(least),
                    "noise_torque": torque,
                }
                for (mesh, noise, bandwidth, preload, least), torque in zip(rows, found.noise_torque, strict=True)
            ],
            "resolution": settings.resolution,
        },
        columns={
            "time": found.time,
            **{
                f"minimum_contact_torque_{name.replace(' ', '_')}_{how}": found.flanks[:, s, h]
                for s, name in enumerate(STRATEGIES)
                for h, how in enumerate(("formula", "found"))
            },
        },
        pictures=(_torque_figures(found), *(_least(found, strategy) for strategy in range(len(STRATEGIES)))),
    )


def _torque_figures(found: Sizing) -> Picture:
    return Picture(
        caption="Minimum contact torque; where it is zero, contact is lost.",
        x="time [s]",
        y="contact torque [N m]",
        curves=[
            Curve(name=f"{name}, {how}", colour=COLOURS[2 * s + h], x=found.time, y=found.flanks[:, s, h])
            for s, name in enumerate(STRATEGIES)
            for h, how in enumerate(("by the formula", "as found"))
        ],
    )


def _least(found: Sizing, strategy: int) -> Picture:
    curves = []
    for k, mesh in enumerate(np.unique(found.meshes)):
        for noise, name in ((np.min(found.noises), "least noise"), (np.max(found.noises), "most noise")):
            use = (found.meshes == mesh) & (found.noises == noise)
            curves.append(
                Curve(
                    name=f"{mesh:g} N m/rad, {name}",
                    colour=COLOURS[k % len(COLOURS)],
                    x=found.bandwidths[use],
                    y=found.least[use, strategy],
                    points=bool(noise == np.max(found.noises)),
                )
            )
    return Picture(caption=f"Least T_min, {STRATEGIES[strategy]}.", x="loop [Hz]", y="T_min [N m]", curves=curves)


def _finite(values: Array) -> list[float | None]:
    """Numbers for JSON: None if no preload kept contact."""
    return [float(value) if np.isfinite(value) else None for value in values]


def _range(values: Array) -> str:
    return f"{np.min(values):.2f} to {np.max(values):.2f}"


def _list(values: tuple[float, ...]) -> str:
    return ", ".join(f"{value:g}" for value in values)
