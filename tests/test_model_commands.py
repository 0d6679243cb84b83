"""The commands that hand a model to a drive or a simulator."""

from __future__ import annotations

import json

from front_door import TRUTH, antidrive, listing, write_model

from plant import feedforward_code


def test_export_feedforward_writes_the_code(tmp_path):
    model, out = write_model(tmp_path / "model.json", TRUTH), tmp_path / "out"
    result = antidrive("export", model, "--feedforward", "--single", "--out", out)
    assert result.code == 0, result.err
    assert listing(out) == {n: t.encode() for n, t in feedforward_code(TRUTH, single=True).files.items()}
    assert result.out.splitlines()[0] == (
        "Feedforward [N m] in single precision: inertia, gravity, viscous_friction, dead_zone, coulomb_friction."
    )
    reported = json.loads(antidrive("export", model, "--feedforward", "--out", out, "--json").out)
    assert reported["precision"] == "double"
    assert sorted(reported["files"]) == sorted(listing(out))


def test_export_feedforward_reports_what_is_wrong(tmp_path):
    result = antidrive("export", tmp_path / "absent.json", "--feedforward", "--out", tmp_path / "out")
    assert (result.code, result.err.count("\n")) == (2, 1)
    assert "cannot be read" in result.err
    assert listing(tmp_path) == {}
