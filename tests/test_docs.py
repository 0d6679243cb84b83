"""The documentation: its examples print what it says, the site is built strictly, and it asks for nothing elsewhere."""

from __future__ import annotations

import contextlib
import importlib
import io
import json
import os
import re
import subprocess
import sys
import tomllib
from html.parser import HTMLParser
from pathlib import Path
from types import ModuleType

import pytest
import yaml
from browser import chromium

from plant import catalogue

ROOT = Path(__file__).parents[1]
PAGES = sorted((ROOT / "docs").rglob("*.md"))
THOUSANDS = re.compile(r"(?<=\d),(?=\d{3})")
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e-?\d+)?")
CODE = re.compile(r"```.*?```|`[^`]*`|^    .*?$", re.DOTALL | re.MULTILINE)
PAPER = re.compile(r"\([^()]*\b(?:19|20)\d\d\)")
BLOCK = re.compile(r"```python\n(.*?)```\n(?:\n```text\n(.*?)```)?", re.DOTALL)


@pytest.mark.parametrize("path", [p for p in PAGES if "```python" in p.read_text("utf-8")], ids=lambda p: p.stem)
def test_the_examples_of_a_page_run_and_print_what_it_shows(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = ModuleType("page")
    monkeypatch.setitem(sys.modules, "page", page)
    blocks = BLOCK.findall(path.read_text(encoding="utf-8"))
    assert blocks
    with contextlib.chdir(tmp_path):
        for code, printed in blocks:
            out = io.StringIO()
            with contextlib.redirect_stdout(out):
                exec(compile(code, path.name, "exec"), page.__dict__)
            assert NUMBER.sub("#", out.getvalue()) == NUMBER.sub("#", printed), code
            found, written = ([float(n) for n in NUMBER.findall(text)] for text in (out.getvalue(), printed))
            assert found == pytest.approx(written, rel=0.1), code


class Outline(HTMLParser):
    """What a page loads, and the names of its parts."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.ids: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        named = {name: value or "" for name, value in attrs}
        self.ids.add(named.get("id", ""))
        if tag in ("script", "img", "iframe", "source", "object", "embed"):
            self.loads.append(named.get("src", named.get("data", "")))
        if tag == "link" and named.get("rel") not in ("canonical", "prev", "next"):
            self.loads.append(named.get("href", ""))


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    line = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "-d", str(folder)]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(line, cwd=ROOT, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def outline(page: Path) -> Outline:
    return Outline(page.read_text(encoding="utf-8"))


def test_the_site_asks_for_nothing_elsewhere(site: Path) -> None:
    pages = sorted(site.rglob("*.html"))
    assert len(pages) > 20
    for page in pages:
        loads = outline(page).loads
        assert loads
        assert [load for load in loads if re.match(r"(\w+:)?//", load)] == [], page
        for load in loads:
            if load and not load.startswith("data:"):
                file = re.split("[?#]", load)[0]
                assert (site / file[1:] if file.startswith("/") else page.parent / file).exists(), (page, load)
    for style in site.rglob("*.css"):
        assert not re.search(r"url\([\"']?(https?:)?//", style.read_text(encoding="utf-8")), style


def test_every_effect_has_its_part_and_its_picture(site: Path) -> None:
    found = outline(site / "gallery.html")
    assert set(catalogue) <= found.ids
    for name in catalogue:
        drawn = (site / "gallery" / f"{name}.svg").read_text(encoding="utf-8")
        assert drawn.count("<path") > 10
        assert f"gallery/{name}.svg" in found.loads


def test_a_long_equation_scrolls_and_not_the_page(site: Path) -> None:
    page = (site / "gallery.html").read_text(encoding="utf-8")
    assert page.count("<math") == page.count('<div style="overflow: auto hidden"><math') == len(catalogue)


def test_the_gallery_fits_on_a_phone(site: Path) -> None:
    with chromium() as browser:
        page = browser.new_page(viewport={"width": 400, "height": 800}, is_mobile=True)
        page.goto((site / "gallery.html").as_uri())
        assert page.evaluate("document.documentElement.scrollWidth") == 400


@pytest.mark.parametrize(
    "word",
    [
        "MATLAB",
        "Simulink",
        "ROS",
        "EtherCAT",
        "TwinCAT",
        "ODrive",
        "MuJoCo",
        "feedforward",
        "licence",
        "license",
        "backlash",
    ],
)
def test_the_search_finds_what_people_look_for(site: Path, word: str) -> None:
    sections = json.loads((site / "search" / "search_index.json").read_text(encoding="utf-8"))["docs"]
    written = [part for part in sections if "changelog" not in part["location"]]
    assert any(re.search(rf"\b{word}\b", part["text"] + part["title"], re.IGNORECASE) for part in written)


@pytest.mark.parametrize("package", ["plant", "allocation", "identification", "diagnosis", "mpc"])
def test_the_reference_has_every_public_name(site: Path, package: str) -> None:
    module = importlib.import_module(package)
    homes = {name: getattr(getattr(module, name), "__module__", "") for name in module.__all__}
    homes = {name: home for name, home in homes.items() if home.split(".")[0] == package}
    assert len(homes) > 0.8 * len(module.__all__)
    page = site / "reference" / f"{package}.html"
    assert {f"{home}.{name}" for name, home in homes.items()} <= outline(page).ids
    for name in homes:
        assert f"{package}.{name}" in page.read_text(encoding="utf-8")


def test_every_notebook_is_there_with_its_pictures(site: Path) -> None:
    for path in (ROOT / "notebooks").glob("*.ipynb"):
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
        pictures = sum("image/png" in output.get("data", {}) for cell in cells for output in cell.get("outputs", ()))
        shown = outline(site / "notebooks" / f"{path.stem}.html").loads
        assert sum(load.startswith("data:image/png") for load in shown) == pictures


def test_each_limit_of_the_readme_is_reported_in_full(site: Path) -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    bold = re.findall(r"^\| \*\*([^*]+?)\*\*", readme[readme.index("## Limits") :], re.MULTILINE)
    page = (site / "explanation" / "limits.html").read_text(encoding="utf-8")
    assert len(bold) > 6
    for words in bold:
        assert words in " ".join(page.split()), words


def test_the_links_of_the_readme_lead_somewhere() -> None:
    links = re.findall(r"\]\(([^)#]+)", (ROOT / "README.md").read_text(encoding="utf-8"))
    assert len(links) > 2
    for link in links:
        assert (ROOT / link).exists(), link


# Of others: the EMPS with asymmetric and symmetric friction in its authors' measure, the worst of six friction models,
# regressions of the EMPS and of the UR10e, the paper's alpha; the number of a standard, and a year.
PUBLISHED = "4.08 3.11 5.98 0.0309 0.0323 3.44 3.32 2.75 0.0047 402 2001"


def test_the_figures_of_the_explanations_were_measured() -> None:
    """Shares, and numbers of three figures or with a decimal point: they stand in the README or in a result."""
    results = "".join(path.read_text() for path in sorted((ROOT / "benchmarks" / "results").glob("*.txt")))
    known = " ".join([(ROOT / "README.md").read_text(encoding="utf-8"), results, PUBLISHED])
    known, checked = " ".join(THOUSANDS.sub("", known).split()), 0
    for path in PAGES:
        prose = THOUSANDS.sub("", PAPER.sub("", CODE.sub("", path.read_text(encoding="utf-8"))))
        for share in re.findall(r"(?<![\w.])\d+ (?:of|\+-) \d+(?![\d.]*\d)", prose):
            assert re.search(rf"(?<![\d.]){re.escape(share)}(?!\d)", known), (path.name, share)
        for number in re.findall(r"(?<![\w.])\d+(?:\.\d+)?(?![\w.]*\d)", prose):
            if len(number) > 2 or "." in number:
                assert re.search(rf"(?<![\d.]){re.escape(number)}(?![\d])", known), (path.name, number)
                checked += 1
    assert checked > 100


def test_the_citation_is_of_this_version() -> None:
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert (cited["cff-version"], cited["title"], cited["version"]) == ("1.2.0", project["name"], project["version"])
    assert cited["authors"] == [{"name": "the antidrive authors"}]
    assert "Drive/Anti Drive" in cited["references"][0]["title"]
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert "## [Unreleased]" in changes or f"## [{project['version']}]" in changes


def test_the_list_for_adding_an_effect_names_existing_files() -> None:
    listed = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    files = re.findall(r"`?((?:plant|tests|benchmarks)/[\w/]+\.py)", listed)
    assert len(files) > 6
    for name in files:
        assert (ROOT / name).exists() or name == "plant/effects/NAME.py", name
    for pattern in ("quadratic_drag", "stribeck_friction", "actuator_lag", "compliance"):
        assert f"`{pattern}.py`" in listed
        assert (ROOT / "plant" / "effects" / f"{pattern}.py").exists()
