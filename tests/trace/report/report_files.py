"""Files that a report must cope with and that no run of ours writes: damaged, another tool's."""

from __future__ import annotations

import math
import struct
from pathlib import Path

from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorSet
from mcap.writer import Writer

from cosim.trace import Attachment, Signal, TraceWriter

POSE = [Signal(n, i, "m") for i, n in enumerate(("eta.x", "eta.y", "eta.z"))]
EPOCH_NS = 1_700_000_000_000_000_000


def small(
    path: Path,
    *,
    run: dict[str, str] | None = None,
    result: dict[str, str] | None = None,
    scenario: bytes = b"",
) -> Path:
    """A pose, a command, a link with a loss; metadata and attachments may hold anything."""
    attached = [
        Attachment("scenario.toml", "application/toml", scenario),
        Attachment("plant.modelDescription.xml", "text/xml", scenario),
        Attachment("design.json", "application/json", scenario),
    ]
    with TraceWriter(path, run=run or {"scenario": "small"}, attachments=attached) as writer:
        pose = [*POSE, Signal("eta.psi", 3, "rad")]
        eta = writer.add_topic("/plant/output", pose, schema_name="cosim.plant.Output")
        up = writer.add_topic("/link/up", [Signal("plant.eta.x")], schema_name="cosim.link.up")
        lost = writer.add_dropped_topic("up")
        for k in range(40):
            writer.write(eta, k * 10**8, [0.1 * k, 0.0, 1.0, 0.1])
            if k % 7:
                writer.write(up, k * 10**8, [0.1 * k], publish_time_ns=max(k - 2, 0) * 10**8)
            else:
                writer.write(lost, k * 10**8, ["lost"])
        writer.log(4 * 10**9, "warning", "plant", "late")
        return writer.finish(result or {"status": "finished", "metrics": "{}"})


def foreign(path: Path) -> Path:
    """Another tool's recording at today's times: a protobuf topic, and bytes nobody can read."""
    schema = FileDescriptorSet()
    file = schema.file.add(name="lab.proto", package="lab", syntax="proto3")
    reading = file.message_type.add(name="Reading")
    fields = {
        "temperature": FieldDescriptorProto.TYPE_DOUBLE,
        "count": FieldDescriptorProto.TYPE_INT64,
        "constant": FieldDescriptorProto.TYPE_DOUBLE,
    }
    for number, (name, kind) in enumerate(fields.items(), start=1):
        reading.field.add(name=name, number=number, type=kind)
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="", library="some other tool")
        known = writer.register_schema("lab.Reading", "protobuf", schema.SerializeToString())
        channel = writer.register_channel("/lab/sensors/1", "protobuf", known)
        other = writer.register_channel("/camera", "application/octet-stream", 0)
        for k in range(500):
            data = b"\x09" + struct.pack("<d", 20 + math.sin(k / 9))
            data += b"\x10" + bytes([k % 100]) + b"\x19" + struct.pack("<d", 4.0)
            at = EPOCH_NS + k * 10**8
            writer.add_message(channel, at, data, at)
        writer.add_message(other, EPOCH_NS, b"\xff\xd8", EPOCH_NS)
        writer.finish()  # type: ignore[no-untyped-call]
    return path
