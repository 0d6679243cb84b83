"""Stored lines of a long study, one per diagnosis: existing lines are not run again, so it may be interrupted."""

from __future__ import annotations

import json
import multiprocessing
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

Key = tuple[str, int, int]


def stored(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def add(path: Path, keys: Iterable[Key], work: Callable[[Key], dict[str, Any]], processes: int, chunk: int = 1) -> None:
    """Append the missing lines as they come, and print each; `chunk` consecutive keys go to one process."""
    done = {tuple(line["key"]) for line in stored(path)}
    left = [key for key in keys if key not in done]
    path.parent.mkdir(exist_ok=True)
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        for place, reported in enumerate(pool.imap_unordered(work, left, chunk), start=1):
            with path.open("a") as file:
                file.write(json.dumps(reported) + "\n")
            line = (
                reported.get("failed") or f"{reported['verdict']} {', '.join(c['effect'] for c in reported['causes'])}"
            )
            print(
                f"{place}/{len(left)} {reported.get('truth') or reported.get('kind')} {reported['key'][2]}: {line}",
                flush=True,
            )


def attempted(work: Callable[[Key], dict[str, Any]], key: Key) -> dict[str, Any]:
    """The line of a diagnosis, or the error that it raised, which is a result too; the study continues."""
    try:
        return work(key)
    except Exception as error:
        return {"key": list(key), "failed": f"{type(error).__name__}: {error}"}
