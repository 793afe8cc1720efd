"""Events of a run are counted and logged as they happen; the log has no more than it can bear."""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import tomli_w

from cosim.master import EngineName, Pace
from cosim.scenario import (
    FmuCache,
    Outcome,
    execute_recorded,
    parse,
    prepare,
    supervision_of,
)
from cosim.trace import RunOutcome, Trace, verify
from cosim.trace.outcome import EventCount

STEP_NS = 100_000_000
AXES = {"force.x": "x", "force.y": "y", "force.z": "z", "moment.z": "psi"}
LIMIT = 10.0
AS_COMMANDED = {f"K[{i},{j}]": -float(i == j) for i in range(1, 5) for j in range(1, 9)} | {
    f"thrust_map[{i},{j}]": float(i == j) for i in range(1, 5) for j in range(1, 5)
}
"""u = K (x - reference) with x = 0: each command is the reference of its axis."""
BEGINS, ENDS = "at its limit of 10 N", "below its limit again"
MOST_LINES = 400
"""Lines of one kind of event of one subject that a log can bear, as its last one says."""


LEVELS = {1: "debug", 2: "info", 3: "warning", 4: "error"}
"""Levels of the log of a trace, which are Foxglove's."""


class Line(NamedTuple):
    """A line of the log of a trace."""

    time_ns: int
    level: str
    name: str
    message: str


def run_of(
    data: Mapping[str, Any], fmus: Path, folder: Path, engine: EngineName = "auto"
) -> tuple[Outcome, list[Line]]:
    """A recorded run: its outcome, and its log."""
    loaded = parse(tomli_w.dumps(data), name="e", where="e.toml", folder=folder)
    prepared = prepare(loaded, FmuCache(fmus.parent, folder, flavour="native"))
    path = folder / f"{engine}.mcap"
    alone = supervision_of(loaded.scenario, supervise=False)
    pace = None if engine == "auto" else Pace(factor=1e6)  # which looks at every point
    outcome, _, _ = execute_recorded(prepared, path, engine=engine, pace=pace, supervision=alone)
    checks = verify(path).checks  # every line has its place among the rows
    assert [check for check in checks if check.verdict == "failed"] == []
    log = Trace(path).read("/log")
    levels = [LEVELS[int(level)] for level in log["level"]]
    columns = (log.log_time_ns.tolist(), levels, log["name"], log["message"])
    return outcome, [Line(*line) for line in zip(*columns, strict=True)]


def at_limits(truths: Mapping[str, Sequence[bool]]) -> dict[str, Any]:
    """A scenario of a controller whose commands are at their limits where it is true."""
    count = len(next(iter(truths.values())))
    return {
        "title": "commands at their limits",
        "run": {"end": (count - 1) * STEP_NS / 1e9, "step": STEP_NS / 1e9},
        "components": {
            "c": {
                "fmu": "HinfController",
                "parameters": {
                    **AS_COMMANDED,
                    "limit.force": LIMIT,
                    "limit.moment": LIMIT,
                    "sample_time": 0.0,
                },
            }
        },
        "inputs": [
            {
                "times": [k * STEP_NS / 1e9 for k in range(count)],
                "values": {  # what it samples at a point it commands at the next one
                    f"c.reference.{AXES[name]}": [2 * LIMIT * x for x in [*there[1:], False]]
                    for name, there in truths.items()
                },
                "interpolation": "hold",
            }
        ],
    }


def lines_of(log: Sequence[Line], *words: str) -> list[tuple[int, str, str]]:
    """The lines of the log about a subject."""
    about = [line for line in log if all(word in f"{line.name}: {line.message}" for word in words)]
    return [(line.time_ns, line.level, line.message) for line in about]


@pytest.mark.parametrize("engine", ["python", "auto"])
def test_episodes_are_where_it_is_true(
    engine: EngineName, native_fmus: Path, tmp_path: Path
) -> None:
    """Begin, end and duration of each, found by hand; one that lasts ends with the run."""
    r = random.Random(3)  # noqa: S311 - cases, not secrets
    some = {name: [False, *(r.random() < 0.4 for _ in range(60))] for name in AXES}
    some["force.y"][-3:] = [True, True, True]
    some["moment.z"] = [False] * 61
    outcome, log = run_of(at_limits(some), native_fmus, tmp_path, engine)
    counts = {one.subject: one for one in outcome.events if one.kind == "saturation"}
    assert set(counts) == {"c.force.x", "c.force.y", "c.force.z"}
    for name in ("force.x", "force.y", "force.z"):
        wanted, total, k = [], 0, 0
        for there, group in groupby(some[name]):
            lasts = len(list(group))
            ended = k + lasts == len(some[name])
            if there:
                wanted.append((k * STEP_NS, "warning", BEGINS))
                total += (lasts - ended) * STEP_NS
                if not ended:
                    wanted.append(((k + lasts) * STEP_NS, "info", ENDS))
            k += lasts
        assert lines_of(log, f"c.{name}", "its limit") == wanted
        begun = [time for time, level, _ in wanted if level == "warning"]
        found = counts[f"c.{name}"]
        assert (found.count, found.first_s) == (len(begun), begun[0] / 1e9)
        assert found.total_s == total / 1e9


@pytest.mark.parametrize("engine", ["python", "auto"])
def test_bursts_are_three_messages_missed_in_a_row(
    engine: EngineName, native_fmus: Path, tmp_path: Path
) -> None:
    """Begin at the third, end with the next that arrives: counted one message after the other."""
    r = random.Random(4)  # noqa: S311 - cases, not secrets
    missed = {name: [r.random() < 0.6 for _ in range(80)] for name in ("up", "down")}
    missed["up"][-4:] = [False, True, True, True]
    missed["down"][:5] = [True, True, True, True, False]
    data = {
        "title": "bursts",
        "connect": ["plant.x -> controller.x : up", "controller.u -> plant.u : down"],
        "run": {"end": 79 * STEP_NS / 1e9, "step": STEP_NS / 1e9},
        "components": {
            "plant": {"fmu": "DelayedPlant"},
            "controller": {"fmu": "PaperController"},
        },
        "links": {
            name: {
                "kind": "packet",
                "sample_time": STEP_NS / 1e9,
                "recording": {
                    "sent": [k * STEP_NS / 1e9 for k in range(80)],
                    "lost": [k for k, lost in enumerate(each) if lost],
                },
            }
            for name, each in missed.items()
        },
    }
    outcome, log = run_of(data, native_fmus, tmp_path, engine)
    counts = {one.subject: one for one in outcome.events if one.kind == "loss"}
    for name, each in missed.items():
        wanted, gone = [], 0
        for k, lost in enumerate(each):
            gone = gone + 1 if lost else 0
            if gone == 3:
                wanted.append((STEP_NS * k, "3 messages in a row did not arrive"))
            before = [not x for x in reversed(each[:k])]
            run = before.index(True) if True in before else len(before)
            if not lost and run >= 3:
                words = f"messages arrive again, after {run} that did not"
                wanted.append((STEP_NS * k, words))
        found = lines_of(log, name, "messages")
        assert [(time, words) for time, _, words in found] == wanted
        begun = [time for time, words in wanted if words.startswith("3")]
        assert (counts[name].count, counts[name].first_s) == (len(begun), begun[0] / 1e9)


def test_log_has_a_bounded_number_of_lines_of_a_kind(native_fmus: Path, tmp_path: Path) -> None:
    """The last one says so; all are counted, and another subject has its own lines."""
    count = MOST_LINES + 50
    often = [k % 2 == 1 for k in range(2 * count + 1)]
    once = [k == 5 for k in range(2 * count + 1)]
    outcome, log = run_of(at_limits({"force.x": often, "moment.z": once}), native_fmus, tmp_path)
    mine = lines_of(log, "c.force.x", "its limit")
    assert len(mine) == 2 * MOST_LINES
    assert sum("counted only" in message for _, _, message in mine) == 1
    assert "counted only" in mine[-2][2]
    assert len(lines_of(log, "c.moment.z", "its limit")) == 2
    times = [line.time_ns for line in log]
    assert times == sorted(times)
    first, other = (one for one in outcome.events if one.kind == "saturation")
    assert (first.count, first.total_s) == (count, count * STEP_NS / 1e9)
    assert first.words == f"c.force.x: at its limit of 10 N ({count} times, 45 s in all)"
    assert (other.count, other.words) == (1, "c.moment.z: at its limit of 10 N.m (0.1 s)")


def test_count_of_any_json_is_read() -> None:
    """What is no event is left out; what is one reads as itself."""
    found = EventCount("loss", "up", "warning", "x", 2, 0.5, 1.5)
    (written,) = RunOutcome(events=(found,)).to_json()["events"]
    others = (None, [], {}, {"kind": "loss"}, {**written, "first_s": "x"}, {**written, "kind": []})
    read = RunOutcome.from_json({"events": [*others, written]})
    assert read.events == (found,)
