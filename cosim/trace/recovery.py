"""Recover a trace that was cut short or damaged: write a finished file of its whole records."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from mcap.opcode import Opcode

from cosim.core import InputError, LossError, Progress, silent
from cosim.trace import layout
from cosim.trace.disk import PartialFile
from cosim.trace.pieces import McapFile, Piece, attachment_of, message_of, metadata_of
from cosim.trace.records import Cursor, chunk_data, inner_records
from cosim.trace.scan import Damage, Scan, scan
from cosim.trace.stream import McapStream


@dataclass(frozen=True)
class Recovery:
    """The result of recovering a file.

    Attributes
    ----------
    source, output : the file read, and the one written; the same if nothing had to be written.
    complete : whether the file was whole, with nothing to recover.
    finished : whether the run has a result.
    messages, metadata, attachments : number of them in the output.
    lost_messages : number of messages lost, None if unknown.
    lost_bytes : bytes of the file that could not be used.
    damage : places and reasons.
    lost : whether recorded data are lost, or may be: the file was cut before its end.
    """

    source: Path
    output: Path
    complete: bool
    finished: bool
    messages: int
    metadata: int
    attachments: int
    lost_messages: int | None
    lost_bytes: int
    damage: tuple[Damage, ...]
    lost: bool

    def to_json(self) -> dict[str, Any]:
        """Return all fields as JSON values, for `--json`."""
        return {
            **{name: getattr(self, name) for name in _PLAIN},
            "source": str(self.source),
            "output": str(self.output),
            "damage": [asdict(damage) for damage in self.damage],
        }


_PLAIN = (
    "complete",
    "finished",
    "messages",
    "metadata",
    "attachments",
    "lost_messages",
    "lost_bytes",
    "lost",
)


def recover(
    source: Path,
    output: Path | None = None,
    *,
    force: bool = False,
    progress: Progress | None = None,
) -> Recovery:
    """Write a finished file with every message, metadata record and attachment that is whole.

    A chunk whose checksum does not match is left out. The source is not changed. If it is whole,
    nothing is written, or a copy if an output is given.

    Parameters
    ----------
    output : by default NAME.recovered.mcap beside NAME.mcap or NAME.mcap.partial.
    force : replace an output that exists.

    Raises
    ------
    InputError : the source cannot be read, is no MCAP file or has no whole record; the output
        exists or is the source.
    LossError : the output cannot be written.
    """
    report_progress = progress or silent
    with McapFile(source) as file:
        report_progress("reading", 0.0)
        found = scan(file)
        if found.whole and not found.damage:
            return _as_it_is(file, found, source, output, force=force)
        if not found.pieces or all(p.opcode == Opcode.HEADER for p in found.pieces):
            raise InputError(
                "nothing in this file can be recovered",
                where=str(source),
                expected="at least one whole record behind the header",
                got=found.damage[0].reason if found.damage else f"{file.size} bytes",
            )
        target = _target(source) if output is None else output
        _check_target(source, target, force=force)
        return _written(file, found, source, target, report_progress)


def _as_it_is(
    file: McapFile, found: Scan, source: Path, output: Path | None, *, force: bool
) -> Recovery:
    counts = _Counts()
    for _ in _events(file, found, counts):
        pass
    if output is not None:
        _check_target(source, output, force=force)
        try:
            shutil.copyfile(source, output)
        except OSError as error:
            raise LossError(
                "the file could not be copied", where=str(output), got=str(error)
            ) from error
    return _recovery(file, found, counts, source, output or source)


def _target(source: Path) -> Path:
    name = source.name.removesuffix(".partial").removesuffix(".mcap")
    return source.with_name(f"{name}.recovered.mcap")


def _check_target(source: Path, target: Path, *, force: bool) -> None:
    if target.exists() and target.samefile(source):
        raise InputError(
            "the output is the file that is to be recovered",
            where=str(target),
            hint="another place: --out; the original is kept",
        )
    if target.exists() and not force:
        raise InputError(
            "the output exists already", where=str(target), hint="another place: --out; or --force"
        )


@dataclass
class _Counts:
    messages: int = 0
    metadata: int = 0
    attachments: int = 0
    orphans: int = 0
    """Messages on channels that are declared nowhere."""
    result: bool = False


def _written(
    file: McapFile, found: Scan, source: Path, target: Path, report_progress: Progress
) -> Recovery:
    sink = PartialFile(target, fsync=False, suffix=".recovering")
    counts = _Counts()
    try:
        stream = McapStream(sink, 256 * 1024, _compression(file, found), early=True)
        _copy(file, found, stream, counts, report_progress)
        recovery = _recovery(file, found, counts, source, target)
        sink.finish()
    except OSError as error:
        sink.discard()
        raise LossError(
            "the recovered file could not be written",
            where=str(target),
            got=str(error),
            hint="make room on the disk, or choose another place: --out; the original is kept",
        ) from error
    except BaseException:
        sink.discard()
        raise
    return recovery


def _copy(
    file: McapFile, found: Scan, stream: McapStream, counts: _Counts, report_progress: Progress
) -> None:
    profile, library = _header(file, found)
    stream.start(library, profile)
    numbers: dict[int, int] = {}
    schemas: dict[int, int] = {0: 0}
    waiting: list[tuple[str, dict[str, str]]] = []
    for position, opcode, content in _events(file, found, counts):
        for name, entries in waiting:
            stream.flush()
            stream.metadata(name, entries)
        waiting = []
        if opcode == Opcode.MESSAGE:
            old, sequence, log_ns, publish_ns, data = message_of(content)
            new = numbers.get(old)
            if new is None:
                new = numbers[old] = _declared(stream, found, old, schemas)
            stream.message(new, log_ns, publish_ns, sequence, data)
        elif opcode == Opcode.METADATA:
            waiting.append(metadata_of(content))
        else:
            one = attachment_of(content)
            stream.flush()
            stream.attachment(
                one.name, one.media_type, one.data, log_ns=one.log_ns, create_ns=one.create_ns
            )
        report_progress("writing", position / file.size)
    last = [record for record in waiting if record[0] == layout.RESULT]
    for name, entries in (
        [r for r in waiting if r not in last] + [_recovery_record(found, counts)] + last
    ):
        stream.flush()
        stream.metadata(name, entries)
    stream.finish()


def _recovery_record(found: Scan, counts: _Counts) -> tuple[str, dict[str, str]]:
    """The record that says that, and of what, a file was recovered."""
    lost = _lost_messages(found, counts)
    return layout.RECOVERED, {
        "host.lost_bytes": str(sum(damage.length for damage in found.damage)),
        "host.lost_messages": "unknown" if lost is None else str(lost),
        "host.damage": "; ".join(f"byte {d.position}: {d.reason}" for d in found.damage[:20]),
    }


def _events(
    file: McapFile, found: Scan, counts: _Counts
) -> Iterator[tuple[int, int, bytes | memoryview]]:
    """Messages, metadata and attachments in file order, counted; channels must be known."""
    for piece in found.pieces:
        for opcode, content in _inside(file, piece):
            if opcode == Opcode.MESSAGE:
                if int.from_bytes(content[:2], "little") not in found.channels:
                    counts.orphans += 1
                    continue
                counts.messages += 1
            elif opcode == Opcode.METADATA:
                counts.metadata += 1
                counts.result |= metadata_of(content)[0] == layout.RESULT
            elif opcode == Opcode.ATTACHMENT:
                counts.attachments += 1
            else:
                continue
            yield piece.position, opcode, content


def _inside(file: McapFile, piece: Piece) -> Iterator[tuple[int, bytes | memoryview]]:
    content = file.content(piece)
    if piece.opcode != Opcode.CHUNK:
        yield piece.opcode, content
        return
    for opcode, _, inside in inner_records(chunk_data(content)):
        yield opcode, inside


def _declared(stream: McapStream, found: Scan, number: int, schemas: dict[int, int]) -> int:
    """Declare a channel, and its schema, when its first message comes."""
    channel = found.channels[number]
    if channel.schema not in schemas:
        schema = found.schemas.get(channel.schema)
        schemas[channel.schema] = (
            0 if schema is None else stream.schema(schema.name, schema.encoding, schema.data)
        )
    return stream.channel(
        channel.topic, channel.encoding, schemas[channel.schema], dict(channel.metadata)
    )


def _header(file: McapFile, found: Scan) -> tuple[str, str]:
    for piece in found.pieces:
        if piece.opcode == Opcode.HEADER:
            fields = Cursor(file.content(piece))
            with contextlib.suppress(Exception):
                return fields.text(), fields.text()
    return "", ""


def _compression(file: McapFile, found: Scan) -> str:
    """That of the first chunk."""
    for piece in found.pieces:
        if piece.opcode == Opcode.CHUNK:
            fields = Cursor(file.content(piece))
            fields.take(28)
            return fields.text() or "none"
    return "zstd"


def _lost_messages(found: Scan, counts: _Counts) -> int | None:
    """How many are missing: none if the end is there, by the indexes of what is damaged."""
    has_end = found.ended is not None or counts.result
    return found.lost + counts.orphans if has_end and found.lost is not None else None


def _recovery(file: McapFile, found: Scan, counts: _Counts, source: Path, target: Path) -> Recovery:
    lost = _lost_messages(found, counts)
    total = _promised(file, found)
    if total is not None:
        lost = max(total - counts.messages, 0)
    end = file.size
    if found.ended is not None:
        end = found.ended.position + 1
    elif counts.result:  # the last that a run writes
        end = found.pieces[-1].end
    return Recovery(
        source=source,
        output=target,
        complete=found.whole and not found.damage,
        finished=counts.result,
        messages=counts.messages,
        metadata=counts.metadata,
        attachments=counts.attachments,
        lost_messages=lost,
        lost_bytes=sum(damage.length for damage in found.damage),
        damage=tuple(found.damage),
        lost=lost != 0 or any(damage.position < end for damage in found.damage),
    )


def _promised(file: McapFile, found: Scan) -> int | None:
    """Number of messages as the summary has it, where that is proved."""
    for piece in found.summary if found.proved else ():
        if piece.opcode == Opcode.STATISTICS:
            return int.from_bytes(file.content(piece)[:8], "little")
    return None
