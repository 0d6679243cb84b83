"""Tables for drives: friction over velocity, cogging and position error over the angle, dead zone over the torque."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from plant.effects import Cogging, DeadZone, Effect, EncoderEccentricity, Stage, TorqueOffset
from plant.effects.effect import TURN, Array
from plant.effects.ripple import HARMONICS, Ripple
from plant.errors import BadParameter
from plant.inverse import moving, strength, torque_unit
from plant.model_file import ModelLike, model_of
from plant.number import finite, whole
from plant.result_display import Drawn
from plant.servo import ServoModel

if TYPE_CHECKING:
    import pandas as pd

_MOST_POINTS = 1_000_000
_FINER = 16  # intermediate points between two table points, for the interpolation error
_NARROW = 300  # places on each side of zero, closer to each other toward it
_WHOLE = 1e-3  # tolerance of a whole number of periods
_ROUNDS = 50  # iterations for the true angle; each reduces the error by the slope of the position error
_DEAD_ZONES = 10.0  # half widths that the table of a dead zone covers on each side

Parts: TypeAlias = dict[str, Callable[[Array], Array]]
Waves: TypeAlias = tuple[tuple[float, float, float], ...]
"""For each sine its order n, amplitude A and phase p: A sin(n x + p)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DriveTable(Drawn):
    """A table of points, interpolated linearly by a drive.

    Attributes:
        kind: one of `KINDS`.
        columns: by name, (points,) values: first the variable, last the result, between them its components.
        units: unit of each column.
        meaning: meaning of the last column, in a sentence.
        notes: remarks, a sentence each.
        harmonics: the sines in the result. That of a position error is over the true angle.
        largest_error: of linear interpolation between the points, in the unit of the last column.
    """

    kind: str
    columns: Mapping[str, Array]
    units: Mapping[str, str]
    meaning: str
    notes: tuple[str, ...]
    harmonics: Waves
    largest_error: float

    @property
    def points(self) -> int:
        """Number of rows."""
        return len(next(iter(self.columns.values())))

    @property
    def ends(self) -> tuple[str, str]:
        """Names of the variable and of the result."""
        names = list(self.columns)
        return names[0], names[-1]

    def __repr__(self) -> str:
        """Kind, number of points, and meaning of the last column, in one line."""
        return f"DriveTable({self.kind}, {self.points} points; {self.ends[1]}: {self.meaning})"

    def to_frame(self) -> pd.DataFrame:
        """The columns as a table; `attrs["units"]` has their units."""
        import pandas as pd

        frame = pd.DataFrame(dict(self.columns))
        frame.attrs["units"] = dict(self.units)
        return frame


def drive_table(
    model: ModelLike, kind: str, *, points: int = 64, reach: tuple[float, float] | None = None
) -> DriveTable:
    """A table of what a drive has to compensate.

    Args:
        model: the servo, its model file, or the path of one.
        kind: "friction" over velocity: torque to add in steady motion; "cogging" and "gravity" over the angle: torque
            to add; "position-error" over the measured angle: error of the measurement; "dead-zone" over the torque to
            be delivered: command for it.
        points: number of rows.
        reach: first and last value of the variable. By default a turn of the load per second in both directions, one
            turn of the load without its end (on a linear axis one period), and ten half widths of the dead zone.

    Raises:
        BadParameter: the model has no such effect, or the points do not suffice for its periods.
        BadModelFile: a file that cannot be used.
    """
    if not isinstance(kind, str) or kind not in KINDS:
        raise BadParameter(f"There is no table {kind!r}; there are {', '.join(KINDS)}.")
    rows = whole(points)
    if rows is None or not 2 <= rows <= _MOST_POINTS:
        raise BadParameter(f"A table has between 2 and {_MOST_POINTS} points, a whole number, not {points!r}.")
    _check_reach(reach)
    model = model_of(model).without_clock()
    variable, parts, notes = KINDS[kind](model)
    effects = [effect for effect in model.effects if effect.name in parts]
    waves = tuple(wave if kind == "position-error" else _opposite(wave) for e in effects for wave in harmonics(e))
    low, high = reach if reach is not None else _usual(model, kind, waves)
    _enough(points, low, high, waves)
    whole_turn = reach is None and bool(waves)
    if whole_turn and any(
        abs(_periods(order, low, high) - round(_periods(order, low, high))) > 1e-3 for order, *_ in waves
    ):
        notes.append("It is not a whole number of periods, so its end does not meet its beginning.")
    at = np.linspace(low, high, points, endpoint=not whole_turn)
    if kind in ("friction", "gravity"):
        notes += _offset(model)
    error, jumps = _line_error(parts, at)
    if jumps:
        notes.append("It jumps at zero. On each side extrapolate linearly to zero.")
    shares = {name: part(at) for name, part in parts.items()} if len(parts) > 1 else {}
    motion, unit = moving(model), torque_unit(model)
    place, result = next(iter(motion)), _RESULTS.get(kind, strength(model))
    columns = {variable: at, **shares, result: _together(parts, at)}
    of_result = motion[place] if kind == "position-error" else unit
    return DriveTable(
        kind=kind,
        columns=columns,
        units={**dict.fromkeys(columns, of_result), variable: {**motion, strength(model): unit}[variable]},
        meaning=_MEANINGS[kind].format(torque=strength(model), place=f"{'an' if place == 'angle' else 'a'} {place}"),
        notes=tuple(notes),
        harmonics=waves,
        largest_error=error,
    )


def _check_reach(reach: object) -> None:
    if reach is None:
        return
    given = list(reach) if isinstance(reach, tuple | list | np.ndarray) else []
    ends = [number for number in map(finite, given) if number is not None]
    if not len(given) == len(ends) == 2:
        raise BadParameter(f"reach: give the first and the last value, such as (-5.0, 5.0), not {reach!r}.")
    if not ends[0] < ends[1]:
        raise BadParameter(f"A table goes from a lower to a higher value, not from {ends[0]:g} to {ends[1]:g}.")


def _periods(order: float, low: float, high: float) -> float:
    return order * (high - low) / TURN


def _enough(points: int, low: float, high: float, waves: Waves) -> None:
    most = max((_periods(order, low, high) for order, *_ in waves), default=0.0)
    if points <= 2.0 * most:
        raise BadParameter(
            f"{points} points are too few for {most:.4g} period{'s' * (most != 1.0)} from {low:.4g} to {high:.4g}; "
            f"give {int(np.ceil(8.0 * most))} or more."
        )


def _together(parts: Parts, at: Array) -> Array:
    return np.asarray(np.sum([part(at) for part in parts.values()], axis=0))


def _line_error(parts: Parts, at: Array) -> tuple[float, bool]:
    """Largest error of linear interpolation, and whether there is a jump at zero, which is then excluded from it."""
    narrow = np.geomspace(1e-6, 1.0, _NARROW) * (at[-1] - at[0])  # a Stribeck peak may be narrower than a step
    fine = np.unique(np.concatenate((np.linspace(at[0], at[-1], _FINER * (at.size - 1) + 1), narrow, -narrow)))
    fine = fine[(fine >= at[0]) & (fine <= at[-1])]
    beside = 1e-9 * (at[-1] - at[0]) * np.array([-1.0, 1.0])
    whole, points, step = (_together(parts, place) for place in (fine, at, beside))
    drawn = np.interp(fine, at, points)
    jumps = bool(at[0] < 0.0 < at[-1] and abs(np.diff(step)[0]) > 1e-6 * np.max(np.abs(whole)))
    if jumps:
        for side in (-1.0, 1.0):
            nearest = np.argsort(np.where(side * at > 0.0, side * at, np.inf))[: min(2, int(np.sum(side * at > 0.0)))]
            line = np.polyfit(at[nearest], points[nearest], nearest.size - 1)
            between = (side * fine > 0.0) & (side * fine < side * at[nearest[0]])
            drawn[between] = np.polyval(line, fine[between])
        drawn[fine == 0.0] = whole[fine == 0.0]
    return float(np.max(np.abs(whole - drawn))), jumps


def harmonics(effect: Effect) -> list[tuple[float, float, float]]:
    """The sines of a periodic effect: order n, amplitude A and phase p of A sin(n x + p)."""
    if isinstance(effect, Cogging | EncoderEccentricity):
        return [(effect.order, effect.amplitude, effect.phase)]
    if isinstance(effect, Ripple):
        sines, cosines = effect.values[1::2], effect.values[2::2]
        orders = [k * effect.rate for k in range(1, HARMONICS + 1)]
        found = zip(orders, np.hypot(sines, cosines), np.arctan2(cosines, sines), strict=True)
        return [(order, float(size), float(phase)) for order, size, phase in found if size > 0.0]
    return []


def _opposite(wave: tuple[float, float, float]) -> tuple[float, float, float]:
    """The wave that cancels it, with a phase from -pi to pi."""
    order, amplitude, phase = wave
    return order, amplitude, float(np.angle(-np.exp(1j * phase)))


def _usual(model: ServoModel, kind: str, waves: Waves) -> tuple[float, float]:
    if kind == "friction":
        return (-TURN, TURN) if model.axis == "rotary" else (-1.0, 1.0)
    if kind == "dead-zone":
        zone = model.effect("dead_zone")
        width = zone.half_width if isinstance(zone, DeadZone) else 0.0
        return -_DEAD_ZONES * width, _DEAD_ZONES * width
    if model.axis == "linear" and waves:
        return 0.0, TURN / min(order for order, _, _ in waves)
    return 0.0, TURN if model.axis == "rotary" else 1.0


def _friction(model: ServoModel) -> tuple[str, Parts, list[str]]:
    """Friction torque in steady motion, without the load-dependent part."""
    parts: Parts = {"viscous_friction": lambda v: model.viscous_friction * v}
    notes = []
    for effect in model.effects:
        steady = [one for one in (effect, *(effect.reduced() if effect.states else ())) if one.curve_over == "velocity"]
        if steady:
            parts[effect.name] = steady[0].curve
        elif type(effect).dry_friction is not Effect.dry_friction:
            notes.append(f"Not in the table, since it depends on more than the velocity: {effect.title}.")
    return "velocity", parts, notes


def _over_angle(model: ServoModel, *, periodic: bool) -> Parts:
    return {
        effect.name: lambda x, effect=effect: -effect.curve(x)  # type: ignore[misc]
        for effect in model.effects
        if effect.curve_over == "angle" and effect.stage is not Stage.SENSOR and effect.periodic is periodic
    }


def _cogging(model: ServoModel) -> tuple[str, Parts, list[str]]:
    parts = _over_angle(model, periodic=True)
    return next(iter(moving(model))), _some(model, parts, "cogging"), []


def _gravity(model: ServoModel) -> tuple[str, Parts, list[str]]:
    own: Parts = {"gravity": lambda x: model.gravity * np.cos(x)} if model.gravity else {}
    parts = own | _over_angle(model, periodic=False)
    return next(iter(moving(model))), _some(model, parts, "torque over the angle"), []


def _offset(model: ServoModel) -> list[str]:
    """A note on the torque offset, which depends on nothing and so is in no table."""
    offset = model.effect("torque_offset")
    if not isinstance(offset, TorqueOffset):
        return []
    unit = torque_unit(model)
    return [f"Not in the table: the {strength(model)} offset; the drive adds {-offset.torque:.4g} {unit} against it."]


def _position_error(model: ServoModel) -> tuple[str, Parts, list[str]]:
    """Error over the measured angle; the true angle is found by fixed-point iteration."""
    errors = [e for e in model.effects if e.curve_over == "angle" and e.stage is Stage.SENSOR]

    def true(shown: Array) -> Array:
        found = shown
        for _ in range(_ROUNDS):
            before, found = found, shown - sum(effect.curve(found) for effect in errors)
            if np.array_equal(before, found):
                break
        return found

    parts: Parts = {e.name: lambda shown, e=e: e.curve(true(shown)) for e in errors}  # type: ignore[misc]
    return next(iter(moving(model))), _some(model, parts, "position error"), []


def _dead_zone(model: ServoModel) -> tuple[str, Parts, list[str]]:
    zone = model.effect("dead_zone")
    parts: Parts = {}
    if isinstance(zone, DeadZone) and not zone.half_width:
        raise BadParameter("The dead zone of the model is zero, so the command is the torque itself.")
    if isinstance(zone, DeadZone):
        parts["dead_zone"] = lambda torque: torque + zone.half_width * np.sign(torque)
    return strength(model), _some(model, parts, "dead zone"), []


def _some(model: ServoModel, parts: Parts, what: str) -> Parts:
    if not parts:
        has = ", ".join(effect.title for effect in model.effects) or "none"
        raise BadParameter(f"The model has no {what}; its effects: {has}.")
    return parts


KINDS: Mapping[str, Callable[[ServoModel], tuple[str, Parts, list[str]]]] = {
    "friction": _friction,
    "cogging": _cogging,
    "gravity": _gravity,
    "position-error": _position_error,
    "dead-zone": _dead_zone,
}
"""The function that computes each kind of table, by its name."""

_RESULTS = {"position-error": "error", "dead-zone": "command"}
"""Name of the last column, where it is not a torque (or force)."""

_MEANINGS = {
    "friction": "what the drive adds against friction at a steady velocity",
    "cogging": "what the drive adds against cogging at {place}",
    "gravity": "what the drive adds against gravity and springs at {place}",
    "position-error": "error of the measurement; subtract it",
    "dead-zone": "command for the {torque} that shall arrive",
}
