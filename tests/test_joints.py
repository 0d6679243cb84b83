"""Logs of robots with several joints: ROS 2 in MCAP, exports of ROS as text, LeRobot; and one joint of them."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from mcap_ros2.writer import Writer
from sample_logs import motion
from test_malformed_logs import check_sentence

from identification.errors import MalformedLog, MissingColumns
from identification.log import Log
from identification.reading.files import read_table
from identification.reading.joints import select_joint, with_joints
from identification.reading.reading_options import Reading
from identification.reading.table import Table
from plant.errors import AntidriveError, BadParameter

SOUND = motion(samples=200)
LINE = "================================================================================\n"
STAMP = "builtin_interfaces/Time stamp\nstring frame_id\n"
HEADER = f"{LINE}MSG: std_msgs/Header\n{STAMP}{LINE}MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
STATE = f"std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n{HEADER}"
POINT = f"{LINE}MSG: trajectory_msgs/JointTrajectoryPoint\nfloat64[] positions\nfloat64[] velocities\n"
CONTROL = (
    "std_msgs/Header header\nstring[] joint_names\ntrajectory_msgs/JointTrajectoryPoint reference\n"
    f"trajectory_msgs/JointTrajectoryPoint feedback\n{POINT}{HEADER}"
)
WRENCH = f"std_msgs/Header header\nfloat64 torque\nuint8[] picture\nfloat32[3] axis\n{HEADER}"
EPOCH = 1_700_000_000


def header(time, epoch=EPOCH):
    return {"stamp": {"sec": epoch + int(time), "nanosec": round(1e9 * (time % 1))}, "frame_id": "base"}


def state(time, position, torque, *, names=("shoulder", "elbow"), epoch=EPOCH):
    other = 0.1
    arrays = {"position": [other, position], "velocity": [], "effort": [other, torque]}
    if names[0] != "shoulder":
        arrays = {key: values[::-1] for key, values in arrays.items()}
    return {"header": header(time, epoch) if epoch else header(0, 0), "name": list(names), **arrays}


def bag(path, topics, late=0.0):
    """topics: name -> (message type, its definition, [(time, message)]), written `late` after their stamps."""
    with path.open("wb") as stream, Writer(stream) as writer:
        for topic, (kind, definition, messages) in topics.items():
            schema = writer.register_msgdef(kind, definition)
            for time, message in messages:
                logged = EPOCH * 10**9 + round(1e9 * (time + late * (1 + np.sin(1e3 * time))))
                writer.write_message(topic, schema, message, log_time=logged)
    return path


def states(**options):
    rows = zip(SOUND["time"], SOUND["angle"], SOUND["torque"], strict=True)
    return ("sensor_msgs/msg/JointState", STATE, [(t, state(t, q, tau, **options)) for t, q, tau in rows])


def same(table, angle="position", torque="effort"):
    np.testing.assert_allclose(table.columns[angle], SOUND["angle"])
    np.testing.assert_allclose(table.columns[torque], SOUND["torque"])


def test_joint_states_of_ros_2(tmp_path):
    table = read_table(bag(tmp_path / "bag.mcap", {"/joint_states": states()}))
    assert table.joints == ("shoulder", "elbow")
    assert "/joint_states.position:elbow" in table.columns
    one = select_joint(table, "elbow")
    assert list(one.columns) == ["position", "effort"]
    assert one.joints == ()
    same(one)
    np.testing.assert_allclose(one.clocks["position"], SOUND["time"], atol=1e-8)
    mapping = {"angle": "/joint_states.position:elbow", "torque": "/joint_states.effort:elbow"}
    np.testing.assert_allclose(Log.read(tmp_path / "bag.mcap", mapping=mapping).runs[0].output, SOUND["angle"])


def test_stamps_count_and_not_when_they_were_logged(tmp_path):
    """What is logged late and unevenly; and simulated time, which is not that of the log."""
    table = read_table(bag(tmp_path / "bag.mcap", {"/joint_states": states()}, late=0.002))
    np.testing.assert_allclose(np.diff(table.clocks["/joint_states.position:elbow"]), 0.005, atol=1e-8)
    table = read_table(bag(tmp_path / "bag.mcap", {"/joint_states": states(epoch=1)}, late=0.002))
    np.testing.assert_allclose(np.diff(table.clocks["/joint_states.position:elbow"]), 0.005, atol=1e-8)
    table = read_table(bag(tmp_path / "bag.mcap", {"/joint_states": states(epoch=0)}, late=0.002))
    assert np.ptp(np.diff(table.clocks["/joint_states.position:elbow"])) > 1e-4


def test_topics_with_and_without_stamps_share_a_clock(tmp_path):
    bare = [(t, {"data": v}) for t, v in zip(SOUND["time"], SOUND["torque"], strict=True)]
    topics = {"/joint_states": states(epoch=1), "/torque": ("std_msgs/msg/Float64", "float64 data\n", bare)}
    table = read_table(bag(tmp_path / "bag.mcap", topics, late=0.001))
    off = table.clocks["/torque.data"] - table.clocks["/joint_states.position:elbow"]
    assert np.abs(off).max() < 3e-3


def test_joints_in_any_order_and_messages(tmp_path):
    kind, definition, messages = states()
    swapped = [
        (t, state(t, q, tau, names=("elbow", "shoulder")) if k % 2 else message)
        for k, ((t, message), q, tau) in enumerate(zip(messages, SOUND["angle"], SOUND["torque"], strict=True))
    ]
    closed = {"name": ["gripper"], "position": [0.0], "velocity": [], "effort": []}
    gripper = [(t + 1e-3, {"header": header(t + 1e-3), **closed}) for t in SOUND["time"]]
    table = read_table(
        bag(tmp_path / "bag.mcap", {"/joint_states": (kind, definition, sorted(swapped + gripper, key=lambda m: m[0]))})
    )
    one = select_joint(table, "elbow")
    known = np.isfinite(one.columns["position"])
    assert known.sum() == 200
    np.testing.assert_allclose(one.columns["position"][known], SOUND["angle"])


def test_a_controller_with_its_set_point(tmp_path):
    messages = [
        (t, {"header": header(t), "joint_names": ["shoulder", "elbow"],
             "reference": {"positions": [0.0, q + 0.1], "velocities": []},
             "feedback": {"positions": [0.0, q], "velocities": []}})
        for t, q in zip(SOUND["time"], SOUND["angle"], strict=True)
    ]  # fmt: skip
    topics = {"/arm/controller_state": ("control_msgs/msg/JointTrajectoryControllerState", CONTROL, messages)}
    one = select_joint(read_table(bag(tmp_path / "bag.mcap", topics)), "elbow")
    assert list(one.columns) == ["reference.positions", "feedback.positions"]
    np.testing.assert_allclose(one.columns["reference.positions"], SOUND["angle"] + 0.1)


def test_the_same_joint_on_two_topics_keeps_the_topics(tmp_path):
    table = read_table(bag(tmp_path / "bag.mcap", {"/joint_states": states(), "/joint_commands": states()}))
    one = select_joint(table, "elbow")
    assert set(one.columns) == {f"/joint_{kind}.{q}" for kind in ("states", "commands") for q in ("position", "effort")}
    assert set(one.clocks) == set(one.columns)


def test_pictures_are_no_channels(tmp_path):
    axis = [0.0, 0.0, 1.0]
    messages = [
        (t, {"header": header(t), "torque": tau, "picture": bytes(90_000 if k % 9 == 1 else 3), "axis": axis})
        for k, (t, tau) in enumerate(zip(SOUND["time"], SOUND["torque"], strict=True))
    ]
    table = read_table(bag(tmp_path / "bag.mcap", {"/wrench": ("my_msgs/msg/Wrench", WRENCH, messages)}))
    assert list(table.columns) == ["/wrench.torque", *(f"/wrench.axis:{k}" for k in (1, 2, 3))]


def test_an_undecodable_topic_leaves_the_others_readable(tmp_path):
    """The decoder knows no wide strings; and a message that ends too early."""
    path = tmp_path / "bag.mcap"
    with path.open("wb") as stream, Writer(stream) as writer:
        states_of = writer.register_msgdef("sensor_msgs/msg/JointState", STATE)
        wide = writer._writer.register_schema(name="a/msg/Wide", encoding="ros2msg", data=b"wstring text\n")
        idl = writer._writer.register_schema(name="a/msg/Idl", encoding="ros2idl", data=b"module a {};")
        for name, schema in (("/wide", wide), ("/idl", idl)):
            channel = writer._writer.register_channel(topic=name, message_encoding="cdr", schema_id=schema)
            writer._writer.add_message(channel_id=channel, log_time=0, publish_time=0, data=b"\0\1\0\0\0\0\0\0")
        for t, message in states()[2]:
            writer.write_message("/joint_states", states_of, message, log_time=round(1e9 * t))
    table = read_table(path)
    same(select_joint(table, "elbow"))
    assert "'/wide' (cdr, which cannot be decoded), '/idl' (cdr)" in table.notes[0]


def test_one_of_several_must_be_chosen_and_exist(tmp_path):
    table = read_table(bag(tmp_path / "bag.mcap", {"/joint_states": states()}))
    with pytest.raises(MalformedLog, match=r"2 joints, choose one with --joint NAME: shoulder, elbow\.$") as caught:
        select_joint(table)
    check_sentence(str(caught.value))
    with pytest.raises(BadParameter, match="no joint 'elbows', is it 'elbow'"):
        select_joint(table, "elbows")
    with pytest.raises(BadParameter, match="no joint 'x', the log has shoulder, elbow"):
        select_joint(table, "x")
    with pytest.raises(BadParameter, match="there are no joints in this log"):
        select_joint(Table(name="log.csv", columns=SOUND, sha256=""), "elbow")
    mapped = select_joint(table, mapped=["/joint_states.position:elbow"])
    assert mapped is table
    kept = select_joint(table, "elbow", mapped=["/joint_states.position:shoulder"])
    assert list(kept.columns) == ["/joint_states.position:shoulder", "position", "effort"]


def test_a_single_joint_needs_no_choice(tmp_path):
    rows = [(t, {"header": header(t), "name": ["arm"], "position": [q], "velocity": [], "effort": [tau]})
            for t, q, tau in zip(SOUND["time"], SOUND["angle"], SOUND["torque"], strict=True)]  # fmt: skip
    table = read_table(bag(tmp_path / "bag.mcap", {"/joint_states": ("sensor_msgs/msg/JointState", STATE, rows)}))
    same(select_joint(table))
    plain = Table(name="log.csv", columns=SOUND, sha256="")
    assert select_joint(plain) is plain


def test_exports_of_ros_as_text(tmp_path):
    rows = list(zip(SOUND["time"], SOUND["angle"], SOUND["torque"], strict=True))
    echo = (
        "%time,field.header.stamp,field.name0,field.name1,field.position0,field.position1,field.effort0,field.effort1\n"
    )
    echo += "".join(f"{round(1e9 * t)},0,shoulder,elbow,0.1,{q},0.1,{tau}\n" for t, q, tau in rows)
    plot = "__time,/joint_states/shoulder/position,/joint_states/elbow/position,/joint_states/elbow/effort\n"
    plot += "".join(f"{t},0.1,{q},{tau}\n" for t, q, tau in rows)
    bagpy = echo.replace("field.", "")
    bagpy = re.sub(r"(name|position|effort)(\d)", r"\1_\2", bagpy)
    lists = "Time,name,position,effort\n"
    lists += "".join(f'{t},"[\'shoulder\', \'elbow\']","[0.1, {q}]","(0.1, {tau})"\n' for t, q, tau in rows)
    exports = ((echo, "time"), (plot, "__time"), (bagpy, "time"), (lists, "Time"))
    for content, rest in exports:
        (tmp_path / "log.csv").write_text(content)
        table = read_table(tmp_path / "log.csv")
        assert table.joints == ("shoulder", "elbow")
        one = select_joint(table, "elbow")
        same(one)
        assert rest in one.columns


def test_an_encoder_and_a_drive_are_no_joints(tmp_path):
    (tmp_path / "log.csv").write_text("__time,/axis/encoder/position,/axis/drive/effort\n0,1,2\n1,2,3\n")
    assert read_table(tmp_path / "log.csv").joints == ()


def test_lists_in_the_cells_of_a_text_table(tmp_path):
    """As NumPy prints them, without commas; what is no list of numbers gives no number."""
    content = "time,state,label\n" + "".join(
        f"{t},[0.1  {q}],up\n" for t, q in zip(SOUND["time"], SOUND["angle"], strict=True)
    )
    (tmp_path / "log.csv").write_text(content + "2.0,[open],up\n")
    table = read_table(tmp_path / "log.csv")
    assert list(table.columns) == ["time", "label", "state:1", "state:2"]
    np.testing.assert_allclose(table.columns["state:2"][:200], SOUND["angle"])
    assert np.isnan(table.columns["state:2"][200])


def lerobot(folder, names):
    frame = pd.DataFrame({
        "observation.state": [np.array([0.1, q], dtype=np.float32) for q in SOUND["angle"]],
        "action": [np.array([0.1, q + 0.1], dtype=np.float32) for q in SOUND["angle"]],
        "timestamp": SOUND["time"].astype(np.float32),
        "episode_index": 0,
    })  # fmt: skip
    path = folder / "data" / "chunk-000" / "episode_000000.parquet"
    path.parent.mkdir(parents=True, exist_ok=True)
    frame.to_parquet(path)
    features = {name: {"dtype": "float32", "shape": [2], "names": names} for name in ("observation.state", "action")}
    if names is not None:
        (folder / "meta").mkdir(exist_ok=True)
        (folder / "meta" / "info.json").write_text(json.dumps({"fps": 200, "features": features}))
    return path


@pytest.mark.parametrize(
    "names", [["shoulder", "elbow"], ["shoulder.pos", "elbow.pos"], {"motors": ["shoulder", "elbow"]}]
)
def test_data_sets_of_lerobot(tmp_path, names):
    table = read_table(lerobot(tmp_path, names))
    assert table.joints == ("shoulder", "elbow")
    one = select_joint(table, "elbow")
    assert list(one.columns) == ["observation.state", "action", "timestamp", "episode_index"]
    np.testing.assert_allclose(one.columns["observation.state"], SOUND["angle"], rtol=1e-6)
    np.testing.assert_allclose(one.columns["action"], SOUND["angle"] + 0.1, rtol=1e-6)
    log = Log.of_tables([table], Reading(joint="elbow"))
    assert log.command_unit == "rad"
    np.testing.assert_allclose(log.runs[0].output, SOUND["angle"], rtol=1e-6)


@pytest.mark.parametrize("names", [None, ["one", "two", "three"], "odd"])
def test_lists_without_names_are_counted(tmp_path, names):
    table = read_table(lerobot(tmp_path, names))
    assert table.joints == ()
    assert list(table.columns)[:4] == [f"{name}:{k}" for name in ("observation.state", "action") for k in (1, 2)]
    with pytest.raises(MissingColumns) as refused:
        Log.read(tmp_path / "data" / "chunk-000" / "episode_000000.parquet")
    assert refused.value.options == "--map setpoint=action:1 --map angle=observation.state:1"


@pytest.mark.parametrize("info", ["{", "[]", '{"features": 7}', '{"features": {"action": 7}}'])
def test_a_damaged_description_is_no_hindrance(tmp_path, info):
    path = lerobot(tmp_path, ["shoulder", "elbow"])
    (tmp_path / "meta" / "info.json").write_text(info)
    assert read_table(path).joints == ()


def test_structures_and_ragged_lists_in_cells(tmp_path):
    frame = pd.DataFrame({
        "time": SOUND["time"],
        "drive": [{"torque": tau, "state": {"on": 1}} for tau in SOUND["torque"]],
        "load": [[q] if k else [] for k, q in enumerate(SOUND["angle"])],
    })  # fmt: skip
    frame.to_parquet(tmp_path / "log.parquet")
    table = read_table(tmp_path / "log.parquet")
    assert list(table.columns) == ["time", "drive.torque", "drive.state.on", "load"]
    np.testing.assert_allclose(table.columns["load"][1:], SOUND["angle"][1:])


def test_damaged_bags_are_read_as_far_as_intact_or_refused(tmp_path):
    path = bag(tmp_path / "bag.mcap", {"/joint_states": states()})
    sound = path.read_bytes()
    rng = np.random.default_rng(0)
    for _ in range(40):
        damaged = bytearray(sound[: rng.integers(8, len(sound)) if rng.random() < 0.2 else None])
        for place in rng.integers(len(damaged) if rng.random() < 0.5 else 2000, size=3):
            damaged[place % len(damaged)] = rng.integers(256)
        path.write_bytes(damaged)
        try:
            assert read_table(path).columns
        except AntidriveError as error:
            check_sentence(str(error))


def test_a_definition_that_cannot_be_parsed_is_a_sentence(tmp_path):
    from mcap.writer import Writer as Plain

    with (tmp_path / "bag.mcap").open("wb") as stream:
        file = Plain(stream)
        file.start()
        schema = file.register_schema(name="a/b/C", encoding="ros2msg", data=b"float64[ x = = \n\xff")
        channel = file.register_channel(topic="/x", message_encoding="cdr", schema_id=schema)
        file.add_message(channel_id=channel, log_time=0, publish_time=0, data=b"\0\1\0\0")
        file.finish()
    with pytest.raises(MalformedLog, match=r"not those of '/x' \(cdr, which cannot be decoded\)") as caught:
        read_table(tmp_path / "bag.mcap")
    check_sentence(str(caught.value))


@pytest.mark.parametrize(
    ("names", "joint", "others"),
    [
        (("elbow_joint_position", "elbow_joint_effort"), "elbow_joint", ("wrist_joint_position", "wrist_joint_effort")),
        (("q:2", "tau:2"), "2", ("q:1", "tau:1")),
        (("positions:2", "torques:2"), "2", ("positions:1", "torques:1")),
    ],
)
def test_joints_in_names_and_in_columns_of_a_matrix(
    names: tuple[str, str], joint: str, others: tuple[str, str], tmp_path: Path
) -> None:
    time = np.arange(0.0, 5.0, 0.01)
    columns = {"time": time, names[0]: np.sin(time), names[1]: np.cos(time)}
    columns |= dict.fromkeys(others, np.cos(2.0 * time))
    table = "\n".join([",".join(columns), *(",".join(map(str, row)) for row in zip(*columns.values(), strict=True))])
    (tmp_path / "log.csv").write_text(table)
    with pytest.raises(MalformedLog, match="the log has 2 joints, choose one with --joint NAME"):
        Log.read(tmp_path / "log.csv")
    run = Log.read(tmp_path / "log.csv", joint=joint).runs[0]
    assert run.output == pytest.approx(np.sin(time))
    assert run.command == pytest.approx(np.cos(time))


def test_a_single_joint_in_a_name_needs_no_choice(tmp_path: Path) -> None:
    rows = [f"{0.01 * k},{np.sin(0.01 * k)},{np.cos(0.01 * k)}" for k in range(500)]
    (tmp_path / "log.csv").write_text("\n".join(["time,elbow_joint_position,elbow_joint_effort", *rows]))
    assert len(Log.read(tmp_path / "log.csv").runs[0]) == 500


def numbered(joints):
    """Columns of robots whose exports count them: Position1 to PositionN, with others of every joint."""
    table = {"Time": SOUND["time"]}
    for joint in range(1, joints + 1):
        table |= {f"Position{joint}": SOUND["angle"], f"Torque{joint}": SOUND["torque"]}
        table |= {f"PositionCmptd{joint}": SOUND["angle"], f"TorqueCur{joint}": SOUND["torque"]}
    return Table(name="log.csv", columns=table | {"Bus1": SOUND["time"]}, sha256="")


def test_columns_that_end_in_the_number_of_a_joint():
    """With two, they may be the two motors of one axis."""
    table = with_joints(numbered(7))
    assert table.joints == tuple("1234567")
    with pytest.raises(MalformedLog, match="the log has 7 joints, choose one with --joint NAME: 1, 2, 3"):
        select_joint(table)
    chosen = ["Time", "position", "effort", "PositionCmptd", "TorqueCur", "Bus1"]
    assert list(select_joint(table, "3").columns) == chosen
    assert with_joints(numbered(2)).joint_of == {}
    assert with_joints(numbered(3)).joints == tuple("123")


def test_two_counted_joints_are_joints_if_the_user_says_so(tmp_path):
    table = numbered(2)
    assert list(select_joint(table, "2").columns) == [
        "Time",
        "position",
        "effort",
        "PositionCmptd",
        "TorqueCur",
        "Bus1",
    ]
    bracketed = {re.sub(r"(\d)$", r" (\1)", name): values for name, values in table.columns.items()}
    pd.DataFrame(bracketed).to_csv(tmp_path / "log.csv", index=False)
    with pytest.raises(MissingColumns, match="If they are of 2 joints, choose one with --joint: 1, 2"):
        Log.read(tmp_path / "log.csv")
    assert len(Log.read(tmp_path / "log.csv", joint="1").runs) == 1
    with pytest.raises(BadParameter, match="there are no joints in this log"):
        select_joint(Table(name="log.csv", columns=SOUND, sha256=""), "1")


def test_of_named_columns_of_a_joint_no_others_are_used(tmp_path):
    """The angles of joints 1 and 2 were read as those of two motors."""
    path = tmp_path / "arm.csv"
    pd.DataFrame(numbered(7).columns).to_csv(path, index=False)
    log = Log.read(path, mapping={"angle": "Position1", "torque": "TorqueCur1"})
    assert not any("angle_1" in text for text in (*log.warnings, *log.notes, *log.repairs))
    assert np.allclose(log.runs[0].output, SOUND["angle"])
