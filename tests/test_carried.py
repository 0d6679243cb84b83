"""What is carried without a name: how much a second must bring, whose place it takes, and where it is refused."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from diagnosis import curves
from diagnosis.curves import Carried, beside_unnamed, carried
from plant.effects.varying import FrictionOverTurn

BASE, FIRST, SECOND = (SimpleNamespace(name=name) for name in ("base", "first", "second"))


@pytest.mark.parametrize(("brings", "kept"), [(19.0, 1), (21.0, 2)])
def test_a_second_must_bring_a_fifth_of_what_the_first_did(
    monkeypatch: pytest.MonkeyPatch, brings: float, kept: int
) -> None:
    following = {"base": FIRST, "first": SECOND}
    rises = {("first", "base"): 100.0, ("second", "first"): brings}
    monkeypatch.setattr(curves, "_one_more", lambda at, kinds: following[at.name])
    monkeypatch.setattr(curves, "evidence_of", lambda after, before: rises[after.name, before.name])
    assert len(curves.nameless(BASE)) == kept  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("fast", "worth", "taken"), [(False, 111.0, SECOND), (False, 109.0, FIRST), (True, 500.0, FIRST)]
)
def test_what_is_richer_must_say_clearly_more_and_leave_no_work_for_a_fast_observer(
    monkeypatch: pytest.MonkeyPatch, fast: bool, worth: float, taken: Any
) -> None:
    fit: Any = SimpleNamespace(bandwidth=5.0)
    monkeypatch.setattr(curves, "unnamed_dependence", lambda at: ((None, 50.0),))
    monkeypatch.setattr(curves, "_path", lambda at, kinds: (FIRST,) if kinds is curves.plain else (SECOND,))
    monkeypatch.setattr(curves, "follows_anything", lambda at: fast)
    monkeypatch.setattr(curves, "charged", lambda path, than: 100.0 if path == (FIRST,) else worth)
    assert carried(fit).path == (taken,)


def test_a_name_that_does_not_pay_beside_it_goes(monkeypatch: pytest.MonkeyPatch) -> None:
    def fit(*names: str) -> Any:
        model = SimpleNamespace(names=names, without_effect=lambda gone: [name for name in names if name != gone])
        return SimpleNamespace(model=model)

    near, true = (SimpleNamespace(effect=name, evidence=10.0, fit=fit(name)) for name in ("near", "true"))
    monkeypatch.setattr(curves, "carried", lambda at: Carried(path=(fit("near", "true", "curve"),), seen=()))
    monkeypatch.setattr(curves, "fitted_near", lambda at, names: fit(*names))
    monkeypatch.setattr(curves, "needed_with", lambda addition, at, less: 0.96 if addition.effect == "true" else 0.94)
    monkeypatch.setattr(curves, "refitted", lambda base, kept, at: kept)
    additions, beside = beside_unnamed(fit(), (near, true))  # type: ignore[arg-type]
    assert [addition.effect for addition in additions] == ["true"]
    assert beside.path[-1].model.names == ("true", "curve")


def test_varying_friction_begins_where_none_of_it_is_cut_off() -> None:
    heights = np.array([0.1, -0.2, 0.0, 0.3, 0.1, 0.0, -0.1, 0.2, 0.0])
    begun = FrictionOverTurn.begun(heights)
    assert begun.min() == 0.0
    assert np.ptp(begun) == pytest.approx(np.ptp(heights))
    assert FrictionOverTurn.begun(np.abs(heights)) == pytest.approx(np.abs(heights))
