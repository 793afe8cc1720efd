"""The scene of a recorded run: frames, reference, path, hull, states of links; and its price."""

from __future__ import annotations

import re
import zlib
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_files import type_of
from mcap_protobuf.decoder import DecoderFactory
from scene_run import scene_run

from cosim.models import TABLE_1
from cosim.trace import Poses, Signal, Trace, TraceWriter, begins_with, content_hash, diff
from cosim.trace.report import write_report

S = 10**9
MOST_POINTS = 256
"""Most points of a path, beside the last position."""


@pytest.fixture(scope="module")
def path() -> Path:
    return scene_run()


@pytest.fixture(scope="module")
def messages(path: Path) -> dict[str, list[tuple[int, Any, int]]]:
    """(log time, message, bytes) by topic, by the official reader and decoder."""
    found: dict[str, list[tuple[int, Any, int]]] = {}
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, m, row in reader.iter_decoded_messages(log_time_order=False):
            found.setdefault(channel.topic, []).append((m.log_time, row, len(m.data)))
    return found


def test_vehicle_moves_in_the_frames(path: Path, messages: dict[str, Any]) -> None:
    """How a view's map lies to north, by itself, and the vehicle in it, as its outputs say."""
    ((_, fixed, _),), moving = messages["/tf_static"], messages["/tf"]
    assert (fixed.parent_frame_id, fixed.child_frame_id) == ("map", "ned")
    plant = Trace(path).read("/plant/output")
    rows = {int(t): k for k, t in enumerate(plant.log_time_ns)}
    tenths = [time // (S // 10) for time, _, _ in moving]
    assert tenths == sorted({int(t) // (S // 10) for t in plant.log_time_ns})
    for time, frame, _ in moving:
        assert (frame.parent_frame_id, frame.child_frame_id) == ("ned", "auv")
        place, turn = frame.translation, frame.rotation
        k = rows[time]
        assert (place.x, place.y, place.z) == tuple(plant[f"eta.{a}"][k] for a in "xyz")
        psi = plant["eta.psi"][k]
        assert [turn.z, turn.w] == pytest.approx([np.sin(psi / 2), np.cos(psi / 2)], abs=1e-15)


def test_reference_is_where_the_vehicle_is_to_be(path: Path, messages: dict[str, Any]) -> None:
    controller = Trace(path).read("/controller/input")
    rows = {int(t): k for k, t in enumerate(controller.log_time_ns)}
    poses = messages["/auv/reference"]
    assert len(poses) == 201
    for time, message, _ in poses:
        found = message.pose.position
        wanted = [controller[f"reference.{a}"][rows[time]] for a in "xyz"]
        assert [found.x, found.y, found.z] == wanted
    assert (found.x, found.y, found.z) == (2.0, 1.0, -1.0)


def test_hull_is_the_vehicle_of_the_model(messages: dict[str, Any]) -> None:
    ((_, update, _),) = messages["/auv/hull"]
    (hull,) = update.entities
    assert (hull.frame_id, hull.frame_locked) == ("auv", True)
    assert hull.lifetime.seconds == hull.lifetime.nanos == 0  # for ever
    bow, stern = hull.spheres
    ends = [s.pose.position.x + side * s.size.x / 2 for s, side in ((bow, 1), (stern, -1))]
    assert ends[0] - ends[1] == pytest.approx(TABLE_1["length"])
    (tube,) = hull.cylinders
    volume = np.pi / 4 * tube.size.x**2 * tube.size.z + np.pi / 6 * bow.size.x**3
    assert volume * TABLE_1["density"] == pytest.approx(TABLE_1["mass"], rel=0.01)


def test_path_so_far_is_whole_small_and_ends_where_the_vehicle_is(
    path: Path, messages: dict[str, Any]
) -> None:
    plant = Trace(path).read("/plant/output")
    track = np.column_stack([plant[f"eta.{a}"] for a in "xyz"])
    updates = messages["/auv/path"]
    assert len(updates) > 3
    for time, update, _ in updates:
        points = update.entities[0].lines[0].points
        assert len(points) <= MOST_POINTS + 1
        so_far = track[plant.log_time_ns <= time]
        ends = np.array([[p.x, p.y, p.z] for p in (points[0], points[-1])])
        assert ends == pytest.approx(so_far[[0, -1]], abs=1e-3)
        for p in points:
            assert np.abs(so_far - [p.x, p.y, p.z]).max(axis=1).min() < 1e-3
    assert updates[-1][0] == plant.log_time_ns[-1]
    packed = sum(len(zlib.compress(u.SerializeToString())) for _, u, _ in updates)
    assert packed < 0.05 * path.stat().st_size


def test_states_of_links_are_those_of_their_messages(path: Path) -> None:
    """Ages are those of the reader; counts those of the messages; nothing is unaccounted for."""
    trace = Trace(path)
    for link in ("uplink", "downlink"):
        table = trace.read(f"/link/{link}/state")
        assert len(table) == 201
        arrived, missed = trace.read(f"/link/{link}"), trace.dropped(link)
        at = table.log_time_ns
        _, ages = trace.age(link, at=at / 1e9)
        begun = ~np.isnan(ages)
        assert table["age_s"][begun] == pytest.approx(ages[begun], abs=1e-9)
        assert table["age_s"][~begun] == pytest.approx(at[~begun] / 1e9)  # of the start value
        lost_ns = missed.log_time_ns[missed["reason"] == "lost"]
        for name, times in (
            ("delivered", arrived.log_time_ns),
            ("dropped", missed.log_time_ns),
            ("lost", lost_ns),
        ):
            assert table[name].tolist() == [int((times <= t).sum()) for t in at], (link, name)
        sent = at // (150 * 10**6) + 1  # a message each 0.15 s
        under_way = sent - table["delivered"] - table["dropped"]
        assert table["in_flight"].tolist() == under_way.tolist()
        during = (at >= 5 * S) & (at < 8 * S) & (link == "uplink")
        assert table["outage"].tolist() == during.tolist()


def test_schemas_have_unit_and_description(path: Path) -> None:
    """As comments of the fields, where a tool of protobuf has them."""
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    comments = {}
    for channel in summary.channels.values():
        schema = summary.schemas[channel.schema_id]
        file = FileDescriptorSet.FromString(schema.data).file[-1]
        for place in file.source_code_info.location:
            kind, message, inner, field = place.path
            assert (kind, message, inner) == (4, 0, 2)
            name = file.message_type[message].field[field].name
            comments[f"{channel.topic}.{name}"] = place.leading_comments
    assert comments["/plant/output.eta_x"].startswith(" eta.x [m]: ")
    assert comments["/link/uplink/state.age_s"].startswith(" age_s [s]: time since")
    assert {topic for topic in comments if topic.startswith(("/tf", "/auv"))} == set()


def copied(path: Path, target: Path, *, but_last: str | None = None, scene: bool = False) -> Path:
    """The same file, without its scene as an older version wrote it; `but_last` of a topic."""
    with path.open("rb") as source, target.open("wb") as stream:
        reader, writer = make_reader(source), Writer(stream)
        writer.start()
        for metadata in reader.iter_metadata():
            writer.add_metadata(metadata.name, metadata.metadata)
        ids: dict[int, int] = {}
        for schema, channel, m in reader.iter_messages(log_time_order=False):
            if "computed" in channel.metadata and not scene:
                continue
            if channel.topic == but_last and m.log_time == 20 * S:
                continue
            if channel.id not in ids:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                ids[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, number, channel.metadata
                )
            writer.add_message(ids[channel.id], m.log_time, m.data, m.publish_time, m.sequence)
        writer.finish()
    return target


def test_content_hash_and_diff_leave_the_scene_out(path: Path, tmp_path: Path) -> None:
    plain = copied(path, tmp_path / "plain.mcap")
    assert set(Trace(path).topics) - set(Trace(plain).topics) == {
        "/tf",
        "/tf_static",
        *(f"/auv/{name}" for name in ("pose", "reference", "hull", "path")),
        *(f"/link/{name}/state" for name in ("uplink", "downlink")),
    }
    assert content_hash(path) == content_hash(plain)
    assert diff(path, plain).identical
    assert begins_with(Trace(plain), Trace(path))
    for scene in (False, True):
        shorter = copied(path, tmp_path / "shorter.mcap", but_last="/sea/output", scene=scene)
        found = diff(path, shorter)
        assert (found.identical, found.only, found.other_bytes) == (False, ((), ()), ())
        compared = {signal.topic for signal in found.signals}
        assert "/sea/output" in compared
        assert not [topic for topic in compared if Trace(path).topics[topic].is_computed]


def test_component_called_scene_is_in_the_hash(tmp_path: Path) -> None:
    hashes = set()
    for value in (1.0, 2.0):
        with TraceWriter(tmp_path / "a.mcap", run={}) as writer:
            topic = writer.add_topic(
                "/scene/output", [Signal("x")], schema_name="cosim.scene.Output"
            )
            writer.write(topic, 0, [value])
            writer.finish({})
        hashes.add(content_hash(tmp_path / "a.mcap"))
    assert len(hashes) == 2


def test_report_draws_no_scene(path: Path, tmp_path: Path) -> None:
    """Nor is it among its signals in numbers."""
    html = write_report(path, tmp_path / "report.html").output.read_text("utf-8")
    numbers = html.partition("<h2>Signals in numbers</h2>")[2].partition("</section>")[0]
    drawn = set(re.findall(r"<tr><td>(/[^<]*)</td>", numbers))
    drawn |= set(re.findall(r"<figcaption><span>(/[^<]*)</span>", html))
    assert {"/plant/output", "/controller/input", "/link/uplink"} <= drawn
    assert not [topic for topic in drawn if Trace(path).topics[topic].is_computed]


def path_messages(path: Path) -> list[tuple[int, np.ndarray]]:
    """Log time and points (n, 3) of each path that a trace has."""
    message = type_of(path, "/auv/path")
    found = []
    with path.open("rb") as stream:
        for _, _, m in make_reader(stream).iter_messages("/auv/path", log_time_order=False):
            ((line,),) = (entity.lines for entity in message.FromString(m.data).entities)
            found.append((m.log_time, np.array([[p.x, p.y, p.z] for p in line.points])))
    return found


def test_path_is_the_same_whatever_its_blocks(tmp_path: Path) -> None:
    """Bounded points, ever fewer messages; what is no place is left out."""
    line = np.column_stack([np.arange(50_000) * 0.01] * 3 + [np.zeros(50_000)])
    line[777, :3] = np.nan
    line[40_000:, :3] = 1e300
    begins = [0, 1, 31, 32, 4096, 30_000, 50_000]
    found = []
    for name, blocks in (("whole", [0, 50_000]), ("cut", begins)):
        with TraceWriter(tmp_path / f"{name}.mcap", run={}) as writer:
            for begin, end in pairwise(blocks):
                writer.write_rows([Poses(np.arange(begin, end), line[begin:end])])
            found.append(path_messages(writer.finish({})))
    at_once, in_parts = found
    assert [k for k, _ in at_once] == [k for k, _ in in_parts]
    for (_, a), (_, b) in zip(at_once, in_parts, strict=True):
        assert np.array_equal(a, b)
        assert a[0].tolist() == [0.0] * 3
        assert len(a) <= MOST_POINTS + 1
        assert np.isfinite(a).all()
        assert np.abs(a).max() <= 400
    assert len(at_once) < 200
    assert at_once[-1][0] == 49_999  # when the trace is finished
    assert np.diff([k for k, _ in at_once[:-1]][-5:]).min() >= MOST_POINTS
