"""Tab completion, as IPython does it with jedi, offers what a user needs, and what is printed fits on a screen."""

from __future__ import annotations

import importlib
import inspect

import numpy as np
import pytest
from front_door import TRUTH, columns

import allocation
import antidrive as ad
import plant

PACKAGES = ("plant", "identification", "allocation", "mpc", "diagnosis")


def offered(given: object) -> set[str]:
    """What jedi completes behind a name and a point."""
    jedi = pytest.importorskip("jedi")
    return {one.name for one in jedi.Interpreter("x.", [{"x": given}]).complete() if not one.name.startswith("_")}


@pytest.fixture(scope="module")
def log() -> ad.Log:
    return ad.Log.from_arrays(**columns(duration=6.0))


@pytest.mark.parametrize("package", PACKAGES)
def test_every_public_class_can_be_completed(package):
    """One property whose annotation jedi does not understand, and nothing at all is offered."""
    classes = [kind for kind in vars(importlib.import_module(package)).values() if inspect.isclass(kind)]
    assert classes
    for kind in classes:
        bare = type("Bare", (), {name: vars(kind)[name] for name in vars(kind) if not name.startswith("__")})
        assert offered(object.__new__(bare)) or not any(not name.startswith("_") for name in vars(kind)), kind


def test_completion_shows_what_a_user_needs(log):
    assert {"read", "from_arrays", "runs", "warnings", "plot", "to_frame"} <= offered(log)
    assert not {"of_tables", "colour", "usable", "report", "internal"} & offered(log)
    assert {"inertia", "effects", "inverse", "with_effect", "to_frame"} <= offered(TRUTH)
    assert not {"bound", "slides", "own_states"} & offered(TRUTH)
    assert len(offered(TRUTH)) < 25
    fit = ad.identify(log, TRUTH)
    assert {"model", "parameters", "covariance", "save", "report"} <= offered(fit)
    assert not {"substeps", "runs_off"} & offered(fit)
    assert fit.substeps >= 1  # left out, and still there


def test_completion_of_a_controller_shows_step_and_its_numbers():
    controller = ad.Controller(TRUTH, ad.GearTrain.paper())
    assert {"step", "with_", "reset", "bandwidth", "max_torque", "compiled"} <= offered(controller)
    assert not {"bounds", "governor", "estimator", "c_code", "compile_time", "words"} & offered(controller)
    assert controller.bounds.greatest.max() == 0.3  # left out, and still there
    assert repr(controller).startswith("Controller(rigid body + ")
    assert len(repr(controller)) < 300


@pytest.mark.parametrize("package", ["plant", "identification", "allocation"])
def test_a_package_offers_its_names_and_not_its_files(package):
    module = importlib.import_module(package)
    assert set(module.__all__) <= set(dir(module)) <= {*module.__all__, "effects", "signals"}


def test_what_is_printed_is_short(log):
    drives = ad.Allocator(ad.GearTrain.paper(), min_torque=0.02, max_torque=0.3)
    axis = np.linspace(-1.0, 1.0, 5)
    found = allocation.capability_map(drives, inertia=2.0, acceleration=axis, load_torque=axis)
    for shown in (log, TRUTH, plant.drive_table(TRUTH, "friction"), found):
        assert len(str(shown)) < 300
        assert "array(" not in str(shown)


def test_a_saved_model_is_read_again(log, tmp_path):
    path = tmp_path / "model.json"
    ad.write_model(TRUTH, path)
    assert plant.read_model(path).model == TRUTH
    fit = ad.identify(log, TRUTH)
    fit.save(path)
    read = ad.read_model(path)
    assert read.model == fit.model
    assert read.std["inertia"] == fit["inertia"].std
    assert ad.predict(read, log).to_frame().equals(ad.predict(path, log).to_frame())


def test_a_model_is_written_as_json_alone(tmp_path):
    with pytest.raises(plant.BadParameter, match=r"name it model\.json\.$"):
        ad.write_model(TRUTH, tmp_path / "model.mat")
    assert not list(tmp_path.iterdir())


def test_a_model_file_in_place_of_its_model_is_reported(tmp_path):
    ad.write_model(TRUTH, tmp_path / "model.json")
    with pytest.raises(AttributeError, match="its attribute 'model'"):
        ad.Controller(ad.read_model(tmp_path / "model.json"), ad.GearTrain.paper())
