"""The order of each way to couple, over five halvings of the step, against exact solutions.

Two scalar systems in a loop, each advanced exactly for an input held over the step: what is left
is the error of the coupling. The truth is a matrix exponential without links, the method of steps
with transport delays, and an event by event calculation with packets. Two systems have a component
in the loop whose output depends on its input at once: a gain between two transport delays, and the
two-mass oscillator with its coupling spring.

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
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.table import Table
from scipy.linalg import expm

from cosim.master import Link, System, simulate
from cosim.network import PacketLink, TransportLink
from cosim.scenario.coupling import coupling_delays
from cosim.scenario.measure import measured

if __package__ == "tests.benchmarks":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from master.masses import exact, mass_fmu, oscillator
from master.scalar import ns, scalar_fmu, scalars
from truth.dde import solve

from tests.benchmarks._show import show

A = (-1.0, -0.5)
B = (1.5, -2.0)
START = (1.0, -0.5)
STOP = 2.0
DELAY = 0.4
GAIN = -1.2
HALVINGS = tuple(0.1 / 2**i for i in range(6))
ROUND_OFF = 1e-12
"""An error below is rounding, which has no order."""
TRANSPORT = (TransportLink("there", ns(DELAY)), TransportLink("back", ns(DELAY)))
PACKETS = (
    PacketLink("there", ns(0.07), ns(0.01), ns(0.0331)),
    PacketLink("back", ns(0.05), 0, ns(0.0207)),
)


class Fmus(NamedTuple):
    """Files of the FMUs."""

    scalar: Path
    mass: Path


def orders_fmus(folder: Path) -> Fmus:
    """Make the FMUs."""
    return Fmus(scalar_fmu(folder), mass_fmu(folder))


@dataclass(frozen=True)
class Case:
    """One way to couple: the exact values at the end, the system, and these values in a run."""

    truth: Callable[[], Any]
    system: Callable[[Fmus, float], System]
    signals: tuple[tuple[str, str], ...] = (("a", "x"), ("b", "x"))


def pair(policy: str = "hold", links: tuple[Link, ...] = (), **more: Any) -> Any:
    """Two scalar systems, each reading the other's state."""
    named = [link.name for link in links] or ["", ""]
    pairs = (("a.x", "b.u", named[0], policy), ("b.x", "a.u", named[1], policy))
    given = {name: {"a": A[i], "b": B[i], "x0": START[i]} for i, name in enumerate(("a", "b"))}
    return lambda fmus, step: scalars(
        fmus.scalar, given, pairs, step=step, stop=STOP, links=links, **more
    )


def gain_between(policy: str) -> Any:
    """A scalar system whose input is its own state, times a gain, between two delays."""
    pairs = (("a.x", "b.u", "there", policy), ("b.y", "a.u", "back", policy))
    given = {
        "a": {"a": A[0], "b": B[0], "x0": START[0]},
        "b": {"b": 0.0, "c": 0.0, "e": GAIN},
    }
    return lambda fmus, step: scalars(
        fmus.scalar, given, pairs, step=step, stop=STOP, links=TRANSPORT
    )


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


def with_gain() -> Any:
    """The state at the end, fed back through the gain after both delays."""
    found = solve(
        lambda _t, x, old: [A[0] * x[0] + B[0] * GAIN * old[0][0]],
        START[:1],
        [2 * DELAY],
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


_MASSES = (("left", "x"), ("left", "v"), ("right", "x"), ("right", "v"))
CASES = {
    "jacobi, hold": Case(without_links, pair()),
    "gauss-seidel, hold": Case(without_links, pair(algorithm="gauss-seidel")),
    "jacobi, linear": Case(without_links, pair("linear")),
    "transport delay, hold": Case(with_transport, pair("hold", TRANSPORT)),
    "transport delay, midpoint": Case(with_transport, pair("midpoint", TRANSPORT)),
    "gain between delays, hold": Case(with_gain, gain_between("hold"), (("a", "x"),)),
    "gain between delays, midpoint": Case(with_gain, gain_between("midpoint"), (("a", "x"),)),
    "two masses, hold": Case(
        partial(exact, STOP), lambda f, h: oscillator(f.mass, "hold", step=h, stop=STOP), _MASSES
    ),
    "two masses, linear": Case(
        partial(exact, STOP), lambda f, h: oscillator(f.mass, "linear", step=h, stop=STOP), _MASSES
    ),
    "packets, event-aligned": Case(with_packets, pair("hold", PACKETS)),
}


def errors(fmus: Fmus, case: Case) -> list[float]:
    """Largest error of the values at the end, per step."""
    truth = case.truth()
    found = []
    for step in HALVINGS:
        run = simulate(case.system(fmus, step), engine="python")
        ends = [run.signal(*signal)[-1] for signal in case.signals]
        found.append(float(np.abs(np.array(ends) - truth).max()))
    return found


def coupling_delay(fmus: Fmus, case: Case) -> float:
    """Largest delay that the coupling adds at the longest step, as the summary of a run has it."""
    system = case.system(fmus, HALVINGS[0])
    return max(measured(simulate(system, engine="python"), coupling_delays(system)).values())


def slopes(of: list[float]) -> list[float]:
    """Order of the error from one halving to the next."""
    return [math.log2(a / b) if a > 0 and b > 0 else math.nan for a, b in itertools.pairwise(of)]


def main() -> None:
    """Measure, print."""
    table: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        fmus = orders_fmus(Path(folder))
        for name, case in CASES.items():
            found = errors(fmus, case)
            table[name] = {
                "steps": HALVINGS,
                "errors": found,
                "slopes": [
                    None if found[i + 1] < ROUND_OFF else slope
                    for i, slope in enumerate(slopes(found))
                ],
                "seconds_of_coupling": coupling_delay(fmus, case),
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
