"""A trace as a bag of ROS 2, read back by the mcap package's decoder of ROS 2 messages."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Channel, DataEnd, Message
from mcap.stream_reader import StreamReader
from mcap_files import records_of
from mcap_ros2.decoder import DecoderFactory
from rosbags.interfaces import QosDurability
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scene_run import scene_run

from cosim.core import InputError
from cosim.trace import Signal, Trace, TraceWriter
from cosim.trace.ros2 import WrittenBag, export_bag

Bag = dict[str, list[tuple[int, Any]]]
ROS = get_typestore(Stores.ROS2_JAZZY)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> WrittenBag:
    return export_bag(scene_run(), tmp_path_factory.mktemp("bag") / "run.mcap")


@pytest.fixture(scope="module")
def bag(written: WrittenBag) -> Bag:
    """Time and message by topic, with the definitions in the file itself."""
    return read(written.path)


def read(path: Path) -> Bag:
    found: Bag = {}
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, channel, raw, message in reader.iter_decoded_messages():
            found.setdefault(channel.topic, []).append((raw.log_time, message))
    return found


def test_topics_are_declared_in_the_chunks_of_a_bag_and_once_more_in_its_summary(
    written: WrittenBag,
) -> None:
    """Each before its first message, as the mcap package's own writer does."""
    kinds = [record.opcode for record in records_of(written.path)]
    before, after = (kinds[: kinds.index(Opcode.DATA_END)], kinds[kinds.index(Opcode.DATA_END) :])
    assert {*before} == {Opcode.HEADER, Opcode.METADATA, Opcode.CHUNK, Opcode.MESSAGE_INDEX}
    with written.path.open("rb") as stream:
        records = [*StreamReader(stream, validate_crcs=True).records]
    declared: list[int] = []
    for record in records[: next(i for i, one in enumerate(records) if isinstance(one, DataEnd))]:
        if isinstance(record, Channel):
            declared.append(record.id)
        assert not isinstance(record, Message) or record.channel_id in declared
    assert declared == sorted(set(declared))
    assert after.count(Opcode.CHANNEL) == len(declared)


def test_types_are_those_of_ros(written: WrittenBag) -> None:
    """Definitions in the file are those that rosbags has of the distribution Jazzy."""
    with Reader(written.path) as reader:
        for connection in reader.connections:
            types = get_types_from_msg(connection.msgdef.data, connection.msgtype)
            assert connection.msgtype in types
            for name, definition in types.items():
                assert _without_defaults(definition) == _without_defaults(ROS.fielddefs[name])


def _without_defaults(definition: Any) -> Any:
    constants, fields = definition
    return constants, [(name, str(kind).replace(" ", "")) for name, kind in fields]


def test_signals_are_topics_with_the_values_of_the_trace(bag: Bag) -> None:
    """To the bit, at the times of delivery; integers and truth values and texts, too."""
    trace = Trace(scene_run())
    for topic, field, name in (
        ("/plant/output", "eta_x", "eta.x"),
        ("/link/uplink", "plant_nu_r", "plant.nu.r"),
        ("/link/uplink/state", "in_flight", "in_flight"),
        ("/link/uplink/state", "outage", "outage"),
        ("/link/uplink/dropped", "reason", "reason"),
    ):
        table, found = trace.read(topic), bag[f"{topic}/{field}"]
        assert [time for time, _ in found] == table.log_time_ns.tolist()
        assert [message.data for _, message in found] == table[name].tolist()


def test_poses_frames_and_odometry_are_those_of_the_trace(bag: Bag) -> None:
    trace = Trace(scene_run())
    plant, poses = trace.read("/plant/output"), trace.read("/auv/pose")
    for k, ((time, pose), (_, odometry)) in enumerate(
        zip(bag["/auv/pose"], bag["/auv/odometry"], strict=True)
    ):
        stamp = pose.header.stamp
        assert time == stamp.sec * 10**9 + stamp.nanosec == plant.log_time_ns[k]
        assert pose.header.frame_id == odometry.header.frame_id == "ned"
        assert odometry.child_frame_id == "auv"
        place, speed = pose.pose.position, odometry.twist.twist
        assert [place.x, place.y, place.z] == [plant[f"eta.{a}"][k] for a in "xyz"]
        assert [speed.linear.x, speed.linear.y, speed.linear.z, speed.angular.z] == [
            plant[f"nu.{a}"][k] for a in "uvwr"
        ]
        other = odometry.pose.pose.position
        assert [other.x, other.y, other.z] == [place.x, place.y, place.z]
        assert pose.pose.orientation.z == poses["pose.orientation.z"][k]
        turns = [(q.z, q.w) for q in (odometry.pose.pose.orientation, pose.pose.orientation)]
        assert turns[0] == pytest.approx(turns[1], abs=1e-15)
    ((_, fixed),) = bag["/tf_static"]
    assert [t.child_frame_id for t in fixed.transforms] == ["ned"]
    assert {t.child_frame_id for _, tf in bag["/tf"] for t in tf.transforms} == {"auv"}
    moving = bag["/tf"][-1][1].transforms[0]
    assert (moving.header.frame_id, moving.transform.translation.y) == ("ned", plant["eta.y"][-1])
    assert len(bag["/auv/reference"]) == 201
    path = bag["/auv/path"][-1][1]
    ends = [[p.pose.position.x, p.pose.position.y] for p in (path.poses[0], path.poses[-1])]
    track = np.column_stack([plant["eta.x"], plant["eta.y"]])
    assert np.array(ends) == pytest.approx(track[[0, -1]], abs=1e-3)


def test_log_has_its_levels_and_texts(bag: Bag) -> None:
    table = Trace(scene_run()).read("/log")
    lines = [message for _, message in bag["/log"]]
    assert [line.msg for line in lines] == table["message"].tolist()
    assert [line.level // 10 for line in lines] == table["level"].tolist()
    assert {20, 30} <= {line.level for line in lines}


def test_late_comers_get_the_frames_that_do_not_move(written: WrittenBag) -> None:
    with Reader(written.path) as reader:
        quality = {c.topic: c.ext.offered_qos_profiles for c in reader.connections}
    assert quality["/tf_static"][0].durability == QosDurability.TRANSIENT_LOCAL
    assert quality["/tf"] == []


def test_what_has_no_message_is_named_and_metadata_go_along(written: WrittenBag) -> None:
    assert written.left_out == ("/auv/hull",)
    source, found = Trace(scene_run()), Trace(written.path)
    assert (found.run, found.result) == (source.run, source.result)
    assert {t: i.count for t, i in found.topics.items()} == written.topics
    notes = found.topics["/plant/output/eta_x"].metadata
    assert (notes["name"], notes["unit"]) == ("eta.x", "m")


def test_names_that_ros_refuses_and_absent_values(tmp_path: Path) -> None:
    """Texts of any length stand at their places; a value that is absent is no message."""
    signals = [Signal("K[1,3]"), Signal("word", kind="string")]
    rows: list[list[Any]] = [[0.5, "é"], [None, ""], [2.5, "four"], [-0.0, "é"]]
    with TraceWriter(tmp_path / "a.mcap", run={}) as writer:
        topic = writer.add_topic("/2nd part/out-put", signals, schema_name="t.T")
        for k, row in enumerate(rows):
            writer.write(topic, k, row)
        writer.finish({})
    found = read(export_bag(tmp_path / "a.mcap", None).path)
    assert list(found) == ["/x_2nd_part/out_put/K_1_3", "/x_2nd_part/out_put/word"]
    numbers, words = found.values()
    assert [(time, message.data) for time, message in numbers] == [(0, 0.5), (2, 2.5), (3, -0.0)]
    assert [message.data for _, message in words] == ["é", "", "four", "é"]
    assert (tmp_path / "a.ros2.mcap").exists()


def test_a_bag_that_cannot_be_is_refused(tmp_path: Path) -> None:
    """Nothing to write, its own trace as target, an instant beyond 32 bits; no file is left."""
    path = tmp_path / "a.mcap"
    with TraceWriter(path, run={}) as writer:
        topic = writer.add_topic("/a/output", [Signal("x")], schema_name="t.T")
        writer.write(topic, 2**62, [1.0])
        writer.finish({})
    log = tmp_path / "log.mcap"
    with TraceWriter(log, run={}) as writer:
        writer.log(2**62, "info", "a", "b")
        writer.finish({})
    with pytest.raises(InputError, match="does not fit"):
        export_bag(log, None)
    with pytest.raises(InputError, match="overwrite"):
        export_bag(path, path)
    with pytest.raises(InputError, match="topic"):
        export_bag(path, None, topics=["/b"])
    with pytest.raises(InputError, match="no topic can be written"):
        export_bag(scene_run(), tmp_path / "b.mcap", topics=["/auv/hull"])
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.mcap", "log.mcap"]
