"""Format a comparison of two traces: as JSON and as lines of text."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from cosim.trace.comparison.compared_rows import SignalDiff
from cosim.trace.comparison.links import LinkDiff
from cosim.trace.comparison.signals import Diff


def diff_json(found: Diff) -> dict[str, Any]:
    """Return the whole comparison as JSON values; numbers that are not finite are None."""
    first = found.parted[0] if found.parted else None
    return {
        "a": found.paths[0],
        "b": found.paths[1],
        "content_hash": {"a": found.hashes[0], "b": found.hashes[1]},
        "identical": found.identical,
        "equal": found.equal,
        "first": None if first is None else {"signal": first.name, "time_s": first.first_s},
        "ends_s": _pair(found.ends_s),
        "signals": [_fields(signal) for signal in found.signals],
        "only": {"a": list(found.only[0]), "b": list(found.only[1])},
        "other_bytes": list(found.other_bytes),
        "links": [
            {"link": link.link, "differs": link.differs, **_fields(link)} for link in found.links
        ],
        "log_lines": _pair(found.log_lines),
        "texts": {name: list(lines) for name, lines in found.context.texts.items()},
        "entries": [asdict(change) for change in found.context.entries],
        "entries_left_out": found.context.left_out,
    }


def _pair(both: tuple[Any, Any]) -> dict[str, Any]:
    return {"a": both[0], "b": both[1]}


def _fields(item: SignalDiff | LinkDiff) -> dict[str, Any]:
    """Return the fields of a dataclass; a tuple holds the first trace's value and the second's."""
    return {k: _pair(v) if isinstance(v, tuple) else v for k, v in asdict(item).items()}


def diff_verdict(found: Diff) -> str:
    """Say in one sentence whether the traces are identical or equal, or what differs first."""
    if found.identical:
        return "identical"
    if found.parted:
        first = found.parted[0]
        return f"the first to part is {first.name} at t = {first.first_s:g} s"
    if not found.signals and any(found.only):
        return "no signal is in both"
    if found.equal:
        return "equal within the tolerances"
    return "the signals agree; something else differs"


def differences(found: Diff) -> Iterator[str]:
    """Yield one line per difference: signals by the time of their first difference, then the rest.

    What differs is a signal, topic, link, end time, log, metadata entry or attached text.
    """
    yield from (_signal_line(signal) for signal in found.parted)
    for name, only in zip(("first", "second"), found.only, strict=True):
        yield from (f"{what}: only in the {name} trace" for what in only)
    yield from (f"{topic}: other messages" for topic in found.other_bytes)
    for link in found.links:
        if link.differs:
            yield (
                f"link {link.link}: delivered {link.delivered[0]} and {link.delivered[1]} messages "
                f"({link.only[0]} and {link.only[1]} in one trace only, "
                f"{link.other_times} at other times); dropped {link.dropped[0]} and "
                f"{link.dropped[1]}"
            )
    if not found.same_end:
        yield f"the first ends at t = {found.ends_s[0]:g} s, the second at {found.ends_s[1]:g} s"
    if any(found.log_lines):
        yield f"/log: {found.log_lines[0]} and {found.log_lines[1]} lines in one trace only"
    for change in found.context.entries:
        yield f"{change.where} {change.key}: {change.a} in the first, {change.b} in the second"
    yield from (f"{name}: the text differs" for name in found.context.texts)


def further_differences(found: Diff) -> Iterator[str]:
    """Yield what differs beside signals in both, messages of links, metadata and texts."""
    for name, only in zip(("first", "second"), found.only, strict=True):
        if only:
            yield f"only in the {name} trace: {', '.join(only)}"
    if found.other_bytes:
        yield f"other messages: {', '.join(found.other_bytes)}"
    if not found.same_end:
        yield f"end: t = {found.ends_s[0]:g} s and {found.ends_s[1]:g} s"
    if any(found.log_lines):
        yield f"/log: {found.log_lines[0]} and {found.log_lines[1]} lines of its own each"


def _signal_line(signal: SignalDiff) -> str:
    most = "unlike" if signal.max_abs is None else f"at most {signal.max_abs:.3g}"
    unit = f" {signal.unit}" if signal.unit and signal.max_abs is not None else ""
    of_link = signal.name.startswith("/")
    own = signal.name.partition(":")[2] if of_link else signal.name.partition(".")[2]
    note = ", sample and hold (rows at other times)" if signal.sample_and_hold else ""
    return f"{signal.topic} {own}: from t = {signal.first_s:g} s, {most}{unit}{note}"
