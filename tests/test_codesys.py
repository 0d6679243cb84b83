"""Traces of CODESYS, as the trace editor saves them."""

from __future__ import annotations

import numpy as np
import pytest
from sample_logs import motion
from test_malformed_logs import check_sentence
from test_text_tables import case

from identification.errors import MalformedLog
from identification.log import Log
from identification.reading.files import read_table
from plant.errors import AntidriveError

SOUND = motion(samples=600)


def trace(variables, *, flags="16", unit=1e3, end="\n", header="[key]; [value]\n", footer=""):
    """The trace of variables: name -> (times [s], values)."""
    text = header + f"Version; 0x03050000\nName; Application.Trace\nIecTaskName; MainTask\nComment; \nFlags; {flags}\n"
    for k, (name, (times, values)) in enumerate(variables.items()):
        text += (
            f"{k}.Variable; {name}\n{k}.Address.AddrFlags; 0x00000000\n{k}.Class; 14\n{k}.GraphColor; 42\n{k}.Data; \n"
        )
        text += "".join(f"; {round(unit * t)}; {v}\n" for t, v in zip(times, values, strict=True))
    return (text + footer).replace("\n", end)


SLOW = slice(None, None, 4)
VARIABLES = {
    "GVL.torque": (SOUND["time"], SOUND["torque"]),
    "PLC_PRG.axis.angle": (SOUND["time"], SOUND["angle"]),
    "GVL.temperature": (SOUND["time"][SLOW], SOUND["angle"][SLOW]),
}
MAPPING = {"torque": "GVL.torque", "angle": "PLC_PRG.axis.angle"}


def read(folder, content, name="log.trace.csv"):
    path = folder / name
    path.write_bytes(content.encode())
    return read_table(path)


@pytest.mark.parametrize(
    ("flags", "factor", "unit"), [("16", 1e3, "ms"), ("32", 1e6, "us"), ("36", 1e6, "us"), ("20", 1e3, "ms")]
)
def test_each_variable_has_its_clock_in_the_unit_of_its_flags(tmp_path, flags, factor, unit):
    table = read(tmp_path, trace(VARIABLES, flags=flags, unit=factor))
    assert list(table.columns) == list(VARIABLES)
    assert table.units == {"time": unit}
    assert table.notes == ()
    for name, (times, values) in VARIABLES.items():
        np.testing.assert_allclose(table.clocks[name], factor * times, atol=0.5)
        np.testing.assert_allclose(table.columns[name], values)
    assert table.clocks["GVL.torque"] is table.clocks["PLC_PRG.axis.angle"]
    run = Log.read(tmp_path / "log.trace.csv", mapping=MAPPING).runs[0]
    np.testing.assert_allclose(run.time, SOUND["time"], atol=1e-9)
    np.testing.assert_allclose(run.output, SOUND["angle"])


@pytest.mark.parametrize("style", [{"end": "\r\n"}, {"end": "\n\n"}, {"header": ""}, {"footer": "; 9999"}])
def test_styles(tmp_path, style):
    table = read(tmp_path, trace(VARIABLES, **style))
    assert len(table.columns["GVL.torque"]) == 600
    cut = ("log.trace.csv: the last line (1372) is cut off and left out",)
    assert table.notes == (cut if "footer" in style else ())


def test_truth_values_and_flags_without_information(tmp_path):
    on = {"GVL.on": ([0, 1, 2], ["TRUE", "FALSE", "TRUE"])}
    table = read(tmp_path, trace(on, flags="0"))
    np.testing.assert_array_equal(table.columns["GVL.on"], [1, 0, 1])
    assert "milliseconds or microseconds (Flags 0)" in table.notes[0]


REFUSED = {
    "a sample that is none": (trace(VARIABLES).replace("; 10; ", "; ten; ", 1), "line 14: '; ten; .* is no sample"),
    "a line that is none": (
        trace(VARIABLES).replace("1.Class; 14", "oops"),
        "line 614: this is no line of a CODESYS trace",
    ),
    "nothing recorded": (trace({"GVL.torque": ([], [])}), "holds no samples"),
    "samples before a variable": ("[key]; [value]\n; 2; 3\n; 4; 5\nFlags; 16\n", "line 2: '; 2; 3' is no sample"),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_refused_in_one_sentence(tmp_path, kind):
    content, message = REFUSED[kind]
    with pytest.raises(MalformedLog, match=message) as caught:
        read(tmp_path, content)
    check_sentence(str(caught.value))


def test_damaged_traces_are_read_in_part_or_refused(tmp_path):
    rng = np.random.default_rng(0)
    sound = bytearray(trace(VARIABLES).encode())
    for _ in range(60):
        damaged = sound[: rng.integers(20, len(sound))]
        for place in rng.integers(len(damaged) if rng.random() < 0.5 else 20, size=3):
            damaged[place] = rng.integers(256)
        (tmp_path / "log.csv").write_bytes(damaged)
        try:
            assert read_table(tmp_path / "log.csv").columns
        except AntidriveError as error:
            check_sentence(str(error))


def test_case_codesys_trace():
    table = read_table(case("logs/11-codesys-trace/log.csv"))
    assert list(table.columns) == [
        "DB_HMI.HMI_SP_Local_Automatico", "Main_Control.Velocidad_Scaled", "Main_Control.PID_OUT"
    ]  # fmt: skip
    assert table.units == {"time": "ms"}
    assert table.notes == ()
    assert all(clock[0] == 2 and clock[-1] == 30322 for clock in table.clocks.values())
    with pytest.raises(AntidriveError) as caught:
        Log.read(case("logs/11-codesys-trace/log.csv"))
    check_sentence(str(caught.value))
