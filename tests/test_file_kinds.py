"""What a file is decides its content: compressed, without a suffix or with a wrong one, from standard input."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import sys
import zipfile

import h5py
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from sample_logs import motion, text
from scipy.io import savemat
from test_malformed_logs import check_sentence

from identification.errors import MalformedLog
from identification.log import Log
from identification.reading.files import read_table
from plant.errors import AntidriveError

SOUND = motion(samples=120)
TEXT = text(SOUND).encode()


def zipped(content, *names):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name in names:
            archive.writestr(name, content)
    return file.getvalue()


def written(write):
    file = io.BytesIO()
    write(file)
    return file.getvalue()


def hdf5(file):
    with h5py.File(file, "w") as target:
        for name, values in SOUND.items():
            target[name] = values


def excel(sheets):
    def write(file):
        from openpyxl import Workbook

        book = Workbook()
        book.remove(book.active)
        for title, lines in sheets.items():
            sheet = book.create_sheet(title)
            for line in lines:
                sheet.append(line)
        book.save(file)

    return written(write)


FRAME = pd.DataFrame(SOUND)
ROWS = [list(map(float, row)) for row in zip(*SOUND.values(), strict=True)]
ARRAY = written(lambda file: np.save(file, np.column_stack(list(SOUND.values()))))
KINDS = {
    "text": TEXT,
    "parquet": written(FRAME.to_parquet),
    "feather": written(FRAME.to_feather),
    "feather, uncompressed": written(lambda file: FRAME.to_feather(file, compression="uncompressed")),
    "npz": written(lambda file: np.savez(file, **SOUND)),
    "npy of records": written(lambda file: np.save(file, FRAME.to_records(index=False))),
    "mat": written(lambda file: savemat(file, SOUND)),
    "mat v4": written(lambda file: savemat(file, SOUND, format="4")),
    "hdf5": written(hdf5),
    "excel": excel({"log": [["a recorder", None], [], list(SOUND), ["s", "N m", "rad", "rad/s"], *ROWS]}),
    "excel, second sheet": excel({"about": [["arm"], ["station", 7]], "log": [list(SOUND), *ROWS]}),
}
PACKED = {
    "gz": gzip.compress,
    "bz2": bz2.compress,
    "xz": lzma.compress,
    "zip": lambda content: zipped(content, "log.csv"),
    "zip of a Macintosh": lambda content: zipped(content, "log.csv", "__MACOSX/._log.csv"),
}


def read(folder, content, name="log"):
    path = folder / name
    path.write_bytes(content)
    return read_table(path)


def same(table):
    assert set(SOUND) <= set(table.columns)
    for name, values in SOUND.items():
        np.testing.assert_allclose(np.asarray(table.columns[name], dtype=float), values, rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("suffix", ["", ".csv", ".parquet", ".dat"])
@pytest.mark.parametrize("kind", KINDS)
def test_the_content_decides_and_not_the_suffix(tmp_path, kind, suffix):
    if kind == "mat v4":  # the only one without a signature
        suffix = ".mat"
    table = read(tmp_path, KINDS[kind], f"log{suffix}")
    same(table)
    assert table.name == f"log{suffix}"


@pytest.mark.parametrize("packing", PACKED)
@pytest.mark.parametrize("kind", ["text", "parquet", "mat", "hdf5"])
def test_compressed(tmp_path, kind, packing):
    table = read(tmp_path, PACKED[packing](KINDS[kind]), "log.csv.gz")
    same(table)
    assert table.name == "log.csv.gz"


def test_a_matrix_of_numpy_has_places_for_names(tmp_path):
    assert list(read(tmp_path, ARRAY, "log.npy").columns) == ["1", "2", "3", "4"]


def test_a_sheet_of_excel_has_lines_and_units(tmp_path):
    table = read(tmp_path, KINDS["excel"], "log.xlsx")
    assert table.units["torque"] == "N m"
    assert table.where(0) == "log.xlsx, row 1 (line 5)"
    assert read(tmp_path, KINDS["excel, second sheet"]).notes == ("log: of 2 sheets, 'log' is read",)


def test_sheets_with_the_same_columns_are_runs(tmp_path):
    parts = (ROWS[:70], ROWS[70:])
    two = {title: [["arm"], list(SOUND), *part] for title, part in zip(("slow", "fast"), parts, strict=True)}
    (tmp_path / "log.xlsx").write_bytes(excel({"about": [["station", 7]], **two}))
    log = Log.read(tmp_path / "log.xlsx")
    assert [(run.run, len(run)) for run in log.runs] == [("slow", 70), ("fast", 50)]
    assert any("the sheets 'slow', 'fast' have the same columns" in text for text in log.warnings)
    other = {"slow": [list(SOUND), *ROWS], "fast": [["time", "torque"], *(row[:2] for row in ROWS)]}
    assert "run" not in read(tmp_path, excel(other), "other.xlsx").columns


def test_units_in_the_attributes_of_hdf5_and_parquet_are_used(tmp_path):
    """As h5py, netCDF4 and pandas' neighbours write them; else degrees would be radians without a word."""
    measured = {
        "time": (1e3 * SOUND["time"], "milliseconds since 2026-01-01"),
        "torque": (1e3 * SOUND["torque"], "mN m"),
    }
    measured["angle"] = (np.degrees(SOUND["angle"]), "degrees")
    with h5py.File(tmp_path / "log.nc", "w") as file:
        for name, (values, unit) in measured.items():
            for run, part in (("run_1", slice(60)), ("run_2", slice(60, None))):
                file[f"{run}/{name}"] = values[part]
                file[f"{run}/{name}"].attrs["units"] = unit
    log = Log.read(tmp_path / "log.nc")
    np.testing.assert_allclose(log.runs[1].output, SOUND["angle"][60:], atol=1e-9)
    np.testing.assert_allclose(log.runs[1].command, SOUND["torque"][60:], atol=1e-9)
    fields = [
        pa.field(name, pa.float64(), metadata={"unit": unit.split()[0] if name == "time" else unit})
        for name, (_, unit) in measured.items()
    ]
    table = pa.table([pa.array(values) for values, _ in measured.values()], schema=pa.schema(fields))
    pq.write_table(table, tmp_path / "log.parquet")
    (run,) = Log.read(tmp_path / "log.parquet").runs
    np.testing.assert_allclose(run.output, SOUND["angle"], atol=1e-9)


def test_dates_in_excel_are_stamps(tmp_path):
    stamps = pd.Timestamp("2026-03-01 10:00:00.25") + pd.to_timedelta(SOUND["time"], unit="s")
    rows = [[stamp.to_pydatetime(), *row[1:]] for stamp, row in zip(stamps, ROWS, strict=True)]
    content = excel({"log": [list(SOUND), *rows]})
    (tmp_path / "log.xlsx").write_bytes(content)
    run = Log.read(tmp_path / "log.xlsx").runs[0]
    np.testing.assert_allclose(run.time - run.time[0], SOUND["time"], atol=2e-6)


@pytest.mark.parametrize("kind", ["text", "parquet"])
def test_standard_input(monkeypatch, kind):
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(KINDS[kind])))
    table = read_table("-")
    same(table)
    assert table.name == "standard input"


def test_a_terminal_is_not_waited_for(monkeypatch):
    terminal = io.TextIOWrapper(io.BytesIO())
    monkeypatch.setattr(terminal, "isatty", lambda: True)
    monkeypatch.setattr(sys, "stdin", terminal)
    with pytest.raises(MalformedLog, match="nothing is piped"):
        read_table("-")


def test_a_folder_is_named_with_a_file_in_it(tmp_path):
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "bag_0.mcap").write_bytes(b"x")
    (tmp_path / "bag" / "metadata.yaml").write_bytes(b"x")
    with pytest.raises(MalformedLog, match=r"a folder cannot be opened.*bag_0\.mcap\.$"):
        read_table(tmp_path / "bag")


REFUSED = {
    "gzip cut off": (gzip.compress(TEXT)[:-20], r"not a readable \.gz file \(EOFError\), it is damaged or cut off"),
    "xz damaged": (lzma.compress(TEXT)[:40] + b"xxxxxxxx", r"not a readable \.xz"),
    "an archive of two": (zipped(TEXT, "a.csv", "b.csv"), "holds 2 files, unpack it"),
    "an empty archive": (zipped(b"", "folder/"), "holds 0 files"),
    "feather cut off": (KINDS["feather"][:900], r"not a readable \.feather"),
    "hdf5 cut off": (KINDS["hdf5"][:900], r"not a readable \.h5"),
    "npy cut off": (ARRAY[:900], r"not a readable \.npy"),
    "excel cut off": (KINDS["excel"][:2000], r"not a readable \.zip"),
    "excel without numbers": (excel({"log": [["a", "b"], ["c", "d"]]}), "no table of numbers"),
    "npy of objects": (written(lambda f: np.save(f, np.array([{}, {}]), allow_pickle=True)), r"not a readable \.npy"),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_refused_in_one_sentence(tmp_path, kind):
    content, message = REFUSED[kind]
    with pytest.raises(MalformedLog, match=message) as caught:
        read(tmp_path, content)
    check_sentence(str(caught.value))


@pytest.mark.parametrize("module", ["openpyxl", "h5py", "pyarrow.feather"])
def test_a_missing_library_is_reported_with_what_to_install(tmp_path, monkeypatch, module):
    monkeypatch.setitem(sys.modules, module, None)
    kind = {"openpyxl": "excel", "h5py": "hdf5", "pyarrow.feather": "feather"}[module]
    with pytest.raises(MalformedLog, match=r"install it with pip install 'antidrive\[logs\]'"):
        read(tmp_path, KINDS[kind])


@pytest.mark.parametrize("kind", [*KINDS, *PACKED])
def test_damaged_files_are_read_in_part_or_refused(tmp_path, kind):
    sound = PACKED[kind](TEXT) if kind in PACKED else KINDS[kind]
    rng = np.random.default_rng(0)
    for _ in range(25):
        damaged = bytearray(sound[: rng.integers(1, len(sound)) if rng.random() < 0.3 else None])
        for place in rng.integers(min(len(damaged), 10 ** rng.integers(2, 6)), size=3):
            damaged[place] = rng.integers(256)
        try:
            table = read(tmp_path, bytes(damaged), "log.mat" if kind == "mat v4" else "log")
        except AntidriveError as error:
            check_sentence(str(error))
        else:
            assert table.columns
