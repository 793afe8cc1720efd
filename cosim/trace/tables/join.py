"""Put signals of several topics on a common time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from cosim.trace.rows.layout import Signal
from cosim.trace.tables.column import Align, Between, Joined
from cosim.trace.tables.table import Table
from cosim.trace.tables.time_base import time_base


def joined(
    where: str,
    wanted: Sequence[tuple[str, str | None]],
    names: Mapping[str, tuple[str, Signal]],
    tables: Mapping[str, Table],
    align: Align,
    between: Between,
) -> Joined:
    """Join columns of several topics.

    wanted : topics and their columns, None for all.
    names : topic and signal by the name of its column; `TOPIC:name` of others.
    align, between : as of `Framed`; of a topic in `tables`.
    """
    full = {(topic, signal.name): name for name, (topic, signal) in names.items()}
    instants = {topic: table.log_time_ns for topic, table in tables.items()}
    base = time_base(align, instants, [instants[topic] for topic, _ in wanted])
    columns = {}
    for topic, name in wanted:
        for own in [name] if name is not None else tables[topic].columns:
            full_name = full.get((topic, own), f"{topic}:{own}")
            columns[full_name] = tables[topic].column(own, base, between, full_name=full_name)
    return Joined(where, base, list(columns.values()))
