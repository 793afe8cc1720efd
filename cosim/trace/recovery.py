"""Recover a trace that was cut short or damaged: write a finished file of its records."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from mcap.opcode import Opcode
from mcap.records import Attachment, Header, Metadata

from cosim.core import (
    AnyPath,
    InputError,
    LossError,
    Progress,
    copy_whole,
    not_written,
    silent,
    written_beside,
)
from cosim.trace.checks.of_file import FileChecks
from cosim.trace.checks.verification import verification_of
from cosim.trace.file.records import chunk_head, parsed
from cosim.trace.file.stream import McapStream
from cosim.trace.file.walk import Damage, Policy, Record, Walk
from cosim.trace.recovered import Recovered
from cosim.trace.rows import layout


@dataclass(frozen=True)
class Recovery:
    """The result of recovering a file.

    Attributes
    ----------
    source, output : the file read, and the one written; the same if nothing had to be written.
    complete : whether the file was whole, with nothing to recover, and `verify` finds no fault.
    finished : whether the run has a result.
    failed : checks of `verify` that the source fails, by name. Those of indexes and summary are
        mended in the output, which has new ones; what a run lacks is not.
    messages, metadata, attachments : number of them in the output.
    suspect_messages : number of those that were kept though their chunk is damaged.
    lost_messages : number of messages lost, None if unknown.
    lost_bytes : bytes of the file that could not be used.
    damage : places and reasons.
    lost : whether recorded data are lost, or may be: the file was cut before its end.
    """

    source: Path
    output: Path
    complete: bool
    finished: bool
    failed: tuple[str, ...]
    messages: int
    suspect_messages: int
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
            "failed": list(self.failed),
            "damage": [asdict(damage) for damage in self.damage],
        }


_MOST_DAMAGE = 20
_PLAIN = (
    "complete",
    "finished",
    "messages",
    "suspect_messages",
    "metadata",
    "attachments",
    "lost_messages",
    "lost_bytes",
    "lost",
)


def recover(
    source: AnyPath,
    output: AnyPath | None = None,
    *,
    force: bool = False,
    strict: bool = False,
    progress: Progress | None = None,
) -> Recovery:
    """Write a finished file with every message, metadata record and attachment that can be read.

        >>> from pathlib import Path
        >>> from cosim import DelaySystem, Scenario, run
        >>> from cosim.trace import recover
        >>> lag = Scenario(step=0.1, until=1).add("lag", DelaySystem([[-1]]), initial=[1.0])
        >>> whole = run(lag, "lag.mcap").trace.read_bytes()
        >>> cut_short = Path("lag.mcap").write_bytes(whole[:-100])
        >>> recovery = recover("lag.mcap")
        >>> recovery.output.name, recovery.complete, recovery.finished
        ('lag.recovered.mcap', False, True)

    Readable data of a damaged chunk or attachment are kept and marked: values may be wrong, and the
    record `cosim.recovered` names them. The source is not changed. If it is whole, nothing is
    written, or a copy if an output is given.

    Parameters
    ----------
    output : by default NAME.recovered.mcap beside NAME.mcap or NAME.mcap.partial.
    force : replace an output that exists.
    strict : leave out everything from damaged chunks and attachments.

    Raises
    ------
    InputError : the source cannot be read, is no MCAP file or has no whole record; the output
        exists or is the source.
    LossError : the output cannot be written.
    """
    source, output = Path(source), None if output is None else Path(output)
    report_progress = progress or silent
    report_progress("reading", 0.0)
    found = _look(source, "skip" if strict else "keep", report_progress)
    whole = found.walk.whole and not found.walk.damage
    if whole and not found.mendable:
        return _as_it_is(found, source, output, force=force)
    if not found.checks.first:
        damage = found.walk.damage
        raise InputError(
            "nothing in this file can be recovered",
            where=str(source),
            expected="at least one whole record behind the header",
            got=damage[0].reason if damage else f"{found.walk.size} bytes",
        )
    target = _target(source) if output is None else output
    _check_target(source, target, force=force)
    return _written(found, source, target, report_progress)


@dataclass
class _Found:
    """A file as the first walk over it has found it.

    Attributes
    ----------
    mendable : checks of the structure that fail, though no byte is damaged.
    promised : number of messages as a proved summary has it; None without.
    """

    walk: Walk
    policy: Policy
    checks: FileChecks
    mendable: tuple[str, ...] = ()
    promised: int | None = None
    profile: str = ""
    library: str = ""
    compression: str | None = None


def _look(source: Path, policy: Policy, report_progress: Progress) -> _Found:
    walk = Walk(source, policy)
    found = _Found(walk, policy, FileChecks(walk))
    for record in walk:
        found.checks.add(record)
        if record.opcode == Opcode.HEADER:
            header = parsed(Header, record.content)
            found.profile, found.library = header.profile, header.library
        elif record.opcode == Opcode.CHUNK and found.compression is None and not record.suspect:
            found.compression = chunk_head(record.content).compression or "none"
        report_progress("reading", walk.position / walk.size)
    found.mendable = tuple(c.name for c in found.checks.results if c.verdict == "failed")
    found.promised = found.checks.stated if walk.proved else None
    return found


def _as_it_is(found: _Found, source: Path, output: Path | None, *, force: bool) -> Recovery:
    counts = _Counts(
        messages=sum(n for c, n in found.checks.counts.items() if c in found.checks.channels),
        metadata=len(found.checks.metadata),
        attachments=found.checks.attachments,
        result=any(name == layout.RESULT for name, _ in found.checks.metadata),
    )
    if output is not None:
        _check_target(source, output, force=force)
        with not_written("the copy", output, LossError):
            copy_whole(source, output)
    checks = verification_of(source, found.walk, found.checks).checks
    failed = tuple(check.name for check in checks if check.verdict == "failed")
    return replace(_recovery(found, counts, source, output or source, failed), lost=bool(failed))


def _target(source: Path) -> Path:
    name = source.name.removesuffix(".partial").removesuffix(".mcap")
    return source.with_name(f"{name}.recovered.mcap")


def _check_target(source: Path, target: Path, *, force: bool) -> None:
    if target.exists() and target.samefile(source):
        raise InputError(
            "the output is the file that is to be recovered",
            where=str(target),
            hint="another place: `out`; the original is kept",
        )
    if target.is_file() and not force:  # a device or a pipe is not overwritten
        raise InputError(
            "the output exists already", where=str(target), hint="another place: `out`; or `force`"
        )


@dataclass
class _Counts:
    """What the output has.

    Attributes
    ----------
    orphans : messages on channels that are declared nowhere.
    suspect : what was kept of each damaged chunk or attachment.
    """

    messages: int = 0
    metadata: int = 0
    attachments: int = 0
    orphans: int = 0
    result: bool = False
    suspect_messages: int = 0
    suspect: list[dict[str, Any]] = field(default_factory=list)


def _written(found: _Found, source: Path, target: Path, report_progress: Progress) -> Recovery:
    counts = _Counts()
    hint = "make room on the disk, or choose another place: `out`; the original is kept"
    with (
        not_written("the recovered file", target, LossError, hint=hint),
        written_beside(target) as partial,
        partial.open("wb") as file,
    ):
        stream = McapStream(file, 256 * 1024, found.compression or "zstd", early=True)
        _copy(found, source, stream, counts, report_progress)
        return _recovery(found, counts, source, target, found.mendable)


def _copy(
    found: _Found, source: Path, stream: McapStream, counts: _Counts, report_progress: Progress
) -> None:
    stream.start(found.library, found.profile)
    numbers: dict[int, int] = {}
    schemas: dict[int, int] = {0: 0}
    waiting: list[tuple[str, dict[str, str]]] = []
    walk = Walk(source, found.policy)
    for record in walk:
        if walk.ended is not None and record.position > walk.ended:
            break
        if record.messages is None and record.opcode not in (Opcode.METADATA, Opcode.ATTACHMENT):
            continue
        for name, entries in waiting:
            stream.flush()
            stream.metadata(name, entries)
        waiting = []
        if record.messages is not None:
            _copy_messages(found, record, stream, counts, numbers, schemas)
        elif record.opcode == Opcode.METADATA:
            metadata = parsed(Metadata, record.content)
            counts.metadata += 1
            counts.result |= metadata.name == layout.RESULT
            waiting.append((metadata.name, metadata.metadata))
        else:
            one = parsed(Attachment, record.trusted)
            counts.attachments += 1
            stream.flush()
            stream.attachment(
                one.name, one.media_type, one.data, log_ns=one.log_time, create_ns=one.create_time
            )
            if record.suspect is not None:
                counts.suspect.append({"attachment": one.name, "why": record.suspect})
        report_progress("writing", record.position / walk.size)
    last = [record for record in waiting if record[0] == layout.RESULT]
    for name, entries in (
        [r for r in waiting if r not in last] + [_recovery_record(found, counts)] + last
    ):
        stream.flush()
        stream.metadata(name, entries)
    stream.finish()


def _copy_messages(
    found: _Found,
    record: Record,
    stream: McapStream,
    counts: _Counts,
    numbers: dict[int, int],
    schemas: dict[int, int],
) -> None:
    """Copy the messages of a chunk, or outside chunks, in file order; note those suspect."""
    messages = record.messages
    assert messages is not None  # noqa: S101 - the caller has looked
    before, topics = counts.messages, dict[str, int]()
    heads = messages.heads
    columns = [heads[key].tolist() for key in ("channel", "sequence", "log", "publish")]
    for old, sequence, log_ns, publish_ns, data in zip(*columns, messages.payloads(), strict=True):
        channel = found.checks.channels.get(old)
        if channel is None:
            counts.orphans += 1
            continue
        new = numbers.get(old)
        if new is None:
            new = numbers[old] = _declared(stream, found, old, schemas)
        stream.message(new, log_ns, publish_ns, sequence, bytes(data))
        counts.messages += 1
        topics[channel.topic] = topics.get(channel.topic, 0) + 1
    suspect = record.suspect
    if record.opcode == Opcode.MESSAGE and found.walk.chunked and found.policy == "keep":
        suspect = found.walk.refuted  # where all others are in chunks, it may be another record
    if suspect is not None and counts.messages > before:
        counts.suspect_messages += counts.messages - before
        counts.suspect.append(
            {
                "messages": [before, counts.messages],
                "topics": topics,
                "log_ns": [int(heads["log"].min()), int(heads["log"].max())],
                "byte": record.position,
                "why": suspect,
            }
        )


def _recovery_record(found: _Found, counts: _Counts) -> tuple[str, dict[str, str]]:
    """The record that says that, and of what, a file was recovered."""
    damage = found.walk.damage
    record = Recovered(
        _lost_messages(found, counts),
        sum(d.length for d in damage if d.outcome == "lost"),
        "; ".join(f"byte {d.position}: {d.reason}" for d in damage[:_MOST_DAMAGE]),
        counts.suspect_messages,
        tuple(counts.suspect),
    )
    return layout.RECOVERED, record.entries()


def _declared(stream: McapStream, found: _Found, number: int, schemas: dict[int, int]) -> int:
    """Declare a channel, and its schema, when its first message comes."""
    channel = found.checks.channels[number]
    if channel.schema_id not in schemas:
        schema = found.checks.schemas.get(channel.schema_id)
        schemas[channel.schema_id] = (
            0 if schema is None else stream.schema(schema.name, schema.encoding, schema.data)
        )
    return stream.channel(
        channel.topic, channel.message_encoding, schemas[channel.schema_id], channel.metadata
    )


def _lost_messages(found: _Found, counts: _Counts) -> int | None:
    """How many are missing: none if the end is there, by the indexes of what is damaged."""
    if found.promised is not None:
        return max(found.promised - counts.messages, 0)
    has_end = found.walk.ended is not None or counts.result
    lost = found.walk.lost
    return lost + counts.orphans if has_end and lost is not None else None


def _recovery(
    found: _Found, counts: _Counts, source: Path, target: Path, failed: tuple[str, ...]
) -> Recovery:
    walk = found.walk
    lost = _lost_messages(found, counts)
    end = walk.size
    if walk.ended is not None:
        end = walk.ended + 1
    elif counts.result:  # the last that a run writes
        end = found.checks.end
    damage = walk.damage
    return Recovery(
        source=source,
        output=target,
        complete=walk.whole and not damage and not failed,
        finished=counts.result,
        failed=failed,
        messages=counts.messages,
        suspect_messages=counts.suspect_messages,
        metadata=counts.metadata,
        attachments=counts.attachments,
        lost_messages=lost,
        lost_bytes=sum(d.length for d in damage if d.outcome == "lost"),
        damage=tuple(damage),
        lost=lost != 0 or any(d.position < end and d.outcome != "mended" for d in damage),
    )
