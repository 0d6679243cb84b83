"""Results show themselves in Python: pictures, tables, pages, notebooks."""

from __future__ import annotations

import json
import re
import sys
from base64 import b64decode
from dataclasses import replace
from html.parser import HTMLParser
from io import BytesIO

import matplotlib
import matplotlib.image
import numpy as np
import pandas as pd
import pytest
from front_door import TRUTH, antidrive, columns, write_csv, write_model
from test_friction_test import PLAIN, SWEEP, driven

import antidrive as ad
from allocation import Limits, capability_map
from antidrive.closed_loop_run import ClosedLoopRun
from antidrive.experiments.outcome import Curve, Outcome, Picture
from antidrive.model_comparison import Change, Comparison
from antidrive.scenario import parse_scenario, scenario_text
from diagnosis import Experiment
from diagnosis.experiment.signal_families import Signal
from identification import LostMotion
from identification.friction_test import friction_test
from identification.lost_motion.sweep import DriveLostMotion, Measured
from mpc import MonteCarlo, Sweep, analyse_loop, time_optimal
from plant import BadParameter, drive_table
from plant.result_display import Tabled

matplotlib.use("Agg")


@pytest.fixture(scope="module")
def log() -> ad.Log:
    return ad.Log.from_arrays(**columns(duration=6.0))


@pytest.fixture(scope="module")
def fitted(log) -> ad.Fit:
    return ad.identify(log, TRUTH)


@pytest.fixture(scope="module")
def diagnosed(log):
    return ad.diagnose(log, candidates=["coulomb_friction"])


@pytest.fixture(scope="module")
def results(log, fitted, diagnosed) -> dict[str, Tabled]:
    change = {"unit": "kg m^2", "before": 0.5, "before_std": 0.01, "after": 0.6, "after_std": 0.01, "moved": True}
    drives, axis = ad.Allocator(ad.GearTrain.paper(), min_torque=0.02, max_torque=0.3), np.linspace(-1.0, 1.0, 5)
    limits = Limits(gears=ad.GearTrain.paper(), min_torque=0.02, max_torque=0.3)
    runs = {"tracking_rms": np.array([0.1, 0.2]), "minimum_contact_torque": np.array([0.3, -0.1])}
    runs |= {"degraded": np.array([0, 3]), "copper_loss": np.array([0.01, 0.02])}
    time, measured = np.arange(3) * 0.01, Measured(value=1e-3, std=1e-5)
    drive = DriveLostMotion(gap=measured, stiffness=measured, friction=measured, friction_coefficient=measured)
    loop = ad.closed_loop(ad.Controller(TRUTH, ad.GearTrain.paper()), ad.Rig.paper_like(), 0.1, 0.5, seed=0)
    course = Curve(name="measured", colour="#1f77b4", x=time, y=time)
    errors = {"error_before": 0.2, "error_after": 0.1, "unit": "rad"}
    return {
        "log": log,
        "fit": fitted,
        "prediction": ad.predict(TRUTH, log),
        "friction test": friction_test(ad.Log.from_arrays(**driven(PLAIN, SWEEP))),
        "comparison": Comparison(
            changes=(Change(name="inertia", **change),), diagnosis=diagnosed, new=(), possible=(), gone=(), **errors
        ),
        "table": drive_table(TRUTH, "friction", points=10),
        "map": capability_map(drives, inertia=2.0, acceleration=axis, load_torque=axis),
        "allocation": drives.allocate(0.5),
        "trajectory": time_optimal(TRUTH, limits, 0.0, 0.5, intervals=10),
        "sweep": Sweep(**runs),
        "monte carlo": MonteCarlo(**runs, names=("inertia",), factors=np.array([[0.9], [1.1]])),
        "loop analysis": analyse_loop(ad.Controller(TRUTH, ad.GearTrain.paper())),
        "lost motion": LostMotion(drives=(drive, drive), total_gap=measured, encoder_noise=1e-6, samples=100, visits=4),
        "experiment": Experiment(
            competing=("input_delay", "sensor_lag"),
            time=time,
            torque=np.array([0.0, 1.0, 2.0]),
            start=0.0,
            signal=Signal(family="chirp", numbers={}, amplitude=1.0, bias=0.0),
            separation=12.0,
            absorbed=0.2,
            chirp_separation=4.0,
            chirp_absorbed=0.5,
            chirp_duration=8.0,
            predictions=(time, 2.0 * time),
            axis="rotary",
        ),
        "test bench": ad.Rig.paper_like().run(np.full((20, 2), [0.1, -0.1]), 0.005, seed=0),
        "scenario": ClosedLoopRun(
            title="Tracking",
            scenario=parse_scenario("tracking", scenario_text("tracking")),
            result=loop,
            min_torque=0.02,
            max_torque=0.3,
        ),
        "experiment of the paper": Outcome(
            title="Figure",
            results=["It moves."],
            comparison=(),
            found={"rms": 0.1},
            columns={"time": time, "angle": time},
            pictures=(Picture(caption="Angle.", x="time [s]", y="angle [rad]", curves=(course,)),),
        ),
        "loop": loop,
    }


NAMES = {"log": 2, "fit": 2, "prediction": 2, "friction test": 1, "comparison": 1, "table": 1, "map": 1, "loop": 4}
NAMES |= {"trajectory": 3, "sweep": 1, "monte carlo": 1, "loop analysis": 2, "experiment": 2}
NAMES |= {"allocation": 1, "lost motion": 1, "test bench": 3, "scenario": 4, "experiment of the paper": 1}


class Text(HTMLParser):
    """Words and tags of a page."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.words, self.tags = "", []
        self.feed(page)

    def handle_data(self, data: str) -> None:
        self.words += data

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)


@pytest.mark.parametrize("name", NAMES)
def test_a_result_is_drawn(name, results):
    axes = np.atleast_1d(results[name].plot())
    assert axes.size == NAMES[name]
    for ax in axes:
        assert ax.has_data()
        assert ax.get_ylabel() or name == "comparison"
    assert axes[-1].get_xlabel()
    given = matplotlib.pyplot.subplots(NAMES[name], 1)[1]
    assert np.atleast_1d(results[name].plot(given))[0] is np.atleast_1d(given)[0]
    with pytest.raises(BadParameter, match=f"needs {NAMES[name]} axes, not 5"):
        results[name].plot(matplotlib.pyplot.subplots(5, 1)[1])
    matplotlib.pyplot.close("all")


@pytest.mark.parametrize("name", NAMES)
def test_a_result_is_a_table_and_shows_itself_in_a_notebook(name, results):
    frame = results[name].to_frame()
    assert len(frame)
    page = Text(results[name]._repr_html_())
    assert {"p", "table"} <= set(page.tags)
    assert all(str(column) in page.words for column in frame.columns[:4])
    assert len(page.words.splitlines()[0]) < 250  # and no array


def test_tables_hold_the_numbers(log, fitted, diagnosed):
    table = log.to_frame()
    assert table["angle"].to_numpy() == pytest.approx(log.runs[0].output)
    assert table.attrs["units"]["command"] == "N m"
    found = fitted.to_frame()
    assert found.loc["inertia", "value"] == fitted["inertia"].value
    causes = diagnosed.to_frame()
    assert causes.loc["coulomb_friction", "value"] == pytest.approx(0.4, rel=0.02)


@pytest.mark.parametrize("name", ["fit", "prediction", "friction test", "comparison", "map", "loop"])
def test_a_result_writes_its_page(name, results, tmp_path):
    path = results[name].report(tmp_path / "page.html")
    page = path.read_text(encoding="utf-8")
    assert page.count('class="plot"') >= 1 or "plot" in page
    assert "<h1>" in page


def test_the_page_of_a_loop_has_its_numbers(results, tmp_path):
    loop = results["loop"]
    words = Text(loop.report(tmp_path / "loop.html").read_text(encoding="utf-8")).words
    for number in (loop.tracking_rms, loop.minimum_contact_torque, loop.copper_loss):
        assert f"{number:.4g}" in words
    assert f"{loop.time.size - loop.degraded} of {loop.time.size} samples were optimal." in words


def test_a_diagnosis_is_drawn_and_written(diagnosed, tmp_path):
    axes = diagnosed.plot()
    assert len(axes[0].lines) == 3
    assert "<h1>" in diagnosed.report(tmp_path / "x.html").read_text(encoding="utf-8")
    assert "coulomb_friction" in diagnosed._repr_html_()
    matplotlib.pyplot.close("all")


@pytest.mark.parametrize("name", sorted(NAMES))
def test_every_result_writes_a_page_that_opens_offline(name, results, tmp_path):
    page = results[name].report(tmp_path / "page.html").read_text(encoding="utf-8")
    text = Text(page)
    assert "<h1>" in page
    assert "script" in text.tags or "img" in text.tags
    assert not re.search(r'(?:src|href)="(?!data:)', page)
    assert len(page) < 2_000_000


def test_each_drive_is_drawn_above_its_least_torque(results):
    allocated = results["allocation"]
    axes = allocated.plot()
    heights = [bar.get_height() for bar in axes.patches]
    np.testing.assert_array_equal(heights, allocated.torques)
    (lines,) = (each for each in axes.collections if each.get_label().startswith("minimum"))
    least = np.array([line[0, 1] for line in lines.get_segments()])
    np.testing.assert_array_equal(np.abs(least), allocated.floor)
    assert (least * allocated.torques > 0.0).all()
    matplotlib.pyplot.close("all")


def test_a_page_of_figure_and_table_has_both(results, tmp_path):
    page = results["lost motion"].report(tmp_path / "gaps.html").read_text(encoding="utf-8")
    (image,) = re.findall(r'src="data:image/png;base64,([^"]+)"', page)
    drawn = matplotlib.image.imread(BytesIO(b64decode(image)))
    assert drawn[..., :3].min() < 0.5 < drawn[..., :3].max()
    text = Text(page)
    assert "table" in text.tags
    assert {"Lost motion", "gap_1", "total_gap"} <= {line.strip() for line in text.words.splitlines()}
    assert "Drag across" not in page
    assert results["log"].report(tmp_path / "log.html").read_text(encoding="utf-8").count("<img") == 1


def test_a_model_has_a_page_without_a_figure(tmp_path):
    page = TRUTH.report(tmp_path / "model.html").read_text(encoding="utf-8")
    assert "inertia" in Text(page).words
    assert "<img" not in page


def test_a_closed_loop_reports_itself_in_one_line(results):
    loop = results["loop"]
    assert "\n" not in repr(loop)
    assert f"100 samples to 0.495 s; tracking error {loop.tracking_rms:.3g} rad rms" in repr(loop)
    frame = loop.to_frame()
    np.testing.assert_array_equal(frame["contact_torque_2"], loop.contact_torques[:, 1])
    assert frame.attrs["units"]["velocity"] == "rad/s"
    table = replace(loop, axis="linear").to_frame()
    np.testing.assert_array_equal(table["position"], loop.angle)
    assert table.attrs["units"]["contact_torque_1"] == "N"


def test_a_table_has_every_number_of_its_result(results):
    allocated, move, loops = (results[name] for name in ("allocation", "trajectory", "monte carlo"))
    np.testing.assert_array_equal(allocated.to_frame()["torque"], allocated.torques)
    np.testing.assert_array_equal(move.to_frame()["torque_2"][:-1], move.torques[:, 1])
    assert np.isnan(move.to_frame()["torque_2"].iloc[-1])
    assert loops.to_frame()["inertia"].tolist() == [0.9, 1.1]
    record = results["test bench"]
    np.testing.assert_array_equal(record.to_frame()["minimum_contact_torque_2"], record.minimum_contact_torques[:, 1])
    assert results["lost motion"].to_frame().loc["gap_2", "value"] == 1e-3
    response, analysis = results["loop analysis"].to_frame(), results["loop analysis"]
    assert response["sensitivity"].max() == pytest.approx(analysis.peak_sensitivity, rel=0.01)
    phase = np.interp(analysis.crossover, response["frequency"], response["phase"])
    assert phase % 360.0 == pytest.approx(180.0 + analysis.phase_margin, abs=1.0)
    played = results["experiment"].to_frame()
    assert list(played) == ["time", "torque", "angle_with_input_delay", "angle_with_sensor_lag"]
    assert played["angle_with_sensor_lag"].tolist() == [0.0, 0.02, 0.04]


def test_a_map_without_a_torque_at_rest_is_reported(results, tmp_path):
    drives = ad.Allocator(ad.GearTrain.paper(), min_torque=0.02, max_torque=0.3)
    beyond = capability_map(drives, inertia=2.0, acceleration=np.array([0.0]), load_torque=np.array([50.0, 60.0]))
    page = beyond.report(tmp_path / "map.html").read_text(encoding="utf-8")
    assert "hold none of these load torques" in page


def test_a_model_is_a_table_of_its_parameters():
    table = TRUTH.to_frame()
    assert list(table.index) == list(TRUTH.names)
    assert table.loc["inertia", "unit"] == "kg m^2"
    assert "rigid body" in TRUTH._repr_html_()


def test_a_prediction_lies_beside_what_was_measured(tmp_path):
    model, log = write_model(tmp_path / "model.json", TRUTH), write_csv(tmp_path / "log.csv", columns(duration=4.0))
    out, page = tmp_path / "p.csv", tmp_path / "p.html"
    result = antidrive("predict", model, log, "--measured", "--out", out)
    assert result.code == 0, result.err
    table = pd.read_csv(out)
    assert list(table) == ["run", "time", "angle", "measured"]
    assert table["measured"].to_numpy() == pytest.approx(pd.read_csv(log)["angle"].to_numpy())
    again = ad.predict(TRUTH, log).to_frame()
    assert again["measured"].to_numpy() == pytest.approx(table["measured"].to_numpy())
    assert again["angle"].to_numpy() == pytest.approx(table["angle"].to_numpy(), abs=1e-9)
    words = Text(page.read_text(encoding="utf-8")).words.replace("\N{NO-BREAK SPACE}", " ")
    (said,) = result.out.splitlines()[:-1]
    assert re.fullmatch(r"log\.csv: rms error \d+(\.\d+)? ± \d+(\.\d+)? µrad", said)
    assert f"{said}." in words
    assert "angle [rad]" in words + page.read_text(encoding="utf-8")
    assert result.out.splitlines()[-1] == f"Written: {out}, {page}"


def test_the_report_of_a_prediction_may_be_elsewhere(tmp_path):
    model, log = write_model(tmp_path / "model.json", TRUTH), write_csv(tmp_path / "log.csv", columns(duration=2.0))
    out, page = tmp_path / "p.csv", tmp_path / "pages" / "friday.html"
    result = antidrive("predict", model, log, "--out", out, "--report", page, "--json")
    assert (json.loads(result.out)["file"], json.loads(result.out)["report"]) == (str(out), str(page))
    assert "Measured and simulated" in page.read_text(encoding="utf-8")
    assert not out.with_suffix(".html").exists()
    assert list(pd.read_csv(out)) == ["run", "time", "angle"]


@pytest.mark.parametrize(
    ("suffix", "read"),
    [(".csv", pd.read_csv), (".parquet", pd.read_parquet), (".json", pd.read_json), (".xlsx", pd.read_excel)],
)
@pytest.mark.parametrize("more", [(), ("--measured",)])
def test_a_prediction_has_the_format_of_its_suffix(suffix, read, more, tmp_path):
    model, log = write_model(tmp_path / "model.json", TRUTH), write_csv(tmp_path / "log.csv", columns(duration=2.0))
    result = antidrive("predict", model, log, *more, "--out", tmp_path / f"p{suffix}")
    assert result.code == 0, result.err
    table, wanted = read(tmp_path / f"p{suffix}"), ad.predict(TRUTH, log).to_frame()
    assert list(table) == ["run", "time", "angle", *(["measured"] if more else [])]
    for column in list(table)[1:]:
        np.testing.assert_allclose(table[column], wanted[column], atol=1e-9)
    assert (tmp_path / "p.html").is_file()


def test_a_workbook_without_its_library_is_refused(tmp_path, monkeypatch):
    model, log = write_model(tmp_path / "model.json", TRUTH), write_csv(tmp_path / "log.csv", columns(duration=2.0))
    monkeypatch.setitem(sys.modules, "openpyxl", None)
    result = antidrive("predict", model, log, "--out", tmp_path / "p.xlsx")
    assert (result.code, len(list(tmp_path.iterdir()))) == (2, 2)
    assert "pip install openpyxl" in result.err


def test_a_workbook_that_is_too_long_is_refused(tmp_path, monkeypatch):
    model, log = write_model(tmp_path / "model.json", TRUTH), write_csv(tmp_path / "log.csv", columns(duration=2.0))
    monkeypatch.setattr("antidrive.prediction._SHEET", 100)
    result = antidrive("predict", model, log, "--out", tmp_path / "p.xlsx")
    assert (result.code, len(list(tmp_path.iterdir()))) == (2, 2)
    assert "sheet has 100 rows" in result.err


def test_a_report_is_no_pdf(fitted, tmp_path):
    with pytest.raises(BadParameter, match=r"^report .*x\.pdf: \.pdf is not .* name it x\.html or x\.htm\.$"):
        fitted.report(tmp_path / "x.pdf")
    assert not list(tmp_path.iterdir())
