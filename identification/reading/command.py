"""The command: the torque at the output gear, or the force, from the columns that the log has.

A current is the torque over the motor's torque constant, a voltage or a duty cycle is the torque over an unknown
constant. If the constant is unknown, every parameter is given per ampere, per volt or per unit of duty, not in newton
metres. A position servo computes its torque from the set-point: kp (setpoint - angle) - kd velocity.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from identification.errors import MalformedLog
from identification.log_columns import CURRENTS_OF_TWO, TORQUES_OF_TWO
from identification.reading.reading_options import Reading
from identification.recording import Array
from plant.errors import BadParameter

_KINDS = ("direct", "pinions", "currents", "current", "voltage", "duty", "setpoint")
"""The kinds of commands, the most direct measure of the torque first."""
_OF_TWO = {"pinions": TORQUES_OF_TWO, "currents": CURRENTS_OF_TWO}
_CONSTANT = "; give the motor's with --torque-constant"


@dataclass(frozen=True, kw_only=True, eq=False)
class Command:
    """The command of a log.

    values: (T,) torque at the output gear [N m] or force [N]; for a position servo its gain times the set-point.
    servo_gain: (T,) torque per angle of a position servo [N m/rad]; zero if the log has the torque.
    servo_damping: (T,) its torque per speed of the load [N m s/rad].
    name: name of the column in the file.
    unit: "N m", "N", or the unit of the command if its scale is unknown.
    notes: limitations of a result, such as an unknown scale.
    """

    values: Array
    servo_gain: Array
    servo_damping: Array
    name: str
    unit: str
    notes: tuple[str, ...] = ()


def command_of(
    file: str, found: Mapping[str, str], channels: Mapping[str, Array], axis: str, reading: Reading
) -> Command:
    """The command in the channels (contract column -> values) of a file.

    A column that the user mapped or gave a constant for has priority over one that only has the right name.

    Raises `MalformedLog` if the columns do not fit together, `BadParameter` for a constant without its column.
    """
    torque = "torque" if axis == "rotary" else "force"
    columns = {"direct": (torque,), **_OF_TWO}
    given = [kind for kind in _KINDS if all(column in channels for column in columns.get(kind, (kind,)))]
    _go_with(file, given, channels, reading)
    with_options = {
        kind
        for kind in given
        if any(column in reading.mapping for column in columns.get(kind, (kind,)))
        or (kind in ("current", "currents") and reading.torque_constant is not None)
        or (kind == "setpoint" and reading.kp is not None)
    }
    kind = next((kind for kind in given if kind in with_options), given[0])
    command = _of_kind(kind, file, found, channels, axis, reading)
    if reading.gears is None or set(given).intersection(_OF_TWO) or kind == "setpoint":
        return command
    note = (
        f"the gear train is not applied to '{command.name}' of {file}, only to the torques of two motors; if it is the "
        f"motor's, give --scale {torque if kind == 'direct' else kind}=RATIO"
    )
    return replace(command, notes=(*command.notes, note))


def _of_kind(
    kind: str, file: str, found: Mapping[str, str], channels: Mapping[str, Array], axis: str, reading: Reading
) -> Command:
    """The command from the columns of one kind."""
    torque, unit = ("torque", "N m") if axis == "rotary" else ("force", "N")
    if kind == "setpoint":
        return _servo(file, found, channels, axis, reading)
    if kind == "direct":
        return _plain(channels[torque], found[torque], unit)
    if kind in _OF_TWO:
        return _of_two_motors(kind, file, found, channels, unit, reading)
    if kind == "current" and reading.torque_constant is not None:
        return _plain(float(reading.torque_constant) * channels["current"], found["current"], unit)
    own = {"current": "A", "voltage": "V", "duty": "duty"}[kind]
    per = {"A": "per ampere", "V": "per volt", "duty": "per unit of duty"}[own]
    note = (
        f"torque scale unknown: the command of {file} is the {kind} '{found[kind]}', so all parameters are "
        f"{per}{_CONSTANT if own == 'A' else ''}"
    )
    return _plain(channels[kind], found[kind], own, note)


def _go_with(file: str, given: list[str], channels: Mapping[str, Array], reading: Reading) -> None:
    """Raise an error for constants and gains without their columns."""
    if reading.torque_constant is not None and not {"current", "currents"}.intersection(given):
        raise BadParameter(
            f"A torque constant is given, but {file} has no column 'current'; name it with --map current=NAME."
        )
    gains = [name for name in ("kp", "kd") if getattr(reading, name) is not None or name in channels]
    if gains and "setpoint" not in given and (reading.kp is not None or reading.kd is not None):
        raise BadParameter(
            f"{' and '.join(gains)}: a position servo's gain needs its set-point, but {file} has no column "
            "'setpoint'; name it with --map setpoint=NAME."
        )
    if gains == ["kd"] and "setpoint" in given:
        raise BadParameter("kd is given without kp: give both gains of the position servo, or none.")


def _plain(values: Array, name: str, unit: str, *notes: str) -> Command:
    none = np.zeros(len(values))
    return Command(values=values, servo_gain=none, servo_damping=none, name=name, unit=unit, notes=notes)


def _of_two_motors(
    kind: str, file: str, found: Mapping[str, str], channels: Mapping[str, Array], unit: str, reading: Reading
) -> Command:
    """The sum of two drives' torques at the output gear, by the gear train; ratio one if none is given."""
    one, two = (found[column] for column in _OF_TWO[kind])
    first, second = 1.0, 1.0
    notes: list[str] = []
    if reading.gears is None:
        notes.append(
            f"no gear train is given: '{one}' and '{two}' of {file} are taken at the "
            "output gear and added; give --gears 20,20:161 or --ratio 8.05"
        )
    else:
        first, second = np.asarray(reading.gears.torque_map, dtype=np.float64)  # paper, eq. (2)
    constant = 1.0
    if kind == "currents" and reading.torque_constant is not None:
        constant = float(reading.torque_constant)
    elif kind == "currents":
        unit = "A"
        notes.append(
            f"torque scale unknown: the command of {file} are the currents '{one}' and '{two}', so all parameters are "
            f"per ampere{_CONSTANT}"
        )
    torque_1, torque_2 = (constant * channels[column] for column in _OF_TWO[kind])
    return _plain(first * torque_1 + second * torque_2, f"{one}, {two}", unit, *notes)


def with_motor_torques(channels: Mapping[str, Array], reading: Reading) -> dict[str, Array]:
    """The channels; with the torques of two motors, if their currents and the torque constant are known."""
    torques = {}
    if reading.torque_constant is not None and channels.keys() >= set(CURRENTS_OF_TWO):
        for torque, current in zip(TORQUES_OF_TWO, CURRENTS_OF_TWO, strict=True):
            torques[torque] = float(reading.torque_constant) * channels[current]
    return {**torques, **channels}


def _servo(file: str, found: Mapping[str, str], channels: Mapping[str, Array], axis: str, reading: Reading) -> Command:
    """A position servo's set-point with its gains; with unknown gains the command is per radian (or metre) of error."""
    setpoint, (torque, unit, angle) = channels["setpoint"], _WORDS[axis]
    kp, kd = (_gain(name, channels, reading, len(setpoint)) for name in ("kp", "kd"))
    if kp is not None:
        _usable(file, found, kp, kd)
        return Command(
            values=kp * setpoint,
            servo_gain=kp,
            servo_damping=np.zeros(len(setpoint)) if kd is None else kd,
            name=found["setpoint"],
            unit=unit,
        )
    note = (
        f"torque scale unknown: {file} has a set-point but no {torque}, so {torque}s are per {angle} of its error, and "
        "viscous friction includes the damping by the servo's kd; give the gains with --kp and --kd, or as columns"
    )
    return Command(
        values=setpoint,
        servo_gain=np.ones(len(setpoint)),
        servo_damping=np.zeros(len(setpoint)),
        name=found["setpoint"],
        unit={"radian": "rad", "metre": "m"}[angle],
        notes=(note,),
    )


_WORDS = {"rotary": ("torque", "N m", "radian"), "linear": ("force", "N", "metre")}


def _gain(name: str, channels: Mapping[str, Array], reading: Reading, samples: int) -> Array | None:
    """(T,) a gain from the user, else from the log; None if it is unknown."""
    if (value := getattr(reading, name)) is not None:
        return np.full(samples, float(value))
    return channels.get(name)


def _usable(file: str, found: Mapping[str, str], kp: Array, kd: Array | None) -> None:
    for name, values in (("kp", kp), ("kd", kd)):
        if values is not None and (np.any(values < 0.0) or not np.isfinite(values).any()):
            raise MalformedLog(f"{file}: '{found.get(name, name)}' holds a negative gain, a position servo has none.")
    if not np.any(kp > 0.0):
        raise MalformedLog(f"{file}: '{found.get('kp', 'kp')}' is zero throughout: such a servo gives no torque.")
