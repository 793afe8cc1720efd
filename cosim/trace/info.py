"""Summarise a trace as JSON values; `info_view` prints them."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from cosim.core import AnyPath, CosimError, InputError
from cosim.trace.checks.verification import verify
from cosim.trace.content import content_hash_of
from cosim.trace.outcome.run_outcome import outcome_of
from cosim.trace.reader import TopicInfo, Trace
from cosim.trace.recovered import Recovered
from cosim.trace.rows import foxglove
from cosim.trace.rows.layout import LOG_TOPIC, certificate_of, parsed_json

_LINK = "link."
_STRUCTURED = ("metrics", "final", "assertions", "events", "cause")
_LOG_LINES = 20

MOST_HASHED_BYTES = 2**26
"""Larger files are read whole for their content hash only if that is asked for [bytes]."""


def describe(
    path: AnyPath, *, incomplete: bool | None = True, hashed: bool | None = None
) -> dict[str, Any]:
    """Summarise a trace as JSON values (no NaN; None for what is absent).

        >>> from cosim import DelaySystem, Scenario, run
        >>> from cosim.trace import describe
        >>> lag = Scenario(step=0.1, until=1).add("lag", DelaySystem([[-1]]), initial=[1.0])
        >>> result = run(lag, "lag.mcap")
        >>> about = describe("lag.mcap")
        >>> about["complete"], about["outcome"]["status"], [t["topic"] for t in about["topics"]]
        (True, 'finished', ['/lag/output', '/log'])

    Keys: `path`, `bytes`, `library`, `complete`, `damage`, `finished`, `recovered` (what a
    recovered file lost, and what in it is marked as suspect; None for another), `run`, `result`
    (entries but those of links; JSON parsed), `links` (figures by link name), `log` (the last
    warnings and errors), `start_ns`, `end_ns`, `message_count`, `outcome` (as of
    `RunOutcome.to_json`, and `tone`; None without a result), `certificate` (`claim`, `sha256`,
    `attachment`, `gain`; None without one), `topics` (list of `topic`, `schema`, `encoding`,
    `count`, `start_ns`, `end_ns`, `rate_hz`, `signals`), `attachments` (list of `name`,
    `media_type`, `bytes`), `verified` (`verdict`, and `failed`, the details of checks that failed;
    None if the file was not read whole), `content_hash`, `content_hash_version`.

    Parameters
    ----------
    incomplete : as in `Trace`, but True by default, to summarise damaged files too.
    hashed : whether to read the whole file, for its content hash and for damage in its data.
        Without, all comes from the summary if the file has one, and `content_hash` is None. None:
        if it has at most `MOST_HASHED_BYTES`.
    """
    if hashed is None:
        hashed = not _is_large(Path(path))
    if hashed or not incomplete:
        return description_of(Trace(path, incomplete=incomplete), hashed=hashed)
    return description_of(Trace(path, incomplete=True, by_summary=True), hashed=False)


def _verified(path: Path) -> dict[str, Any]:
    """Return what `verify` says of the file that a summary is of."""
    try:
        found = verify(path)
    except CosimError as error:
        return {"verdict": "failed", "failed": [error.what]}
    failed = [f"{each.name}: {each.detail}" for each in found.checks if each.verdict == "failed"]
    return {"verdict": found.verdict, "failed": failed}


def _is_large(path: Path) -> bool:
    try:
        return path.stat().st_size > MOST_HASHED_BYTES
    except (OSError, ValueError):  # `Trace` says what is wrong with it
        return False


def description_of(trace: Trace, *, hashed: bool) -> dict[str, Any]:
    """Summarise an open trace; see `describe`."""
    topics = [_topic(info) for info in trace.topics.values()]
    starts = [t["start_ns"] for t in topics if t["start_ns"] is not None]
    ends = [t["end_ns"] for t in topics if t["end_ns"] is not None]
    links, result = _split(trace.result or {})
    outcome, recovered = outcome_of(trace.result), Recovered.of(trace.metadata)
    version = digest = None
    with suppress(InputError):  # a format of rows that is not known has no hash
        version = trace.content_hash_version
        digest = content_hash_of(trace) if hashed else None
    return {
        "path": str(trace.path),
        "bytes": trace.path.stat().st_size,
        "library": trace.library,
        "complete": trace.complete,
        "damage": trace.damage,
        "finished": trace.finished,
        "recovered": None if recovered is None else recovered.to_json(),
        "run": dict(trace.run),
        "result": None if trace.result is None else result,
        "links": links,
        "outcome": None if outcome is None else {**outcome.to_json(), "tone": outcome.tone},
        "certificate": certificate_of(trace.run),
        "log": _log(trace),
        "start_ns": min(starts, default=None),
        "end_ns": max(ends, default=None),
        "message_count": sum(t["count"] for t in topics),
        "topics": topics,
        "attachments": [
            {"name": name, "media_type": trace.media_types[name], "bytes": len(data)}
            for name, data in trace.attachments.items()
        ],
        "verified": _verified(trace.path) if hashed else None,
        "content_hash": digest,
        "content_hash_version": version,
    }


def _topic(info: TopicInfo) -> dict[str, Any]:
    rate = None
    if info.start_ns is not None and info.end_ns is not None and info.end_ns > info.start_ns:
        rate = (info.count - 1) * 1e9 / (info.end_ns - info.start_ns)
    return {
        "topic": info.topic,
        "schema": info.schema,
        "encoding": info.encoding,
        "count": info.count,
        "start_ns": info.start_ns,
        "end_ns": info.end_ns,
        "rate_hz": rate,
        "signals": [
            {
                "name": signal.name,
                "kind": signal.kind,
                "unit": signal.unit,
                "value_reference": signal.value_reference,
                "hold": signal.hold,
            }
            for signal in info.signals
        ],
    }


def _split(result: Mapping[str, str]) -> tuple[dict[str, dict[str, str]], dict[str, Any]]:
    """Separate the entries `link.<name>.<figure>` from the others, and parse those of JSON."""
    links: dict[str, dict[str, str]] = {}
    rest: dict[str, Any] = {}
    for key, value in result.items():
        link, dot, figure = key.removeprefix(_LINK).rpartition(".")
        if key.startswith(_LINK) and dot:
            links.setdefault(link, {})[figure] = value
        else:
            parsed = parsed_json(value) if key in _STRUCTURED else None
            rest[key] = value if parsed is None else parsed
    return links, rest


def _log(trace: Trace) -> list[dict[str, Any]]:
    """Return the last warnings and errors of components and master."""
    info = trace.topics.get(LOG_TOPIC)
    if info is None or info.schema != "foxglove.Log":
        return []
    table = trace.read(LOG_TOPIC)
    words = {number: word for word, number in foxglove.LEVELS.items()}
    serious = [i for i in range(len(table)) if table["level"][i] >= foxglove.LEVELS["warning"]]
    return [
        {
            "time_s": int(table.log_time_ns[i]) / 1e9,
            "level": words.get(int(table["level"][i]), str(table["level"][i])),
            "name": str(table["name"][i]),
            "message": str(table["message"][i]),
        }
        for i in serious[-_LOG_LINES:]
    ]
