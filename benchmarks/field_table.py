"""The table of outcomes: requirements, rates by kind of command, loop and rest, and each false effect."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from field_scoring import Outcome, Score, score

CATEGORIES = ("right", "honest", "wrong", "missed", "crash")
_UNMENTIONED = 1e-3  # assumed probability of an expected effect that is not mentioned, in the log score
Pair = tuple[Outcome, Score]


def table(outcomes: Sequence[Outcome]) -> str:
    """The whole table as text."""
    pairs = [(outcome, score(outcome)) for outcome in sorted(outcomes, key=lambda o: o["seed"])]
    if not pairs:
        return "no outcomes"
    parts = [
        _shares(pairs),
        _demands(pairs),
        _reliability(pairs),
        _times(pairs),
        _names("false sure names", pairs, lambda s: (s.wrong, s.part), ("wrong", "part of the rest")),
        _names("expected effects that were not named for sure", pairs, _lost, ("honest", "missed", "wrong")),
        _failures(pairs),
    ]
    return "\n\n".join(filter(None, parts))


def _shares(pairs: list[Pair]) -> str:
    head = f"{'':28}{'logs':>6}" + "".join(f"{name:>9}" for name in CATEGORIES) + f"{'ok %':>8}{'part':>7}"
    groups: list[tuple[str, Callable[[Outcome], Any]]] = [
        ("loop", lambda o: o["loop"]),
        ("command", lambda o: o["kind"]),
        ("rest", lambda o: f"{100 * o['rest_share']:g} %"),
        ("hidden", lambda o: str(len(o["truth"]))),
        ("clock", lambda o: o["clock"]),
        ("left out", lambda o: "yes" if o["left_out"] else "no"),
    ]
    lines = [head, _row("all", pairs)]
    for title, key in groups:
        lines += [_row(f"{title}: {value}", [p for p in pairs if key(p[0]) == value]) for value in _values(pairs, key)]
    return "\n".join(lines)


def _values(pairs: list[Pair], key: Callable[[Outcome], Any]) -> list[Any]:
    return sorted({key(outcome) for outcome, _ in pairs})


def _row(title: str, pairs: list[Pair]) -> str:
    count = Counter(found.category for _, found in pairs)
    good = 100.0 * (count["right"] + count["honest"]) / len(pairs)
    part = sum(bool(found.part) for _, found in pairs)
    cells = "".join(f"{count[name]:>9}" for name in CATEGORIES)
    return f"{title:28}{len(pairs):>6}{cells}{good:>8.1f}{part:>7}"


def _demands(pairs: list[Pair]) -> str:
    """The requirements, each with its target."""
    offered = [(o, s) for o, s in pairs if o["left_out"] is None]
    two = [s for o, s in offered if len(o["truth"]) == 2]
    clean = [(o, s) for o, s in pairs if not o["truth"]]
    rows = [
        ("right or honest", ">= 95 %", _share([s.category in ("right", "honest") for _, s in pairs])),
        ("confidently wrong", "<= 1 %", _share([s.category == "wrong" for _, s in pairs])),
        ("a part of the rest named above 0.9", "<= 5 %", _share([bool(s.part) for _, s in pairs])),
        ("crash or no end", "0", _share([s.category == "crash" for _, s in pairs])),
        ("sets of two exact or honest", ">= 90 %", _share([s.exact or s.category == "honest" for s in two])),
        ("sets of two exact", "", _share([s.exact for s in two])),
        ("clean logs named", "<= 1 %", _share([bool(s.wrong or s.part) for _, s in clean])),
        ("  with 3 % of rest", "<= 1 %", _share([bool(s.wrong or s.part) for o, s in clean if o["rest_share"] > 0.02])),
        ("left out: silently wrong", "<= 2 %", _share([s.unreported for _, s in pairs if s.unreported is not None])),
        ("left out: the right variable", ">= 90 %", _share([s.variable for _, s in pairs if s.variable is not None])),
    ]
    return "\n".join(f"{title:40}{wanted:>9}   {found}" for title, wanted, found in rows)


def _share(flags: Sequence[bool | None]) -> str:
    return (
        f"{100.0 * sum(map(bool, flags)) / len(flags):5.1f} %  ({sum(map(bool, flags))} of {len(flags)})"
        if flags
        else "-"
    )


def _reliability(pairs: list[Pair]) -> str:
    """Reported probability against true share, over all effects of all logs."""
    events = [event for _, found in pairs for event in found.events]
    if not events:
        return ""
    stated, true = np.array([p for p, _ in events]), np.array([hit for _, hit in events], dtype=float)
    edges = np.array([0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99, 1.0 + 1e-12])
    place = np.clip(np.digitize(stated, edges) - 1, 0, edges.size - 2)
    lines, error, chance = [f"{'said':14}{'names':>7}{'mean':>8}{'true':>8}"], 0.0, 0.0
    for k in range(edges.size - 1):
        chosen = place == k
        if chosen.any():
            mean, share = float(stated[chosen].mean()), float(true[chosen].mean())
            error += float(chosen.mean()) * abs(mean - share)
            spread = np.sqrt(2.0 / np.pi * mean * (1.0 - mean) / chosen.sum())  # mean absolute error of a true share
            chance += float(chosen.mean()) * float(spread)
            lines.append(
                f"{edges[k]:5.2f} to {min(edges[k + 1], 1.0):4.2f}{int(chosen.sum()):>7}{mean:>8.3f}{share:>8.3f}"
            )
    clipped = np.clip(stated, _UNMENTIONED, 1.0 - _UNMENTIONED)
    score_sum = float(np.sum(np.where(true > 0.0, np.log(clipped), np.log1p(-clipped))))
    score_sum += np.log(_UNMENTIONED) * sum(found.unmentioned for _, found in pairs)
    logs = sum(found.category != "crash" for _, found in pairs)
    lines.append(
        f"expected calibration error (<= 0.02): {error:.4f}, {chance:.4f} by chance;  log score per log: "
        f"{score_sum / max(logs, 1):.4f}"
    )
    return "\n".join(lines)


def _times(pairs: list[Pair]) -> str:
    lines = [f"{'seconds a log':34}{'median':>9}{'95 %':>9}{'most':>9}"]
    for clock, key in (("on the clock", "seconds"), ("of the processor", "processor")):
        for title, low, high in (("all", 0, 10**9), ("7,000 samples and more", 7000, 10**9)):
            taken = [o[key] for o, _ in pairs if key in o and low <= o["samples"] < high]
            if taken:
                cells = (np.median(taken), np.quantile(taken, 0.95), max(taken))
                lines.append(f"{clock}, {title}"[:34].ljust(34) + "".join(f"{cell:>9.1f}" for cell in cells))
    return "\n".join(lines)


def _lost(found: Score) -> tuple[tuple[str, ...], ...]:
    return tuple(found.lost if found.category == name else () for name in ("honest", "missed", "wrong"))


def _names(
    title: str, pairs: list[Pair], of: Callable[[Score], tuple[tuple[str, ...], ...]], heads: tuple[str, ...]
) -> str:
    """How often each effect occurs in each of several lists."""
    counts = [Counter(name for _, found in pairs for name in of(found)[k]) for k in range(len(heads))]
    names = sorted({name for count in counts for name in count}, key=lambda n: -sum(count[n] for count in counts))
    if not names:
        return ""
    lines = [f"{title:48}" + "".join(f"{head:>18}" for head in heads)]
    lines += [f"  {name:46}" + "".join(f"{count[name]:>18}" for count in counts) for name in names]
    return "\n".join(lines)


def _failures(pairs: list[Pair]) -> str:
    failed = [f"seed {o['seed']}: {o['failed']}" for o, _ in pairs if "failed" in o]
    return "\n".join(["failed", *failed]) if failed else ""
