"""The times of a table in seconds: from times of day, dates in any notation, epochs in any unit, plain numbers."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from identification.checks.plausibility import FASTEST_SAMPLING, SLOWEST_SAMPLING
from identification.checks.timing import GAP
from identification.errors import MalformedLog
from identification.reading.cell_values import numbers_of
from identification.reading.table import Table
from identification.recording import Array

if TYPE_CHECKING:
    import pandas as pd

_DAY = 86400.0
_OF_DAY = (
    r"(?:(?P<days>\d+)\s*d(?:ays?)?,?\s+)?(?P<first>\d{1,4}):(?P<second>\d{1,2})(?::(?P<third>\d{1,2}))?"
    r"(?:[.,:](?P<part>\d{1,9}))?\s*(?P<half>[AaPp])?(?(half)\.?[Mm]\.?)"
)
_DATED = (
    r"^(?P<date>.*\w)[T\s,_]+(?P<time>\d{1,2}:\d{2}(?::\d{2})?(?:[.,:]\d{1,9})?(?:\s*[AaPp]\.?[Mm]\.?)?)"
    r"(?:\s*(?:Z|UTC|GMT))?$"
)
_SECONDS = ("sec", "secs", "second", "seconds")
_HOUR = 3600.0
_LONGER = {**dict.fromkeys(("hour", "hours"), _HOUR), **dict.fromkeys(("minute", "minutes", "min"), 60.0)}
_SIZES = {"nano": 1e-9, "micro": 1e-6, "milli": 1e-3, "n": 1e-9, "u": 1e-6, "m": 1e-3}
_FRACTION = re.compile(rf"(?P<stem>.*?)(?P<size>{'|'.join(_SIZES)})_?(secs?|seconds?)", re.IGNORECASE)
_EPOCHS = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_THIS_CENTURY = (946684800.0, 4102444800.0)  # [s] since 1970: the years 2000 to 2100


def seconds_of(table: Table, name: str, factor: float | None) -> tuple[Array, tuple[str, ...]]:
    """(T,) times [s], and notes on them. Dates count from the first one.

    factor: seconds per unit of the column's numbers; None if it is unknown, then numbers are seconds or an epoch.

    Raises `MalformedLog` for a cell that is not a time.
    """
    times, _, clock_notes = clock_of(table, name, factor)
    return times, clock_notes


def clock_of(table: Table, name: str, factor: float | None) -> tuple[Array, float, tuple[str, ...]]:
    """(T,) times [s], the first date [s] since 1970 (0 without dates), and notes; arguments as in `seconds_of`."""
    raw: NDArray[Any] = np.asarray(table.columns[name])
    if raw.ndim == 1 and raw.dtype.kind in "mMOUST":
        import pandas as pd

        cells = pd.Series(raw)
        if raw.dtype.kind == "m":
            return np.asarray(cells.dt.total_seconds(), dtype=np.float64), 0.0, ()
        written = cells.map(lambda cell: str(cell).strip(), na_action="ignore").replace("", np.nan)
        times = _times_of_day(written)
        if times is None:
            dates = _dates(cells) if raw.dtype.kind == "M" else _dates(written)
            if dates is not None:
                _refuse_others(table, name, written, dates[0])
                return *dates, ()
        else:
            _refuse_others(table, name, written, times)
            times, clock_notes = _over_midnight(table, name, times, whole=bool(written.str.contains("d").any()))
            return times, 0.0, clock_notes
    numbers, clock_notes = _over_its_bits(table, name, numbers_of(table, name, "time"))
    if factor is not None:
        return numbers * factor, 0.0, clock_notes
    unit = _epoch(numbers)
    if unit is None:
        return numbers, 0.0, clock_notes
    note = f"{table.name}: '{name}' counts {unit} since 1970, as in seconds it would lie far in the future"
    return numbers * _EPOCHS[unit], 0.0, (*clock_notes, note)


def _times_of_day(written: pd.Series[str]) -> Array | None:
    """Seconds of `16:13:10.123`, `4:13:10 PM`, `1 day, 0:00:01` or `13:10.1` (minutes); None if most are others."""
    import pandas as pd

    parts = written.str.extract(f"^{_OF_DAY}$")
    if not 2 * int(parts["first"].notna().sum()) > int(written.notna().sum()):
        return None
    fields = {
        key: np.asarray(pd.to_numeric(parts[key]), dtype=np.float64) for key in ("days", "first", "second", "third")
    }
    fraction = np.asarray(pd.to_numeric("0." + parts["part"].fillna("0")), dtype=np.float64)
    first, second, third = fields["first"], fields["second"], fields["third"]
    if np.isnan(third).all():
        seconds = 60 * first + second + fraction
    else:
        half = parts["half"].str.lower()
        hours = np.where(half.notna(), first % 12 + 12 * np.asarray(half == "p"), first)
        seconds = 3600 * hours + 60 * second + np.nan_to_num(third) + fraction
    return np.where(parts["first"].notna(), seconds + _DAY * np.nan_to_num(fields["days"]), np.nan)


def _over_midnight(table: Table, name: str, times: Array, *, whole: bool) -> tuple[Array, tuple[str, ...]]:
    """Continue times of day over midnight, where they decrease by more than half a day."""
    known = np.flatnonzero(np.isfinite(times))
    nights = np.cumsum(np.diff(times[known], prepend=times[known][:1]) < -_DAY / 2)
    if whole or len(nights) == 0 or nights[-1] == 0:
        return times, ()
    continued = times.copy()
    continued[known] += _DAY * nights
    return continued, (f"{table.name}: '{name}' passes midnight and is continued",)


def _over_its_bits(table: Table, name: str, numbers: Array) -> tuple[Array, tuple[str, ...]]:
    """Continue a counter of 16 or 32 bits over its wraps, if the steps there are then like the others."""
    known = np.flatnonzero(np.isfinite(numbers))
    steps = np.diff(numbers[known])
    falls = steps < 0
    if not falls.any() or np.any(numbers[known] % 1 != 0) or not np.any(steps > 0):
        return numbers, ()
    usual = GAP * float(np.median(steps[steps > 0]))
    for bits in (16, 32):
        size = 2.0**bits
        within = np.all((numbers[known] >= 0) & (numbers[known] < size))
        if within and np.all((steps[falls] + size > 0) & (steps[falls] + size <= usual)):
            continued = numbers.copy()
            continued[known[1:]] += size * np.cumsum(falls)
            return continued, (f"{table.name}: '{name}' passes the end of its {bits} bits and is continued",)
    return numbers, ()


def _dates(cells: pd.Series[Any]) -> tuple[Array, float] | None:
    """Seconds since the first date, NaN for other cells, and the first date since 1970; None if most are not dates.

    The order of day and month is unknown: the one for which the log is shorter is used.
    """
    import pandas as pd

    stamps = pd.to_datetime(cells, format="ISO8601", utc=True, errors="coerce")
    if 2 * int(stamps.notna().sum()) > int(cells.notna().sum()):
        first = stamps.dropna().iloc[0]
        since = np.asarray((stamps - first).dt.total_seconds(), dtype=np.float64)
        return since, float((first - pd.Timestamp(0, tz="UTC")).total_seconds())
    parts = cells.astype(str).str.extract(_DATED)
    times = _times_of_day(parts["time"]) if parts["time"].notna().any() else None
    if times is None or not 2 * int(parts["date"].notna().sum()) > int(cells.notna().sum()):
        return None
    codes, different = pd.factorize(parts["date"])
    read = []
    for day_first in (True, False):
        days = pd.to_datetime(pd.Series(different), dayfirst=day_first, format="mixed", errors="coerce")
        if days.notna().all() and len(days):
            since = np.asarray((days - pd.Timestamp(0)).dt.total_seconds(), dtype=np.float64)
            read.append(np.where(codes >= 0, since[codes], np.nan) + times)
    if not read:
        return None
    shortest = min(read, key=lambda seconds: float(np.nanmax(seconds) - np.nanmin(seconds)))
    begin = float(shortest[np.isfinite(shortest)][0])
    return shortest - begin, begin


def _refuse_others(table: Table, name: str, written: pd.Series[str], times: Array) -> None:
    odd = np.flatnonzero(np.isnan(times) & np.asarray(written.notna()))
    if len(odd):
        row = int(odd[0])
        raise MalformedLog(
            f"{table.where(row)}, column '{name}': {str(written.iloc[row])[:30]!r} is no time like those of the other "
            "rows, repair or delete this row."
        )


def with_whole_stamps(table: Table) -> Table:
    """Join whole seconds and their fraction in another column (`sec` and `nanosec`, as in ROS) to one time.

    Hours and minutes beside them belong to it. The sum replaces the seconds; if it is the only one in a table without a
    time, it is also the time.
    """
    lower = {name.lower(): name for name in table.columns}
    columns, notes = dict(table.columns), table.notes
    joined = []
    for name in table.columns:
        found = _FRACTION.fullmatch(name)
        wholes = [lower.get(f"{found['stem']}{word}".lower()) for word in _SECONDS] if found else []
        whole = next((w for w in wholes if w is not None), None)
        if found is None or whole is None:
            continue
        factor = _SIZES[found["size"].lower()]
        seconds, part = np.asarray(table.columns[whole]), np.asarray(table.columns[name])
        if not part.size or seconds.shape != part.shape or not {seconds.dtype.kind, part.dtype.kind} <= set("iuf"):
            continue
        if np.any(seconds % 1 > 0) or not (np.nanmin(part) >= 0 and np.nanmax(part) * factor < 1):
            continue
        columns[whole], others, crossed = _with_minutes(table, whole, found["stem"], seconds + factor * part)
        for other in (name, *others):
            del columns[other]
        quoted = [f"'{each}'" for each in (*others, whole, name)]
        notes += (f"{table.name}: {', '.join(quoted[:-1])} and {quoted[-1]} are one time", *crossed)
        joined.append(whole)
    if len(joined) == 1 and "time" not in lower:
        columns = {"time": columns[joined[0]], **columns}
    return replace(table, columns=columns, notes=notes)


def _with_minutes(table: Table, whole: str, stem: str, time: Array) -> tuple[Array, list[str], tuple[str, ...]]:
    """Seconds (T,) with the hours and minutes in columns beside them, these columns, and a note on midnight."""
    lower, found = {name.lower(): name for name in table.columns}, list[str]()
    day = False
    for word, size in _LONGER.items():
        name = lower.get(f"{stem}{word}".lower())
        values = np.asarray(table.columns[name]) if name is not None else np.empty(0)
        if name is not None and values.shape == time.shape and values.dtype.kind in "iuf" and not np.any(values % 1):
            time, day = time + size * values, day or size == _HOUR
            found.append(name)
    time, crossed = _over_midnight(table, whole, time, whole=not day)
    return time, found, crossed


def _epoch(numbers: Array) -> str | None:
    """The unit of an epoch: numbers that are far in the future as seconds, but of this century in ms, us or ns."""
    finite = numbers[np.isfinite(numbers)]
    if len(finite) < 2 or float(np.median(finite)) < _THIS_CENTURY[1]:
        return None
    steps = np.diff(finite)
    step = float(np.median(steps[steps > 0])) if np.any(steps > 0) else 0.0
    for unit, factor in _EPOCHS.items():
        dated = _THIS_CENTURY[0] < factor * float(np.median(finite)) < _THIS_CENTURY[1]
        if dated and FASTEST_SAMPLING <= factor * step <= SLOWEST_SAMPLING:
            return unit
    return None
