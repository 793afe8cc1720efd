"""`verify` believes nothing: every change to a good trace, made by other tools, is noticed."""

from __future__ import annotations

import hashlib
import json
import struct
import zlib
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import Attachment as AttachmentRecord, Channel, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer
from network.fates import delivered, entries
from test_trace_recover import foreign

from cosim.core import InputError
from cosim.network import Jitter, PacketLink, deliver
from cosim.trace import Attachment, Signal, Trace, TraceWriter, verify
from cosim.trace.rows import result_of_link

END = 2000
LINK = PacketLink(
    "sc", 20, delay_ns=30, jitter=Jitter("uniform", width_ns=50), loss=0.1, quantization=0.25
)
SCENARIO = b"end = 1\n"
PROOF = json.dumps({"claim": {"gamma": "1/2"}}).encode()


def a_run(path: Path, link: PacketLink = LINK) -> Path:
    """A plant that sends over a link; what is delivered lies between its rows."""
    d = deliver(link, END)
    x = np.random.default_rng(1).normal(size=(END // 10 + 1, 2))
    run = {
        "scenario.sha256": hashlib.sha256(SCENARIO).hexdigest(),
        "certificate.sha256": hashlib.sha256(PROOF).hexdigest(),
        "certificate.attachment": "certificate.json",
        "certificate.claim": json.dumps({"gamma": "1/2"}),
        "certificate.gain": "K",
        "fmu.plant": "Plant",
        "fmu.plant.sha256": hashlib.sha256(b"fmu").hexdigest(),
        f"link.{link.name}": json.dumps(asdict(link)),
        "end_ns": str(END),
    }
    attachments = [
        Attachment("scenario.toml", "application/toml", SCENARIO),
        Attachment("certificate.json", "application/json", PROOF),
        Attachment("plant.modelDescription.xml", "text/xml", b"<x/>"),
    ]
    with TraceWriter(path, run=run, attachments=attachments, chunk_bytes=1500) as writer:
        out = writer.add_topic(
            "/plant/output", [Signal("eta.x"), Signal("eta.y")], schema_name="t.Plant"
        )
        over = writer.add_topic(
            f"/link/{link.name}",
            [Signal("plant.eta.x"), Signal("plant.eta.y")],
            schema_name="t.Link",
            metadata={"order": link.order},
        )
        dropped = writer.add_dropped_topic(link.name)
        events: list[tuple[int, int, Any]] = [(10 * k, 0, k) for k in range(len(x))]
        arrivals = entries(d)
        events += [(arrival.arrival, 1, k) for k, arrival in enumerate(arrivals)]
        for t, kind, k in sorted(events, key=lambda e: e[:2]):
            if kind == 0:
                writer.write(out, t, x[k])
                continue
            _, sent_ns, number, fate = arrivals[k]
            sent = {"publish_time_ns": sent_ns, "sequence": number}
            if fate == "delivered":
                writer.write(over, t, link.quantize(x[sent_ns // 10]), **sent)
            else:
                writer.write(dropped, t, [fate], **sent)
        result = {"status": "finished", "steps": str(len(x) - 1)}
        return writer.finish({**result, **result_of_link(link.name, d.statistics(END))})


def failing(path: Path, **more: Any) -> set[str]:
    """Names of the checks that are not ok."""
    found = verify(path, **more)
    assert json.loads(json.dumps(found.to_json()))["ok"] == (found.verdict == "ok")
    return {c.name for c in found.checks if c.verdict in ("failed", "incomplete")}


Change = Callable[[str, Any], Any]


def rewritten(path: Path, out: Path, change: Change) -> Path:
    """The file as the official writer has it, each record passed through `change`."""
    with path.open("rb") as source, out.open("wb") as target:
        writer = Writer(target, 1500, CompressionType.ZSTD, enable_data_crcs=True)
        writer.start("", "rewritten")
        schemas: dict[int, int] = {}
        channels: dict[int, int] = {}
        topics: dict[int, str] = {}
        for record in StreamReader(source).records:
            if isinstance(record, Schema) and record.id not in schemas:
                schemas[record.id] = writer.register_schema(
                    record.name, record.encoding, record.data
                )
            elif isinstance(record, Channel) and record.id not in channels:
                topics[record.id] = record.topic
                channels[record.id] = writer.register_channel(
                    record.topic,
                    record.message_encoding,
                    schemas[record.schema_id],
                    record.metadata,
                )
            elif isinstance(record, Message):
                for m in change(topics[record.channel_id], record):
                    writer.add_message(
                        channels[record.channel_id], m.log_time, m.data, m.publish_time, m.sequence
                    )
            elif isinstance(record, Metadata):
                writer.flush()
                for m in change(record.name, record):
                    writer.add_metadata(m.name, m.metadata)
            elif isinstance(record, AttachmentRecord):
                for a in change(record.name, record):
                    writer.add_attachment(0, 0, a.name, a.media_type, a.data)
        writer.finish()
    return out


def test_good_traces_pass(tmp_path: Path) -> None:
    """Ours, with every order of the link, and as another tool writes it."""
    for order in ("newest-wins", "fifo", "as-arrived"):
        for duplicate in (0.0, 0.3):
            wide = Jitter("uniform", width_ns=90)
            link = PacketLink("l", 20, jitter=wide, loss=0.1, duplicate=duplicate, order=order)
            assert failing(a_run(tmp_path / "good.mcap", link)) == set(), link
    buffered = PacketLink("l", 20, jitter=Jitter("uniform", width_ns=90), loss=0.1, playout_ns=60)
    path = a_run(tmp_path / "buffered.mcap", buffered)
    assert failing(path) == set()
    assert set(Trace(path).dropped("l")["reason"].tolist()) == {"lost", "late"}
    path = a_run(tmp_path / "a.mcap")
    found = verify(path)
    assert (found.verdict, found.ours) == ("ok", True)
    assert {c.verdict for c in found.checks} == {"ok"}
    same = rewritten(path, tmp_path / "b.mcap", lambda _, record: [record])
    assert failing(same) == set()


def altered(record: Any, **changes: Any) -> list[Any]:
    for name, value in changes.items():
        object.__setattr__(record, name, value)
    return [record]


def once(topic: str, number: int, what: Callable[[Any], list[Any]]) -> Change:
    """A change to one message of a topic."""
    left = [number]

    def change(name: str, record: Any) -> list[Any]:
        if name != topic:
            return [record]
        left[0] -= 1
        return what(record) if left[0] == 0 else [record]

    return change


def entry(name: str, key: str, value: str | None) -> Change:
    """A change to an entry of a metadata record."""

    def change(found: str, record: Any) -> list[Any]:
        if found == name:
            record.metadata.pop(key, None)
            if value is not None:
                record.metadata[key] = value
        return [record]

    return change


def nudge(record: Any, by: float = 1e-9) -> list[Any]:
    x = struct.unpack("<d", record.data[1:9])[0]
    changed = record.data[:1] + struct.pack("<d", x + by) + record.data[9:]
    return altered(record, data=changed)


TAMPERED: dict[str, tuple[set[str], Change]] = {
    "one value": ({"link values"}, once("/link/sc", 7, nudge)),
    "a sender's value": (
        {"link values"},
        once("/plant/output", 5, lambda m: nudge(m, 0.5)),
    ),
    "sent elsewhere": (
        {"link values", "link sequence"},
        once("/link/sc", 9, lambda m: altered(m, publish_time=m.publish_time - 27)),
    ),
    "early": (
        {"link delays", "link sequence", "link values"},
        once("/link/sc", 9, lambda m: altered(m, publish_time=m.log_time - 20)),
    ),
    "early by a nanosecond": (
        {"link delays", "link sequence", "link values"},
        once("/link/sc", 9, lambda m: altered(m, publish_time=m.log_time - 29)),
    ),
    "before it was sent": (
        {"order", "link delays", "link sequence", "link values"},
        once("/link/sc", 9, lambda m: altered(m, publish_time=m.log_time + 1)),
    ),
    "out of order": (
        {"order", "rows"},
        once("/plant/output", 9, lambda m: altered(m, log_time=1)),
    ),
    "two rows at one instant": (
        {"rows"},
        once("/plant/output", 3, lambda m: altered(m, log_time=10, publish_time=10)),
    ),
    "another number": (
        {"link sequence", "link counts"},
        once("/link/sc", 9, lambda m: altered(m, sequence=999)),
    ),
    "a message less": ({"link counts"}, once("/link/sc", 9, lambda _: [])),
    "a message twice": (
        {"link fates", "link sequence", "link counts"},
        once("/link/sc", 9, lambda m: [m, m]),
    ),
    "a drop less": ({"link counts"}, once("/link/sc/dropped", 2, lambda _: [])),
    "a row less": ({"rows", "link values"}, once("/plant/output", 5, lambda _: [])),
    "the last row less": ({"rows"}, once("/plant/output", 201, lambda _: [])),
    "another scenario": (
        {"run"},
        lambda n, r: altered(r, data=b"end = 2\n") if n == "scenario.toml" else [r],
    ),
    "no scenario": ({"run"}, lambda n, r: [] if n == "scenario.toml" else [r]),
    "another proof": (
        {"certificate"},
        lambda n, r: altered(r, data=b"{}") if n == "certificate.json" else [r],
    ),
    "the same claim of another proof": (
        {"certificate"},
        lambda n, r: altered(r, data=PROOF + b" ") if n == "certificate.json" else [r],
    ),
    "another claim": ({"certificate"}, entry("cosim.run", "certificate.claim", '{"gamma": "1"}')),
    "no model description": ({"FMUs"}, lambda n, r: [] if n.startswith("plant.model") else [r]),
    "no hash": ({"FMUs"}, entry("cosim.run", "fmu.plant.sha256", None)),
    "no result": ({"result"}, lambda n, r: [] if n == "cosim.result" else [r]),
    "two results": ({"result"}, lambda n, r: [r, r] if n == "cosim.result" else [r]),
    "two runs": ({"result"}, lambda n, r: [r, r] if n == "cosim.run" else [r]),
    "more sent": ({"link counts"}, entry("cosim.result", "link.sc.sent", "500")),
    "no figures": ({"link counts"}, entry("cosim.result", "link.sc.sent", None)),
    "other steps": ({"rows"}, entry("cosim.result", "steps", "7")),
    "another end": ({"rows"}, entry("cosim.run", "end_ns", "3000")),
}


@pytest.mark.parametrize("name", TAMPERED)
def test_tampered_run_fails(tmp_path: Path, name: str) -> None:
    """With right checksums and wrong content, the check of that content fails."""
    expected, change = TAMPERED[name]
    path = rewritten(a_run(tmp_path / "a.mcap"), tmp_path / "b.mcap", change)
    assert failing(path) == expected
    assert verify(path).verdict == ("incomplete" if name == "no result" else "failed")


def test_sequence_number_beyond_those_sent_fails(tmp_path: Path) -> None:
    """A copy that calls itself the message after the last, while other copies are in flight."""
    wide = Jitter("uniform", width_ns=400)
    link = PacketLink("sc", 20, jitter=wide, duplicate=0.9, order="as-arrived", seed=6)
    d = deliver(link, END)
    numbers = [entry.message for entry in delivered(d)]
    twice, figures = max(numbers), d.statistics(END)
    sent, in_flight = figures["sent"], figures["in_flight"]
    assert sent is not None
    assert in_flight is not None
    assert numbers.count(twice) == 2
    # so that the number of those without a fate gives nothing away
    assert in_flight > sent - len({*numbers})
    left = [1]

    def change(name: str, record: Any) -> list[Any]:
        if name == "/link/sc" and record.sequence == twice and left:
            left.pop()
            return altered(record, sequence=sent)
        return [record]

    path = rewritten(a_run(tmp_path / "a.mcap", link), tmp_path / "b.mcap", change)
    assert failing(path) == {"link counts"}


@pytest.mark.slow
def test_every_flipped_bit_is_noticed(tmp_path: Path) -> None:
    """Wherever it is, in data, summary or footer."""
    path = a_run(tmp_path / "a.mcap")
    whole = path.read_bytes()
    bad = tmp_path / "bad.mcap"
    for at in range(0, len(whole), 61):
        damaged = bytearray(whole)
        damaged[at] ^= 1 << at % 8
        bad.write_bytes(damaged)
        try:
            verdict = verify(bad).verdict
        except InputError:
            continue
        assert verdict != "ok", at


def test_cut_file_is_incomplete(tmp_path: Path) -> None:
    """A correct file that is cut short is incomplete, neither ok nor failed."""
    path = a_run(tmp_path / "a.mcap")
    whole = path.read_bytes()
    cut = tmp_path / "cut.mcap"
    for length in [*range(8, len(whole), 203), len(whole) - 1]:
        cut.write_bytes(whole[:length])
        found = verify(cut)
        assert found.verdict == "incomplete", [c for c in found.checks if c.verdict == "failed"]


def patched(whole: bytes, at: int, new: bytes) -> bytes:
    """Bytes replaced, and the checksums of data and summary made right again."""
    data = bytearray(whole)
    data[at : at + len(new)] = new
    (start,) = struct.unpack("<Q", data[-28:-20])
    data[start - 4 : start] = struct.pack("<I", zlib.crc32(data[: start - 13]))
    data[-12:-8] = struct.pack("<I", zlib.crc32(data[start:-12]))
    return bytes(data)


def test_false_indexes_are_noticed(tmp_path: Path) -> None:
    """Indexes, statistics and offsets that contradict the file."""
    path = a_run(tmp_path / "a.mcap")
    whole = path.read_bytes()
    assert patched(whole, 0, b"") == whole
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    (start, offsets) = struct.unpack("<QQ", whole[-28:-12])
    chunk = summary.chunk_indexes[1]
    index = min(chunk.message_index_offsets.values())
    places = {
        "message index, time": (index + 15, {"message indexes"}),
        "message index, offset": (index + 23, {"message indexes"}),
        "statistics, count": (whole.index(b"\x0b", start) + 9, {"summary"}),
        "footer, offsets": (len(whole) - 20, {"summary"}),
        "summary offset": (offsets + 10, {"summary"}),
    }
    position = start
    while position < offsets:
        opcode, length = struct.unpack("<BQ", whole[position : position + 9])
        if opcode == 0x0B:
            places["statistics, count"] = (position + 9, {"summary"})
        if opcode == 0x08:
            places["chunk index, time"] = (position + 9, {"summary"})
            places["chunk index, offset"] = (position + 9 + 16, {"summary"})
        if opcode in (0x0A, 0x0D):
            places[f"index {opcode}, offset"] = (position + 9, {"summary"})
            name = position + 9 + (40 if opcode == 0x0A else 16) + 4
            places[f"index {opcode}, name"] = (name, {"summary"})
        position += 9 + length
    bad = tmp_path / "bad.mcap"
    for name, (at, expected) in places.items():
        bad.write_bytes(patched(whole, at, bytes([whole[at] ^ 1])))
        assert failing(bad) == expected, name
    assert len(places) == 11


def test_chunk_with_wrong_times_fails(tmp_path: Path) -> None:
    path = a_run(tmp_path / "a.mcap")
    whole = path.read_bytes()
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    at = summary.chunk_indexes[0].chunk_start_offset + 9
    path.write_bytes(patched(whole, at, struct.pack("<Q", 5)))
    assert failing(path) == {"message indexes", "summary"}


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("chunking", [True, False])
def test_foreign_files_are_checked_for_structure_alone(
    tmp_path: Path, compression: CompressionType, *, chunking: bool
) -> None:
    path = foreign(tmp_path / "a.mcap", chunking=chunking, compression=compression)
    found = verify(path)
    assert (found.verdict, found.ours) == ("ok", False)
    assert "only the structure" in found.checks[-1].detail
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    assert verify(path).verdict == "incomplete"


def test_fmus_are_found_by_their_hash(tmp_path: Path) -> None:
    """FMUs are found by their SHA-256, whatever their names."""
    path = a_run(tmp_path / "a.mcap")
    folder = tmp_path / "fmus"
    (folder / "deep").mkdir(parents=True)
    (folder / "deep" / "other.fmu").write_bytes(b"something else")
    assert failing(path, fmus=folder) == {"FMU files"}
    (folder / "deep" / "renamed.fmu").write_bytes(b"fmu")
    assert failing(path, fmus=folder) == set()
    with pytest.raises(InputError, match="folder"):
        verify(path, tmp_path / "none")


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04" * 9])
def test_no_mcap_file(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.mcap").write_bytes(content)
    for path in (tmp_path / "a.mcap", tmp_path, tmp_path / "none.mcap"):
        with pytest.raises(InputError):
            verify(path)
