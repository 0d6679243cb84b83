"""Which effects of a round are refitted: side by side the same as one after the other."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from diagnosis.round import _PROMISING, _REFITS, _WORTH, _worth_a_refit
from diagnosis.screen import Suspect
from plant.effects import CoulombFriction


def one_by_one(suspects: list[Suspect], promised: dict[str, float], delivered: dict[str, float]) -> list[str]:
    """The rule as it is meant: each suspect is decided when everything before it has been refitted."""
    leader, refitted = max(suspect.evidence for suspect in suspects), []
    for suspect in sorted(suspects, key=lambda suspect: -promised[suspect.name]):
        promise = promised[suspect.name]
        best = max((delivered[name] for name in refitted), default=-np.inf)
        close = suspect.evidence >= _WORTH * leader and len(refitted) < _REFITS
        if promise + float(np.log(suspect.searched)) > _PROMISING and (close or promise > best):
            refitted.append(suspect.name)
    return refitted


numbers = st.floats(-20.0, 100.0)


@given(st.lists(st.tuples(numbers, numbers, numbers, st.sampled_from([1, 10, 1000])), min_size=1, max_size=12))
@settings(max_examples=300, deadline=None)
def test_together_the_same_effects_are_refitted_as_one_by_one(
    drawn: list[tuple[float, float, float, int]],
) -> None:
    start = (CoulombFriction(torque=0.1),)
    suspects = [
        Suspect(name=f"e{k}", evidence=evidence, columns=1, searched=searched, starts=start)
        for k, (evidence, _, _, searched) in enumerate(drawn)
    ]
    promised = {f"e{k}": promise for k, (_, promise, _, _) in enumerate(drawn)}
    delivered = {f"e{k}": value for k, (_, _, value, _) in enumerate(drawn)}
    scores, refits, sizes = dict(promised), {}, []
    for some in _worth_a_refit(suspects, scores, refits, observed=False):  # type: ignore[arg-type]
        sizes.append(len(some))
        for suspect in some:
            refits[suspect.name], scores[suspect.name] = None, delivered[suspect.name]
    assert list(refits) == one_by_one(suspects, promised, delivered)
    assert all(sizes)


def test_the_leaders_come_together() -> None:
    start = (CoulombFriction(torque=0.1),)
    suspects = [Suspect(name=f"e{k}", evidence=50.0 - k, columns=1, searched=1, starts=start) for k in range(3)]
    scores = {suspect.name: suspect.evidence for suspect in suspects}
    first = next(iter(_worth_a_refit(suspects, scores, {}, observed=False)))
    assert [suspect.name for suspect in first] == ["e0", "e1", "e2"]
