"""The meaning of a column from its name, with a grade of certainty: `pos`, `theta`, `ENC1Position`, `q3` are angles.

The last known noun in a heading is the measured quantity. Words such as "error" or "max" exclude the column, words such
as "target" or "command" make it a requested value. The four grades are: the name in the log contract, a synonym without
other words, a synonym among other words, or a requested instead of a measured value.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from identification.reading.headings import Heading, heading
from identification.reading.units import kind_of

OWN, SYNONYM, AMONG_OTHERS, COMMANDED = 3, 2, 1, 0  # grades of certainty

_TIMES = (
    *("times", "timestamps", "stamps", "ts", "secs", "zeitstempel", "x value", "x axis", "tout"),
    *("millis", "micros", "nanos", "uptime", "ms today", "temps", "tiempo", "tempo"),
)
_SPANS = ("dt", "latency", "period", "duration", "interval", "cycle time", "sample time")  # times, but not time stamps
NOUNS: Mapping[str, tuple[str, ...]] = {
    "time": ("time", "t", "timestamp", "stamp", "seconds", "sec", "elapsed", "clock", "zeit", *_TIMES),
    "torque": ("torque", "effort", "tau", "trq", "tq", "moment", "drehmoment", "couple", "par", "coppia"),
    "force": ("force", "thrust", "kraft", "fuerza", "forza"),
    "current": (
        *("current", "iq", "i q", "ia", "i a", "i", "amps", "q current", "q axis current", "current q"),
        *("strom", "courant", "corriente", "corrente"),
    ),
    "voltage": ("voltage", "volts", "volt", "uq", "u q", "voltage q", "q voltage", "spannung", "voltaje"),
    "duty": ("duty", "duty cycle", "pwm"),
    "angle": (
        *("angle", "theta", "q", "phi", "alpha", "rotation", "angular position", "position angulaire"),
        *("observation state", "winkel", "angulo", "angolo", "posicion angular", "posizione angolare"),
    ),
    "position": (
        *("position", "pos", "encoder", "enc", "displacement", "stroke", "travel"),
        *("weg", "posicion", "posizione"),
    ),
    "setpoint": ("q d", "theta d", "phi d", "action"),  # of LeRobot: the requested motor positions
    "velocity": (
        *("velocity", "vel", "velo", "speed", "omega", "w", "rpm", "dq", "qd", "qdot", "q dot", "dtheta", "d theta"),
        *("theta dot", "thetadot", "erpm", "angular velocity", "drehzahl", "vitesse", "velocidad", "velocita"),
    ),
    "run": ("run", "experiment", "trial", "episode"),
    "something else": (
        "id",
        "i d",
        "d current",
        "d axis current",
        "current d",
        "voltage d",
        "ud",
        "u d",
        "vd",
        "v d",
        "dq d",
        "tau d",
        "i 2 t",
        *_SPANS,
    ),
    "acceleration": ("acceleration", "acc", "accel", "ddq", "qdd", "ddtheta", "jerk"),
}
"""Words, or phrases, that name a quantity. A position may be an angle: its unit, or the command, decides."""

_PHRASES = {tuple(phrase.split()): column for column, phrases in NOUNS.items() for phrase in phrases}
_LONGEST = max(map(len, _PHRASES))
_COMMAND_WORDS = {
    *("setpoint", "set", "sp", "target", "desired", "des", "demand", "ref", "reference", "goal", "cmd", "command"),
    *("commanded", "action", "soll", "sollwert", "wanted", "request", "requested", "consigne", "consigna"),
}
_SOMETHING_ELSE = {
    *("error", "err", "deviation", "max", "min", "limit", "lim", "constant", "temperature", "temp", "std", "variance"),
    *("offset", "gain", "enabled", "enable", "status", "state", "mode", "flag", "delay", "ratio", "power", "index"),
    *("battery", "supply", "bus"),
    *("fault", "predicted", "filter", "count", "rate"),
}
_OTHERS = ("acceleration", "something else")
_IN_PASSING = {"index", "id", "number", "no", "nr"}  # allowed with "run"
_PLAIN = {
    "actual",
    "act",
    "measured",
    "meas",
    "value",
    "val",
    "present",
    "feedback",
    "ist",
    "istwert",
    "signal",
    "estimate",
    "estimated",
    "est",
}


@dataclass(frozen=True, kw_only=True)
class Meaning:
    """Possible contract column of a name, the grade of certainty, and the unit in the heading."""

    column: str
    grade: int
    unit: str = ""


def meaning(name: str, file_unit: str = "") -> Meaning | None:
    """Possible meaning of a column with that name and the unit in the file, if there is one; None if unknown."""
    read = heading(name)
    noun, phrase = _noun(read.words)
    of_word = read.unit if read.trailing and len(read.unit) > 1 else ""  # one letter is ambiguous: phase A
    if noun is None and read.trailing:  # the unit was a word after all
        read = Heading(words=(*read.words, read.unit.lower()))
        noun, phrase = _noun(read.words)
    others = [word for word in read.words if word not in phrase]
    if noun == "run":
        return None if set(others) - _IN_PASSING else Meaning(column="run", grade=SYNONYM if others else OWN)
    unit = file_unit or read.unit
    fits = noun is not None and _fits(noun, unit)
    if read.trailing and not fits:
        unit, others, fits = file_unit, [*others, read.unit.lower()], noun is not None and _fits(noun, file_unit)
    if set(others) & _SOMETHING_ELSE or noun in _OTHERS:
        return None
    if noun is None:
        return _by_unit(unit or of_word)
    if not fits:
        return None
    grade = SYNONYM if not set(others) - _PLAIN else AMONG_OTHERS
    column = "angle" if noun == "position" and kind_of(unit) == "rad" else noun
    if set(others) & _COMMAND_WORDS:
        if column not in ("angle", "position", "torque", "force", "current", "voltage", "duty"):
            return None
        column = "setpoint" if column in ("angle", "position") else column
        grade = SYNONYM if not set(others) - _COMMAND_WORDS - _PLAIN else AMONG_OTHERS
        grade = grade if column == "setpoint" else COMMANDED  # a measured value has priority
    elif read.words == (noun,):
        grade = OWN
    return Meaning(column=column, grade=grade, unit=unit)


def is_time(name: str) -> bool:
    """Whether a column has the name of a time: `time`, `Time (s)`, `%time`, `rel_time`, `Zeit [ms]`."""
    found = meaning(name)
    return found is not None and found.column == "time" and found.grade >= SYNONYM


def time_unit(name: str) -> str:
    """The unit in the name of a time, "" without one."""
    return heading(name).unit if is_time(name) else ""


def _by_unit(unit: str) -> Meaning | None:
    """Possible meaning of a column with an unknown name, from its unit alone."""
    column = _BY_UNIT.get(kind_of(unit) or "") if unit else None
    return Meaning(column=column, grade=AMONG_OTHERS, unit=unit) if column else None


def _noun(words: tuple[str, ...]) -> tuple[str | None, tuple[str, ...]]:
    """The last known noun in a list of words, and its words; the longest noun if several end at the same word."""
    for end in range(len(words), 0, -1):
        for length in range(min(_LONGEST, end), 0, -1):
            phrase = words[end - length : end]
            if phrase in _PHRASES:
                return _PHRASES[phrase], phrase
    return None, ()


_UNITS = {
    "time": ("s",),
    "torque": ("N m",),
    "force": ("N",),
    "current": ("A",),
    "voltage": ("V",),
    "angle": ("rad",),
    "position": ("rad", "m"),
    "setpoint": ("rad", "m"),
    "velocity": ("rad/s", "m/s"),
}

_BY_UNIT = {
    "s": "time",
    "N m": "torque",
    "N": "force",
    "A": "current",
    "V": "voltage",
    "rad": "angle",
    "rad/s": "velocity",
}


def _fits(noun: str, unit: str) -> bool:
    """Whether a unit is possible for a quantity: it is empty, has no size (counts, percent), or is of that kind."""
    kind = kind_of(unit) if unit else None
    if noun == "torque" and unit.lower() == "nm":  # of a position, it would be nanometres
        return True
    return kind is None or kind in _UNITS.get(noun, ())
