"""Time to read a log of a million rows and four columns, in each format.

    python benchmarks/reading_speed.py

Prints the table and writes it to benchmarks/results/reading_speed.txt. The target is 3 s for any text table; processor
time is given too, as other load on the computer does not affect it.
"""

from __future__ import annotations

import gzip
import os
import platform
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from identification.reading.files import read_table

ROWS = 1_000_000
RESULTS = Path(__file__).parent / "results" / "reading_speed.txt"


def table() -> pd.DataFrame:
    rng = np.random.default_rng(0)
    values = {name: rng.normal(size=ROWS) for name in ("torque", "angle", "velocity")}
    return pd.DataFrame({"time": 1e-3 * np.arange(ROWS), **values})


def trace(text: str) -> str:
    """The columns as a CODESYS trace."""
    rows = [line.split(",") for line in text.splitlines()]
    blocks = (
        f"{k}.Variable; {name}\n{k}.Data; \n" + "".join(f"; {t}; {row[k]}\n" for t, row in enumerate(rows[1:]))
        for k, name in enumerate(rows[0])
    )
    return "[key]; [value]\nFlags; 32\n" + "".join(blocks)


def kinds(frame: pd.DataFrame, path: Path) -> dict[str, Callable[[], object]]:
    """Format -> function that writes it."""
    text = frame.to_csv(index=False)
    dated = frame.assign(time=pd.to_datetime(frame["time"], unit="s").astype(str))
    return {
        "comma separated": lambda: path.write_text(text),
        "CR CR LF": lambda: path.write_bytes(text.replace("\n", "\r\r\n").encode()),
        "a blank line after each": lambda: path.write_text(text.replace("\n", "\n\n")),
        "blanks between, no names": lambda: path.write_text(
            text.split("\n", 1)[1].replace(",", " ").replace("\n", " \n")
        ),
        "decimal commas": lambda: path.write_text(text.replace(",", ";").replace(".", ",")),
        "compressed with gzip": lambda: path.write_bytes(gzip.compress(text.encode(), 1)),
        "dates for times": lambda: dated.to_csv(path, index=False),
        "CODESYS trace": lambda: path.write_text(trace(text)),
        "JSON records": lambda: frame.to_json(path, orient="records"),
        "JSON lines": lambda: frame.to_json(path, orient="records", lines=True),
        "Parquet": lambda: frame.to_parquet(path),
        "Feather": lambda: frame.to_feather(path),
    }


def main() -> None:
    lines = [
        f"{ROWS} rows of 4 columns; {platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}",
        f"{'format':28}{'by the clock [s]':>18}{'by the processor [s]':>22}",
    ]
    frame = table()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log"
        for kind, write in kinds(frame, path).items():
            write()
            clock, processor = time.perf_counter(), time.process_time()
            read = read_table(path)
            clock, processor = time.perf_counter() - clock, time.process_time() - processor
            assert all(len(values) == ROWS for values in read.columns.values()), kind
            lines.append(f"{kind:28}{clock:18.2f}{processor:22.2f}")
            print(lines[-1], flush=True)
    text = "\n".join(lines) + "\n"
    RESULTS.write_text(text)
    print(text)


if __name__ == "__main__":
    main()
