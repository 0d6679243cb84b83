"""Parse a heading: words without case and punctuation, and the unit after or in it.

`Torque [mNm]`, `torque_mNm` and `Torque (mN·m)` are the word "torque" and the unit mNm; `ENC1Position` is "enc 1
position"; `q̇`, `θ` and `τ` are spelled out.
"""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass, replace
from functools import lru_cache

from identification.reading.units import kind_of

_GREEK = {"θ": "theta", "ϑ": "theta", "φ": "phi", "ϕ": "phi", "τ": "tau", "ω": "omega", "α": "alpha"}
_BRACKETS = re.compile(r"^(.*\S)\s*[\[({<]\s*([^\[\](){}<>]+?)\s*[\])}>]\s*$")
_PLACE = re.compile(r"(.*\S):(\d+)$")
_RATIO = re.compile(r"[^\W\d_]+\s*/\s*[^\W\d_]+")
_WORDS = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|\d+")
_LETTERS = re.compile(r"[A-Za-zµ°%]+")
_COUNTS = {"count", "counts", "cnt", "inc", "increments", "ticks", "steps", "pulses", "raw", "lsb", "digits"}
_AT_THE_END = {  # as a last word; single letters are case-sensitive: a motor "a" has no amperes
    *("s", "sec", "ms", "us", "ns", "rad", "mrad", "deg", "turn", "turns", "rev", "revs", "rpm", "rps", "dps"),
    *(
        "mm",
        "um",
        "m",
        "nm",
        "Nm",
        "NM",
        "mNm",
        "Ncm",
        "N",
        "kN",
        "A",
        "mA",
        "V",
        "mV",
        "RPM",
        "DEG",
        "Deg",
        "RAD",
        "Rad",
    ),
}
_SPELLED = {"sec": "s", "turns": "turn", "nm": "N*m", "NM": "N*m", "Nm": "N*m"}
_SPELLED |= {"mNm": "mN*m", "Ncm": "N*cm", "RPM": "rpm", "DEG": "deg", "Deg": "deg", "RAD": "rad", "Rad": "rad"}
_CAMEL_UNITS = re.compile(  # leftSpeedRpm, positionRad, VelocityRadPerSec, AppliedVolts
    r"(?<=[a-z0-9])(?P<unit>(Rad|Deg|Rot)(?=PerSec)|Rpm|RPM|Radians|Rad|Degrees|Deg|Rotations|Ms|Sec|Seconds|Nm|Mm|Volts|Amps)"
    r"(?P<rate>PerSec(ond)?)?$"
)
_CAMEL_SPELLED = {"Rot": "turn", "Rotations": "turn", "Nm": "N*m", "Sec": "s"}
_IMPLIED_UNITS = {"millis": "ms", "micros": "us", "nanos": "ns", "ms today": "ms", "rpm": "rpm", "erpm": "erpm"}


@dataclass(frozen=True, kw_only=True)
class Heading:
    """The words of a heading, lower case, and its unit as a text for `units.si_factor`; empty without a unit.

    trailing: whether the unit is a last word, as in `time_ms`, and may be an ordinary word (`torque_m`).
    """

    words: tuple[str, ...]
    unit: str = ""
    trailing: bool = False


@lru_cache(maxsize=4096)
def heading(text: str) -> Heading:
    """Split a heading into words and unit."""
    plain = unicodedata.normalize("NFKC", text.lstrip("\ufeff")).strip()
    if place := _PLACE.match(plain):  # a column of a matrix has the unit of the matrix
        whole = heading(place[1])
        return replace(whole, words=(*whole.words, place[2]))
    found = _BRACKETS.match(plain)
    if found:
        unit = "count" if found[2].lower() in _COUNTS else found[2]
        if unit in ("count", "%", "‰") or kind_of(unit) is not None:
            return Heading(words=_words(found[1]), unit=unit)
        if _RATIO.fullmatch(unit):  # a unit without a use here, whose letters are no words: kgf/W has no speed "w"
            plain = found[1]
    words = _words(plain)
    if len(words) > 1 and words[-1] in _COUNTS:
        return Heading(words=words[:-1], unit="count")
    for count in (2, 1):
        last = _last_letters(plain, count)
        if len(words) <= count or not last or not all(one in _AT_THE_END for one in last):
            continue
        unit = "/".join(_SPELLED.get(one, one) for one in last)
        if unit == "N/m":
            unit = "N*m"
        if kind_of(unit) is not None:
            count += words[-2] == "per"
            return Heading(words=words[: len(words) - count], unit=unit, trailing=True)
    if tail := _CAMEL_UNITS.search(plain):
        unit = _CAMEL_SPELLED.get(tail["unit"], tail["unit"].lower())
        return Heading(words=_words(plain[: tail.start()]), unit=f"{unit}/s" if tail["rate"] else unit)
    return Heading(
        words=words,
        unit=next((u for words_with_unit, u in _IMPLIED_UNITS.items() if " ".join(words) == words_with_unit), ""),
    )


def _words(text: str) -> tuple[str, ...]:
    spelled = "".join(f" {_GREEK[one]} " if one in _GREEK else one for one in text)
    ascii_only = unicodedata.normalize("NFKD", spelled).encode("ascii", "ignore").decode()
    return tuple(word.lower() for word in _WORDS.findall(ascii_only))


def _last_letters(text: str, count: int) -> list[str]:
    """The last groups of letters, separated by `_`, a space, a slash or a point."""
    parts = re.split(r"[_\s./]+per[_\s.]+|[_\s./]+", text)
    return parts[-count:] if len(parts) > count and all(map(_LETTERS.fullmatch, parts[-count:])) else []
