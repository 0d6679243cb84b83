"""HDF5: datasets, groups with clocks of their own, compound tables, and frames as pandas lays them out."""

from __future__ import annotations

import pickle

import h5py
import numpy as np
import pandas as pd
import pytest
from sample_logs import motion
from scipy.io import savemat
from test_log_formats import Intruder
from test_malformed_logs import check_sentence

from identification.reading.files import read_table
from plant.errors import AntidriveError

SOUND = motion(samples=120)
RECORDS = pd.DataFrame(SOUND).to_records(index=False)
REST = [name for name in SOUND if name != "time"]


def flat(file):
    for name, values in SOUND.items():
        file[name] = values
    file["station"] = 7


def grouped(file):
    file["time"] = SOUND["time"]
    for name in REST:
        file[f"{'drive' if name == 'torque' else 'load'}/{name}"] = SOUND[name][:, None]


def compound(file):
    file["log"] = RECORDS


def pickled(content):
    return np.bytes_(pickle.dumps(content, protocol=0))


def pandas_table(file):
    """`to_hdf(format="table")`: a block for each kind of numbers, names in pickles, and an index beside the rows."""
    rows = np.zeros(120, dtype=[("index", "f8"), ("values_block_0", "f8", (3,)), ("values_block_1", "S2", (1,))])
    rows["index"] = SOUND["time"]
    rows["values_block_0"] = np.column_stack([SOUND[name] for name in REST])
    rows["values_block_1"] = b"up"
    group = file.create_group("log")
    group.attrs["pandas_type"] = np.bytes_(b"frame_table")
    group.attrs["info"] = pickled({1: {"names": [None], "type": "Index"}, "index": {"index_name": "time"}})
    group["table"] = rows
    group["table"].attrs["index_kind"] = np.bytes_(b"float")
    group["table"].attrs["values_block_0_kind"] = pickled(REST)
    group["table"].attrs["values_block_1_kind"] = pickled(["run"])
    file["log/_i_table/index/sortedLR"] = np.zeros(131201)


def pandas_columns(file):
    """`to_hdf(format="table", data_columns=True)`."""
    group = file.create_group("a/log")
    group.attrs["pandas_type"] = np.bytes_(b"frame_table")
    group["table"] = pd.DataFrame(SOUND).to_records()
    group["table"].attrs["index_kind"] = np.bytes_(b"integer")


def pandas_fixed(file):
    """`to_hdf(format="fixed")`: blocks beside the names of their columns, the index in `axis1`."""
    group = file.create_group("log")
    group.attrs["pandas_type"] = np.bytes_(b"frame")
    group["axis0"] = np.array([name.encode() for name in REST])
    group["axis1"] = SOUND["time"]
    group["axis1"].attrs["name"] = np.bytes_(b"time")
    group["block0_items"] = np.array([name.encode() for name in REST])
    group["block0_values"] = np.column_stack([SOUND[name] for name in REST])


LAID_OUT = (flat, grouped, compound, pandas_table, pandas_columns, pandas_fixed)


def written(folder, write):
    path = folder / "log.h5"
    with h5py.File(path, "w") as file:
        write(file)
    return path


@pytest.mark.parametrize("write", LAID_OUT)
def test_laid_out(tmp_path, write):
    table = read_table(written(tmp_path, write))
    for name, values in SOUND.items():
        np.testing.assert_allclose(table.columns[name], values)
    assert set(table.columns) <= {*SOUND, "index", "run"}
    assert table.clocks == {}


def two_rates(file):
    for group, names, step in (("drive", ["torque"], 1), ("load", ["angle", "velocity"], 3)):
        for name in ["time_ms", *names]:
            values = 1e3 * SOUND["time"] if name == "time_ms" else SOUND[name]
            file[f"{group}/{name}"] = values[::step]


def test_groups_with_times_that_differ_are_channels_with_clocks(tmp_path):
    table = read_table(written(tmp_path, two_rates))
    assert set(table.columns) == set(REST)
    assert table.units == {"time": "ms"}
    np.testing.assert_allclose(table.clocks["angle"], 1e3 * SOUND["time"][::3])
    assert table.clocks["angle"] is table.clocks["velocity"]
    assert len(table.clocks["torque"]) == 120
    savemat(tmp_path / "log.mat", {
        "drive": {"time": SOUND["time"], "torque": SOUND["torque"]},
        "load": {"time": SOUND["time"][::3], "angle": SOUND["angle"][::3]},
    })  # fmt: skip
    table = read_table(tmp_path / "log.mat")
    assert {name: len(clock) for name, clock in table.clocks.items()} == {"torque": 120, "angle": 40}


def test_groups_with_one_time_are_one_table(tmp_path):
    def write(file):
        for name in REST:
            file[f"{name}/time"] = SOUND["time"]
            file[f"{name}/value"] = SOUND[name]

    table = read_table(written(tmp_path, write))
    assert set(table.columns) == set(SOUND)
    assert table.clocks == {}


def test_names_that_two_groups_have_are_distinguished(tmp_path):
    def write(file):
        for k in (1, 2):
            file[f"axis{k}/angle"] = k * SOUND["angle"]

    assert set(read_table(written(tmp_path, write)).columns) == {"axis1/angle", "axis2/angle"}


def test_a_pickle_in_an_attribute_is_not_loaded(tmp_path):
    def write(file):
        pandas_table(file)
        file["log/table"].attrs["values_block_0_kind"] = np.bytes_(
            pickle.dumps(Intruder(tmp_path / "trace"), protocol=0)
        )

    read_table(written(tmp_path, write))
    assert not (tmp_path / "trace").exists()


def test_damaged_files_are_read_in_part_or_refused(tmp_path):
    rng = np.random.default_rng(0)
    for write in (grouped, pandas_table, pandas_fixed):
        path = written(tmp_path, write)
        sound = path.read_bytes()
        for _ in range(20):
            damaged = bytearray(sound)
            for place in rng.integers(len(damaged), size=5):
                damaged[place] = rng.integers(256)
            path.write_bytes(damaged)
            try:
                assert read_table(path).columns
            except AntidriveError as error:
                check_sentence(str(error))
