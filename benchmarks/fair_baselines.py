"""Errors of least squares on the public logs, in the measure that a diagnosis reports.

    python benchmarks/fair_baselines.py FOLDER

FOLDER holds the folders emps and ur10e. The torque of the fitted part is regressed on its measured motion; the error is
that of the validation part, relative to its torque. Motion, filter and the trimmed ends are those of `antidrive
diagnose`. The sign of the velocity passes the same filter as the torque, as in the identification of robots (Gautier
1997); without that, the filter alone causes an error at each reversal. Writes results/fair_baselines.txt.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from scipy import optimize, signal

from identification.datasets import load_dataset
from identification.inverse import FilteredMotion, filtered_motion
from identification.log import Log
from plant.effects.effect import Array

Columns = Callable[[FilteredMotion, Callable[[Array], Array]], tuple[Array, ...]]  # motion, low pass -> regressors


def table(log: Log, columns: Columns, cutoff: float) -> tuple[Array, Array]:
    """(T, P) regressors and (T,) torque, with ends trimmed as in `identification.inverse.torque_error_samples`."""
    rows, torques = [], []
    for run in log.runs:
        m = filtered_motion(run, cutoff)
        edge = min(m.time.size // 10, int(2.0 / (cutoff * run.sample_time)))
        filter_ = signal.butter(4, cutoff, fs=1.0 / (m.time[1] - m.time[0]), output="sos")
        rows.append(np.column_stack(columns(m, partial(signal.sosfiltfilt, filter_)))[edge : m.time.size - edge])
        torques.append(m.torque[edge : m.time.size - edge])
    return np.vstack(rows), np.concatenate(torques)


def errors(fitted: Log, held_out: Log, columns: Columns) -> tuple[float, float]:
    """Relative error on the fitted part and on the validation part [%]."""
    cutoff = min(40.0, 0.1 / fitted.runs[0].sample_time)
    (rows, torque), (others, other) = (table(log, columns, cutoff) for log in (fitted, held_out))
    values = np.linalg.lstsq(rows, torque, rcond=None)[0]
    return tuple(
        100.0 * float(np.linalg.norm(y - a @ values) / np.linalg.norm(y)) for a, y in ((rows, torque), (others, other))
    )


def plain(sign_filtered: bool) -> Columns:
    """Inertia, gravity, viscous and dry friction: the textbook regression."""

    def columns(m: FilteredMotion, low_pass: Callable[[Array], Array]) -> tuple[Array, ...]:
        sign = np.sign(m.velocity)
        return (m.acceleration, np.cos(m.angle), m.velocity, low_pass(sign) if sign_filtered else sign)

    return columns


def with_drag(m: FilteredMotion, low_pass: Callable[[Array], Array]) -> tuple[Array, ...]:
    """The same, with quadratic friction over the speed."""
    return (*plain(True)(m, low_pass), m.velocity * np.abs(m.velocity))


def cart(sign_filtered: bool) -> Columns:
    """Mass, viscous and symmetric dry friction, offset."""

    def columns(m: FilteredMotion, low_pass: Callable[[Array], Array]) -> tuple[Array, ...]:
        sign = np.sign(m.velocity)
        return (m.acceleration, m.velocity, low_pass(sign) if sign_filtered else sign, np.ones(m.time.size))

    return columns


def asymmetric(m: FilteredMotion, low_pass: Callable[[Array], Array]) -> tuple[Array, ...]:
    """Mass, and viscous and dry friction of each direction."""
    forward = (m.velocity > 0.0).astype(float)
    backward = 1.0 - forward
    return (m.acceleration, m.velocity * forward, m.velocity * backward, low_pass(forward), low_pass(backward))


def with_presliding(give: float) -> Columns:
    """The same, with one element that deforms by `give` [m] before it slides (elastic-plastic)."""

    def columns(m: FilteredMotion, low_pass: Callable[[Array], Array]) -> tuple[Array, ...]:
        stretch = np.zeros(m.time.size)
        for k, way in enumerate(np.diff(m.angle), start=1):
            stretch[k] = min(max(stretch[k - 1] + way / give, -1.0), 1.0)
        return (*asymmetric(m, low_pass), low_pass(stretch))

    return columns


def best_give(fitted: Log) -> float:
    """The deformation of the element with the least error on the fitted part [m]."""
    found = optimize.minimize_scalar(
        lambda log_give: errors(fitted, fitted, with_presliding(float(np.exp(log_give))))[0],
        bounds=(np.log(1e-6), np.log(1e-3)),
        method="bounded",
        options={"xatol": 0.05},
    )
    return float(np.exp(found.x))


def main() -> None:
    folder = Path(sys.argv[1])
    lines = ["Relative error of the inverse model by least squares [%]: fitted, held out", ""]

    def tell(name: str, fitted: Log, held_out: Log, columns: Columns) -> None:
        lines.append("{:76}{:6.2f}{:7.2f}".format(name, *errors(fitted, held_out, columns)))
        print(lines[-1], flush=True)

    emps = load_dataset("emps", folder / "emps")
    cases = [
        ("symmetric dry friction and offset, sign not filtered", cart(False)),
        ("symmetric dry friction and offset", cart(True)),
        ("asymmetric friction", asymmetric),
    ]
    give = best_give(emps.estimation)
    cases.append((f"asymmetric friction and one presliding element ({1e6 * give:.0f} µm)", with_presliding(give)))
    for name, columns in cases:
        tell(f"emps: {name}", emps.estimation, emps.holdout, columns)
    for joint in (1, 2, 3):
        arm = load_dataset("ur10e", folder / "ur10e", joint=joint)
        for name, columns in (
            ("dry friction, sign not filtered", plain(False)),
            ("dry friction", plain(True)),
            ("dry friction and quadratic drag", with_drag),
        ):
            tell(f"ur10e, joint {joint}: {name}", arm.estimation, arm.holdout, columns)
    (Path(__file__).parent / "results" / "fair_baselines.txt").write_text("\n".join([*lines, ""]))


if __name__ == "__main__":
    main()
