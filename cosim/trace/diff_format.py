"""A comparison of two traces as JSON and as lines of text."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from cosim.trace.diff_signals import Diff, SignalDiff


def diff_json(found: Diff) -> dict[str, Any]:
    """Everything, JSON-safe: numbers that are not finite are None."""
    first = found.parted[0] if found.parted else None
    return {
        "a": found.paths[0],
        "b": found.paths[1],
        "content_hash": {"a": found.hashes[0], "b": found.hashes[1]},
        "identical": found.identical,
        "equal": found.equal,
        "first": None if first is None else {"signal": first.name, "time_s": first.first_s},
        "ends_s": _pair(found.ends_s),
        "signals": [_signal(signal) for signal in found.signals],
        "only": {"a": list(found.only[0]), "b": list(found.only[1])},
        "other_bytes": list(found.other_bytes),
        "links": [
            {
                "link": link.link,
                "differs": link.differs,
                "delivered": _pair(link.delivered),
                "dropped": _pair(link.dropped),
                "only": _pair(link.only),
                "other_times": link.other_times,
                "largest_shift_s": link.largest_shift_s,
                "first_s": link.first_s,
            }
            for link in found.links
        ],
        "log_lines": _pair(found.log_lines),
        "texts": {name: list(lines) for name, lines in found.context.texts.items()},
        "entries": [asdict(change) for change in found.context.entries],
        "entries_left_out": found.context.left_out,
    }


def _pair(both: tuple[Any, Any]) -> dict[str, Any]:
    return {"a": both[0], "b": both[1]}


def _signal(signal: SignalDiff) -> dict[str, Any]:
    return {
        "name": signal.name,
        "topic": signal.topic,
        "unit": signal.unit,
        "rows": _pair(signal.rows),
        "compared": signal.compared,
        "differing": signal.differing,
        "max_abs": signal.max_abs,
        "max_rel": signal.max_rel,
        "max_at_s": signal.max_at_s,
        "first_s": signal.first_s,
        "sample_and_hold": signal.sample_and_hold,
    }


def diff_verdict(found: Diff) -> str:
    """One sentence: identical, equal, or the first to part."""
    if found.identical:
        return "identical"
    if found.parted:
        first = found.parted[0]
        return f"the first to part is {first.name} at t = {first.first_s:g} s"
    if found.equal:
        return "equal within the tolerances"
    return "the signals agree; something else differs"


def differences(found: Diff) -> Iterator[str]:
    """What differs, line by line: signals in the order in which they part, then the rest."""
    yield from (_parting(signal) for signal in found.parted)
    for name, only in zip(("first", "second"), found.only, strict=True):
        yield from (f"{what}: only in the {name} trace" for what in only)
    yield from (f"{topic}: other messages" for topic in found.other_bytes)
    for link in found.links:
        if link.differs:
            yield (
                f"link {link.link}: delivered {link.delivered[0]}, then {link.delivered[1]}; "
                f"{link.only[0]} and {link.only[1]} that the other did not, "
                f"{link.other_times} at other times; dropped {link.dropped[0]}, {link.dropped[1]}"
            )
    if not found.same_end:
        yield f"the first ends at t = {found.ends_s[0]:g} s, the second at {found.ends_s[1]:g} s"
    if any(found.log_lines):
        yield f"/log: {found.log_lines[0]} and {found.log_lines[1]} lines of their own"
    for change in found.context.entries:
        yield f"{change.where} {change.key}: {change.a}, then {change.b}"
    yield from (f"{name}: other lines" for name in found.context.texts)


def _parting(signal: SignalDiff) -> str:
    most = "unlike" if signal.max_abs is None else f"at most {signal.max_abs:.3g}"
    unit = f" {signal.unit}" if signal.unit and signal.max_abs is not None else ""
    of_link = signal.name.startswith("/")
    own = signal.name.partition(":")[2] if of_link else signal.name.partition(".")[2]
    sample_and_hold = ", as held (rows at other times)" if signal.sample_and_hold else ""
    return f"{signal.topic} {own}: from t = {signal.first_s:g} s, {most}{unit}{sample_and_hold}"
