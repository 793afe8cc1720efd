"""How the cost of a run grows: with FMUs, signals, links, messages, points, topics and length.

    python -m tests.benchmarks.exponents [--small] [--json]

Along each axis one quantity doubles several times and the others stay. Told apart, in CPU time of
this process, the least of several turns: setting up (reading descriptions once, wiring,
instantiating, initialising) and going through the points. An exponent is the slope of log cost over
log size by least squares, over the upper half of the sizes, where what is constant counts least: 1
is in proportion. Where a loop in C does the same, its exponent stands beside it. `--small` goes
through the least sizes alone, to see that every axis still runs.
"""

from __future__ import annotations

import math
import random
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.table import Table

from cosim.fmu import describe_fmu
from cosim.master import (
    Component,
    Connection,
    Endpoint,
    Session,
    System,
    TraceRecorder,
    make_schedule,
)
from cosim.network import Jitter, PacketLink
from cosim.trace import TraceWriter
from tests.benchmarks import wide
from tests.benchmarks._show import show
from tests.benchmarks._tiny import tiny_fmu

_MS = 1_000_000
TURNS = 5


class Axis(NamedTuple):
    """What grows along an axis.

    Attributes
    ----------
    sizes : in order.
    points : steps of a turn at a size.
    system : makes the system of a size, for a run of so many steps.
    per : what its cost is told for: of a point, or of a whole turn.
    recorded : whether its rows are written to a trace.
    bound : the same in C: goes through so many steps.
    """

    sizes: Sequence[int]
    points: Callable[[int], int]
    system: Callable[[int, int], System]
    per: str = "point"
    recorded: bool = False
    bound: Callable[[int], Callable[[int], None]] | None = None


class _Folder:
    """FMUs by number of signals, made once."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def fmu(self, signals: int) -> Path:
        path = self.folder / f"tiny{signals}.fmu"
        return path if path.exists() else tiny_fmu(signals, self.folder)

    def pairs(
        self,
        many: int,
        signals: int,
        steps: int,
        links: Mapping[str, PacketLink] | None = None,
        events: Any = "grid",
    ) -> System:
        """FMUs in a ring, each of which reads all signals of the one before; over links in turn."""
        described, names = describe_fmu(self.fmu(signals)), [*(links or {None: None})]
        connections = [
            Connection(
                Endpoint(f"c{(i - 1) % many}", f"x[{j + 1}]"),
                Endpoint(f"c{i}", f"u[{j + 1}]"),
                names[(i * signals + j) % len(names)],
            )
            for i in range(many)
            for j in range(signals)
        ]
        components = {f"c{i}": Component(described) for i in range(many)}
        schedule = make_schedule(links or {}, _MS, _MS * steps, events)
        return System(components, connections, links or {}, {}, schedule, 1e9)

    def linked(self, many: int, steps: int, every_ns: int = _MS, events: Any = "grid") -> System:
        """Two FMUs that exchange as many signals as there are links, each over one of its own."""
        links = {
            name: PacketLink(name, every_ns, delay_ns=3 * _MS, jitter=Jitter("uniform", _MS))
            for name in (f"l{i}" for i in range(many))
        }
        return self.pairs(2, many // 2, steps, links, events)

    def bare_graph(self, many: int) -> Callable[[int], None]:
        """The loop in C over so many FMUs."""
        return wide.bare_graph(self.fmu(wide.SIGNALS), many)


def axes(of: _Folder) -> dict[str, Axis]:
    """Every axis by name."""
    return {
        "FMUs": Axis(
            (10, 20, 40, 80, 160),
            lambda many: 40_000 // many,
            lambda many, steps: wide.system(of.fmu(wide.SIGNALS), many, steps),
            bound=of.bare_graph,
        ),
        "signals": Axis(
            (4, 8, 16, 32, 64, 128), lambda _: 4000, lambda n, steps: of.pairs(2, n, steps)
        ),
        "links": Axis((2, 4, 8, 16, 32), lambda _: 1000, of.linked),
        "messages": Axis(
            (1, 2, 4, 8, 16),
            lambda _: 1000,
            lambda n, steps: of.linked(2, steps, _MS // n),
            per="turn",
        ),
        "points": Axis(
            (1, 2, 4, 8, 16),
            lambda _: 1000,
            lambda n, steps: of.linked(2, steps, _MS // n, "align"),
            per="turn",
        ),
        "topics": Axis(
            (2, 4, 8, 16, 32),
            lambda _: 1000,
            lambda many, steps: of.pairs(many, 4, steps),
            recorded=True,
        ),
        "length": Axis(
            (1000, 2000, 4000, 8000, 16000),
            lambda steps: steps,
            lambda _, steps: of.pairs(2, 6, steps),
            per="turn",
        ),
    }


def timed(axis: Axis, size: int, folder: Path) -> dict[str, float]:
    """CPU seconds to set up, and microseconds for a point or a turn; those of the loop in C."""
    steps = axis.points(size)
    began = time.process_time()
    system = axis.system(size, steps * (TURNS + 1))
    path = folder / f"{size}.mcap"
    writer = TraceWriter(path, run={}) if axis.recorded else None
    observers = [] if writer is None else [TraceRecorder(writer, system)]
    with Session(system, observers, engine="kernel", keep=False) as session:
        session.go_on(until_ns=steps * _MS // 2)
        set_up = time.process_time() - began
        found = {"set_up_s": set_up, "cost_us": math.inf}
        bound = None if axis.bound is None else axis.bound(size)
        for turn in range(1, TURNS + 1):
            began = time.process_time()
            session.go_on(until_ns=(turn + 1) * steps * _MS - steps * _MS // 2)
            spent = (time.process_time() - began) * 1e6
            found["cost_us"] = min(found["cost_us"], spent / (steps if axis.per == "point" else 1))
            if bound is not None:
                began = time.process_time()
                bound(steps)
                spent = (time.process_time() - began) * 1e6 / steps
                found["c_us"] = min(found.get("c_us", math.inf), spent)
    if writer is not None:
        writer.finish({})
    return found


def exponent(rows: Mapping[int, Mapping[str, float]], name: str) -> float | None:
    """The slope of log cost over log size over the upper half of the sizes; None: no such cost."""
    sizes = [size for size, row in rows.items() if name in row]
    sizes = sizes[len(sizes) // 2 :] if len(sizes) > 3 else sizes
    if len(sizes) < 2:
        return None
    costs = [math.log(rows[size][name]) for size in sizes]
    return float(np.polyfit([math.log(size) for size in sizes], costs, 1)[0])


def main() -> None:
    """Measure, print."""
    small, found = "--small" in sys.argv, {}
    random.seed(1)
    with tempfile.TemporaryDirectory() as scratch:
        for name, axis in axes(_Folder(Path(scratch))).items():
            sizes = axis.sizes[:2] if small else axis.sizes
            rows = {size: timed(axis, size, Path(scratch)) for size in sizes}
            exponents = {cost: exponent(rows, cost) for cost in ("set_up_s", "cost_us", "c_us")}
            found[name] = {"per": axis.per, "sizes": rows, "exponents": exponents}
    view = Table(title="exponents of cost in the size", title_justify="left")
    for column in ("axis", "sizes", "cost at the greatest", "exponent", "set-up", "a loop in C"):
        view.add_column(column, justify="right")
    for name, of in found.items():
        least, greatest = min(of["sizes"]), max(of["sizes"])
        cost = f"{of['sizes'][greatest]['cost_us']:.3g} us a {of['per']}"
        words = ("-" if x is None else f"{x:.2f}" for x in (
            of["exponents"][key] for key in ("cost_us", "set_up_s", "c_us")
        ))  # fmt: skip
        view.add_row(name, f"{least} to {greatest}", cost, *words)
    show(view, {"exponents": found})


if __name__ == "__main__":
    main()
