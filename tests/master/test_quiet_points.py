"""Random systems with events: the kernel between them and the loop in Python agree, bit for bit."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pytest
from events import event_fmu
from mixed import mixed_fmu
from scalar import end, ns, scalar_fmu
from shared import made_once, sampled, share_of

from cosim.core import InputError
from cosim.fmu import describe_fmu
from cosim.master import (
    Component,
    Connection,
    EngineName,
    Link,
    Observer,
    Session,
    System,
    make_schedule,
)
from cosim.network import Jitter, PacketLink

TICK = 'intervalVariability="constant" intervalDecimal="0.1"'
THIRD = (
    'intervalVariability="constant" intervalDecimal="0.333" intervalCounter="1" resolution="3" '
    'shiftDecimal="0.14" shiftCounter="1"'
)
PARAMETERS = {
    "event_at": (0.013, 0.4, 1 / 3, 1e300),
    "alarm_after": (0.01, 0.3),
    "stop_early": (0.0213, 0.4, 1 / 3, 1e300),
    "limit": (2.0, 40.0),
}
KINDS: dict[str, tuple[tuple[str, ...], str]] = {
    "counter": (("u", "y", "limit", "ramp", "stop_early"), ""),
    "sampler": (("x", "sampled", "ticks", "fired"), TICK),
    "thirds": (("x", "sampled", "ticks", "y", "event_at", "ramp"), THIRD),
    "alarmed": (("u", "y", "alarm", "alarms", "alarm_after", "event_at"), ""),
    "triggered": (("trigger", "triggers", "fired"), ""),
    "echo": (("message", "echo", "x", "ramp"), ""),
}


class Log(Observer):
    """Keeps log lines, and how many rows there were."""

    def __init__(self) -> None:
        self.lines: list[Any] = []
        self.rows = 0

    def begin(self, instances: object) -> None:
        del instances

    def rows_complete(self, first: int, last: int) -> None:
        assert first == self.rows
        self.rows = last

    def log(self, time_ns: int, level: str, name: str, message: str) -> None:
        self.lines.append((time_ns, level, name, message))


def _make(folder: Path) -> None:
    scalar_fmu(folder)
    mixed_fmu(folder)
    for state in (True, False):
        for kind, (names, tick) in KINDS.items():
            made = event_fmu(folder, names, tick, state=state)
            made.rename(folder / f"{kind}-{state:d}.fmu.made")
    for made in folder.glob("*.made"):
        made.rename(made.with_suffix(""))


def random_component(r: random.Random, folder: Path, kind: str, *, state: bool) -> Component:
    """A component of a kind with parameters of its own."""
    described = describe_fmu(folder / f"{kind}-{state:d}.fmu")
    given: dict[str, Any] = {
        key: r.choice(values) for key, values in PARAMETERS.items() if key in KINDS[kind][0]
    }
    if "limit" in given:
        given["limit"] = int(given["limit"])
    if kind == "echo":
        given["message"] = r.choice([b"", b"\x00\xffab"])
    clocks = {"trigger": sorted(r.uniform(0, 0.5) for _ in range(3))}
    return Component(
        described, given, clocks=clocks if kind == "triggered" and r.random() < 0.4 else {}
    )


def random_links(r: random.Random) -> dict[str, Link]:
    """None, or a few, with delays that are known before the run."""
    return {
        name: PacketLink(
            *(name, ns(r.choice([0.02, 0.013]))), delay_ns=ns(r.choice([0, 0.03])),
            jitter=r.choice([Jitter(), Jitter("uniform", width_ns=ns(0.01))]),
            loss=r.choice([0.0, 0.2]), seed=r.randint(0, 9),
        )
        for name in ("l", "m")[: r.choice([0, 0, 1, 2])]
    }  # fmt: skip


def random_system(r: random.Random) -> System:
    """Components with events of all kinds, and without, in chains and rings, some over links."""
    folder = made_once("quiet", _make)
    step, steps = r.choice([0.001, 0.005, 0.01]), r.randint(60, 300)
    state = r.random() < 0.7
    components = {
        f"c{i}": random_component(r, folder, r.choice([*KINDS]), state=state)
        for i in range(r.randint(1, 4))
    }
    if r.random() < 0.4:
        scalar = describe_fmu(folder / "scalar-11.fmu")
        components["s"] = Component(scalar, {"a": r.uniform(-3, 0), "x0": r.uniform(-1, 1)})
    if r.random() < 0.25:
        components["m"] = Component(describe_fmu(folder / "mixed.fmu"), {})
    links, connections = random_links(r), []
    for name, component in components.items():
        for port in component.description.ports.values():
            asked = port.causality == "input" and port.name not in ("alarm", "tick")
            if not asked or port.name in component.clocks:
                continue
            kind = KIND_OF.get(port.getter_type)
            sources = [
                f"{other}.{output.name}"
                for other, one in components.items()
                for output in one.description.ports.values()
                if output.causality == "output"
                and KIND_OF.get(output.getter_type) == kind
                # no circle of outputs that follow at once
                and (not output.feedthrough or other < name)
            ]
            if kind is not None and sources and r.random() < 0.85:
                source, link = r.choice(sources), r.choice([None, *links])
                link = link if kind in ("real", "whole") else None
                connections.append(Connection(end(source), end(f"{name}.{port.name}"), link))
    schedule = make_schedule(links, ns(step), ns(step * steps), "align")
    return System(components, connections, links, {}, schedule, 1e9)


KIND_OF = {
    "Float64": "real", "Real": "real", "Int32": "whole", "Integer": "whole", "Clock": "clock",
    "Binary": "bytes",
}  # fmt: skip


def outcome(seed: int, engine: EngineName) -> Any:
    """Everything that a run gives: stopped, adjusted and taken back on the way."""
    r = random.Random(seed)  # noqa: S311 - cases, not secrets
    try:
        system, log = random_system(r), Log()
        end_ns, saved = system.comm_schedule.end_ns, None
        with Session(system, [log], engine=engine) as session:
            if r.random() < 0.3:
                session.step(r.randint(1, 9))
            for _ in range(r.randint(0, 3)):
                session.go_on(until_ns=r.randint(0, end_ns))
                if session.ended:
                    break
                target = r.choice(system.connections).target if system.connections else None
                is_number = target is not None and target.variable in "ux"
                if is_number and r.random() < 0.3:
                    session.override(*target, 3.0)
                elif is_number and r.random() < 0.5:
                    session.release(*target)
            saved = session.time_s
            session.go_on()
            run = session.result(complete=True)
        names = [(i.name, c.name) for i in run.instances for c in i.output_columns]
        names += [(i.name, c.name) for i in run.instances for c in i.input_columns]
        rows = [run.signal(*name).tobytes() for name in names]
    except InputError as error:
        return error.text()
    points = run.points_ns.tobytes(), log.rows, log.lines
    return run.status, run.reason, points, names, rows, run.statistics, saved


def check(seed: int) -> str:
    """Both engines; return how it ended."""
    kernel = outcome(seed, "kernel")
    assert kernel == outcome(seed, "python"), seed
    return str(kernel[0]) if isinstance(kernel, tuple) else "refused"


@pytest.mark.parametrize("part", sampled(range(10), 1))
def test_both_engines_agree(part: int) -> None:
    """500 random systems, 50 of them in every test run."""
    ends = [check(seed) for seed in range(50 * part, 50 * (part + 1))]
    assert ends.count("finished") > 30, ends


@pytest.mark.slow
@pytest.mark.parametrize("part", share_of(range(20)))
def test_both_engines_agree_on_ten_thousand(part: int) -> None:
    """10 000 random systems."""
    for seed in range(500 * (part + 1), 500 * (part + 2)):
        check(seed)
