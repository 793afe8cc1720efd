"""The order of each way to couple, over five halvings of the step, against exact solutions.

Two scalar systems in a loop, each advanced exactly for an input held over the step: what is left
is the error of the coupling. The truth is a matrix exponential without links, the method of steps
with transport delays, and an event by event calculation with packets.

`python -m tests.benchmarks.orders --json` prints {"orders": {CASE: {"steps", "errors",
"slopes", "seconds_of_coupling"}}}; slopes are null at round-off, `seconds_of_coupling` is the delay
that the coupling itself adds at the longest step, apart from the links'.
"""

from __future__ import annotations

import heapq
import itertools
import math
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table
from scipy.linalg import expm

from cosim.master import Link, simulate
from cosim.network import PacketLink, TransportLink

if __package__ == "tests.benchmarks":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from master.scalar import ns, scalar_fmu, scalars
from truth.dde import solve

from tests.benchmarks._show import show

A = (-1.0, -0.5)
B = (1.5, -2.0)
START = (1.0, -0.5)
STOP = 2.0
DELAY = 0.4
HALVINGS = tuple(0.1 / 2**i for i in range(6))
ROUND_OFF = 1e-12
"""An error below is rounding, which has no order."""
PACKETS = (
    PacketLink("there", ns(0.07), ns(0.01), ns(0.0331)),
    PacketLink("back", ns(0.05), 0, ns(0.0207)),
)


@dataclass(frozen=True)
class Case:
    """One way to couple."""

    truth: Callable[[], Any]
    policy: str = "hold"
    links: tuple[Link, ...] = ()
    more: dict[str, Any] = field(default_factory=dict)


def without_links() -> Any:
    """Both states at the end, coupled without delay."""
    return expm(STOP * np.array([[A[0], B[0]], [B[1], A[1]]])) @ START


def with_transport() -> Any:
    """Both states at the end, each reading the other one `DELAY` ago."""
    found = solve(
        lambda _t, x, old: [A[0] * x[0] + B[0] * old[0][1], A[1] * x[1] + B[1] * old[0][0]],
        START,
        [DELAY],
        STOP,
    )
    return found(STOP)


def with_packets() -> Any:
    """Both states at the end, coupled by packets: from one event to the next, exactly."""
    order = itertools.count()
    events: list[tuple[int, int, int, float | None]] = []
    for i, link in enumerate(PACKETS):
        for sent in range(link.offset_ns, ns(STOP) + 1, link.sample_time_ns):
            heapq.heappush(events, (sent, next(order), i, None))
    x, u, now = list(START), [0.0, 0.0], 0
    while events and events[0][0] <= ns(STOP):
        at, _, i, value = heapq.heappop(events)
        x, now = _advanced(x, u, (at - now) / 1e9), at
        if value is None:  # sender i sends; the other one will get it
            heapq.heappush(events, (at + PACKETS[i].delay_ns, next(order), i, x[i]))
        else:
            u[1 - i] = value
    return np.array(_advanced(x, u, (ns(STOP) - now) / 1e9))


def _advanced(x: list[float], u: list[float], h: float) -> list[float]:
    return [math.exp(a * h) * x[i] + math.expm1(a * h) / a * B[i] * u[i] for i, a in enumerate(A)]


TRANSPORT = (TransportLink("there", ns(DELAY)), TransportLink("back", ns(DELAY)))
CASES = {
    "jacobi, hold": Case(without_links),
    "gauss-seidel, hold": Case(without_links, more={"algorithm": "gauss-seidel"}),
    "jacobi, linear": Case(without_links, "linear"),
    "transport delay, hold": Case(with_transport, "hold", TRANSPORT),
    "transport delay, midpoint": Case(with_transport, "midpoint", TRANSPORT),
    "packets, event-aligned": Case(with_packets, "hold", PACKETS),
}


def errors(fmu: Path, case: Case) -> list[float]:
    """Largest error of the two states at the end, per step."""
    truth = case.truth()
    found = []
    for step in HALVINGS:
        links = [link.name for link in case.links] or ["", ""]
        pairs = (("a.x", "b.u", links[0], case.policy), ("b.x", "a.u", links[1], case.policy))
        given = {name: {"a": A[i], "b": B[i], "x0": START[i]} for i, name in enumerate(("a", "b"))}
        system = scalars(fmu, given, pairs, step=step, stop=STOP, links=case.links, **case.more)
        run = simulate(system, engine="python")
        ends = [run.signal(name, "x")[-1] for name in ("a", "b")]
        found.append(float(np.abs(np.array(ends) - truth).max()))
    return found


def slopes(of: list[float]) -> list[float]:
    """Order of the error from one halving to the next."""
    return [math.log2(a / b) if a > 0 and b > 0 else math.nan for a, b in itertools.pairwise(of)]


def main() -> None:
    """Measure, print."""
    table: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        fmu = scalar_fmu(Path(folder))
        for name, case in CASES.items():
            found = errors(fmu, case)
            table[name] = {
                "steps": HALVINGS,
                "errors": found,
                "slopes": [
                    None if found[i + 1] < ROUND_OFF else slope
                    for i, slope in enumerate(slopes(found))
                ],
                "seconds_of_coupling": 0.0 if case.more else HALVINGS[0],
            }
    view = Table(title="error at the end, and order from halving to halving", title_justify="left")
    view.add_column("coupling")
    for step in HALVINGS:
        view.add_column(f"h = {step:g}", justify="right")
    view.add_column("orders", justify="right")
    for name, row in table.items():
        orders = " ".join("-" if s is None else f"{s:.2f}" for s in row["slopes"])
        view.add_row(name, *(f"{e:.1e}" for e in row["errors"]), orders)
    show(view, {"orders": table})


if __name__ == "__main__":
    main()
