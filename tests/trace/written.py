"""Traces for the tests of reading."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.trace import Signal, TraceWriter
from cosim.trace.file.messages import HEAD, Messages

if TYPE_CHECKING:
    from collections.abc import Sequence

ETA = [Signal("eta.x", 1, "m"), Signal("eta.psi", 4, "rad")]


def write(
    path: Path,
    *,
    run: dict[str, str] | None = None,
    result: dict[str, str] | None = None,
    rows: Any = None,
    topic: str = "/plant/output",
    signals: Any = None,
    **options: Any,
) -> Path:
    """Write a trace of 2000 rows, or of those given: (log, publish, sequence, values)."""
    if rows is None:
        rows = [(10 * k, 10 * k, k, [0.5 * k, -k]) for k in range(2000)]
    with TraceWriter(path, run=run or {"seed": "1"}, **options) as writer:
        eta = writer.add_topic(topic, signals or ETA, schema_name="cosim.plant.Output")
        for log, publish, sequence, values in rows:
            writer.write(eta, log, values, publish_time_ns=publish, sequence=sequence)
        return writer.finish(result or {"state": "done"})


def side_by_side(payloads: Sequence[bytes]) -> Messages:
    """Payloads as the messages of an opened chunk."""
    heads = np.zeros(len(payloads), HEAD)
    heads["opcode"] = 5
    heads["length"] = [HEAD.itemsize - 9 + len(payload) for payload in payloads]
    sizes = [HEAD.itemsize + len(payload) for payload in payloads]
    data = b"".join(head.tobytes() + p for head, p in zip(heads, payloads, strict=True))
    return Messages(data, np.cumsum([0, *sizes])[:-1].astype(np.int64), heads)
