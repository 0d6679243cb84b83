"""MF4, TDMS, MCAP and TwinCAT Scope come out as the same SI channels as a CSV file; damage is told in one sentence."""

from __future__ import annotations

import hashlib
import json
import sys

import h5py
import numpy as np
import pytest
from front_door import antidrive, columns
from mcap.writer import Writer
from measurement_logs import mcap, mf4, scope, tdms
from sample_logs import motion
from test_malformed_logs import check_sentence

from identification.errors import MalformedLog
from identification.log import Log
from plant.errors import AntidriveError, BadParameter

SOUND = motion(counts=65536)
NAMES = ("torque", "angle", "velocity")
UNITS = {"angle": "deg", "torque": "mNm", "velocity": "1/min"}
INSIDE = SOUND | {  # the same in the units above
    "angle": np.rad2deg(SOUND["angle"]),
    "torque": 1e3 * SOUND["torque"],
    "velocity": SOUND["velocity"] * 30 / np.pi,
}
TOPIC = {"angle": "/servo.drive.angle", "torque": "/servo.drive.torque", "velocity": "/servo.drive.velocity"}


def same(log, columns=SOUND):
    (run,) = log.runs
    np.testing.assert_allclose(run.time - run.time[0], columns["time"], atol=1e-8)
    np.testing.assert_allclose(run.command, columns["torque"], rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(run.output, columns["angle"], atol=1e-8)
    np.testing.assert_allclose(run.velocity, columns["velocity"], rtol=1e-7, atol=1e-8)
    assert run.valid.all()
    assert log.repairs == ()


WRITE = {
    "mf4": (lambda path: mf4(path / "log.mf4", SOUND), {}),
    "tdms": (lambda path: tdms(path / "log.tdms", SOUND), {}),
    "tdms with a time channel": (lambda path: tdms(path / "log.tdms", SOUND, waveform=False), {}),
    "mcap": (lambda path: mcap(path / "log.mcap", {"/servo": SOUND}), TOPIC),
}


@pytest.mark.parametrize("kind", WRITE)
def test_one_clock_and_si(tmp_path, kind):
    write, mapping = WRITE[kind]
    path = write(tmp_path)
    log = Log.read(path, mapping=mapping)
    same(log)
    assert log.warnings == ()
    assert log.sources[0].file == path.name
    assert log.sources[0].sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.parametrize(
    "write",
    [
        lambda path: mf4(path / "log.mf4", INSIDE, units=UNITS),
        lambda path: tdms(path / "log.tdms", INSIDE, units=UNITS),
        lambda path: scope_file(path, [INSIDE], units={**UNITS, "torque": "mNm (Torque)"}),
    ],
)
def test_file_units_are_used_unless_the_user_gives_others(tmp_path, write):
    path = write(tmp_path)
    log = Log.read(path)
    same(log)
    (warning,) = log.warnings
    assert "units from the file" in warning
    assert "'angle' in deg" in warning
    same(Log.read(path, units={"torque": "N m"}), SOUND | {"torque": INSIDE["torque"]})


def test_a_scale_replaces_amperes_but_never_degrees_unreported(tmp_path):
    path = mf4(tmp_path / "log.mf4", INSIDE, units=UNITS | {"torque": "A"})
    same(Log.read(path, scales={"torque": 1e-3}))
    with pytest.raises(MalformedLog, match=r"'A' of column 'torque' cannot .*--scale torque=VALUE") as caught:
        Log.read(path)
    check_sentence(str(caught.value))
    with pytest.raises(BadParameter, match=r"--unit angle='deg' if .* --unit angle='rad' if") as refusal:
        Log.read(path, scales={"torque": 1e-3, "angle": -1.0})
    check_sentence(str(refusal.value))
    mirrored = Log.read(path, scales={"torque": 1e-3, "angle": -1.0}, units={"angle": "deg"})
    np.testing.assert_allclose(mirrored.runs[0].output, -SOUND["angle"], atol=1e-8)


def test_a_velocity_in_an_unknown_unit_is_left_out_and_reported(tmp_path):
    log = Log.read(mf4(tmp_path / "log.mf4", SOUND, units={"velocity": "counts/s"}))
    assert log.runs[0].velocity is None
    assert any("'velocity' is left out" in warning for warning in log.warnings)


LATE = {"time": SOUND["time"] + 0.0013, "torque": np.interp(SOUND["time"] + 0.0013, SOUND["time"], SOUND["torque"])}
REST = {name: SOUND[name] for name in ("time", "angle", "velocity")}
SLOW = {"time": SOUND["time"][::10], "temperature": np.linspace(20, 30, 60)}


@pytest.mark.parametrize(
    ("write", "mapping"),
    [
        (lambda path: mf4(path / "log.mf4", SLOW, LATE, REST), {}),
        (lambda path: tdms(path / "log.tdms", SLOW, LATE, REST), {}),
        (lambda path: mcap(path / "log.mcap", {"/slow": SLOW, "/amp": LATE, "/servo": REST}), TOPIC),
        (lambda path: scope_file(path, [SLOW, LATE, REST]), {}),
        (lambda path: scope_file(path, [SLOW, LATE, REST], dated=True), {}),
    ],
)
def test_channels_are_resampled_on_the_clock_of_the_output(tmp_path, write, mapping):
    """The angle stays as it was measured; the torque, 1.3 ms late, is interpolated; the temperature is left alone."""
    log = Log.read(write(tmp_path), mapping=mapping | ({"torque": "/amp.torque"} if mapping else {}))
    (run,) = log.runs
    np.testing.assert_allclose(run.output, SOUND["angle"][1:], atol=1e-8)  # the torque begins a sample late
    np.testing.assert_allclose(run.time - run.time[0], SOUND["time"][:-1], atol=1e-6)
    np.testing.assert_allclose(
        run.command[1:-1], np.interp(SOUND["time"][2:-1], *LATE.values()), atol=5e-3
    )  # TDMS dates to 1 us
    warnings = [warning for warning in log.warnings if "own time" in warning]
    assert len(warnings) == 1
    assert "torque' interpolated" in warnings[0]
    assert "temperature" not in warnings[0]


def test_what_is_missing_in_one_channel_is_not_bridged(tmp_path):
    """The torque drops out for 50 ms, of which 9 samples of the angle know nothing."""
    kept = np.ones(600, dtype=bool)
    kept[300:309] = False
    long = motion(samples=2000)
    kept = np.concatenate((kept, np.ones(1400, dtype=bool)))
    torque = {"time": long["time"][kept], "torque": long["torque"][kept]}
    log = Log.read(mf4(tmp_path / "log.mf4", torque, {k: long[k] for k in ("time", "angle")}))
    assert any("9 missing samples of 'torque' held" in repair for repair in log.repairs)


def test_the_number_of_a_run_is_held_and_not_interpolated(tmp_path):
    runs = {"time": np.array([0.0, 1.4999]), "run": np.array([3.0, 4.0])}
    log = Log.read(mf4(tmp_path / "log.mf4", runs, SOUND))
    assert [run.run for run in log.runs] == ["3", "4"]
    assert [len(run) for run in log.runs] == [300, 300]


def test_a_wrap_in_another_channel_is_not_interpolated(tmp_path):
    turning = 9 * SOUND["angle"] + 3.0
    motor = {"time": SOUND["time"] + 0.002, "angle_1": np.mod(turning, 2 * np.pi), "angle_2": turning}
    run = Log.read(mf4(tmp_path / "log.mf4", SOUND, motor)).runs[0]
    truth = np.interp(run.time, motor["time"], turning)
    shift = run.drive_angles[:, 0] - truth
    np.testing.assert_allclose(shift, np.median(shift), atol=0.15)


def test_channels_of_one_name_are_distinguished_by_their_group(tmp_path):
    other = {"time": SOUND["time"], "angle": -SOUND["angle"]}
    for path in (
        mf4(tmp_path / "log.mf4", SOUND, other, names=("group 0", "group 1")),
        tdms(tmp_path / "log.tdms", SOUND, other),
    ):
        same(Log.read(path, mapping={"angle": "group 0/angle"}))
        with pytest.raises(MalformedLog, match=r"group 1/angle .*angle\?"):
            Log.read(path)


def test_lists_in_mcap_are_columns_and_other_than_json_reported(tmp_path):
    path = mcap(tmp_path / "log.mcap", {"/servo": SOUND}, other=["/camera"])
    log = Log.read(path, mapping=TOPIC | {"angle": "/servo.pair:1"})
    same(log)
    assert "not those of '/camera' (cdr)" in log.warnings[0]
    with pytest.raises(MalformedLog, match=r"^cdr\.mcap: .* are read, but not those of '/servo' \(cdr\)") as caught:
        Log.read(mcap(tmp_path / "cdr.mcap", {"/servo": SOUND}, encoding="cdr"))
    check_sentence(str(caught.value))


def test_a_field_that_only_some_messages_have(tmp_path):
    torque = SOUND["torque"].copy()
    torque[[0, 1, 2, 598, 599]] = np.nan
    log = Log.read(mcap(tmp_path / "log.mcap", {"/servo": SOUND | {"torque": torque}}), mapping=TOPIC)
    assert "3 samples at the start and 2 at the end are left out" in log.repairs[0]
    np.testing.assert_allclose(log.runs[0].command, SOUND["torque"][3:598], rtol=1e-12)


def test_a_tdms_file_that_is_cut_off_is_read_up_to_there(tmp_path, caplog):
    path = tdms(tmp_path / "log.tdms", SOUND)
    path.write_bytes(path.read_bytes()[:-2000])
    log = Log.read(path)
    assert len(log.runs[0]) == 500
    assert any("cut off" in warning for warning in log.warnings)
    assert caplog.records == []


# TwinCAT Scope


def scope_file(folder, groups, **style):
    path = folder / "scope.csv"
    path.write_text(scope(groups, **style))
    return path


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize(
    "style",
    [
        {},
        {"decimal": ".", "separator": ";"},
        {"decimal": ".", "separator": ",", "eof": False},
        {"dated": True},
        {"padded": True},
    ],
)
def test_scope_with_its_header(tmp_path, style, order):
    """Several channels a group, groups of other lengths, milliseconds: nothing has to be said on the command line."""
    log = Log.read(scope_file(tmp_path, [SLOW, SOUND][::order], **style))
    (run,) = log.runs
    np.testing.assert_allclose(run.time - run.time[0], SOUND["time"], atol=2e-6)
    np.testing.assert_allclose(run.output, SOUND["angle"], atol=1e-8)
    np.testing.assert_allclose(run.command, SOUND["torque"], rtol=1e-7, atol=1e-8)
    assert not any("not read" in warning for warning in log.warnings)


def test_a_slow_channel_that_the_scope_pads_by_repeating_it(tmp_path):
    half = {name: SOUND[name][::2] for name in ("time", "torque")}
    run = Log.read(scope_file(tmp_path, [half, REST], padded=True)).runs[0]
    np.testing.assert_allclose(run.command[::2], half["torque"], rtol=1e-7)


def test_a_scope_that_scales_leaves_the_unit_to_the_user(tmp_path):
    path = scope_file(tmp_path, [INSIDE], units=UNITS, scales={"torque": "-2"})
    log = Log.read(path, scales={"torque": 1e-3})
    same(log)
    assert any("scale or offset for 'torque'" in warning for warning in log.warnings)


def test_lines_of_a_scope_export_are_counted(tmp_path):
    content = scope([SOUND]).splitlines()
    first = next(k for k, line in enumerate(content) if line.startswith("0\t"))
    spoilt = content[first + 7].split("\t")
    spoilt[0] = "-1"
    content[first + 7] = "\t".join(spoilt)
    (tmp_path / "scope.csv").write_text("\n".join(content))
    (warning,) = [text for text in Log.read(tmp_path / "scope.csv").warnings if "out of its place" in text]
    assert f"row 8 (line {first + 8})" in warning


# MATLAB


def test_mat_version_7_3_as_matlab_writes_it(tmp_path):
    """A header of text in front, and a structure, which is a group."""
    path = tmp_path / "log.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in SOUND.items():
            file.create_dataset(f"record/{name}", data=values[None, :])
    content = bytearray(path.read_bytes())
    content[:20] = b"MATLAB 7.3 MAT-file,"
    path.write_bytes(content)
    same(Log.read(path))


# What cannot be read


def cut(path, size):
    path.write_bytes(path.read_bytes()[:size])
    return path


BAD = {
    "mf4 cut at once": (lambda p: cut(mf4(p / "log.mf4", SOUND), 100), "not a readable .mf4"),
    "mf4 cut in its data": (lambda p: cut(mf4(p / "log.mf4", SOUND), 9000), "not a readable .mf4"),
    "tdms cut at once": (lambda p: cut(tdms(p / "log.tdms", SOUND), 20), "no numeric columns"),
    "mcap cut at once": (lambda p: cut(mcap(p / "log.mcap", {"/servo": SOUND}), 10), "not a readable .mcap"),
    "mcap cut in its data": (lambda p: cut(mcap(p / "log.mcap", {"/servo": SOUND}), 9000), "not a readable .mcap"),
    "mcap of nothing": (lambda p: mcap(p / "log.mcap", {}), "no numeric columns"),
    "mcap of broken json": (lambda p: garbled(p / "log.mcap"), "'/servo' (json, which cannot be decoded)"),
    "mf4 without an angle": (lambda p: mf4(p / "log.mf4", SLOW), "'angle'"),
    "mf4 beyond its record": (lambda p: beyond(mf4(p / "log.mf4", SOUND)), "not a readable .mf4"),
    "mf4 with a name that is nowhere": (lambda p: without_names(mf4(p / "log.mf4", SOUND)), "not a readable .mf4"),
    "clock of another channel goes back": (
        lambda p: mf4(p / "log.mf4", LATE | {"time": LATE["time"][::-1]}, REST),
        "the time of channel 'torque' does not increase",
    ),
}


def garbled(path):
    """A message that is no JSON, with all checksums right."""
    with path.open("wb") as stream:
        file = Writer(stream)
        file.start()
        channel = file.register_channel(topic="/servo", message_encoding="json", schema_id=0)
        file.add_message(channel_id=channel, log_time=0, publish_time=0, data=b'{"angle": 1.')
        file.finish()
    return path


def channel_block(content):
    """Where the first channel that is not the time is described."""
    return [k for k in range(len(content)) if content[k : k + 4] == b"##CN"][1]


def without_names(path):
    """The link to the channel's name leads into the middle of something."""
    content = bytearray(path.read_bytes())
    content[channel_block(content) + 40] = 1
    path.write_bytes(content)
    return path


def beyond(path):
    """The channel begins further on than the record is long."""
    content = bytearray(path.read_bytes())
    offset = channel_block(content) + 24 + 8 * 8 + 4  # header, eight links, four bytes of types
    assert int.from_bytes(content[offset : offset + 4], "little") == 8
    content[offset : offset + 4] = (246).to_bytes(4, "little")
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("name", BAD)
def test_refused_in_one_sentence(tmp_path, name, capfd):
    write, message = BAD[name]
    path = write(tmp_path)
    with pytest.raises(MalformedLog) as caught:
        Log.read(path)
    check_sentence(str(caught.value))
    assert str(caught.value).startswith(path.name)
    assert message in str(caught.value)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("module", ["asammdf", "nptdms", "mcap.reader"])
def test_a_missing_library_is_reported_with_what_to_install(tmp_path, monkeypatch, module):
    kind = {"asammdf": "mf4", "nptdms": "tdms", "mcap.reader": "mcap"}[module]
    path = WRITE[kind][0](tmp_path)
    monkeypatch.setitem(sys.modules, module, None)
    result = antidrive("identify", path, "--out", tmp_path / "out")
    assert result.code == 2
    assert result.out == ""
    assert result.err.count("\n") == 1
    assert "pip install 'antidrive[logs]'" in result.err


def test_through_the_command_line(tmp_path):
    table = columns(duration=8.0)
    path = mf4(tmp_path / "log.mf4", table | {"angle": np.rad2deg(table["angle"])}, units={"angle": "deg"})
    result = antidrive("identify", path, "--out", tmp_path / "out", "--quiet")
    assert (result.code, result.err) == (0, "")
    model = json.loads((tmp_path / "out" / "model.json").read_text())
    assert model["parameters"]["inertia"]["value"] == pytest.approx(0.8, rel=0.1)
    assert model["source"][0]["sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()


def test_every_reader_raises_only_errors_of_antidrive(tmp_path):
    """Damaged TDMS and MCAP files are read as what they still say, or refused."""
    rng = np.random.default_rng(0)
    for path in (tdms(tmp_path / "log.tdms", SOUND), mcap(tmp_path / "log.mcap", {"/servo": SOUND})):
        sound = path.read_bytes()
        for _ in range(30):
            damaged = bytearray(sound)
            for place in rng.integers(len(damaged) if rng.random() < 0.5 else 2000, size=3):
                damaged[place] = rng.integers(256)
            path.write_bytes(damaged)
            try:
                Log.read(path, mapping=TOPIC if path.suffix == ".mcap" else {})
            except AntidriveError as error:
                check_sentence(str(error))
