"""Traces of any size that a run could have written: components, links, values delivered."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from cosim.trace import Rows, Signal, TraceWriter

STEP_NS = 10_000_000
DELAY_STEPS = 3
_BLOCK = 2000


def write_run(
    path: Path,
    steps: int,
    *,
    changed_at: int | None = None,
    wrong: str | None = None,
    step_ns: int = STEP_NS,
    **options: Any,
) -> Path:
    """Write a run that `verify` finds in order; one value differs at step `changed_at`.

    wrong : "value" or "number": what is false of the messages of one block.
    """
    random = np.random.default_rng(1)
    states, forces = [Signal(f"x{i}") for i in range(12)], [Signal(f"u{i}") for i in range(4)]
    last = (steps - 1) * step_ns
    late = DELAY_STEPS
    links = {
        f"link.{name}": json.dumps({"delay_ns": late * step_ns, "order": "newest-wins"})
        for name in ("up", "down")
    }
    with TraceWriter(
        path, run={"end_ns": str(last), "step_ns": str(step_ns), **links}, **options
    ) as writer:
        ours = {
            "plant": (writer.add_topic("/plant/output", states, schema_name="t.P"), "up"),
            "control": (writer.add_topic("/control/output", forces, schema_name="t.C"), "down"),
        }
        over = {
            link: writer.add_topic(
                f"/link/{link}",
                [Signal(f"{name}.{s.name}") for s in signals],
                schema_name=f"t.{link}",
                metadata={"order": "newest-wins"},
            )
            for name, link, signals in (("plant", "up", states), ("control", "down", forces))
        }
        latest = {name: np.zeros((0, n)) for name, n in (("plant", 12), ("control", 4))}
        for first in range(0, steps, _BLOCK):
            k = np.arange(first, min(first + _BLOCK, steps))
            parts = []
            for name, (topic, link) in ours.items():
                values = random.normal(size=(k.size, latest[name].shape[1]))
                if changed_at is not None and k[0] <= changed_at <= k[-1]:
                    values[changed_at - first] += 1e-3
                parts.append(Rows(topic, k * step_ns, values, rank=np.zeros((k.size, 1), int)))
                everything = np.concatenate([latest[name], values])
                sent = k[k >= late] - late
                if sent.size:
                    rows = everything[sent - (first - len(latest[name]))]
                    at = (sent + late) * step_ns
                    rank = np.ones((sent.size, 1), int)
                    number = sent - (np.arange(sent.size) == 90) * (wrong == "number")
                    if wrong == "value":
                        rows[100, 1] += 1e-9
                    parts.append(Rows(over[link], at, rows, sent * step_ns, number, rank))
                latest[name] = everything[-late:]
            writer.write_rows(parts)
        figures = {"sent": steps, "delivered": steps - late, "dropped": 0, "in_flight": late}
        result = {f"link.{n}.{k}": str(v) for n in ("up", "down") for k, v in figures.items()}
        return writer.finish({"status": "finished", "steps": str(steps - 1), **result})


def write_topics(path: Path, topics: int, rows: int = 100) -> Path:
    """Write a file of many topics, each with few rows."""
    with TraceWriter(path, run={"seed": "1"}) as writer:
        numbers = [
            writer.add_topic(f"/c{i}/output", [Signal("x"), Signal("y")], schema_name=f"t.C{i}")
            for i in range(topics)
        ]
        for k in range(rows):
            for number in numbers:
                writer.write(number, k * STEP_NS, [0.5 * k, -k])
        return writer.finish({"status": "finished", "steps": str(rows - 1)})
