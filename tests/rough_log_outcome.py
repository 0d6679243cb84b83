"""What becomes of a rough log: a result or one sentence, with nothing else on the way, and within its time.

A fit may take 10 s and 2 s for each 1,000 samples, a diagnosis with two candidates ten times as long. It is processor
time that counts, as a test may share its machine.
"""

from __future__ import annotations

import math
import time
import traceback
import warnings
from dataclasses import dataclass
from typing import Any

from rough_logs import RoughLog

from diagnosis import diagnose, identifiability_warnings
from identification.fit import fit
from identification.fit_result import fit_report, fit_to_dict
from plant.errors import AntidriveError

CANDIDATES = ("coulomb_friction", "torque_offset")
START, A_SAMPLE, TIMES = 10.0, 2e-3, 10.0  # [s], [s], a diagnosis over a fit


@dataclass(frozen=True, kw_only=True)
class Tried:
    """How a fit or a diagnosis of a log ended: `wrong` says what was neither a result nor a sentence."""

    outcome: str
    seconds: float
    allowed: float
    wrong: str | None = None

    @property
    def faults(self) -> tuple[str, ...]:
        """What is against the promise."""
        late = f"took {self.seconds:.0f} s of {self.allowed:.0f} s" if self.seconds > self.allowed else None
        return tuple(filter(None, (self.wrong, late)))


def identified(rough: RoughLog) -> Tried:
    """A fit, its report and what the log cannot show."""

    def work() -> str:
        found = fit(rough.log())
        reported = [fit_to_dict(found), fit_report(found), identifiability_warnings(found), found.initial.tolist()]
        if found.failed is not None:
            return f"failed: {found.failed}"
        _all_finite(reported)
        return "fitted" if not found.unidentifiable else f"fitted, {len(found.unidentifiable)} not told"

    return _tried(work, START + A_SAMPLE * rough.time.size)


def diagnosed(rough: RoughLog) -> Tried:
    """A diagnosis with few candidates, and all that it says."""

    def work() -> str:
        found = diagnose(rough.log(), candidates=CANDIDATES)
        _all_finite([found.to_dict(), found.explain()])
        return found.verdict

    return _tried(work, TIMES * (START + A_SAMPLE * rough.time.size))


def _tried(work: Any, allowed: float) -> Tried:
    begun, wrong = time.process_time(), None
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        try:
            outcome = work()
        except AntidriveError as error:
            outcome = f"sentence: {type(error).__name__}: {error}"
            if "\n" in str(error):
                wrong = "a sentence of several lines"
        except Exception as error:
            last = traceback.extract_tb(error.__traceback__)[-1]
            outcome = "exception"
            wrong = f"{type(error).__name__}: {error} ({last.filename.split('/')[-1]}, {last.name})"
    if seen and wrong is None:
        place = f"{seen[0].filename.split('/')[-1]}:{seen[0].lineno}"
        wrong = f"{seen[0].category.__name__}: {seen[0].message} ({place})"
    return Tried(outcome=outcome, seconds=time.process_time() - begun, allowed=allowed, wrong=wrong)


def _all_finite(content: Any, where: str = "result") -> None:
    """Raise unless every number in nested lists and dictionaries is one; no text says `nan` either."""
    if isinstance(content, dict):
        for name, value in content.items():
            _all_finite(value, f"{where}.{name}")
    elif isinstance(content, list | tuple):
        for value in content:
            _all_finite(value, where)
    elif isinstance(content, float) and not math.isfinite(content):
        raise ArithmeticError(f"{where} is {content}")
    elif isinstance(content, str) and {"nan", "inf"} & set(content.lower().replace("%", " ").split()):
        raise ArithmeticError(f"{where} says {content!r}")
