"""Bags of ROS, written by the library that robots use: joints become channels, each with its clock."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest

from frictionjax.core import FrictionjaxWarning, InputError
from frictionjax.recordings import case_from_files
from frictionjax.recordings.limits import reading
from frictionjax.recordings.readers import open_table
from frictionjax.recordings.readers.ros import _Channels, open_bag

N, RATE = 400, 250.0
X = np.sin(2.0 * np.pi * 3.0 * np.arange(N) / RATE)
U = np.cos(2.0 * np.pi * 3.0 * np.arange(N) / RATE)
START = 1_700_000_000_000_000_000  # ns


def _records(types, *, ros1=False, topics=("/joint_states",)):
    """Topic, type, time of arrival and message of joint states, and of a torque without a stamp."""
    names = (
        "sensor_msgs/msg/JointState",
        "std_msgs/msg/Header",
        "builtin_interfaces/msg/Time",
        "std_msgs/msg/Float64",
    )
    joint_state, header, time, number = (types.types[name] for name in names)
    for k in range(N):
        stamp = START + round(1e9 * k / RATE)
        late = stamp + 700_000 * (k % 5)  # the network is not punctual
        at = time(sec=stamp // 10**9, nanosec=stamp % 10**9)
        head = header(seq=k, stamp=at, frame_id="") if ros1 else header(stamp=at, frame_id="")
        both = {"position": np.array([X[k], 0.5]), "velocity": np.zeros(2), "effort": np.array([U[k], 0.0])}
        for topic in topics:
            yield topic, names[0], late, joint_state(header=head, name=["elbow", "wrist"], **both)
        yield "/torque", names[3], late, number(data=2.0 * U[k])


def _write(folder, kind, **records):
    """A bag of one kind in a `folder`; the file in it."""
    typesys = pytest.importorskip("rosbags.typesys", reason="needs the extra ros")
    store = typesys.Stores.ROS1_NOETIC if kind == ".bag" else typesys.Stores.ROS2_HUMBLE
    types = typesys.get_typestore(store)
    if kind == ".bag":
        from rosbags.rosbag1 import Writer

        file, how, pack = folder / "run.bag", {}, types.serialize_ros1
        bag = file
    else:
        from rosbags.rosbag2 import StoragePlugin, Writer

        plugin = StoragePlugin.MCAP if kind == ".mcap" else StoragePlugin.SQLITE3
        bag, how, pack = folder / "run", {"version": 9, "storage_plugin": plugin}, types.serialize_cdr
        file = bag / f"run{kind}"
    with Writer(bag, **how) as writer:
        connections = {}
        for topic, name, time, message in _records(types, ros1=kind == ".bag", **records):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=types)
            writer.write(connections[topic], time, pack(message, name))
    return file


@pytest.mark.parametrize("kind", [".bag", ".db3", ".mcap"])
def test_joints_are_channels_at_the_times_of_their_stamps(tmp_path, kind):
    table = open_table(_write(tmp_path, kind))
    fields = [
        f"{joint}.{field}" for joint in ("elbow", "wrist") for field in ("position", "velocity", "effort")
    ]
    assert set(table.names) == {*fields, "/torque.data"}
    position, effort = table.read(["elbow.position", "elbow.effort"])
    np.testing.assert_array_equal(position, X)
    np.testing.assert_array_equal(effort, U)
    np.testing.assert_allclose(table.clock("elbow.position"), np.arange(N) / RATE, atol=1e-9)
    assert np.ptp(np.diff(table.clock("/torque.data"))) > 1e-3


def test_a_bag_becomes_a_case(tmp_path):
    file = _write(tmp_path, ".mcap")
    with pytest.warns(FrictionjaxWarning):
        case = case_from_files([file], columns={"x": "elbow.position", "u": "elbow.effort"})
    assert [one.sample_rate for one in case.recordings] == pytest.approx([RATE] * 2)
    np.testing.assert_array_equal(np.concatenate([one.x for one in case.recordings]), X)
    with pytest.raises(InputError, match=r"elbow\.position"):
        case_from_files([file], columns={"x": "shoulder.position", "u": "elbow.effort"})


def test_one_joint_needs_no_name(tmp_path):
    message = SimpleNamespace(
        name=["elbow"], position=np.array([0.5]), __dataclass_fields__=("name", "position")
    )
    channels = _Channels()
    for time in (1, 2):
        channels.take("/joint_states", time, message)
    assert channels.table(tmp_path, {}).names == ("position",)


def test_a_joint_of_two_topics_goes_by_both_names(tmp_path):
    table = open_table(_write(tmp_path, ".db3", topics=("/left", "/right")))
    assert {"/left/elbow.position", "/right/elbow.position"} <= set(table.names)


def test_more_than_the_limit_is_refused(tmp_path):
    file = _write(tmp_path, ".mcap")
    with reading(1e-5), pytest.raises(InputError, match="unpacked content"):
        open_bag(file)


@pytest.mark.parametrize("kind", [".bag", ".db3", ".mcap"])
def test_a_damaged_bag_is_refused_in_a_sentence(tmp_path, kind):
    whole = _write(tmp_path, kind).read_bytes()
    file = tmp_path / f"cut{kind}"
    file.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"cut.* is not a bag of ROS"):
        open_table(file)


def test_an_absent_library_is_named_with_its_extra(tmp_path, monkeypatch):
    (tmp_path / "run.mcap").write_bytes(b"")
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    with pytest.raises(InputError, match=r'rosbags, which is not installed.*"frictionjax\[ros\]"'):
        open_table(tmp_path / "run.mcap")


def test_arrays_without_names_and_messages_within_messages(tmp_path):
    """With plain objects, which need no library."""
    force = SimpleNamespace(x=1.0, y=2, __dataclass_fields__=("x", "y"))
    fields = ("header", "force", "data", "text", "image")
    parts = {
        "header": None,
        "force": force,
        "data": np.array([3.0, 4.0]),
        "text": "no",
        "image": np.zeros(1000),
    }
    message = SimpleNamespace(**parts, __dataclass_fields__=fields)
    channels = _Channels()
    for time in (2_000_000, 1_000_000):
        channels.take("/hand", time, message)
    table = channels.table(tmp_path, {})
    assert set(table.names) == {"/hand.force.x", "/hand.force.y", "/hand.data[0]", "/hand.data[1]"}
    assert [one[0] for one in table.read(list(table.names))] == [1.0, 2.0, 3.0, 4.0]
