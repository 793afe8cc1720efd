"""The stretches of time in which a link delivers nothing: outages, and losses in a row."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cosim.page import packed_times
from cosim.trace.report.decimation import decimated
from cosim.trace.report.series import Reals, Recording
from cosim.trace.report.timeline import LogLine

OUTAGE, LOSS = "outage", "loss"
_MOST_MESSAGES = 4000
"""Messages of a link whose times are in the page, at about as many instants."""


@dataclass(frozen=True)
class LinkSpan:
    """A stretch of time [s] in which a link delivers nothing; `kind` is `OUTAGE` or `LOSS`."""

    link: str
    kind: str
    begin: float
    end: float


def spans_of(
    recording: Recording, log: Sequence[LogLine], span: tuple[float, float]
) -> list[LinkSpan]:
    """Return outages as the log has them, and where messages in a row did not arrive.

    `span` : first and last time shown [s]; what has no end lasts to the last. Losses in a row that
    an outage caused are not listed beside it.
    """
    found: list[LinkSpan] = []
    for name, link in recording.links.items():
        since: float | None = None
        for line in log:
            # the recorder's own rule: a warning begins an outage, any other line ends it
            if line.name != name or not line.message.startswith("outage "):
                continue
            if line.level == "warning":
                since = line.t if since is None else since
            elif since is not None:
                found.append(LinkSpan(name, OUTAGE, since, line.t))
                since = None
        if since is not None:
            found.append(LinkSpan(name, OUTAGE, since, span[1]))
        for begin_ns, end_ns in link.bursts_ns:
            begin = (begin_ns - recording.origin_ns) / 1e9
            end = span[1] if end_ns is None else (end_ns - recording.origin_ns) / 1e9
            if not any(s.link == name and s.begin <= end and begin <= s.end for s in found):
                found.append(LinkSpan(name, LOSS, begin, end))
    return found


def shaded(spans: Sequence[LinkSpan]) -> list[tuple[str, float, float]]:
    """Return kind, begin and end [s] of what charts shade: of all links, overlaps joined."""
    joined: list[tuple[str, float, float]] = []
    for span in sorted(spans, key=lambda s: (s.kind, s.begin)):
        kind, begin, end = joined[-1] if joined else ("", 0.0, 0.0)
        if kind == span.kind and span.begin <= end:
            joined[-1] = kind, begin, max(end, span.end)
        else:
            joined.append((span.kind, span.begin, span.end))
    return joined


def spans_words(spans: Sequence[LinkSpan]) -> list[str]:
    """Return what is shaded, link by link, in words."""
    words = []
    for kind, noun in ((OUTAGE, "outage"), (LOSS, "three messages or more in a row not received")):
        for link in dict.fromkeys(s.link for s in spans if s.kind == kind):
            own = [s for s in spans if (s.link, s.kind) == (link, kind)]
            times = ", ".join(f"{s.begin:.5g} to {s.end:.5g} s" for s in own[:3])
            more = f" and {len(own) - 3} more" if len(own) > 3 else ""
            words.append(f"{link}: {noun} {times}{more}")
    return words


def link_figures(recording: Recording, spans: Sequence[LinkSpan]) -> list[dict[str, Any]]:
    """Return of each link what the animation shows: times of messages, and the spans."""
    found = []
    for name, link in recording.links.items():
        delivered = recording.seconds(link.deliveries_ns())
        dropped = [np.zeros(0), *(recording.seconds(heads[0]) for heads, _ in link.dropped)]
        found.append(
            {
                "name": name,
                "delivered": packed_times(_thinned(delivered)),
                "dropped": packed_times(_thinned(np.concatenate(dropped))),
                "spans": [[s.kind, s.begin, s.end] for s in spans if s.link == name],
            }
        )
    return found


def _thinned(t: Reals) -> Reals:
    """Return some of many times, so that every stretch in which there are some has one."""
    t = np.sort(t)
    return t[decimated(t, np.zeros(t.size), _MOST_MESSAGES)]
