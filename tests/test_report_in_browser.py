"""Reports in a real browser: they open offline without an error, their plots react, on a phone and on paper too."""

from __future__ import annotations

import re

import pytest
from browser import Reader, chromium
from sample_pages import sample_diagnosis, sample_fit

from antidrive.gallery import gallery_page
from antidrive.prediction import predict
from antidrive.prediction_page import prediction_page
from antidrive.provenance import Provenance
from antidrive.report import diagnosis_page, experiment_page, fit_page
from antidrive.scenario_file import read_scenario_file
from identification import free_simulation
from plant.effects import Cogging, CoulombFriction

PHONE = {"viewport": {"width": 400, "height": 800}, "has_touch": True, "is_mobile": True}
RANGE = "[+document.querySelector('.plot').dataset.from, +document.querySelector('.plot').dataset.to]"
# Words of a plot that reach over its edge, and plots that reach over the edge of the page.
CUT = """[...document.querySelectorAll('.plot')].flatMap(plot => {
    const edge = plot.getBoundingClientRect();
    const over = box => Math.max(
        edge.left - box.left, box.right - edge.right, edge.top - box.top, box.bottom - edge.bottom) > 1;
    const words = [...plot.querySelectorAll('text, .ytitle, .xtitle, .key')].filter(text => text.textContent.trim());
    const page = document.querySelector('main').getBoundingClientRect();
    return [...words.filter(text => over(text.getBoundingClientRect())).map(text => text.textContent),
            ...(edge.right > page.right + 1 ? ['the plot itself'] : [])];
})"""
CONTRAST = """(() => {
    const light = colour => {
        const part = colour.match(/[\\d.]+/g).slice(0, 3).map(c => c / 255)
            .map(c => c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);
        return 0.2126 * part[0] + 0.7152 * part[1] + 0.0722 * part[2];
    };
    const ground = light(getComputedStyle(document.body).backgroundColor);
    const inks = [...document.querySelectorAll('p, td, .xtitle, .ytitle, .key, .plot text')].map(
        e => light(e.matches('text') ? getComputedStyle(e).fill : getComputedStyle(e).color));
    return [ground, Math.min(...inks.map(ink => (Math.max(ink, ground) + 0.05) / (Math.min(ink, ground) + 0.05)))];
})()"""


@pytest.fixture(scope="module")
def browser():
    with chromium() as started:
        yield started


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    folder, fitted = tmp_path_factory.mktemp("pages"), sample_fit()
    how = Provenance.now(["antidrive", "diagnose", "x" * 90], fitted.log.sources)
    written = {
        "diagnosis": diagnosis_page(sample_diagnosis(fitted), how),
        "fit": fit_page(fitted, free_simulation(fitted.log, fitted.model), how),
        "experiment": experiment_page(read_scenario_file("figure6").run(None, 0), how),
        "prediction": prediction_page(predict(fitted.model, fitted.log), how),
        "gallery": gallery_page(how, {kind.name: kind for kind in (Cogging, CoulombFriction)}),
    }
    for name, text in written.items():
        (folder / f"{name}.html").write_text(text, encoding="utf-8")
    return {name: folder / f"{name}.html" for name in written}


KINDS = ("diagnosis", "fit", "prediction", "experiment", "gallery")


@pytest.mark.parametrize("kind", KINDS)
def test_it_opens_without_an_error_and_asks_for_nothing(browser, pages, kind):
    with Reader(browser, pages[kind]) as reader:
        assert reader.messages == []
        assert reader.requested == [pages[kind].as_uri()]
        assert reader.ask("document.querySelectorAll('.plot').length") >= 1
        assert reader.ask("[...document.querySelectorAll('math')].every(m => m.getBoundingClientRect().height > 10)")
        assert reader.ask(CUT) == []


def test_a_plot_zooms_and_comes_back(browser, pages):
    with Reader(browser, pages["diagnosis"], viewport={"width": 1100, "height": 900}) as reader:
        low, high = reader.ask(RANGE)
        reader.page.locator(".plot .inside").first.scroll_into_view_if_needed()
        box = reader.page.locator(".plot .inside").first.bounding_box()
        mouse, middle = reader.page.mouse, box["y"] + box["height"] / 2
        mouse.move(box["x"] + 0.25 * box["width"], middle)
        mouse.down()
        mouse.move(box["x"] + 0.5 * box["width"], middle, steps=4)
        mouse.up()
        reader.page.wait_for_function(f"{RANGE}[0] > {low + 0.1 * (high - low)}")
        assert reader.ask(RANGE) == pytest.approx(
            [low + 0.25 * (high - low), low + 0.5 * (high - low)], abs=0.02 * (high - low)
        )
        mouse.dblclick(box["x"] + 0.5 * box["width"], middle)
        reader.page.wait_for_function(f"{RANGE}[0] < {low + 0.1 * (high - low)}")
        assert reader.ask(RANGE) == pytest.approx([low, high])


@pytest.mark.parametrize("kind", KINDS)
def test_it_reads_well_on_a_phone(browser, pages, kind):
    with Reader(browser, pages[kind], **PHONE) as reader:
        assert reader.ask("document.documentElement.scrollWidth") == 400
        assert reader.ask(CUT) == []
        tables = "[...document.querySelectorAll('section > .wide, .pair > .wide')]"
        assert reader.ask(f"{tables}.filter(table => table.scrollWidth > table.clientWidth).length") == 0
        assert reader.ask("[...document.querySelectorAll('.tile')].every(t => t.scrollWidth <= t.clientWidth)")
        # a finger on a plot scrolls the page
        assert reader.ask("getComputedStyle(document.querySelector('.plot')).touchAction") == "pan-y"


@pytest.mark.parametrize("kind", ["diagnosis", "fit"])
def test_words_stand_out_by_day_and_by_night(browser, pages, kind):
    with Reader(browser, pages[kind], color_scheme="light") as reader:
        ground, contrast = reader.ask(CONTRAST)
        assert ground > 0.9
        assert contrast > 4.5
        ink = "getComputedStyle(document.querySelector('.plot text')).fill"
        day = reader.ask(ink)
        reader.page.emulate_media(color_scheme="dark")
        reader.page.wait_for_function(f"{ink} != '{day}'")
        ground, contrast = reader.ask(CONTRAST)
        assert ground < 0.02
        assert contrast > 4.5


@pytest.mark.parametrize(("scheme", "width"), [("light", 1300), ("dark", 1300), ("light", 400)])
def test_on_paper_nothing_is_cut_and_words_keep_their_size(browser, pages, scheme, width):
    with Reader(browser, pages["diagnosis"], color_scheme=scheme, viewport={"width": width, "height": 900}) as reader:
        paper = reader.page.pdf(format="A4")
        assert len(re.findall(rb"/Type\s*/Page\b", paper)) in (4, 5, 6)
        # as a sheet between its margins shows it
        reader.page.emulate_media(media="print")
        reader.ask("dispatchEvent(new Event('beforeprint'))")
        assert reader.ask(CUT) == []
        assert reader.ask("document.querySelector('main').getBoundingClientRect().width") == 680  # of 688, 182 mm
        tallest = reader.ask(
            "Math.max(...[...document.querySelectorAll('figure')].map(f => f.getBoundingClientRect().height))"
        )
        assert tallest < 1002  # 265 mm
        broken = "[...document.querySelectorAll('figure')].filter(f => getComputedStyle(f).breakInside != 'avoid')"
        assert reader.ask(f"{broken}.length") == 0
        ground, contrast = reader.ask(CONTRAST)
        assert ground > 0.9
        assert contrast > 4.5
        reader.ask("dispatchEvent(new Event('afterprint'))")
        assert reader.ask("document.querySelector('main').getBoundingClientRect().width") == min(width, 960)
