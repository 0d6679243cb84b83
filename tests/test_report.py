"""The report: one file, offline, escaped, thinned without losing a spike; words that say what the numbers say."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from sample_pages import HOSTILE, sample_diagnosis, sample_fit

from antidrive.downsampling import LIMIT, downsample
from antidrive.html_page import printed
from antidrive.output import to_json
from antidrive.provenance import Provenance
from antidrive.report import diagnosis_page, fit_page
from diagnosis.explanation.summary import headline, sentences
from diagnosis.explanation.wording import measured, percent
from identification import free_simulation


@pytest.fixture(scope="module")
def fitted():
    return sample_fit()


@pytest.fixture(scope="module")
def diagnosis(fitted):
    return sample_diagnosis(fitted)


@pytest.fixture(scope="module")
def page(diagnosis):
    return diagnosis_page(diagnosis, Provenance.now(["antidrive", "diagnose", HOSTILE], diagnosis.base.log.sources))


class Outline(HTMLParser):
    """Headings, visible text and what a page would load."""

    def __init__(self) -> None:
        super().__init__()
        self.inside: list[str] = []
        self.headings: list[str] = []
        self.text: list[str] = []
        self.loads: list[str] = []
        self.figures: list[str] = []

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.loads += [given[key] for key in ("src", "href") if key in given]
        if tag == "script":
            self.inside.append("figure" if given.get("type") == "application/json" else "script")
        elif tag in ("style", "h1", "h2", "b"):
            self.inside.append(tag)

    def handle_endtag(self, tag):
        if tag in ("script", "style", "h1", "h2", "b"):
            self.inside.pop()

    def handle_data(self, data):
        where = self.inside[-1] if self.inside else ""
        if where == "figure":
            self.figures.append(data)
        elif where in ("h1", "h2"):
            self.headings.append(data)
        elif where not in ("script", "style"):
            self.text.append(data)


@pytest.fixture(scope="module")
def outline(page):
    outline = Outline()
    outline.feed(page)
    return outline


def test_the_page_reads_from_verdict_to_reproduction(outline):
    assert outline.headings == [
        "The model lacks Coulomb friction.",
        "Measured and simulated",
        "Residual torque",
        "Explanations",
        "Missing effects",
        "Validation error",
        "Parameters of the extended model",
        "Effects that are not named",
        "The data",
        "How to reproduce",
    ]
    text = " ".join(outline.text).replace("\N{NO-BREAK SPACE}", " ")
    for expected in (r"0\.05 rad", r"0\.01 rad", r"0\.001000 ± 0\.0\d+ rad", "97 %", "inertia", "kg m 2"):
        assert re.search(expected, text), expected
    assert re.search(r"[0-9a-f]{64}", text)


def test_the_page_loads_nothing_and_runs_nothing_of_the_user(page, outline):
    assert outline.loads == []
    assert "@import" not in page.split("<script>")[0]
    assert "alert(1)</script>" not in page
    assert page.count("<script>") == 1
    assert HOSTILE in "".join(outline.text)


def test_the_error_of_a_simulation_has_its_standard_error(diagnosis):
    rng = np.random.default_rng(0)
    (replay,) = diagnosis.replays
    samples = 4000
    missed = 0.01 * rng.standard_normal(samples)
    noisy = replace(
        replay,
        time=0.01 * np.arange(samples),
        measured=missed,
        before=np.zeros(samples),
        after=0.9 * missed,
        valid=np.ones(samples, dtype=bool),
    )
    lead = diagnosis_page(replace(diagnosis, replays=(noisy,)), Provenance.now([])).split("<h2>")[0]
    text = re.findall(r"<b>(\S+) ± (\S+) (µ?)rad</b>", lead.replace("\N{NO-BREAK SPACE}", " "))
    sizes, errors = ([float(pair[k]) * (1e-6 if pair[2] else 1.0) for pair in text] for k in (0, 1))
    assert sizes == pytest.approx([0.05, 0.01, 0.001])  # as the diagnosis says them
    # of the rms of white noise: sigma / sqrt(2 N)
    white = [level / np.sqrt(2 * samples) for level in (0.01, 0.001)]
    assert errors == pytest.approx([*white, 0.001 / np.sqrt(2 * diagnosis.extended.samples)], rel=0.5)


def test_numbers_keep_the_digits_that_their_error_leaves():
    assert measured(0.18712, 0.0153, "rad") == "0.187 ± 0.015 rad"
    assert measured(7.93e-5, 6.8e-6, "rad") == "79 ± 7 µrad"
    assert measured(-5.422e-8, 2.4e-10, "m") == "-54.22 ± 0.24 nm"
    assert measured(218123.0, 18345.0, "N/m") == "218000 ± 18000 N/m"
    assert measured(3.21e-7, 4e-8, "N m") == "(3.2 ± 0.4)e-07 N m"
    assert measured(0.0, 0.3) == "0.0 ± 0.3"
    assert [measured(0.18712, std, "s") for std in (None, 0.0, np.inf)] == ["0.187 s"] * 3
    assert percent(0.788, 0.0268) == "78.8 ± 2.7 %"
    assert percent(0.9999, 0.1) == "> 99.9 %"


def test_a_linear_axis_lacks_a_force(diagnosis):
    lacked = replace(diagnosis.residual_before, unit="N")
    for unit, there, absent in (("N m", "torque", "force"), ("N", "force", "torque")):
        changed = replace(
            diagnosis, residual_before=replace(lacked, unit=unit), residual_after=replace(lacked, unit=unit)
        )
        lives = sections(diagnosis_page(changed, Provenance.now(["antidrive"])))[f"Residual {there}"]
        assert f"residual {there} [{unit}]" in lives
        assert f"the variance of the residual {there} of the base model" in lives
        assert f"residual {absent}" not in lives
        assert f"Relative {there} error" in sentences(changed)[4]


def test_words_look_as_in_print():
    assert printed("e^-5.3 to 1, F_c -> 2 kg m^2 <b>") == (
        "e<sup>-5.3</sup> to 1, F<sub>c</sub> → 2\N{NO-BREAK SPACE}kg m<sup>2</sup> &lt;b&gt;"
    )
    assert printed("0.063 N m at 4 rad/s, 5 % of 3 more") == "0.063_N_m at 4_rad/s, 5_% of 3 more".replace(
        "_", "\N{NO-BREAK SPACE}"
    )
    assert printed("1 +- 0.2") == "1_±_0.2".replace("_", "\N{NO-BREAK SPACE}")
    assert printed("cogging_amplitude") == "cogging_amplitude"
    assert printed("(3.2 ± 0.4)e-07, 1e+06, 3e5") == "(3.2_±_0.4) × 10<sup>-7</sup>, 1 × 10<sup>6</sup>, 3e5".replace(
        "_", "\N{NO-BREAK SPACE}"
    )


def sections(page: str) -> dict[str, str]:
    """The text below each second heading, tags taken out, figures left in."""
    return {part.split("<", 1)[0]: re.sub(r"</?[a-z][^>]*>", "|", part) for part in page.split("<h2>")[1:]}


def sized(fit, size, **flags):
    """The fit with another number and flags in its first line."""
    return replace(fit, parameters=(replace(fit.parameters[0], value=size, **flags), *fit.parameters[1:]))


def unbroken(text: str) -> str:
    """With plain spaces and signs."""
    return text.replace("\N{NO-BREAK SPACE}", " ").replace("\N{MINUS SIGN}", "-")


def test_every_section_shows_its_own_numbers(diagnosis):
    changed = replace(
        diagnosis,
        base=sized(replace(diagnosis.base, log=replace(diagnosis.base.log, repairs=("a repair",))), 11.25),
        extended=sized(diagnosis.base, 22.5),
        warnings=("a repair", "a warning"),
    )
    found = sections(diagnosis_page(changed, Provenance.now(["antidrive"])))
    parameters = found["Parameters of the extended model"]
    std = diagnosis.base.parameters[0].std
    assert measured(22.5, std, "kg m^2").split(" kg")[0] in parameters.replace("\N{NO-BREAK SPACE}", " ")
    assert "11.25" not in parameters
    assert "it costs more than it explains (log Bayes factor -3.2)" in unbroken(found["Effects that are not named"])
    assert "Input delay" in found["Effects that are not named"]
    assert found["The data"].count("a repair") == 1
    assert found["The data"].count("a warning") == 1
    sets = unbroken(found["Explanations"])
    assert [sets.count(f"|{share} %|") for share in (97, 2, 1)] == [1, 1, 1]
    places = [sets.index(f"|{name}|") for name in ("Coulomb friction", "Stribeck friction", "nothing more")]
    assert places == sorted(places)


def test_curves_after_are_drawn_only_if_there_is_an_extension(diagnosis):
    extended = sections(diagnosis_page(diagnosis, Provenance.now(["antidrive"])))
    alone = replace(diagnosis, extended=diagnosis.base)
    before = sections(diagnosis_page(alone, Provenance.now(["antidrive"])))
    assert "Parameters of the base model" in before
    named = '"name":"extended model"'
    assert extended["Residual torque"].count(named) == len(diagnosis.residual_after.curves) > 0
    assert named not in before["Residual torque"]


def test_the_worst_runs_are_drawn(diagnosis):
    (replay,) = diagnosis.replays
    valid = replay.valid & (np.arange(replay.valid.size) > 10)
    runs = [
        # a masked sample may miss by anything
        replace(replay, label=f"run {miss}", valid=valid, before=replay.measured + np.where(valid, miss, 1e3))
        for miss in (0.2, 0.1, 0.4, 0.3)
    ]
    spoilt = replace(runs[1], before=np.where(valid, runs[1].before, 1e9))
    page = sections(diagnosis_page(replace(diagnosis, replays=(runs[0], spoilt, *runs[2:])), Provenance.now([])))
    assert re.findall(r"run 0\.\d", page["Measured and simulated"])[:3] == ["run 0.4", "run 0.3", "run 0.2"]
    assert "1 more run with smaller errors is not drawn" in page["Measured and simulated"]


def test_a_fit_draws_its_worst_runs_and_flags_its_parameters(fitted):
    run = fitted.log.runs[0]
    misses = {"small": 0.1, "large": 0.4, "least": 0.0, "middle": 0.2}
    runs = tuple(replace(run, label=label) for label in misses)
    many = sized(replace(fitted, log=replace(fitted.log, runs=runs)), 1.5, at_bound=True)
    page = sections(fit_page(many, [run.output + miss for miss in misses.values()], Provenance.now(["antidrive"])))
    drawn = re.findall(r"\|(small|large|least|middle)\|", page["Measured and simulated"])
    assert drawn == ["large", "middle", "small"]
    assert page["Parameters"].count("at bound") == 1
    assert "fixed" not in page["Parameters"]
    held = fit_page(sized(fitted, 1.5, fixed=True), [run.output], Provenance.now(["antidrive"]))
    assert sections(held)["Parameters"].count("fixed") == 1
    assert "at bound" not in sections(held)["Parameters"]


def test_figures_are_json_of_few_points(outline):
    assert len(outline.figures) >= 7
    curves = [curve for text in outline.figures for row in json.loads(text)["rows"] for curve in row["curves"]]
    assert len(curves) > len(outline.figures)
    assert all(0 < len(curve["x"]) == len(curve["y"]) <= LIMIT + 2 for curve in curves)


def test_a_page_is_small_whatever_the_length_of_its_log(diagnosis):
    (replay,) = diagnosis.replays
    time = np.linspace(0.0, 600.0, 600_000)
    wave = np.sin(time)
    longer = {"time": time, "measured": wave, "before": 0.9 * wave, "after": 0.99 * wave, "valid": time >= 0.0}
    long = replace(replay, **longer)
    page = diagnosis_page(replace(diagnosis, replays=(long,) * 3), Provenance.now(["antidrive"]))
    assert len(page) < 1e6


@pytest.mark.parametrize("verdict", ["nothing_missing", "unknown"])
def test_a_page_without_causes_is_complete_too(diagnosis, verdict):
    bare = replace(diagnosis, verdict=verdict, causes=(), gain=None, extended=diagnosis.base, replays=())
    text = diagnosis_page(bare, Provenance.now(["antidrive"]))
    assert headline(bare) in text
    assert "Missing effects" not in text


def test_a_fit_has_its_page(fitted):
    page = fit_page(fitted, free_simulation(fitted.log, fitted.model), Provenance.now(["antidrive"]))
    outline = Outline()
    outline.feed(page)
    assert outline.headings == [
        "4 parameters fitted",
        "Parameters",
        "Measured and simulated",
        "The data",
        "How to reproduce",
    ]


def test_words_state_the_probability(diagnosis):
    cause, minor, unknown, gain, torque, left = sentences(diagnosis)
    floor = measured(0.001, 0.001 / np.sqrt(2 * diagnosis.extended.samples), "rad")
    assert cause == (
        "Coulomb friction: probability 97 %, evidence decisive (log Bayes factor 321); torque 0.400 ± 0.010 N m; "
        "0.35 N m rms."
    )
    assert minor == ("Minor: cogging (0.002 N m rms), no larger than the unexplained torque; it may be a part of that.")
    assert unknown == "Unexplained: about 2 % of the torque in the log; it depends on velocity."
    assert gain == (
        "On the validation run the simulation error falls from 0.05 rad to 0.01 rad rms (80 %); "
        f"the noise floor is {floor}."
    )
    assert torque == (
        "Relative torque error of the inverse model (below 5 Hz): "
        "18.0 ± 1.0 % -> 4.00 ± 0.20 % on the estimation data, 19.0 ± 1.0 % -> 6.0 ± 0.4 % on validation data."
    )
    assert left == "2 % of the error power remains unexplained; it depends on velocity."
    cause = replace(diagnosis.causes[0], probability=0.6, alternatives=(("stribeck_friction", 0.39),))
    torn = replace(diagnosis, verdict="ambiguous", causes=(cause,))
    assert headline(torn) == (
        "The model lacks Coulomb friction; this log does not show whether it is Stribeck friction."
    )
    delayed = replace(diagnosis.causes[0], effect="input_delay", alternatives=())
    assert headline(replace(torn, causes=(delayed, cause))) == (
        "The model lacks input delay and Coulomb friction; this log does not show whether the Coulomb friction is "
        "Stribeck friction."
    )
    less = replace(cause, alternatives=(("stribeck_friction", 0.2),))
    assert headline(replace(torn, causes=(less,))) == (
        "The model probably lacks Coulomb friction or Stribeck friction; this log does not show which."
    )
    wider = replace(cause, effect="presliding_hysteresis", alternatives=(("coulomb_friction", 0.2), ("cogging", 0.2)))
    assert headline(replace(torn, causes=(wider,))) == (
        "The model probably lacks presliding hysteresis, Coulomb friction or cogging; this log does not show which."
    )
    both = replace(torn, causes=(diagnosis.causes[0], replace(cause, effect="cogging")))
    assert headline(both) == (
        "The model lacks Coulomb friction. It also probably lacks cogging or Stribeck friction; this log does not show "
        "which."
    )
    lost = replace(diagnosis, verdict="unknown", causes=())
    assert headline(lost).endswith("explains; it depends on velocity.")


def test_an_observer_that_takes_over_is_not_called_nothing(diagnosis):
    still, held = (replace(diagnosis.base, bandwidth=bandwidth) for bandwidth in (0.0, 12.0))
    bare = replace(diagnosis, verdict="nothing_missing", causes=(), base=still, extended=still)
    assert headline(bare) == "No effect is missing: noise accounts for the remaining error."
    pushed = headline(replace(bare, base=held, extended=held))
    assert "random disturbance" in pushed
    assert "twice" in pushed


def test_nothing_is_certain_and_nothing_impossible():
    assert [percent(p) for p in (1.0, 0.9999, 0.5, 0.001, 0.0)] == ["> 99.9 %", "> 99.9 %", "50 %", "0.1 %", "< 0.1 %"]


@given(arrays(np.float64, st.integers(1, 30_000), elements=st.just(0.0)), st.data())
@settings(max_examples=40, deadline=None)
def test_thinning_keeps_ends_and_spikes(values, data):
    place = data.draw(st.integers(0, values.size - 1))
    values[place] = data.draw(st.sampled_from([-5.0, 7.0]))
    kept = downsample(values)
    assert kept.size <= LIMIT
    assert kept[0] == 0
    assert kept[-1] == values.size - 1
    assert (np.diff(kept) > 0).all()
    assert place in kept


def test_thinning_keeps_a_long_gap_open():
    values = np.sin(np.linspace(0.0, 50.0, 100_000))
    values[40_000:60_000] = np.nan
    kept = downsample(values)
    inside = kept[(kept > 41_000) & (kept < 59_000)]
    assert inside.size > 0
    assert np.isnan(values[inside]).all()


@given(st.recursive(st.floats() | st.text(max_size=5), lambda inner: st.lists(inner, max_size=4), max_leaves=8))
@settings(deadline=None)
def test_json_is_strict_whatever_the_numbers(content):
    def refuse(constant):
        raise AssertionError(constant)

    json.loads(to_json({"content": content, "array": np.array([1.0, np.nan, np.inf])}), parse_constant=refuse)


def test_str_is_the_command_line_text_and_repr_is_one_line(fitted, diagnosis):
    first, *others = str(diagnosis).splitlines()
    assert first == headline(diagnosis)
    assert [line.strip() for line in others] == [*sentences(diagnosis), *diagnosis.warnings]
    assert repr(diagnosis) == f"Diagnosis(named: {headline(diagnosis)})"
    assert repr(fitted).startswith("Fit(inertia=0.7999, gravity=0.5999, ")
    assert repr(fitted).endswith(f"; {fitted.log!r})")


def test_the_headline_reports_what_is_uncertain(diagnosis):
    (minor,) = diagnosis.minor
    doubt = replace(diagnosis, verdict="ambiguous", minor=(replace(minor, probability=0.3),))
    assert headline(doubt) == (
        "The model lacks Coulomb friction. It may also lack cogging; the unexplained torque is about as large."
    )


def test_the_headline_reports_what_is_about_even(diagnosis):
    likeliest = diagnosis.sets[0]
    open_sets = (
        replace(likeliest, effects=("coulomb_friction",), probability=0.55),
        replace(likeliest, effects=("coulomb_friction", "payload_change"), probability=0.3),
        replace(likeliest, effects=("coulomb_friction", "stribeck_friction"), probability=0.15),
    )
    doubt = replace(diagnosis, verdict="ambiguous", minor=(), sets=open_sets)
    assert headline(doubt) == (
        "The model lacks Coulomb friction. It may also lack payload change (probability 30 %); "
        "this log does not show whether it does."
    )


def test_of_many_improbable_effects_each_is_reported(diagnosis):
    others = ("backlash", "compliance", "end_stop", "payload_change", "rate_limit", "sensor_lag")
    sets = [replace(diagnosis.sets[0], effects=("coulomb_friction",), probability=0.46)]
    sets += [replace(sets[0], effects=("coulomb_friction", name), probability=0.09) for name in others]
    text = headline(replace(diagnosis, verdict="ambiguous", minor=(), sets=tuple(sets)))
    assert "It may also lack backlash (probability 9 %), " in text
    assert text.count("(probability 9 %)") == len(others)


@pytest.mark.parametrize(
    ("alone", "where"), [("From 1 to 2 s ...", "it shows in the validation data alone"), (None, "it depends on angle")]
)
def test_the_headline_reports_more_unexplained_than_named(diagnosis, alone, where):
    left = replace(diagnosis.unexplained, depends_on=("angle",))
    more = replace(diagnosis, verdict="unknown", only_in_validation=alone, unexplained=left)
    assert headline(more) == f"The model lacks Coulomb friction. More of its error is explained by no effect; {where}."
