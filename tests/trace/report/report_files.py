"""Traces that a report must cope with: failed runs, values beyond all numbers, other tools'."""

from __future__ import annotations

import json
import math
import struct
from pathlib import Path

from google.protobuf.descriptor_pb2 import FileDescriptorSet
from hostile.hostile_fmu import FAULTS, hostile_fmu
from mcap.writer import Writer

from cosim.scenario.python_api import run
from cosim.trace import Attachment, Signal, TraceWriter
from cosim.trace.layout import file_descriptor

POSE = [Signal(n, i, "m") for i, n in enumerate(("eta.x", "eta.y", "eta.z"))]
TITLE = "A <b>run</b> & its </script> end"
EPOCH_NS = 1_700_000_000_000_000_000


FAILING = f"""
title = "{TITLE}"
[run]
end = 1.0
step = 0.1
[components.pump]
fmu = "pump.fmu"
parameters = {{ u = 1.0, fault = {FAULTS.index("error")}, at = 0.4 }}
[[assertions]]
eventually = "pump.x > 0.15"
[[assertions]]
name = "the <i>tank</i> stays empty"
always = "pump.x < 0.25"
[[assertions]]
always = "pump.x >= 0"
"""
"""x is the time; the step from 0.4 s on fails. One promise is kept, one broken, one not got to."""


def failing(folder: Path) -> Path:
    """A run that failed: a component refused a step; markup in title, message and assertion."""
    hostile_fmu(folder, "2.0", "pump")
    (folder / "failing.toml").write_text(FAILING)
    path = folder / "failing.mcap"
    assert run(folder / "failing.toml", path).status == "failed"
    return path


def wild(path: Path) -> Path:
    """Growth beyond 1e300, NaN, an infinity: what no run of ours holds, but a file may."""
    signals = [*POSE, Signal("eta.psi", 3, "rad")]
    with TraceWriter(path, run={"scenario": "wild", "title": TITLE}) as writer:
        eta = writer.add_topic("/plant/output", signals, schema_name="cosim.plant.Output")
        for k in range(3000):
            depth = 1.5**k if k < 1700 else math.nan
            psi = math.inf if k == 2000 else 0.1
            writer.write(eta, k * 10**7, [0.1 * k, math.sin(k / 50), depth, psi])
        writer.log(30 * 10**9, "error", "plant", "doStep: the <matrix> is singular")
        return writer.finish({"status": "failed", "metrics": json.dumps({"gain": 1e300})})


def small(
    path: Path,
    *,
    run: dict[str, str] | None = None,
    result: dict[str, str] | None = None,
    scenario: bytes = b"",
) -> Path:
    """A pose, a command, a link with a loss; what it says of itself is given."""
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
    signals = [Signal("temperature"), Signal("count", kind="int"), Signal("constant")]
    schema = FileDescriptorSet(file=[file_descriptor("lab.Reading", signals)])
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
