"""Report of the identification in differential and in common mode."""

from __future__ import annotations

from typing import Any

import numpy as np

from antidrive.chart import AFTER, BEFORE, MEASURED, SECOND
from antidrive.experiments.differential import Case, Differential, DifferentialSettings, experiment
from antidrive.experiments.outcome import Array, Curve, Outcome, Picture
from antidrive.remaining_time import Tell
from identification.fit_result import Fit
from identification.lost_motion import Measured

COLOURS = (BEFORE, SECOND, AFTER, MEASURED)
ARCMIN = np.pi / 180.0 / 60.0
WANTED = 0.05  # required relative error of a backlash


def run(settings: DifferentialSettings, seed: int, tell: Tell | None = None) -> Outcome:
    """Run both modes and report them."""
    found = experiment(settings, seed, tell)
    preloads = np.array(settings.preloads)
    moving, friction = _common(found.common), found.friction(preloads)
    worst = max(found.cases, key=lambda case: abs(case.error))
    rough = max(found.standing, key=lambda case: case.std)
    drive = found.best.found.drives[0]
    duration = settings.visit * settings.visits
    scores = np.array([case.error / case.std for case in found.cases])
    return Outcome(
        title=settings.title,
        results=(
            f"Backlash from {min(settings.gaps) / ARCMIN:.3g} to {max(settings.gaps) / ARCMIN:.3g} arcmin is measured "
            f"in {duration:g} s at standstill, from motor and load encoders of {min(settings.bits):g} to "
            f"{max(settings.bits):g} bits: an error of {100 * abs(worst.error):.2g} % at most, for "
            f"{worst.gap / ARCMIN:.2g} arcmin with {worst.bits} bits (standard error {100 * worst.std:.2g} %).",
            f"One count of {min(settings.bits):g} bits at the load is {_count(min(settings.bits)):.2g} arcmin. One "
            f"sample cannot resolve less, but {duration:g} s of samples can: the load moves slowly over "
            f"{settings.load_speed * duration / ARCMIN / _count(min(settings.bits)):.2g} counts, and the motor "
            f"encoders, finer by the gear ratio of {found.rig.gears.ratio:.1f}, measure the position within a count. "
            f"With the load at rest the standard error is up to {100 * rough.std:.2g} % of the smallest backlash "
            f"({rough.bits} bits).",
            f"Also found: {drive.stiffness.value:.5g} N m/rad of stiffness (true: {found.rig.flank_stiffness:g}), "
            f"and friction of {drive.friction.value:.3f} N m plus {drive.friction_coefficient.value:.4f} of the "
            f"transmitted torque (true: {_coulomb(found):.3f} and {found.rig.mesh_friction:g}; mesh damping counts "
            "with the first).",
            f"In common mode J = {moving['inertia'][0]:.4f}, alpha = {moving['gravity'][0]:.4f}, K = "
            f"{moving['viscous_friction'][0]:.4f} under the least preload (true: {found.rig.total_inertia:.4f}, "
            f"{found.rig.gravity:.4f}, {_viscous(found):.4f}). Its dry friction under {_list(preloads, 'g')} N m of "
            f"preload is {_list(moving['coulomb_friction.torque'])} N m; from the differential mode follows "
            f"{_list(friction)} N m.",
        ),
        comparison=(
            *(_row(case, "") for case in found.cases),
            *(_row(case, ", standing") for case in found.standing),
        ),
        found={
            "cases": [_numbers(case) for case in found.cases],
            "standing": [_numbers(case) for case in found.standing],
            "largest_relative_error": abs(worst.error),
            "all_within_5_percent": bool(abs(worst.error) < WANTED),
            "root_mean_square_score": float(np.sqrt(np.mean(scores**2))),
            "stiffness": _both(drive.stiffness),
            "friction": _both(drive.friction),
            "friction_coefficient": _both(drive.friction_coefficient),
            "common_mode": {name: values.tolist() for name, values in moving.items()},
            "preloads": preloads.tolist(),
            "friction_by_differential_mode": friction.tolist(),
        },
        columns=_columns(found),
        pictures=(_twist(settings, found), _errors(settings, found), _friction(found, preloads, moving)),
    )


def _coulomb(found: Differential) -> float:
    return float(found.rig.motor_coulomb * found.rig.motor_ratios[0])


def _viscous(found: Differential) -> float:
    return float(found.rig.viscous_friction + found.rig.motor_viscous * np.sum(found.rig.motor_ratios**2))


def _count(bits: float) -> float:
    return float(2.0 * np.pi / 2.0**bits / ARCMIN)


def _common(fits: list[Fit]) -> dict[str, Array]:
    """Values (P,) of each parameter, NaN if the log does not determine it."""
    names = [parameter.name for parameter in fits[0].parameters]
    values = [[np.nan if fit[name].value is None else fit[name].value for fit in fits] for name in names]
    return {name: np.array(row, dtype=np.float64) for name, row in zip(names, values, strict=True)}


def _row(case: Case, how: str) -> tuple[str, str, str]:
    text = f"{100 * case.error:+.2f} ± {100 * case.std:.2g}"
    return f"{case.gap / ARCMIN:.3g} arcmin, {case.bits} bits{how} [% off]", "", text


def _both(line: Measured) -> dict[str, float]:
    return {"value": line.value, "std": line.std}


def _numbers(case: Case) -> dict[str, Any]:
    return {
        "bits": case.bits,
        "gap": case.gap,
        "gaps": [_both(drive.gap) for drive in case.found.drives],
        "total_gap": _both(case.found.total_gap),
        "encoder_noise": case.found.encoder_noise,
        "samples": case.found.samples,
    }


def _columns(found: Differential) -> dict[str, Array]:
    run = found.log.runs[0]
    assert run.torques is not None
    assert run.drive_angles is not None
    return {
        "time": run.time,
        "torque_1": run.torques[:, 0],
        "torque_2": run.torques[:, 1],
        "angle": run.output,
        "angle_1": run.drive_angles[:, 0],
        "angle_2": run.drive_angles[:, 1],
    }


def _twist(settings: DifferentialSettings, found: Differential) -> Picture:
    """Half the twist of both drives against each other, independent of the load angle, over the preload."""
    columns, gears = _columns(found), found.rig.gears
    rotors = [columns[f"angle_{k + 1}"] / (gears.pre_reductions[k] * gears.angle_map[k]) for k in (0, 1)]
    preload = 0.5 * (gears.torque_map[1] * columns["torque_2"] - gears.torque_map[0] * columns["torque_1"])
    samples = round(settings.visit / settings.sample_time)
    two = slice(2 * samples, 4 * samples, max(samples // 500, 1))
    twist = 0.5 * (rotors[1] - rotors[0])
    return Picture(
        caption="Two visits of one machine: the rotors against each other over the preload, by the motors' encoders. "
        "The step is the backlash, the slope the stiffness, the width of the loops friction that grows with the load.",
        x="preload [N m]",
        y="half the difference of the rotors [rad]",
        curves=[Curve(name="rotors", colour=AFTER, x=preload[two], y=twist[two] - np.mean(twist))],
    )


def _errors(settings: DifferentialSettings, found: Differential) -> Picture:
    curves = []
    for k, bits in enumerate(settings.bits):
        cases = [case for case in found.cases if case.bits == bits]
        log_backlash = np.log10([case.gap / ARCMIN for case in cases])
        colour = COLOURS[k % len(COLOURS)]
        std = np.log10([100.0 * case.std for case in cases])
        error = np.log10([max(100.0 * abs(case.error), 1e-4) for case in cases])
        curves.append(Curve(name=f"{bits:g} bits, standard error", colour=colour, x=log_backlash, y=std))
        curves.append(Curve(name=f"{bits:g} bits, error", colour=colour, x=log_backlash, y=error, points=True))
    return Picture(
        caption="Error of the backlash and its standard error, in powers of ten.",
        x="log10 of the backlash [arcmin]",
        y="log10 of the error [%]",
        curves=curves,
    )


def _friction(found: Differential, preloads: Array, moving: dict[str, Array]) -> Picture:
    line = np.linspace(0.0, float(np.max(preloads)), 2)
    friction = moving["coulomb_friction.torque"]
    return Picture(
        caption="Dry friction under preload: measured by moving the load, and predicted without moving it.",
        x="preload [N m]",
        y="friction [N m]",
        curves=[
            Curve(name="differential mode", colour=AFTER, x=line, y=found.friction(line)),
            Curve(name="common mode", colour=BEFORE, x=preloads, y=friction, points=True),
        ],
    )


def _list(values: Array, form: str = ".3f") -> str:
    return ", ".join(format(value, form) for value in values)
