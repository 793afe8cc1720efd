"""What event mode of FMI 3 costs beside the same FMUs without it, and what an event costs.

Two FMUs in C that exchange two real numbers and an integer, 1 ms apart, nothing recorded; each may
return early from a step, so that the state of each is saved before its own. They take turns:

* steps alone: `event_mode = false`;
* event mode: no event comes;
* Clocks: both tick every 100 steps.

CPU time, the least of several turns. `python -m tests.benchmarks.events --json` prints
{"events": {"steps_us", "event_mode_us", "clocks_us", "ratio", "event_us"}}; `event_us` is what a
tick of both costs beyond the steps.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from rich.table import Table

from cosim.fmu import describe_fmu
from cosim.master import Component, Connection, Endpoint, Session, System, make_schedule
from tests.benchmarks._show import show

if __package__ == "tests.benchmarks":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "master"))
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from events import event_fmu

_MS = 1_000_000
STEPS, TURNS, EVERY = 2_000, 9, 100
VARIABLES = ("u", "y", "x", "ramp", "ticks", "sampled")


def system(fmu: Path, *, event_mode: bool) -> System:
    """Both, wired both ways."""
    described = describe_fmu(fmu)
    components = {name: Component(described, event_mode=event_mode) for name in ("a", "b")}
    wires = (("a", "y", "b", "u"), ("a", "ramp", "b", "x"), ("b", "ramp", "a", "x"))
    connections = [Connection(Endpoint(s, o), Endpoint(t, i)) for s, o, t, i in wires]
    schedule = make_schedule({}, _MS, _MS * STEPS * (TURNS + 1), "align")
    return System(components, connections, {}, {}, schedule, 1e9)


def turns(session: Session) -> Callable[[int], float]:
    """What makes the turn of a number, and returns its CPU microseconds per step."""

    def go(turn: int) -> float:
        began = time.process_time()
        session.go_on(until_ns=(turn + 1) * STEPS * _MS - _MS // 2)
        return (time.process_time() - began) / STEPS * 1e6

    return go


def main() -> None:
    """Measure, print."""
    with tempfile.TemporaryDirectory() as scratch, ExitStack() as open_sessions:
        never, often = (
            event_fmu(Path(scratch), VARIABLES, f'intervalVariability="constant" {interval}')
            for interval in ('intervalDecimal="1e6"', f'intervalDecimal="{EVERY / 1000}"')
        )
        asked = {
            "steps_us": system(never, event_mode=False),
            "event_mode_us": system(never, event_mode=True),
            "clocks_us": system(often, event_mode=True),
        }
        each = {
            name: turns(open_sessions.enter_context(Session(one, engine="kernel", keep=False)))
            for name, one in asked.items()
        }
        found = dict.fromkeys(each, float("inf"))
        for turn in range(TURNS + 1):
            for name, go in each.items():
                spent = go(turn)
                found[name] = min(found[name], spent) if turn else found[name]
    found["ratio"] = found["event_mode_us"] / found["steps_us"]
    found["event_us"] = (found["clocks_us"] - found["event_mode_us"]) * EVERY
    view = Table(title="microseconds, least of several turns", title_justify="left")
    for column in ("steps alone", "event mode", "ratio", "with Clocks", "a tick of both"):
        view.add_column(column, justify="right")
    names = ("steps_us", "event_mode_us", "ratio", "clocks_us", "event_us")
    view.add_row(*(f"{found[name]:.3g}" for name in names))
    show(view, {"events": found})


if __name__ == "__main__":
    main()
