"""Where a predicate must flip: at the proved value, and a nanosecond below and above it.

What is flown is measured here from the rows: the age of u = K x(s) by the row s whose state gives
the command in force, and the age of a measurement by its stamp. So an edge is where it is said to
be, whatever the code under test takes an age for.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from falsifier.cells import BROKEN, FALSE, GOOD, REFUSED, Cell
from falsifier.draft import Draft
from falsifier.flight import Field, Flight
from falsifier.kinds import LOOPS
from falsifier.loop import MS, packet, transport
from falsifier.parts import DESIGNS

from cosim import Trace

NS = 1e-9


@dataclass(frozen=True)
class Edge:
    """One bound, approached in steps of a nanosecond.

    Attributes
    ----------
    kind, name : the loop, and what its bound is about.
    apply : sets a draft up with so many nanoseconds beyond the bound.
    claimed : which of them may be claimed.
    measured : what the rows show [ns]; None: the number is a parameter.
    proved_ns : the bound.
    """

    kind: str
    name: str
    apply: Callable[[Draft, int], None]
    claimed: tuple[int, ...]
    measured: Callable[[Trace], int] | None = None
    proved_ns: int = 0


def oldest_feedback(design: str) -> Callable[[Trace], int]:
    """Greatest age of the state behind the command in force, of a design for u = K x(t - age)."""
    return lambda trace: max(_feedback_ages(trace, design)[1])


def youngest_feedback(design: str) -> Callable[[Trace], int]:
    """Least age of the state behind the command in force."""
    return lambda trace: min(_feedback_ages(trace, design)[0])


def _feedback_ages(trace: Trace, design: str) -> tuple[list[int], list[int]]:
    """Ages at the beginning and at the end of every step [ns], of commands that were measured."""
    gain = json.loads((DESIGNS / f"{design}.json").read_text("utf-8"))["K"][0]
    states = [trace.signal(f"plant.x[{j}]") for j in (1, 2)]
    times = states[0].delivered_ns
    terms = np.array([k * x.values.astype(float) for k, x in zip(gain, states, strict=True)])
    would, scale = terms.sum(axis=0), np.abs(terms).sum(axis=0)
    begins, ends = [], []
    command = trace.signal("plant.u[1]").values.astype(float)
    for k in range(len(times) - 1):
        if abs(command[k]) < 1e-4:
            continue
        same = np.abs(would[: k + 1] - command[k]) <= 1e-13 * scale[: k + 1]
        rows = np.flatnonzero(same)
        if rows.size and rows[-1] > 0:
            sent = int(times[rows[-1]])
            begins.append(int(times[k]) - sent)
            ends.append(int(times[k + 1]) - sent)
    return begins, ends


def oldest_stamp(name: str) -> Callable[[Trace], int]:
    """Greatest age of a measurement in use, by its stamp."""

    def measured(trace: Trace) -> int:
        series = trace.signal(f"controller.stamp.{name}")
        stamps = np.rint(series.values.astype(float) * 1e9).astype(np.int64)
        times = series.delivered_ns
        known = stamps[:-1] > 0
        return int((times[1:] - stamps[:-1])[known].max())

    return measured


def _rhythm(d: Draft, step: float, delay: float, offset: float) -> None:
    """Messages and steps of one rhythm, sent `offset` after a step: its nanoseconds are the age's.

    A message acts from the next step after its arrival on, for a step; so the age is a sum of
    steps less the offset.
    """
    d.data["run"]["step"] = step
    d.links["up"] = packet(delay, step) | {"offset": offset}


def _old(d: Draft, beyond: int) -> None:
    _rhythm(d, 0.04, 0.25, 0.02 - beyond * NS)  # 0.28 + 0.04 - 0.02 s


def _young(d: Draft, beyond: int) -> None:
    _rhythm(d, 0.06, 0.38, 0.02 + beyond * NS)  # 0.42 - 0.02 s


def _late_stamp(name: str, proved_ms: int) -> Callable[[Draft, int], None]:
    def apply(d: Draft, beyond: int) -> None:
        d.parameters(name)["sample_time"] = 0.01
        d.links[name] = packet((proved_ms - 20) / 1e3 + beyond * NS, 0.01)

    return apply


def _transported(d: Draft, beyond: int) -> None:
    proved = d.loop.ages[0].greatest_ns
    d.links["up"] = transport((proved - 20 * MS + beyond) / 1e9)


def _plant_delay(seconds: float) -> Callable[[Draft, int], None]:
    def apply(d: Draft, beyond: int) -> None:
        d.parameters("plant")["delay.d"] = seconds + beyond * NS

    return apply


EDGES: tuple[Edge, ...] = (
    *(
        Edge(kind, "greatest age", _old, (-1, 0), oldest_feedback(design), 300 * MS)
        for kind, design in (("any", "any"), ("packed", "any"), ("uncertain", "uncertain"))
    ),
    Edge("least", "least age", _young, (-1, 0), youngest_feedback("least"), 400 * MS),
    *(
        Edge(kind, "greatest age over a transport link", _transported, (-1, 0))
        for kind in ("any", "limited", "exact", "upto", "structured", "integral", "least")
    ),
    Edge("one", "age", _late_stamp("position", 200), (-1, 0), oldest_stamp("position"), 200 * MS),
    Edge("two", "age", _late_stamp("position", 200), (-1, 0), oldest_stamp("position"), 200 * MS),
    Edge("two", "other age", _late_stamp("speed", 100), (-1, 0), oldest_stamp("speed"), 100 * MS),
    Edge("exact", "plant delay", _plant_delay(1.0), (0,)),
    Edge("inner", "plant delay", _plant_delay(1.0), (0,)),
    Edge("upto", "plant delay", _plant_delay(1.0), (-1, 0)),
    Edge("station", "plant delay", _plant_delay(0.5), (-1, 0)),
)
"""Bounds of every kind; where ages are measured the rows show how far beyond a bound a run is."""


def edge_cell(field: Field, edge: Edge) -> Cell:
    """Fly an edge at the bound, and a nanosecond to each side of it."""
    loop = next(x for x in LOOPS if x.name == edge.kind)
    verdict, runs, notes = GOOD, [], []
    for beyond in (-1, 0, 1):
        draft = Draft(loop, loop.scenario)
        edge.apply(draft, beyond)
        flight = field.fly(loop, draft.data)
        runs.append(flight)
        _is_where_it_says(field, edge, flight, beyond)
        allowed = beyond in edge.claimed
        if flight.claimed and not allowed:
            verdict = FALSE if flight.wrong else BROKEN
            notes.append(f"claimed at {beyond:+d} ns")
        elif not flight.claimed and allowed:
            verdict = REFUSED if verdict == GOOD else verdict
            notes.append(f"not claimed at {beyond:+d} ns")
    name = edge.name + (f" ({', '.join(notes)})" if notes else "")
    return Cell(edge.kind, "edges", name, verdict, tuple(runs))


def _is_where_it_says(field: Field, edge: Edge, flight: Flight, beyond: int) -> None:
    if edge.measured is None or flight.refused is not None or flight.broke is not None:
        return
    found = edge.measured(Trace(field.trace))
    sense = -1 if edge.name == "least age" else 1
    if found != edge.proved_ns + sense * beyond:
        raise AssertionError(
            f"{edge.kind}, {edge.name}: flown at {found} ns, wanted {beyond:+d} ns"
        )
