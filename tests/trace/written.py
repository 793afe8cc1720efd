"""Traces for the tests of reading."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cosim.trace import Signal, TraceWriter

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
