"""Text tables as recorders, scripts and oscilloscopes write them: where the names, units and numbers stand."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from sample_logs import motion

from identification.errors import MalformedLog
from identification.log import Log
from identification.reading.files import read_table
from identification.reading.units import kind_of

CASES = Path(__file__).parents[1].parent / "shared" / "cases"
SOUND = motion(samples=60)
ROWS = np.column_stack(list(SOUND.values()))


def table(folder, content, name="log.csv"):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return read_table(path)


def rows(separator=",", end="\n", pattern="{:.9g}", trailing=""):
    return "".join(separator.join(pattern.format(v) for v in row) + trailing + end for row in ROWS)


def same(read, names=tuple(SOUND), numbers=ROWS):
    np.testing.assert_allclose(
        np.column_stack([np.asarray(read.columns[name], dtype=float) for name in names]), numbers, rtol=1e-7, atol=1e-8
    )


def case(name):
    path = CASES / name
    if not path.exists():
        pytest.skip("the cases are not beside this checkout")
    return path


NAMES = "time,torque,angle,velocity\n"

LAID_OUT = {
    "csv.writer on Windows": (NAMES + rows()).replace("\n", "\r\r\n"),
    "double spaced": (NAMES + rows()).replace("\n", "\n\n"),
    "double spaced, CR LF": (NAMES + rows()).replace("\n", "\r\n\r\n"),
    "old Macintosh": (NAMES + rows()).replace("\n", "\r"),
    "byte order mark": "\ufeff" + NAMES + rows(),
    "quoted numbers": NAMES + "".join(",".join(f'"{v:.9g}"' for v in row) + "\n" for row in ROWS),
    "trailing separators": NAMES.replace("\n", ",,\n") + rows(trailing=",,"),
    "trailing separators below the names": NAMES + rows(trailing=","),
    "comments between the rows": NAMES + rows().replace("\n", "\n# a mark\n", 5),
    "names above a blank line": NAMES + "\n" + rows(),
    "names and then a comment": NAMES + "# started at noon\n" + rows(),
    "NumPy savetxt": "# time, torque, angle, velocity\n" + rows(" "),
    "NumPy savetxt with tabs between the names": "# time\ttorque\tangle\tvelocity\n" + rows(" "),
    "blanks as columns": "time    torque  angle   velocity\n" + rows("   "),
    "blanks at both ends": " time torque angle velocity \n" + "".join(" " + r + " \n" for r in rows(" ").splitlines()),
    "MATLAB comment": "%time\ttorque\tangle\tvelocity\n" + rows("\t"),
    "Fortran exponents": NAMES + rows(pattern="{:.9E}").replace("E", "D"),
    "preamble of keys and values": "Model,X\nRecord Length,1000\nSample Interval,0.005,\n" + NAMES + rows(),
    "preamble as wide as the table": "Model,X,,\nDate,2026-01-01,,\nSource,a,b,c\n" + NAMES + rows(),
    "WaveForms": "#Digilent WaveForms Oscilloscope\n#Device Name: X\n#Sample rate: 200Hz\n\n" + NAMES + rows(),
    "a note at the end": NAMES + rows() + "# end of file\n",
}


@pytest.mark.parametrize("kind", LAID_OUT)
def test_laid_out_in_any_way(tmp_path, kind):
    read = table(tmp_path, LAID_OUT[kind])
    same(read)
    assert list(read.columns) == list(SOUND)
    assert read.notes == ()


@pytest.mark.parametrize(
    "row", ["s,N m,rad,rad/s", "[s],[Nm],[rad],[rad/s]", "(s),(Nm),(rad),(rad/s)", "second,mNm,-,"]
)
@pytest.mark.parametrize("names", ["time,torque,angle,velocity", "x-axis,1,2,3"])
def test_a_row_of_units_below_the_names(tmp_path, names, row):
    read = table(tmp_path, f"Model,X\n{names}\n{row}\n{rows()}")
    assert list(read.columns) == names.split(",")
    same(read, names.split(","))
    units = [unit.strip("[]()-") for unit in row.split(",")]
    assert read.units == {name: unit for name, unit in zip(names.split(","), units, strict=True) if unit}
    assert read.notes == ()


def test_numbers_in_the_preamble_are_no_table(tmp_path):
    """EPOS Studio writes two lines of scales, names without one of the time, and units."""
    scale = "Scale:;{};True;100.000;0.500;-400.500;399.500\n"
    above = "Date:;2026-01-01 21:54:05\nSampling period:;40.000\n" + scale.format(0) + scale.format(1)
    names = ";Torque actual value;Position actual value;Velocity actual value\nms;%;mrad;rpm\n"
    read = table(tmp_path, above + names + rows(";"))
    same(read, ["1", "Torque actual value", "Position actual value", "Velocity actual value"])
    assert list(read.units.values()) == ["ms", "%", "mrad", "rpm"]
    assert read.notes == ()


def test_rows_before_a_further_column_are_no_preamble(tmp_path):
    """A logger that writes a column more from some row on: its first rows must not be lost without a word."""
    grown = "".join("0.1,0.2,0.3\n" for _ in range(10)) + rows()
    with pytest.raises(MalformedLog):
        table(tmp_path, "time,torque,angle\n" + grown)


def test_names_below_the_numbers_of_channels(tmp_path):
    """MR Configurator writes the signals below the channels, and the unit of the time beside them."""
    above = "Axis1\nSampling time interval(ms),5\nTime,Analog 1,Analog 2,Analog 3\n"
    read = table(tmp_path, above + "ms,Torque,Position,Servo motor speed\n" + rows())
    same(read, ["Time", "Torque", "Position", "Servo motor speed"])
    assert read.units == {"Time": "ms"}
    assert read.notes == ()


def test_units_as_agilent_writes_them(tmp_path):
    read = table(tmp_path, "x-axis,1,2\nsecond,Volt,Volt\n" + "".join(f"{k * 1e-3:.3e},0.5,{k}\n" for k in range(9)))
    assert list(read.columns) == ["x-axis", "1", "2"]
    assert read.units == {"x-axis": "second", "1": "Volt", "2": "Volt"}
    assert {kind_of(unit) for unit in read.units.values()} == {"s", "V"}


def test_names_that_are_units_too_are_names(tmp_path):
    """`t` is a ton, `u` an atomic mass and `m` a metre."""
    content = "".join(f"{k},{k},{k}\n" for k in range(9))
    assert list(table(tmp_path, "t,u,m\n" + content).columns) == ["t", "u", "m"]
    read = table(tmp_path, "t,u,m\ns,V,rad\n" + content)
    assert read.units == {"t": "s", "u": "V", "m": "rad"}


def test_types_and_descriptions_below_the_names_are_reported(tmp_path):
    read = table(tmp_path, NAMES + "REAL64,REAL64,REAL64,REAL64\n" + rows())
    same(read)
    assert read.notes == ("log.csv: line 2 is skipped, as there are no names, units or numbers",)


@pytest.mark.parametrize("above", ["", "the arm moves very slowly\n", "# the arm\n\n", "Station;7\n"])
@pytest.mark.parametrize("separator", [" ", "\t", ","])
def test_a_matrix_without_names_has_numbers_for_names(tmp_path, above, separator):
    read = table(tmp_path, above + rows(separator, trailing=" "), name="matrix.dat")
    same(read, ("1", "2", "3", "4"))
    assert read.notes == ("matrix.dat: no column names stand above the numbers; the columns are called 1 to 4",)


def test_unnamed_and_repeated_columns_are_called_by_position(tmp_path):
    read = table(tmp_path, ",torque,torque,2\n" + rows())
    assert list(read.columns) == ["1", "torque", "3", "2"]
    same(read, ("1", "torque", "3", "2"))


def test_row_numbers_of_r_and_column_numbers_of_pandas(tmp_path):
    numbered = "".join(f'"{k}" {row}\n' for k, row in enumerate(rows(" ").splitlines(), 1))
    read = table(tmp_path, '"time" "torque" "angle" "velocity"\n' + numbered)
    same(read)
    assert list(read.columns) == ["1", *SOUND]
    same(table(tmp_path, "0,1,2,3\n" + rows()), ("0", "1", "2", "3"))


def test_files_one_after_the_other(tmp_path):
    """The names, the units and the remarks of the first stand there again."""
    one = "# station 7\ntime,torque,angle,velocity\ns,N m,rad,rad/s\n" + rows()
    read = table(tmp_path, one + one)
    same(read, numbers=np.vstack([ROWS, ROWS]))
    assert read.notes == ("log.csv: the header is repeated from line 64 on; the repeats are skipped",)
    assert read.where(60) == "log.csv, row 64 (line 67)"


def test_a_wrong_cell_is_reported_by_its_line_below_blank_lines(tmp_path):
    lines = (NAMES + rows()).splitlines()
    lines[40] = "0.2,oops,0.1,0.1,9"
    with pytest.raises(MalformedLog, match="line 81: 5 cells where the names give 4"):
        table(tmp_path, "\n\n".join(lines))


THOUSANDS = {
    "English, quoted": ('"{:,.4f}"', ","),
    "English": ("{:,.4f}", ";"),
    "continental": ("{:,.4f}", "\t"),
}


@pytest.mark.parametrize("style", THOUSANDS)
def test_separators_between_thousands(tmp_path, style):
    pattern, separator = THOUSANDS[style]
    numbers = 3000 * ROWS
    cells = [[pattern.format(v) for v in row] for row in numbers]
    if style == "continental":
        cells = [[cell.translate(str.maketrans(",.", ".,")) for cell in row] for row in cells]
    read = table(tmp_path, separator.join(SOUND) + "\n" + "\n".join(map(separator.join, cells)))
    same(read, numbers=np.round(numbers, 4))


def test_names_may_go_on_in_the_next_line(tmp_path):
    read = table(tmp_path, '"time\n(s)","torque\n[N m]","angle","velocity\n\n(rad/s)"\n' + rows())
    same(read, names=("time (s)", "torque [N m]", "angle", "velocity  (rad/s)"))
    assert read.where(0) == "log.csv, row 1 (line 6)"


def test_a_preamble_of_comments_may_be_long(tmp_path):
    same(table(tmp_path, "# a setting\n" * 500 + NAMES + rows()))


def test_separators_are_set_alike_in_all_columns(tmp_path):
    """Whole numbers such as 1,026 are in doubt by themselves, not beside 1,026.5."""
    content = "time,torque,angle\n" + "".join(f'"{k + 1000.5:,.1f}","{k + 1000:,}","{k}"\n' for k in range(9))
    read = table(tmp_path, content)
    np.testing.assert_array_equal(read.columns["torque"], np.arange(9) + 1000)
    np.testing.assert_array_equal(read.columns["time"], np.arange(9) + 1000.5)


def test_a_garbled_first_line_of_a_serial_port_is_left_out(tmp_path):
    junk = b"4,-0.2\x00\xff3,1\r\n"
    read = table(tmp_path, junk + NAMES.encode() + rows().encode())
    same(read)
    assert any("first line is incomplete" in note for note in read.notes)
    assert read.where(0) == "log.csv, row 1 (line 3)"
    bare = table(tmp_path, junk + rows().encode())
    np.testing.assert_allclose(bare.columns["2"], SOUND["torque"], rtol=1e-7)
    with pytest.raises(MalformedLog, match="not a text table"):
        table(tmp_path, junk + b"1,2\n3,\x004\n", "log.bin")


@pytest.mark.parametrize(
    "line",
    [
        "(1710000000.000123) can0 181#A40F0000",
        " (1710000000.000123)  can0  181   [8]  A4 0F 00 00 00 00 00 00",
        "  can0  181   [2]  A4 0F",
        "   0.0123 1  181             Rx   d 8 A4 0F 00 00 00 00 00 00",
        ";$FILEVERSION=1.1",
    ],
)
def test_frames_of_a_bus_are_no_table(tmp_path, line):
    with pytest.raises(MalformedLog, match=r"CAN bus.*\.dbc"):
        table(tmp_path, f"{line}\n" * 60, "log.log")
    with pytest.raises(MalformedLog, match="CAN bus"):
        table(tmp_path, b"LOGG\x90\x00\x00\x00", "log.blf")


def test_a_decimal_comma_far_below_whole_numbers(tmp_path):
    content = "time;torque;angle\n" + "0;0;0\n" * 300 + "".join(f"{k};0,5;0,{k}\n" for k in range(1, 9))
    read = table(tmp_path, content)
    assert read.columns["torque"][-1] == 0.5
    assert read.columns["angle"][-1] == 0.8


def test_a_comma_that_may_be_either_is_refused_when_it_is_used(tmp_path):
    read = table(tmp_path, "time;torque\n" + "".join(f"{k}.25;1,234\n" for k in range(9)))
    assert read.columns["torque"].dtype == object


def test_names_with_blanks_above_columns_with_blanks(tmp_path):
    read = table(tmp_path, "  Time (s)   Motor torque   Angle (deg)   Speed\n" + rows("   "))
    same(read, ("Time (s)", "Motor torque", "Angle (deg)", "Speed"))


def test_a_header_that_states_where_it_ends(tmp_path):
    """LabVIEW: what is above looks like data, and the rows lack the cell of the comments."""
    end = "***End_of_Header***\t\t\t\n"
    units = "X_Dimension\tTime\tTime\tTime\nDate\t2019/03/01\t2019/03/01\t1\t1\nX0\t0.0\t0.0\t0\t0\n"
    head = f"Writer_Version\t2\nX_Columns\tOne\n{end}\n{units}{end}"
    read = table(tmp_path, head + "\t".join(SOUND) + "\tComment\n" + rows("\t"), name="log.lvm")
    same(read)
    assert read.notes == ()


@pytest.mark.parametrize("end", ["", "\tComment"])
def test_units_that_labview_gives_in_its_header(tmp_path, end):
    header = "***End_of_Header***\t\t\t\n"
    head = f"LabVIEW Measurement\t\nX_Columns\tOne\n{header}Channels\t3\nY_Unit_Label\tNm\tdeg\tdeg/s\t\n{header}"
    read = table(tmp_path, head + "\t".join(["X_Value", *list(SOUND)[1:]]) + end + "\n" + rows("\t"), name="log.lvm")
    assert read.units == {"torque": "Nm", "angle": "deg", "velocity": "deg/s"}


def test_labels_and_units_above_the_channels_of_a_scope(tmp_path):
    head = "Model,MDO3014,,,\nVertical Units,V,V,V,\nLabel,Torque,,Speed,\nTIME,CH1,CH2,CH3,\n"
    read = table(tmp_path, head + rows(trailing=","))
    assert list(read.columns) == ["TIME", "Torque", "CH2", "Speed"]
    assert read.units == {"Torque": "V", "CH2": "V", "Speed": "V"}
    assert list(table(tmp_path, "Label,7\n\n" + NAMES + rows()).columns) == list(SOUND)


def test_times_of_day_are_values(tmp_path):
    read = table(tmp_path, "Zeit;Moment\n" + "".join(f"09:41:{k:02d},250;0,{k}\n" for k in range(10, 40)))
    assert read.columns["Zeit"][3] == "09:41:13,250"
    np.testing.assert_allclose(read.columns["Moment"][3], 0.13)


def test_a_time_for_each_channel_with_units_in_the_names(tmp_path):
    late = SOUND["time"] + 0.001
    content = "Time (ms),A,Time (ms),B\n" + "".join(
        f"{1e3 * t},{a},{1e3 * u},{b}\n"
        for t, a, u, b in zip(SOUND["time"], SOUND["angle"], late, SOUND["torque"], strict=True)
    )
    read = table(tmp_path, content)
    assert list(read.columns) == ["A", "B"]
    assert read.units == {"time": "ms"}
    np.testing.assert_allclose(read.clocks["B"], 1e3 * late)


def test_channels_without_a_name_each_are_refused(tmp_path):
    """Else the time of the second would be taken for the first."""
    head = "Name;Scope\nStarttime of export;1\n\nName;torque;angle\nSampleTime[ms];5;5\n\n"
    with pytest.raises(MalformedLog, match="4 columns but the line of names above has 3"):
        table(tmp_path, head + "".join(f"{5 * k};0.{k};{5 * k};1.{k}\n" for k in range(9)))


def test_a_temperature_is_no_second_time(tmp_path):
    assert list(table(tmp_path, "t,q,T\n" + "".join(f"{k},0.5,20\n" for k in range(9))).columns) == ["t", "q", "T"]


@pytest.mark.parametrize("suffix", ["", ".dat", ".log", ".asc", ".prn", ".out"])
def test_text_of_any_suffix(tmp_path, suffix):
    same(table(tmp_path, NAMES + rows(), name=f"log{suffix}"))


def test_a_million_rows_are_read_in_three_seconds(tmp_path):
    """A sixteenth of that, with blank lines between, so that the slow path is the one measured."""
    many = np.tile(ROWS, (1024, 1))
    content = NAMES + "\n\n".join(",".join(f"{v:.9g}" for v in row) for row in many)
    path = tmp_path / "log.csv"
    path.write_text(content)
    begin = time.process_time()
    read = read_table(path)
    assert len(read.columns["time"]) == len(many) == 61440
    assert time.process_time() - begin < 3 / 16 * 4  # other work on the machine may take its share


# Of the cases


@pytest.mark.parametrize("name", ["double_spaced.csv", "windows_csv_writer.csv"])
def test_case_blank_lines(name):
    read = read_table(case(f"use/11-blank-lines/{name}"))
    assert list(read.columns) == ["time", "torque", "angle"]
    assert all(np.isfinite(column).all() for column in read.columns.values())
    assert read.notes == ()


def test_case_a_matrix_without_names_and_time():
    read = read_table(case("logs/13-no-time-column/log.csv"))
    assert list(read.columns) == ["1", "2", "3", "4", "5", "6", "7"]
    np.testing.assert_array_equal([column[1] for column in read.columns.values()],
        [30.1551, 0.988024, 0, -0.132474, 3.96777, 0.0201416, -0.82982])  # fmt: skip
    log = Log.read(case("logs/13-no-time-column/log.csv"), mapping={"angle": "1", "torque": "5"}, rate=1000.0)
    assert log.runs[0].sample_time == pytest.approx(1e-3)
    assert len(log.runs[0]) > 0.9 * len(read.columns["1"])


def test_case_separators_at_the_ends_of_rows():
    read = read_table(case("logs/08-hint-by-spelling/log2.csv"))
    assert list(read.columns)[:3] == ["time", "q3", "dq3"]
    assert len(read.columns) == 13
    read = read_table(case("logs/08-hint-by-spelling/log.csv"))
    assert len(read.columns) == 26
    assert str(read.columns["Timestamp"][0]).startswith("2025-08-08 09:07:14.606")


@pytest.mark.parametrize("labels", [None, ("time", "torque", "angle")])
def test_signals_in_rows_become_columns(tmp_path, labels):
    sound = motion(samples=400)
    rows = [",".join(f"{value:.9g}" for value in sound[name]) for name in ("time", "torque", "angle")]
    rows = rows if labels is None else [f"{label},{row}" for label, row in zip(labels, rows, strict=True)]
    (tmp_path / "rows.csv").write_text("\n".join(rows) + "\n")
    table = read_table(tmp_path / "rows.csv")
    names = labels or ("1", "2", "3")
    assert tuple(table.columns) == names
    np.testing.assert_allclose(table.columns[names[2]], sound["angle"], atol=1e-8)
    assert table.notes[-1] == "rows.csv: each of its 3 lines is one signal"
