"""Fields of a later format, behind those that a record has today, are passed over."""

from __future__ import annotations

import zlib
from pathlib import Path

import pytest
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    MessageIndex,
    Metadata,
    Schema,
)
from mcap_files import HEAD_BYTES, MAGIC, records_of
from test_trace_recover import ROWS, a_trace
from test_trace_verify import patched

from cosim.core import LossError
from cosim.trace import Trace, recover, verify

MORE = b"\x01\xff\xff"


def written(record: McapRecord, more: bytes = b"") -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data[:1] + (len(data) - 9 + len(more)).to_bytes(8, "little") + data[9:] + more


ATTACHMENT = Attachment(log_time=2, create_time=1, name="a.txt", media_type="text", data=b"text")
METADATA = Metadata(name="m", metadata={"k": "v", "l": "w"})


def test_a_file_with_longer_records_is_in_order(tmp_path: Path) -> None:
    """As the conformance files of the MCAP project have them (variant `pad`)."""
    path = tmp_path / "a.mcap"
    message = written(Message(channel_id=1, sequence=3, log_time=7, publish_time=6, data=b"123"))
    inner = written(Schema(id=1, name="S", encoding="x", data=b"s"), MORE)
    inner += written(
        Channel(id=1, topic="/t", message_encoding="y", schema_id=1, metadata={"a": "b"}), MORE
    )
    chunk = Chunk(
        compression="",
        data=inner + message,
        message_start_time=7,
        message_end_time=7,
        uncompressed_crc=zlib.crc32(inner + message),
        uncompressed_size=len(inner + message),
    )
    index = MessageIndex(channel_id=1, records=[(7, len(inner))])
    data = MAGIC + written(Header(profile="", library=""), MORE) + written(ATTACHMENT, MORE)
    data += written(METADATA, MORE) + written(chunk) + written(index, MORE)
    data += written(DataEnd(data_section_crc=zlib.crc32(data)))
    footer = Footer(summary_start=0, summary_offset_start=0, summary_crc=0)
    path.write_bytes(data + written(footer) + MAGIC)
    assert verify(path).verdict == "ok"
    trace = Trace(path)
    assert [bytes(p) for block in trace.blocks() for p in block.payloads()] == [b"123"]
    assert trace.metadata == [("m", METADATA.metadata)]
    assert trace.attachments["a.txt"] == b"text"
    assert recover(path, tmp_path / "b.mcap").complete


@pytest.mark.parametrize("more", [1, 2, 4, 8, 64])
def test_a_length_that_is_too_great_takes_nothing_that_follows(tmp_path: Path, more: int) -> None:
    """Without a summary too, which knows where the next record begins."""
    whole = a_trace(tmp_path / "a.mcap").read_bytes()
    run = next(r for r in records_of(tmp_path / "a.mcap") if r.opcode == Opcode.METADATA)
    length = (run.end - run.position - HEAD_BYTES + more).to_bytes(8, "little")
    cut = tmp_path / "b.mcap.partial"
    cut.write_bytes(patched(whole, run.position + 1, length)[: whole.index(b"cosim.result")])
    result = recover(cut, tmp_path / "c.mcap")
    assert (result.messages, result.attachments) == (len(ROWS), 1)


FRONT = MAGIC + written(Header(profile="", library=""))
END = written(DataEnd(data_section_crc=0))
END += written(Footer(summary_start=0, summary_offset_start=0, summary_crc=0)) + MAGIC


def opened(path: Path, record: bytes) -> Trace:
    """A whole file with this record alone, without checksums."""
    path.write_bytes(FRONT + record + END)
    return Trace(path)


def test_a_length_that_is_too_small_is_damage(tmp_path: Path) -> None:
    """What it cuts off is no later format."""
    path = tmp_path / "a.mcap"
    whole = written(METADATA)
    assert opened(path, whole).metadata == [("m", METADATA.metadata)]
    head, content = whole[:HEAD_BYTES], whole[HEAD_BYTES:]
    for length in range(int.from_bytes(content[5:9], "little") // 2 + 1):  # an entry is missing
        cut = content[:5] + length.to_bytes(4, "little") + content[9:]
        with pytest.raises(LossError, match=f"record at byte {len(FRONT)}"):
            opened(path, head + cut)
    for data in (b"text", bytes(8)):  # zeros in place of a checksum would stand for none
        attached = Attachment(log_time=2, create_time=1, name="a", media_type="b", data=data)
        whole = written(attached)
        assert opened(path, whole).attachments == {"a": data}
        head, content = whole[:HEAD_BYTES], whole[HEAD_BYTES:]
        at = content.index(len(data).to_bytes(8, "little"))
        for length in range(len(data)):
            cut = content[:at] + length.to_bytes(8, "little") + content[at + 8 :]
            with pytest.raises(LossError, match=f"record at byte {len(FRONT)}"):
                opened(path, head + cut)
