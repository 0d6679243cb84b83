"""Recordings that passed every check, as runs, with the findings as sentences."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from identification.checks.check import check, excited
from identification.checks.sign import sign_of_the_command
from identification.checks.standstill_at_ends import cut_standstill
from identification.errors import MalformedLog
from identification.recording import Finding, Recording
from identification.run import Run
from identification.run_parameters import payload_of
from identification.threads import without_blas_threads

_LISTED = 3  # findings of one kind that are listed one by one


@dataclass(frozen=True, kw_only=True, eq=False)
class Checked:
    """Usable runs, at least one, and warnings, repairs and faults (no model can be fitted), one sentence each."""

    runs: tuple[Run, ...]
    warnings: tuple[str, ...]
    repairs: tuple[str, ...]
    faults: tuple[str, ...]


@without_blas_threads
def checked_runs(recordings: Iterable[Recording]) -> Checked:
    """Check recordings and keep what can be used.

    Raises `MalformedLog` when a recording is unusable, all are too short, or nothing ever moves.
    """
    usable: list[Recording] = []
    findings: list[Finding] = []
    for recording in recordings:
        parts, found = check(recording)
        usable += parts
        findings += found
    findings += sign_of_the_command(usable)
    if not usable:
        short = [finding.text for finding in findings if finding.kind == "too short"]
        raise MalformedLog(short[0].replace("left out, as ", "") + "." if short else "the log holds no runs.")
    if not any(map(excited, usable)):
        first = usable[0]
        raise MalformedLog(
            f"{first.label}: neither '{first.name('command')}' nor '{first.name('output')}' ever changes, "
            "record a log in which the drive moves the load."
        )
    if not any(np.ptp(recording.output[recording.valid]) > 0 for recording in usable):
        findings = [replace(found, unusable=found.unusable or found.kind == "never turns") for found in findings]
    usable, findings = cut_standstill(usable, findings)
    return Checked(
        runs=tuple(Run.from_recording(recording, _zero(usable), payload_of(recording)) for recording in usable),
        warnings=_texts(finding for finding in findings if not finding.repaired and not finding.unusable),
        faults=_texts(finding for finding in findings if finding.unusable),
        repairs=_texts(finding for finding in findings if finding.repaired),
    )


def _zero(recordings: Sequence[Recording]) -> float:
    """Start of the log on a clock that runs since long before it, else zero [s].

    Counted from the zero of such a clock, drift is nearly constant and the phase of a wave is arbitrary.
    """
    first = min(float(recording.time[0]) for recording in recordings)
    last = max(float(recording.time[-1]) for recording in recordings)
    return first if abs(first) > last - first else 0.0


def _texts(findings: Iterable[Finding]) -> tuple[str, ...]:
    """One sentence per finding; of many findings of one kind only the first and the number of the others."""
    kinds: dict[str, list[str]] = defaultdict(list)
    for finding in findings:
        kinds[finding.kind].append(finding.text)
    texts_shown = []
    for texts in kinds.values():
        many = len(texts) > _LISTED
        texts_shown += [f"{texts[0]}; and the like in {len(texts) - 1} further runs"] if many else texts
    return tuple(texts_shown)
