"""A quick friction test: torque over speed from a staircase of speeds or slow sweeps, without a simulation.

The log is cut into windows. Over a window mean torque = J times the change of the velocity over its length + mean
friction + mean gravity, exactly; `identification.friction_regression` selects the terms.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.hierarchy import fcluster, linkage

from identification.errors import Unidentifiable
from identification.friction_regression import best_of, candidates, refined
from identification.friction_windows import friction_windows, kept_of
from identification.log import Log
from identification.log_like import LogLike, log_of
from plant.effects import CoulombFriction, Effect, GravityOffset, StribeckFriction, TorqueOffset
from plant.effects.effect import Array
from plant.result_display import Drawn
from plant.servo import ServoModel
from plant.uncertain_number import measured

if TYPE_CHECKING:
    import pandas as pd

_GROUPS = 24  # groups of windows over the whole range of velocities
_WIDTH = 0.2  # of its speed: largest width of a group
_MOST = (0.02, 0.98)  # quantiles of the speeds that must be further apart than
_APART = 6.0  # standard errors
_SIGNIFICANT = 3.0  # standard errors from which friction is visible, or negative
_MEANINGS = {
    "coulomb": "Coulomb friction F_c",
    "viscous": "Viscous friction K",
    "excess": "Stribeck friction F_s - F_c",
    "stribeck_velocity": "Stribeck velocity v_s",
    "offset": "Offset of the torque",
    "inertia": "Inertia J",
    "gravity": "Gravity torque alpha",
    "gravity_quadrature": "Gravity torque beta, in quadrature",
}
_NOT_FRICTION = ("inertia", "gravity", "gravity_quadrature")


@dataclass(frozen=True, kw_only=True, eq=False)
class FrictionTest(Drawn):
    """Friction over speed.

    Attributes:
        values, std, units: by name: `coulomb`, `viscous`, and if the log determines them `offset`,
            `excess` and `stribeck_velocity`, `inertia`, `gravity`, `gravity_quadrature`.
        velocity: (G,) mean of each group of windows with about the same speed [rad/s].
        torque: (G,) its friction and offset [N m], and `error` its standard error.
        windows: (G,) number of windows in the group.
        residual: rms of the residual torque of a window [N m].
        one_way: whether the load moved in one direction only, so that the offset is part of `coulomb`.
        log: the tested log.
    """

    values: dict[str, float]
    std: dict[str, float]
    units: dict[str, str]
    velocity: Array
    torque: Array
    error: Array
    windows: NDArray[np.float64]
    residual: float
    one_way: bool
    log: Log

    def curve(self, velocity: Array) -> Array:
        """Friction and offset at velocities [rad/s] -> [N m]."""
        v, found = np.asarray(velocity, dtype=float), self.values
        hump = found.get("excess", 0.0) * np.exp(-((v / found.get("stribeck_velocity", 1.0)) ** 2))
        level = np.sign(v) * (found["coulomb"] + hump)
        return np.asarray(level + found["viscous"] * v + found.get("offset", 0.0))

    @property
    def negative(self) -> bool:
        """Whether Coulomb or viscous friction is negative beyond its error, as if friction drove the load."""
        return any(self.values[name] < -_SIGNIFICANT * self.std[name] for name in ("coulomb", "viscous"))

    @property
    def model(self) -> ServoModel | None:
        """A servo with this friction; None if it is negative, or the log does not determine the inertia."""
        found = self.values
        if self.negative or "inertia" not in found or found["inertia"] < 2.0 * self.std["inertia"]:
            return None
        dry, effects = max(found["coulomb"], 0.0), list[Effect]()
        if "excess" in found:
            effects.append(StribeckFriction(coulomb=dry, excess=found["excess"], velocity=found["stribeck_velocity"]))
        elif dry > 0.0:
            effects.append(CoulombFriction(torque=dry))
        if "offset" in found:
            effects.append(TorqueOffset(torque=-found["offset"]))
        if "gravity_quadrature" in found:
            effects.append(GravityOffset(beta=found["gravity_quadrature"]))
        return ServoModel(
            inertia=found["inertia"],
            gravity=found.get("gravity", 0.0),
            viscous_friction=max(found["viscous"], 0.0),
            effects=tuple(effects),
            axis=self.log.axis,
            torque_unit=self.log.command_unit,
        )

    def model_std(self) -> dict[str, float]:
        """Standard errors of the parameters of `model`, by their names there."""
        names = {
            "inertia": "inertia",
            "gravity": "gravity",
            "viscous": "viscous_friction",
            "coulomb": "stribeck_friction.coulomb" if "excess" in self.values else "coulomb_friction.torque",
            "excess": "stribeck_friction.excess",
            "stribeck_velocity": "stribeck_friction.velocity",
            "offset": "torque_offset.torque",
            "gravity_quadrature": "gravity_offset.beta",
        }
        return {names[name]: error for name, error in self.std.items()}

    def sentences(self) -> list[str]:
        """The results, one per line."""
        found, lines = self.values, []
        for name, meaning in _MEANINGS.items():
            if name in found:
                more = " (with the offset: the load moves one way only)" if name == "coulomb" and self.one_way else ""
                lines.append(f"{meaning}: {measured(found[name], self.std.get(name), self.units[name])}{more}")
        if self.negative:
            lines.append("The friction is negative. Check that torque and angle belong together, and their signs.")
        elif found["coulomb"] < _SIGNIFICANT * self.std["coulomb"]:
            lines.append("No Coulomb friction is visible.")
        if "excess" not in found:
            slowest = float(np.min(np.abs(self.velocity)))
            lines.append(f"No Stribeck friction is visible; the slowest speed is {slowest:.3g} {self.units['speed']}.")
        lines.append(f"The torque of a window is fitted within {self.residual:.2g} {self.log.command_unit} rms.")
        return lines

    def to_frame(self) -> pd.DataFrame:
        """The groups: velocity, torque, error, windows, and the curve at the velocity."""
        import pandas as pd

        columns = {"velocity": self.velocity, "torque": self.torque, "error": self.error, "windows": self.windows}
        return pd.DataFrame({**columns, "curve": self.curve(self.velocity)})

    def __str__(self) -> str:
        """The sentences."""
        return "\n".join(self.sentences())

    def to_dict(self) -> dict[str, Any]:
        """The content of friction.json."""
        return {
            "schema": 1,
            "parameters": {
                name: {"value": value, "std": self.std.get(name), "unit": self.units[name]}
                for name, value in self.values.items()
            },
            "residual_rms": self.residual,
            "one_way": self.one_way,
            "source": [{"file": s.file, "sha256": s.sha256} for s in self.log.sources],
        }


def friction_test(log: LogLike) -> FrictionTest:
    """Friction from a log in which the load moves at several speeds, in steps or in slow sweeps.

    Raises:
        Unidentifiable: the load does not move, or moves at one speed only.
    """
    log = log_of(log)
    rows = friction_windows(log)
    speed = np.abs(rows["velocity"])
    if speed.size < 2 or np.ptp(np.quantile(speed, _MOST)) <= _APART * np.median(rows["velocity_error"]):
        raise Unidentifiable("The load moves at one speed at most; record several speeds, slow and fast, both ways.")
    moving = rows["velocity"][speed > np.ptp(rows["velocity"]) / _GROUPS]
    one_way = not (np.any(moving > 0.0) and np.any(moving < 0.0))
    if one_way:
        rows = kept_of(rows, np.sign(rows["velocity"]) == np.sign(moving[0]))
    places = _groups(rows["velocity"])
    best = refined(best_of(list(candidates(rows, one_way, log.axis == "rotary"))), rows)
    friction = rows["torque"] - sum(
        (best.values[name] * best.columns[name] for name in best.values if name in _NOT_FRICTION), start=0.0
    )
    counts = np.bincount(places).astype(float)
    mean = {name: np.bincount(places, values) / counts for name, values in (("v", rows["velocity"]), ("t", friction))}
    scatter = np.bincount(places, (friction - mean["t"][places]) ** 2) / np.maximum(counts - 1, 1)
    error = np.sqrt(np.where(counts > 1, scatter, best.residual**2) / counts)
    order = np.argsort(mean["v"])
    units = _units(log)
    return FrictionTest(
        values=best.values,
        std=best.std,
        units=units,
        velocity=mean["v"][order],
        torque=mean["t"][order],
        error=error[order],
        windows=counts[order],
        residual=best.residual,
        one_way=one_way,
        log=log,
    )


def _units(log: Log) -> dict[str, str]:
    torque, length = log.command_unit, "rad" if log.axis == "rotary" else "m"
    speed = ServoModel(axis=log.axis, gravity=0.0, torque_unit=torque).parameters
    units = {spec.name: spec.unit for spec in speed}
    strengths = dict.fromkeys(("coulomb", "offset", "excess", "gravity", "gravity_quadrature"), torque)
    return {
        **strengths,
        "viscous": units["viscous_friction"],
        "inertia": units["inertia"],
        "stribeck_velocity": f"{length}/s",
        "speed": f"{length}/s",
    }


def _groups(velocity: Array) -> NDArray[np.intp]:
    """(W,) the group of each window: the width of a group is limited by the range of velocities and by its own speed.

    The second limit separates slow speeds, at which friction changes most.
    """
    if velocity.size < 2:
        return np.zeros(velocity.size, dtype=np.intp)
    speed = np.abs(velocity)
    width = max(np.ptp(velocity) / _GROUPS, np.finfo(float).tiny)
    knee = width / _WIDTH  # above it the first limit applies
    place = np.where(speed > knee, speed / width, (1.0 + np.log(np.minimum(speed, knee) / knee)) / _WIDTH)
    apart = np.sign(velocity) * (place - place.min() + 1.0)
    return np.asarray(fcluster(linkage(apart[:, None], "complete"), 1.0, "distance"), dtype=np.intp) - 1
