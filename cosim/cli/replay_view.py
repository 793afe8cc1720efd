"""Reruns and injections, formatted for a terminal."""

from __future__ import annotations

from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from cosim.cli.run_view import late_view
from cosim.cli.terminal import plain, table
from cosim.replay import InjectionResult, Rerun
from cosim.trace.comparison import diff_json, diff_verdict


def rerun_line(result: Rerun) -> str:
    """Say whether a rerun gave the same messages."""
    if not result.identical:
        return f"not identical to {result.original}"
    if not result.finished:
        return (
            f"identical as far as it goes: {result.original} did not finish, and the rerun begins "
            "with all of its messages, bit for bit"
        )
    return f"identical: the rerun gave every message of {result.original}, bit for bit"


def rerun_view(result: Rerun) -> RenderableType:
    """Show the hash of the messages, or where they differ."""
    if result.identical:
        return Text(f"content hash {result.original_hash}" if result.finished else "")
    return Text("\n".join(f"  {line}" for line in result.differences[:20]))


def inject_json(found: InjectionResult) -> dict[str, Any]:
    """Return the object that `--json` prints."""
    compared = None if found.compared is None else diff_json(found.compared)
    keys = ("equal", "first", "signals", "only")
    return {
        "output": str(found.trace),
        "content_hash": found.content_hash,
        "fmu": str(found.fmu.path),
        "fmu_sha256": found.fmu.sha256,
        "component": found.name,
        "as_component": found.role,
        "mapped": {name: f"{s.topic}:{s.column}" for name, s in found.sources.items()},
        "not_mapped": list(found.unmapped_inputs),
        "not_used": list(found.unused),
        "parameters": dict(found.parameters),
        "parameters_not_set": list(found.not_set),
        "points": found.points,
        "end_s": found.end_s,
        "shift_s": found.shift_s,
        "status": found.status,
        "reason": found.reason,
        "identical": found.identical,
        "compare": compared and {key: compared[key] for key in keys},
        "log_after_end": list(found.log_after_end),
    }


def inject_line(found: InjectionResult) -> str:
    """Say how far the FMU came with the recorded inputs, and whether its outputs are the same."""
    fed = f"{found.fmu.path.name} as {found.name}: {found.status} at t = {found.end_s:g} s"
    if found.compared is None:
        return f"{fed}, {found.points} communication points"
    words = diff_verdict(found.compared)
    if found.identical:
        words = "identical: every output is the same, bit for bit"
    return f"{fed}; compared with the recorded outputs: {words}"


def inject_tone(found: InjectionResult) -> str:
    """Return "bad" where the FMU failed or its outputs differ."""
    differs = found.compared is not None and not found.compared.equal
    return "bad" if differs or found.reason else "good"


def inject_view(found: InjectionResult) -> RenderableType:
    """Show which inputs were fed with what, what was left out, and the result."""
    sources = (
        (plain(name), plain(f"{source.topic} {source.column}"))
        for name, source in found.sources.items()
    )
    parts: list[RenderableType] = [table("*input|fed with", sources)]
    for label, names in (
        ("inputs at their start values", found.unmapped_inputs),
        ("recorded inputs that were not used", found.unused),
        ("recorded parameters that the FMU does not have", found.not_set),
    ):
        if names:
            parts.append(plain(f"{label}: {', '.join(names)}"))
    own = f"{len(found.parameters)} set" if found.parameters else "the FMU's own"
    parts.append(plain(f"parameters: {own}"))
    if found.reason:
        parts.append(Text(found.reason, style="red"))
    parts += late_view(found.log_after_end)
    parts.append(plain(f"trace: {found.trace}"))
    return Group(*parts)
