"""That anything is missing is told before its name is sure; what is found beside a name has to be clear."""

from __future__ import annotations

from functools import lru_cache

import pytest
from machine import Machine, excitation, record

from diagnosis import Diagnosis, diagnose
from diagnosis.explanation.summary import headline
from diagnosis.model_probability import CLEAR, SEEN
from diagnosis.result import Cause


@lru_cache
def found(offset: float, friction: float = 0.0) -> Diagnosis:
    """A torque offset [N m] that the log hardly shows, alone or beside dry friction [N m] that it shows plainly."""
    hidden = {"torque_offset": {"torque": offset}} | ({"coulomb_friction": {"torque": friction}} if friction else {})
    log = record(Machine().hiding(**hidden), excitation(1, duration=30.0), seed=0).log()
    return diagnose(log, candidates=("torque_offset", *(["coulomb_friction"] if friction else [])))


def asked(diagnosis: Diagnosis, round_: int) -> float:
    """Probability of the offset in a round of the search."""
    (offset,) = (c for c in diagnosis.candidates if (c.round, c.effect) == (round_, "torque_offset"))
    return offset.probability


def test_a_first_name_in_doubt_is_told_with_its_doubt() -> None:
    diagnosis = found(1.3e-5)
    assert SEEN < asked(diagnosis, 1) < CLEAR
    assert diagnosis.verdict == "ambiguous"
    (cause,) = diagnosis.causes
    assert cause.effect == "torque_offset"
    assert cause.missing == pytest.approx(asked(diagnosis, 1))
    assert headline(diagnosis) == (
        "The model probably lacks torque offset. "
        f"The probability that any effect is missing is {100 * cause.missing:.3g} %."
    )
    assert f"The probability that no effect is missing is {100 * (1 - cause.missing):.3g} %" in str(diagnosis.explain())


def test_below_the_bar_nothing_is_told() -> None:
    diagnosis = found(1e-5)
    assert 0.5 < asked(diagnosis, 1) < SEEN
    assert (diagnosis.verdict, diagnosis.causes) == ("nothing_missing", ())


def test_a_companion_in_doubt_is_not_added() -> None:
    diagnosis = found(8e-5, friction=0.1)
    assert SEEN < asked(diagnosis, 2) < CLEAR
    assert (diagnosis.verdict, [cause.effect for cause in diagnosis.causes]) == ("named", ["coulomb_friction"])


def test_what_is_missing_is_the_name_and_its_alternatives() -> None:
    cause = Cause(effect="a", probability=0.5, alternatives=(("b", 0.3),), parameters={}, gain=0.0, evidence=1.0)
    assert cause.missing == pytest.approx(0.8)
