"""Section 4 of the paper: three torque steps, three steady speeds, and an alpha that is wrong by a factor of 100.

The table's "average angles in degrees" are angles at one instant in radians, and its "steady" state still accelerates.
Each error is removed separately, then both; and alpha is estimated from the same data.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from antidrive.chart import AFTER, BEFORE, SECOND
from antidrive.experiments.outcome import Array, Curve, Outcome, Picture
from antidrive.experiments.settings import need_positive, need_samples
from identification.fit import fit
from identification.log import Log
from plant.effects import DeadZone
from plant.errors import BadParameter
from plant.servo import ServoModel
from plant.simulation import simulate


@dataclass(frozen=True, kw_only=True)
class ThreeStepsSettings:
    """Equation (6), the paper's table, and its conditions.

    Attributes:
        title: for users.
        inertia, gravity, viscous_friction: J, alpha, K of eq. (6) [kg m^2], [N m], [N m s/rad].
        dead_zone: gamma of eq. (6) [N m].
        torques: (3,) of the steps [N m].
        printed_speeds, printed_angles: (3,) the table: speeds [rad/s], and angles as printed, "deg".
        instant: time of the table's values [s].
        duration, sample_time: of the experiment [s].
        noise: of the angle in our fit, standard deviation [rad].
    """

    title: str
    inertia: float
    gravity: float
    viscous_friction: float
    dead_zone: float
    torques: tuple[float, ...]
    printed_speeds: tuple[float, ...]
    printed_angles: tuple[float, ...]
    instant: float
    duration: float
    sample_time: float
    noise: float

    def __post_init__(self) -> None:
        """Check the settings that the model does not check."""
        need_positive(self, "duration", "sample_time", "torques")
        need_samples(self.duration, self.sample_time)
        if not len(self.torques) == len(self.printed_speeds) == len(self.printed_angles) == 3:
            raise BadParameter("torques, printed_speeds and printed_angles must have three numbers each.")
        if not self.sample_time <= self.instant <= self.duration:
            raise BadParameter(f"instant = {self.instant:g} s must lie within the duration.")
        self.model()

    def model(self) -> ServoModel:
        """Equation (6)."""
        effects = (DeadZone(half_width=self.dead_zone),)
        return ServoModel(
            inertia=self.inertia, gravity=self.gravity, viscous_friction=self.viscous_friction, effects=effects
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class ThreeSteps:
    """Results. A solution is (alpha, K, gamma) [N m], [N m s/rad], [N m].

    Attributes:
        time: (T,) [s].
        angle, speed: (T, 3) [rad], [rad/s].
        angles, speeds: (3,) at the instant of the table.
        inertia_torque: (3,) J x'' at that instant [N m].
        printed: solution of eq. (8) from the paper's own table.
        in_radians: with the angles in radians.
        not_steady: with J x'' included, but the angles in degrees.
        both: with radians and J x''.
        table_fit: solution, and instant [s], with the best fit to the six printed numbers.
        table_std: (4,) its standard deviations.
        ours, ours_std: fit to the three trajectories with noise.
        speeds_agree_at: (K,) times [s] at which all three speeds round to the printed ones.
    """

    time: Array
    angle: Array
    speed: Array
    angles: Array
    speeds: Array
    inertia_torque: Array
    printed: Array
    in_radians: Array
    not_steady: Array
    both: Array
    table_fit: Array
    table_std: Array
    ours: Array
    ours_std: Array
    speeds_agree_at: Array


def experiment(settings: ThreeStepsSettings, seed: int) -> ThreeSteps:
    """Simulate eq. (6) from rest at angle zero and solve eq. (8) in all variants."""
    torques, printed_speeds = np.array(settings.torques), np.array(settings.printed_speeds)
    shown = np.array(settings.printed_angles)
    time, angle, speed = _motion(settings.model(), settings)
    row = round(settings.instant / settings.sample_time)
    x, v = angle[row], speed[row]
    torque = torques - settings.dead_zone - settings.viscous_friction * v - settings.gravity * np.cos(x)
    fitted, std = _table_fit(settings)
    ours, ours_std = _trajectory_fit(settings, time, angle, seed)
    agree = np.all(np.abs(speed - printed_speeds) < 0.005, axis=1)
    return ThreeSteps(
        time=time,
        angle=angle,
        speed=speed,
        angles=x,
        speeds=v,
        inertia_torque=torque,
        printed=_solved(torques, printed_speeds, np.cos(np.radians(shown))),
        in_radians=_solved(torques, v, np.cos(x)),
        not_steady=_solved(torques - torque, v, np.cos(np.radians(x))),
        both=_solved(torques - torque, v, np.cos(x)),
        table_fit=fitted,
        table_std=std,
        ours=ours,
        ours_std=ours_std,
        speeds_agree_at=time[agree],
    )


def _solved(torques: Array, speed: Array, cosine: Array) -> Array:
    """(alpha, K, gamma) of eq. (8), tau = K omega + gamma + alpha cos x."""
    return np.asarray(np.linalg.solve(np.column_stack((cosine, speed, np.ones(3))), torques))


def _motion(model: ServoModel, settings: ThreeStepsSettings) -> tuple[Array, Array, Array]:
    """Time (T,), angles (T, 3) and speeds (T, 3), each torque from rest at angle zero."""
    count = round(settings.duration / settings.sample_time) + 1
    runs = [
        simulate(model, command=np.full(count, torque), dt=settings.sample_time, substeps=2)[:-1]
        for torque in settings.torques
    ]
    motion = np.stack(runs, axis=1)
    return np.arange(count, dtype=np.float64) * settings.sample_time, motion[:, :, 0], motion[:, :, 1]


def _table_fit(settings: ThreeStepsSettings) -> tuple[Array, Array]:
    """(alpha, K, gamma, instant) from the six printed numbers only, J known, from rest; with standard deviations.

    Tolerances are half the last digit for angles and 0.02 rad/s for speeds: with a smaller one the speeds agree with no
    instant of the angles.
    """
    size = np.concatenate(([_digit(a) for a in settings.printed_angles], np.full(3, 0.02)))
    printed = np.concatenate((settings.printed_angles, settings.printed_speeds))

    def misses(p: Array) -> Array:
        alpha, friction, half_width, instant = p
        tried = ServoModel(
            inertia=settings.inertia,
            gravity=alpha,
            viscous_friction=friction,
            effects=(DeadZone(half_width=max(half_width, 0.0)),),
        )
        steps = round(settings.instant / settings.sample_time)
        commands = (np.full(steps, torque) for torque in settings.torques)
        ends = [simulate(tried, command=c, dt=instant / steps, substeps=1)[-1] for c in commands]
        return np.asarray((np.array(ends).T.ravel() - printed) / size)

    start = [*_solved(np.array(settings.torques), printed[3:], np.cos(np.radians(printed[:3]))), settings.instant]
    found = least_squares(misses, start, x_scale=[0.1, 0.01, 0.1, 0.1], diff_step=np.full(4, 1e-5))
    slopes = np.asarray(found.jac, dtype=np.float64)
    return found.x, np.sqrt(np.diag(np.linalg.inv(slopes.T @ slopes)))


def _digit(number: float) -> float:
    """Half of the last printed digit."""
    return 0.5 * 10.0 ** -len(repr(number).partition(".")[2])


def _trajectory_fit(settings: ThreeStepsSettings, time: Array, angle: Array, seed: int) -> tuple[Array, Array]:
    """(alpha, K, gamma) and their standard deviations from the angles of all three runs, with noise."""
    measured = angle + settings.noise * np.random.default_rng(seed).standard_normal(angle.shape)
    logs = [
        Log.from_arrays(label=f"{torque:g} N m", time=time, torque=np.full(time.size, torque), angle=measured[:, k])
        for k, torque in enumerate(settings.torques)
    ]
    found = fit(Log.merge(logs))
    lines = [found[name] for name in ("gravity", "viscous_friction", "dead_zone.half_width")]
    return tuple(  # type: ignore[return-value]
        np.array([np.nan if value is None else value for value in values])
        for values in ([line.value for line in lines], [line.std for line in lines])
    )


def run(settings: ThreeStepsSettings, seed: int) -> Outcome:
    """Repeat section 4 and report it."""
    found = experiment(settings, seed)
    ripple = np.sqrt(2.0) * np.std(found.speed[found.time > 0.7 * settings.duration], axis=0)
    alpha, instant = found.table_fit[0], found.table_fit[3]
    rows = [
        *((f"angle {k + 1}", f"{settings.printed_angles[k]:g} “deg”", f"{found.angles[k]:.2f} rad") for k in range(3)),
        *((f"speed {k + 1} [rad/s]", f"{settings.printed_speeds[k]:g}", f"{found.speeds[k]:.3f}") for k in range(3)),
        *(
            (f"{name}: alpha, K, gamma", "0.0047, 0.8, 0.47" if name.startswith("eq. (8)") else "", _list(values))
            for name, values in (
                ("eq. (8), the paper's table", found.printed),
                ("the angles in radians", found.in_radians),
                ("J x'' taken along", found.not_steady),
                ("both", found.both),
                ("fit to the six printed numbers", found.table_fit[:3]),
                ("fit to the trajectories", found.ours),
            )
        ),
    ]
    moments = found.speeds_agree_at
    nearest = moments[np.argmin(np.abs(moments - settings.instant), keepdims=True)] if moments.size else moments
    agreeing = "".join(f"; they round to the printed ones at {moment:.2f} s" for moment in nearest)
    names = [f"{torque:g} N m" for torque in settings.torques]
    late = found.time > 0.7 * settings.duration
    return Outcome(
        title=settings.title,
        results=(
            f"Equation (6), from rest at angle zero, has at {settings.instant:g} s the angles "
            f"{_list(found.angles, '.2f')} rad: the digits of the paper's “average angles in degrees”. The speeds "
            f"there are {_list(found.speeds, '.3f')} rad/s, within "
            f"{np.max(np.abs(found.speeds - settings.printed_speeds)):.2f} rad/s of the table{agreeing}.",
            f"From its own table eq. (8) gives the paper alpha = {found.printed[0]:.4f} N m for {settings.gravity:g}. "
            f"Two errors explain that. Angles in radians were taken for degrees: with radians alone alpha is "
            f"{found.in_radians[0]:.4f}. And the load still accelerates; J x'' is "
            f"{_list(found.inertia_torque, '+.3f')} N m, which eq. (8) leaves out: with it alone "
            f"alpha is {found.not_steady[0]:.4f}, with both {found.both[0]:.6f}.",
            f"A fit to the same six numbers is possible: the alpha, K, gamma and instant whose motion comes nearest to "
            f"them are {_list(found.table_fit[:3])} and {instant:.2f} s, alpha to {found.table_std[0]:.2f}. The ripple "
            f"of the speed, {_list(ripple, '.3f')} rad/s, holds the rest: fitted to the three trajectories with "
            f"{settings.noise:g} rad of noise, alpha is {found.ours[0]:.4f} +- {found.ours_std[0]:.4f}.",
        ),
        comparison=rows,
        found={
            "angles": found.angles.tolist(),
            "speeds": found.speeds.tolist(),
            "inertia_torques": found.inertia_torque.tolist(),
            "ripple": ripple.tolist(),
            "paper": _named(found.printed),
            "angles_in_radians": _named(found.in_radians),
            "inertia_torque_taken_along": _named(found.not_steady),
            "both": _named(found.both),
            "fit_to_the_table": {**_named(found.table_fit), "instant": float(instant), "alpha_std": found.table_std[0]},
            "fit_to_the_trajectories": {**_named(found.ours), "alpha_std": found.ours_std[0]},
            "alpha_of_table_over_paper": float(alpha / found.printed[0]),
        },
        columns={
            "time": found.time,
            **{f"angle_{k + 1}": found.angle[:, k] for k in range(3)},
            **{f"velocity_{k + 1}": found.speed[:, k] for k in range(3)},
        },
        pictures=(
            Picture(
                caption="The speeds from rest.",
                x="time [s]",
                y="speed [rad/s]",
                curves=[
                    Curve(name=name, colour=colour, x=found.time, y=found.speed[:, k])
                    for k, (name, colour) in enumerate(zip(names, (BEFORE, AFTER, SECOND), strict=True))
                ],
            ),
            Picture(
                caption="Late in the runs: speed less its mean. It is not steady, and its ripple is alpha.",
                x="time [s]",
                y="speed less mean [rad/s]",
                curves=[
                    Curve(name=name, colour=colour, x=found.time[late], y=_centred(found.speed[late, k]))
                    for k, (name, colour) in enumerate(zip(names, (BEFORE, AFTER, SECOND), strict=True))
                ],
            ),
        ),
    )


def _centred(values: Array) -> Array:
    return np.asarray(values - np.mean(values))


def _list(values: Array, form: str = ".4f") -> str:
    return ", ".join(format(value, form) for value in values)


def _named(values: Array) -> dict[str, float]:
    return dict(zip(("alpha", "K", "gamma"), (float(value) for value in values), strict=False))
