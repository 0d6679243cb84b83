"""What MATLAB and Simulink write beside plain arrays: labelled signals, runs in groups, objects that nobody reads."""

from __future__ import annotations

import h5py
import numpy as np
import pytest
from sample_logs import motion
from scipy.io import savemat
from scipy.io.matlab import MatlabOpaque

from identification import Log, MalformedLog

SOUND = motion(samples=400)
TIME, TORQUE, ANGLE = (SOUND[name] for name in ("time", "torque", "angle"))


def same(run, part=slice(None)):
    np.testing.assert_allclose(run.command, TORQUE[part], atol=1e-12)
    np.testing.assert_allclose(run.output, ANGLE[part], atol=1e-12)
    return True


@pytest.mark.parametrize("field", ["label", "blockName"])
def test_a_structure_with_time_of_simulink(tmp_path, field):
    """`To Workspace` puts each signal into an element of its own, with its name beside the values."""
    kinds = [("values", "O"), ("dimensions", "O"), (field, "O")]
    signals = np.array([(TORQUE[:, None], 1.0, "axis/tau"), (ANGLE[:, None], 1.0, "theta")], dtype=kinds)
    if field == "label":
        signals[0]["label"] = "tau"
    savemat(tmp_path / "out.mat", {"out": {"time": TIME[:, None], "signals": signals, "blockName": "axis/scope"}})
    assert same(Log.read(tmp_path / "out.mat").runs[0])


@pytest.mark.parametrize("label", ["", "theta"])
def test_a_signal_alone_has_the_name_of_its_label_or_variable(tmp_path, label):
    def saved(name, values, text):
        kinds = [("values", "O"), ("label", "O")]
        signals = np.array([(values[:, None], text)], dtype=kinds)
        savemat(tmp_path / f"{name}.mat", {name: {"time": TIME[:, None], "signals": signals}})
        return tmp_path / f"{name}.mat"

    log = Log.read([saved("torque", TORQUE, ""), saved("x" if label else "angle", ANGLE, label)])
    np.testing.assert_allclose(log.runs[0].command, TORQUE, atol=1e-9)
    np.testing.assert_allclose(log.runs[0].output, ANGLE, atol=1e-9)


def test_an_array_of_structures_has_an_element_for_each_run(tmp_path):
    kinds = [(name, "O") for name in ("time", "torque", "angle")]
    parts = (slice(0, 150), slice(150, 400))
    runs = np.array([tuple(SOUND[name][part] for name, _ in kinds) for part in parts], dtype=kinds)
    savemat(tmp_path / "log.mat", {"run": runs})
    log = Log.read(tmp_path / "log.mat")
    assert all(same(run, part) for run, part in zip(log.runs, parts, strict=True))


@pytest.mark.parametrize("called", ["data/demo_{}/joint", "trial{}", "bench/Exp-{}"])
def test_groups_named_by_experiment_are_runs(tmp_path, called):
    parts = (slice(0, 150), slice(150, 270), slice(270, 400))
    with h5py.File(tmp_path / "log.h5", "w") as file:
        for k, part in enumerate(parts):
            for name in ("time", "torque", "angle"):
                file[f"{called.format(k)}/{name}"] = SOUND[name][part]
    log = Log.read(tmp_path / "log.h5")
    assert len(log.runs) == 3
    assert all(same(run, part) for run, part in zip(log.runs, parts, strict=True))


def test_groups_of_two_joints_are_no_runs(tmp_path):
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["time"] = TIME
        for joint in ("joint_1", "joint_2"):
            file[f"{joint}/torque"], file[f"{joint}/angle"] = TORQUE, ANGLE
    log = Log.read(tmp_path / "log.h5", mapping={"torque": "joint_2/torque", "angle": "joint_2/angle"})
    assert len(log.runs) == 1


def opaque(name):
    return MatlabOpaque(
        np.array([(name, b"MCOS", b"timeseries", 0)], dtype=[(k, "O") for k in ("s0", "s1", "s2", "arr")])
    )


@pytest.mark.parametrize("beside", [False, True])
def test_objects_of_a_mat_file_are_reported_with_what_to_save(tmp_path, monkeypatch, beside):
    found = {"None": opaque(b"tau")} | ({name: SOUND[name] for name in ("time", "torque", "angle")} if beside else {})
    savemat(tmp_path / "log.mat", {"x": 1.0})
    monkeypatch.setattr("scipy.io.loadmat", lambda *_, **__: found)
    if beside:
        assert any(
            "'tau' is an object of MATLAB (timeseries)" in text for text in Log.read(tmp_path / "log.mat").warnings
        )
        return
    with pytest.raises(MalformedLog, match=r"t = tau.Time; x = tau.Data; save\('log.mat', 't', 'x'\)"):
        Log.read(tmp_path / "log.mat")


@pytest.mark.parametrize(
    ("kind", "remedy"), [("timeseries", "t = ts.Time"), ("Simulink.SimulationData.Dataset", r"t = ts\{1\}.Values.Time")]
)
def test_objects_of_a_mat_file_of_version_7_3(tmp_path, kind, remedy):
    with h5py.File(tmp_path / "log.mat", "w", userblock_size=512) as file:
        file["ts"] = np.arange(6, dtype=np.uint32)
        file["ts"].attrs.update({"MATLAB_class": np.bytes_(kind), "MATLAB_object_decode": 3})
        file["#subsystem#/MCOS"] = np.arange(50.0)
        file["#sigstream#/0/#data#"] = np.arange(50, dtype=np.uint8)
    content = (tmp_path / "log.mat").read_bytes()
    (tmp_path / "log.mat").write_bytes(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + content[128:])
    with pytest.raises(MalformedLog, match=rf"'ts' is an object of MATLAB \({kind}\).*{remedy}"):
        Log.read(tmp_path / "log.mat")
