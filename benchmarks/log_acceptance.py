"""Rates at which valid logs are refused, and at which reversed signs, degrees and speeds for torques are detected.

300 drawn logs (`tests/valid_logs.py`): ten kinds of experiments on different machines, one log in five with two motors.
Run it with `python benchmarks/log_acceptance.py`; it takes about ten minutes. It writes
`benchmarks/results/log_acceptance.txt`.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "tests"))

from valid_logs import KINDS, Ratio, draw  # noqa: E402

from identification import Log, MalformedLog  # noqa: E402

COUNT, SEED = 300, 100
COLUMNS = ("right", "brakes", "reversed", "one of two", "in degrees", "speed")


def main() -> None:
    """Draw the logs, read them, count, and write the table."""
    drawn = draw(COUNT, SEED)
    requested: dict[str, Counter[str]] = {name: Counter() for name in COLUMNS}
    reported: dict[str, Counter[str]] = {name: Counter() for name in COLUMNS}
    for place in range(COUNT):
        kind, gears = str(drawn.kind[place]), Ratio(float(drawn.ratio[place]))

        def count(name: str, log: Log | None, wanted: str, warned: bool = False, kind: str = kind) -> None:
            if log is not None:
                requested[name][kind] += 1
                texts = log.warnings if warned else log.faults
                reported[name][kind] += any(wanted in text and "never turns" not in text for text in texts)

        right = _read(drawn.columns(place), gears)
        count("right", right, "")
        count("brakes", right, "almost all the time", warned=True)
        count("reversed", _read(drawn.columns(place, sign=(-1.0, -1.0)), gears), "=-1 turns it")
        if drawn.pair[place]:
            for k, sign in enumerate(((-1.0, 1.0), (1.0, -1.0)), 1):
                count("one of two", _read(drawn.columns(place, sign=sign), gears), f": --scale torque_{k}=-1 turns it")
        count("in degrees", _read(drawn.columns(place, turn=180.0 / np.pi), gears), "--unit angle=deg")
        columns = drawn.columns(place)
        speed = np.gradient(columns["angle"], columns["time"])
        count("speed", _read({"time": columns["time"], "torque": speed, "angle": columns["angle"]}, gears), "a speed")
    lines = [f"{COUNT} drawn logs, seed {SEED}: told of asked", "kind       " + "".join(f"{n:>13}" for n in COLUMNS)]
    for kind in KINDS:
        cells = [f"{reported[name][kind]} of {requested[name][kind]}" for name in COLUMNS]
        lines.append(f"{kind:11}" + "".join(f"{cell:>13}" for cell in cells))
    cells = [f"{reported[name].total()} of {requested[name].total()}" for name in COLUMNS]
    lines.append(f"{'all':11}" + "".join(f"{cell:>13}" for cell in cells))
    lines += [
        "",
        "right: refused though nothing is wrong (a load that friction holds never turns, and is told so with reason).",
        "brakes: warned that the torque works against the motion, of right logs. The rest: what was wrong was noticed,",
        "with the option that helps. A loop that only holds and a generator show no sign that one of a reversed",
        "torque would not show.",
    ]
    text = "\n".join(lines) + "\n"
    print(text)
    (HERE / "results" / "log_acceptance.txt").write_text(text)


def _read(columns: Mapping[str, np.ndarray], gears: Ratio) -> Log | None:
    """The log of these columns, None if it is refused for another reason."""
    try:
        return Log.from_arrays(**columns, gears=gears)
    except MalformedLog:
        return None


if __name__ == "__main__":
    main()
