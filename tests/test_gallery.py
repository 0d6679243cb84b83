"""The gallery: every effect with its equation, parameters and a picture that shows it, an effect of one's own too."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, replace
from html import unescape

import numpy as np
import pytest
from front_door import antidrive, listing
from test_report import Outline
from test_unknown_causes import Windage

from antidrive.collinearity import absorbed_share, added_torque, collinear_share
from antidrive.equations import forms, kinks, typeset
from antidrive.gallery import bounds, gallery_page, paragraphs, table
from antidrive.provenance import Provenance
from antidrive.signature import Signature, signature
from antidrive.standard_excitation import SAMPLE_TIME, standard_excitation
from plant import catalogue
from plant.effects import CoulombFriction, Effect, QuadraticDrag, Stage
from plant.effects.effect import parameter
from plant.units import printed

PROVENANCE = Provenance.now(["antidrive", "effects"])


@pytest.fixture(scope="module")
def page() -> str:
    return gallery_page(PROVENANCE)


def sections(page: str) -> dict[str, str]:
    """The part of each effect."""
    parts = re.split(r'<section id="(\w+)">', page)[1:]
    return {name: part.split("</section>")[0] for name, part in zip(parts[::2], parts[1::2], strict=True)}


def test_the_page_of_all_effects_is_small(page: str) -> None:
    assert len(page) < 2_000_000


def test_every_effect_has_a_section_with_its_confounded_effects(page: str) -> None:
    found = sections(page)
    assert set(found) == set(catalogue)
    for name, kind in catalogue.items():
        part = unescape(found[name])
        assert kind.title.lower() in part.lower()
        assert f"<b>Shows as:</b> {kind.signature}." in part
        assert "<math" in part
        for spec in kind.parameters():
            row = next(row for row in part.split("<tr>") if f"<td>{spec.meaning}</td>" in row)
            assert f"<td>{spec.name.replace('_', ' ')}</td>" in row
            assert f"<td>{bounds(spec)}</td>" in row
            for axis in kind.axes:
                assert printed(spec.unit_on(axis)) in row
        linked = re.findall(r'href="#(\w+)"', part)
        assert linked == [*kind.contains, *kind.confused_with]
        shares = part.count("Here it could absorb")
        assert shares == len(kind.confused_with) - (
            name == "setpoint_rate_limit"
        )  # a rate limit has no regressors beside a goal
        assert part.count("application/json") == 2


def test_the_page_loads_nothing(page: str) -> None:
    outline = Outline()
    outline.feed(page)
    assert outline.loads
    assert all(link.startswith("#") and link[1:] in catalogue for link in outline.loads)
    assert "http" not in page.split("<script>")[0].replace("http-equiv", "")


@pytest.mark.parametrize("name", catalogue)
def test_every_picture_shows_something(name: str) -> None:
    found = signature(catalogue[name])
    assert found is not None
    assert found.effect.name == name
    for values in (found.change, found.lacking, found.seen):
        assert np.isfinite(values).all()
        assert np.ptp(values) > 1e-4 or name == "torque_offset"
    rms = float(np.sqrt(np.mean(found.lacking**2)))
    spread = found.excitation.motion.torque if found.effect.stage is not Stage.SENSOR else found.without
    assert 0.005 < rms / float(np.std(spread)) < 3.0
    drawn = sections(gallery_page(PROVENANCE, {name: catalogue[name]}))[name] if name == "cogging" else ""
    for text in re.findall(r"application/json\">(.*?)</script>", drawn, re.DOTALL):
        assert all(row["curves"] for row in json.loads(text)["rows"])


@pytest.mark.parametrize(
    ("name", "variable"),
    [
        ("coulomb_friction", "velocity"),
        ("gravity_offset", "angle"),
        ("dead_zone", "torque"),
        ("input_delay", "time"),
        ("torque_offset", "time"),
        ("presliding_hysteresis", "angle"),
        ("payload_change", "time"),
        ("sensor_lag", "velocity"),
    ],
)
def test_a_picture_is_drawn_over_the_informative_variable(name: str, variable: str) -> None:
    found = signature(catalogue[name])
    assert found is not None
    assert found.variable == variable


def seen(kind: type[Effect]) -> Signature:
    found = signature(kind)
    assert found is not None
    return found


def test_what_is_missing_is_the_law_of_the_effect() -> None:
    friction = seen(CoulombFriction)
    slides = np.abs(friction.variables["velocity"]) > 0.05
    level = friction.effect.values[0]
    expected = -level * np.sign(friction.variables["velocity"])
    np.testing.assert_allclose(friction.lacking[slides], expected[slides], rtol=5e-3)
    drag = seen(QuadraticDrag)
    v = drag.variables["velocity"]
    np.testing.assert_allclose(drag.lacking, -drag.effect.values[0] * v * np.abs(v), atol=0.05 * np.ptp(drag.lacking))
    offset = seen(catalogue["gravity_offset"])
    expected = -offset.effect.values[0] * np.sin(offset.variables["angle"])
    np.testing.assert_allclose(offset.lacking, expected, atol=0.02 * np.ptp(offset.lacking))
    disc = seen(catalogue["encoder_eccentricity"])
    np.testing.assert_allclose(disc.lacking, disc.seen - disc.variables["angle"], atol=1e-12)


def test_the_torque_that_is_added_is_that_along_the_path_without() -> None:
    on = standard_excitation(False, CoulombFriction)
    path = on.path
    found = added_torque(CoulombFriction(torque=0.3), on)
    moves = np.minimum(np.abs(path[:-1, 1]), np.abs(path[1:, 1])) > 0.02
    np.testing.assert_allclose(found[moves], -0.3 * np.sign(path[:-1, 1])[moves], rtol=5e-3)
    lag = added_torque(catalogue["sensor_lag"](time_constant=0.05), on)
    steady = np.abs(on.motion.acceleration) < 0.1
    np.testing.assert_allclose(lag[steady], -0.05 * on.motion.velocity[steady], atol=5e-3)


def test_a_special_case_is_adopted_whole_other_effects_are_not() -> None:
    for name in ("stribeck_friction", "asymmetric_friction"):
        assert collinear_share(CoulombFriction, catalogue[name]) > 0.99
    assert collinear_share(catalogue["asymmetric_friction"], CoulombFriction) < 0.5
    assert collinear_share(catalogue["periodic_disturbance"], catalogue["cogging"]) < 0.5
    assert collinear_share(catalogue["setpoint_rate_limit"], catalogue["rate_limit"]) is None
    assert absorbed_share(*((s := seen(CoulombFriction)).effect, s.excitation)) > 0.9
    assert absorbed_share(*((s := seen(catalogue["compliance"])).effect, s.excitation)) < 0.5


@pytest.mark.parametrize("name", catalogue)
def test_a_typical_effect_shows_in_a_motion_and_keeps_its_bounds(name: str) -> None:
    kind = catalogue[name]
    motion = standard_excitation(name == "setpoint_rate_limit", kind).motion
    effect = kind.typical(motion)
    assert isinstance(effect, kind)
    doubled = kind.typical(replace(motion, torque=2.0 * motion.torque, command=2.0 * motion.command))
    if name in ("coulomb_friction", "quadratic_drag", "cogging", "gravity_offset"):
        assert doubled.values[0] == pytest.approx(2.0 * effect.values[0])


def test_waves_are_drawn_with_eight_periods() -> None:
    motion = standard_excitation(False, catalogue["cogging"]).motion
    assert catalogue["cogging"].typical(motion).order * np.ptp(motion.angle) == pytest.approx(16 * np.pi)
    assert catalogue["periodic_disturbance"].typical(motion).frequency * np.ptp(motion.time) == pytest.approx(8.0)
    assert catalogue["encoder_eccentricity"].typical(motion).order == 1.0


def test_forms_follow_from_the_equations() -> None:
    assert kinks(catalogue["dead_zone"](half_width=0.1)) == ("minimum", "maximum")
    assert kinks(catalogue["actuator_lag"](time_constant=0.1)) == ()
    assert kinks(QuadraticDrag(drag=0.1)) == ("absolute value",)
    assert forms(CoulombFriction(torque=0.1)).startswith("Exact form")
    assert "(absolute value)" in forms(catalogue["asymmetric_friction"](forward=0.1, backward=0.1))
    assert forms(catalogue["gravity_offset"](beta=0.1)).startswith("Smooth as it stands")
    assert "(minimum, maximum)" in forms(catalogue["torque_saturation"](limit=1.0))


@dataclass(frozen=True, kw_only=True)
class Ghost(Effect):
    """An effect of `one's own` <b>that</b> says nothing."""

    name = "ghost"
    title = "<i>ghost</i>"
    stage = Stage.SENSOR
    equation = r"x_a_b"
    signature = "nothing & nothing"
    confused_with = ("windage", "cogging")
    axes = ("linear",)

    size: float = parameter("{torque}", "how much", lower=-1.0, upper=2.0)

    @classmethod
    def regressors(cls, motion):
        return iter(())


def test_an_effect_of_ones_own_gets_its_part() -> None:
    found = sections(gallery_page(PROVENANCE, {"windage": Windage, "ghost": Ghost}))
    assert found["windage"].count("application/json") == 2
    assert "N m s^3/rad^3 or N s^3/m^3" in found["windage"]
    assert Windage.signature in found["windage"]
    assert "Smooth as it stands" in found["windage"]
    ghost = found["ghost"]
    assert "It has no signature under this excitation." in ghost
    assert "application/json" not in ghost
    assert "<code>one&#39;s own</code> &lt;b&gt;that&lt;/b&gt;" in ghost
    assert "<code>x_a_b</code>" in ghost
    assert "<i>ghost" not in ghost
    assert "<td>N</td><td>-1 to 2</td>" in ghost
    assert re.findall(r'href="#(\w+)"', ghost) == ["windage"]


def test_an_effect_of_a_linear_axis_is_shown_on_one() -> None:
    sled = type("Sled", (Windage,), {"name": "sled", "axes": ("linear",), "__doc__": "A sled."})
    found = seen(sled)
    assert (found.excitation.model.axis, found.excitation.model.gravity) == ("linear", 0.0)
    assert found.lacking.std() > 0.0


def test_equations_are_printed_by_the_browser_itself() -> None:
    printed = typeset(r"J \ddot x = \tau - K \dot x")
    assert printed.startswith("<math")
    assert "http" not in printed


def test_the_command_lists_describes_and_draws(monkeypatch, tmp_path) -> None:
    monkeypatch.chdir(tmp_path)
    result = antidrive("effects", "cogging")
    assert result.code == 0
    assert result.out.startswith("Cogging (load)\n" + paragraphs(catalogue["cogging"])[0])
    assert "  amplitude [N m or N], from 0: amplitude A\n" in result.out
    assert "  confused with: encoder_eccentricity, gravity_offset\n" in result.out
    assert listing(tmp_path) == {}
    reported = json.loads(antidrive("effects", "dead_zone", "--json").out)["effects"]
    assert [entry["name"] for entry in reported] == ["dead_zone"]
    assert reported[0]["parameters"] == [
        {"name": "half_width", "meaning": "half width gamma", "unit": "N m", "lower": 0.0, "upper": None}
    ]
    unknown = antidrive("effects", "stiktion")
    assert (unknown.code, unknown.out) == (2, "")
    assert "'stiktion' is no effect" in unknown.err


def test_without_a_name_the_gallery_is_written(monkeypatch, tmp_path) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("antidrive.gallery.gallery_page", lambda provenance, progress: f"page of {provenance.command}")
    result = antidrive("effects")
    assert result.code == 0
    assert result.out == f"{table()}\nWritten to antidrive-out: gallery.html\n"
    assert all(f"{name} " in result.out for name in catalogue)
    assert listing(tmp_path) == {"antidrive-out/gallery.html": b"page of antidrive effects"}
    antidrive("effects", "cogging", "--out", tmp_path / "two", "--quiet")
    assert list(listing(tmp_path / "two")) == ["gallery.html"]


def test_a_bench_contains_what_it_states() -> None:
    for servo in (False, True):
        motion = standard_excitation(servo, CoulombFriction).motion
        assert motion.sample_time == pytest.approx(SAMPLE_TIME)
        assert np.ptp(motion.angle) < 2 * np.pi  # it never goes over the top, beyond which small things grow large
        assert bool(np.any(motion.servo_gain)) == servo
    assert standard_excitation(False, CoulombFriction) is standard_excitation(False, QuadraticDrag)
    assert standard_excitation(False, catalogue["dead_zone"]).model.effects == ()
