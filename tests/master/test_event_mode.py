"""Event mode, Clocks and what comes with them, against instants and counts known beforehand."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from events import event_fmu

from cosim.core import InputError
from cosim.fmu import describe_fmu
from cosim.master import (
    Component,
    Connection,
    Endpoint,
    Run,
    Session,
    System,
    TraceRecorder,
    make_schedule,
)
from cosim.network import PacketLink
from cosim.trace import Trace, TraceWriter

PERIODIC = 'intervalVariability="constant" intervalDecimal="0.1"'
THIRDS = (
    'intervalVariability="constant" intervalDecimal="0.333" intervalCounter="1" resolution="3" '
    'shiftDecimal="0.14" shiftCounter="1"'
)


def system_of(
    components: Mapping[str, Component],
    *wires: str,
    end: float = 1.0,
    step: float = 0.25,
    links: Mapping[str, Any] | None = None,
    **options: Any,
) -> System:
    """Components with wires as `a.y b.u`, over a link as `a.y b.u link`."""
    connections = []
    for wire in wires:
        source, target, *link = wire.split()
        ends = (Endpoint(*end.split(".")) for end in (source, target))
        connections.append(Connection(*ends, link[0] if link else None))
    schedule = make_schedule(links or {}, round(step * 1e9), round(end * 1e9), "align")
    return System(components, connections, links or {}, {}, schedule, **options)


def run_of(system: System) -> Run:
    """Run to the end."""
    with Session(system) as session:
        session.run_until()
        run = session.result(complete=True)
    assert run.status == "finished", run.reason
    return run


def rows_of(run: Run, component: str, variable: str) -> list[tuple[int, float]]:
    """Instants [ns] and values of a signal, one per row."""
    return list(zip(run.points_ns.tolist(), run.signal(component, variable).tolist(), strict=True))


def instants(run: Run, component: str, clock: str) -> list[int]:
    """Instants at which a Clock ticked [ns]."""
    return [time for time, ticks in rows_of(run, component, clock) if ticks]


def test_events_of_two_components_cause_each_other_at_one_instant(tmp_path: Path) -> None:
    """One counts up the other, three super-dense instants each, until the limit is reached."""
    fmu = describe_fmu(event_fmu(tmp_path, ["u", "y", "event_at", "limit"]))
    start = {"event_at": 0.4, "limit": 104}
    system = system_of(
        {"a": Component(fmu, start), "b": Component(fmu, {"limit": 104})}, "a.y b.u", "b.y a.u"
    )
    run = run_of(system)
    assert run.engine == ("kernel", "events by Python")
    at = np.flatnonzero(run.points_ns == 400_000_000)
    a, b = run.signal("a", "y")[at].tolist(), run.signal("b", "y")[at].tolist()
    # the time event; then each change of an input takes two updates of who receives it
    assert a == [0, 100, 100, 100, 100, 102, 102, 102, 102, 104, 104, 104]
    assert b == [0, 0, 0, 101, 101, 101, 101, 103, 103, 103, 103, 103]
    others = run.points_ns[run.points_ns != 400_000_000]
    assert others.tolist() == [0, 0, 250_000_000, 500_000_000, 750_000_000, 1_000_000_000]


@pytest.mark.parametrize(
    ("tick", "first", "interval"),
    [
        (PERIODIC, Fraction(0), Fraction(1, 10)),
        (THIRDS, Fraction(1, 3), Fraction(1, 3)),
        (
            'intervalVariability="fixed" supportsFraction="true" resolution="21"',
            Fraction(1, 7),
            Fraction(1, 3),
        ),
        # this one gives its interval anew in every event, from there on: first in that of the start
        ('intervalVariability="tunable"', Fraction(1, 10), Fraction(1, 10)),
    ],
)
def test_periodic_clock_ticks_at_rational_instants(
    tmp_path: Path, tick: str, first: Fraction, interval: Fraction
) -> None:
    """At shift + k interval, rounded once to the nanosecond, whoever gives the two."""
    fmu = describe_fmu(event_fmu(tmp_path, ["ticks", "ramp"], tick))
    run = run_of(system_of({"c": Component(fmu)}, end=3.0))
    wanted = [first + k * interval for k in range(40)]
    expected = [round(t * 10**9) for t in wanted if t <= 3]
    assert instants(run, "c", "tick") == expected
    assert run.signal("c", "ticks")[-1] == len(expected)


def test_clocks_activate_the_partitions_of_scheduled_execution(tmp_path: Path) -> None:
    """Each at its tick, those of one instant by priority; what they read is of that instant."""
    names = ["ticks", "x", "sampled", "trigger", "triggers"]
    fmu = describe_fmu(event_fmu(tmp_path, names, f'{THIRDS} priority="1"', scheduled=True))
    ramp = describe_fmu(event_fmu(tmp_path, ["ramp"]))
    component = Component(fmu, clocks={"trigger": [0.25, 0.5]})
    run = run_of(system_of({"s": component, "r": Component(ramp)}, "r.ramp s.x"))
    assert instants(run, "s", "tick") == [333_333_333, 666_666_667, 1_000_000_000]
    np.testing.assert_allclose(run.signal("s", "sampled")[-1], 1.0, atol=1e-9)
    at = np.flatnonzero(run.points_ns == 333_333_333)
    np.testing.assert_allclose(run.signal("s", "sampled")[at], [0.0, 1 / 3, 1 / 3], atol=1e-9)
    assert (run.signal("s", "ticks")[-1], run.signal("s", "triggers")[-1]) == (3.0, 2.0)
    with pytest.raises(InputError, match="nothing but what its Clocks activate"):
        Component(fmu, event_mode=False)


def test_clock_has_the_interval_of_its_type(tmp_path: Path) -> None:
    """Where it has none of its own."""
    types = '<ClockType name="Slow" intervalVariability="constant" intervalDecimal="0.4"/>'
    tick = 'declaredType="Slow" intervalVariability="constant"'
    fmu = describe_fmu(event_fmu(tmp_path, ["ticks"], tick, types=types))
    run = run_of(system_of({"c": Component(fmu)}))
    assert instants(run, "c", "tick") == [0, 400_000_000, 800_000_000]


def test_interval_that_the_scenario_gives(tmp_path: Path) -> None:
    """A fixed Clock gets it in the initialisation and ticks by it."""
    tick = 'intervalVariability="fixed" intervalDecimal="0.1"'
    fmu = describe_fmu(event_fmu(tmp_path, ["ticks"], tick))
    run = run_of(system_of({"c": Component(fmu, clocks={"tick": Fraction(2, 7)})}, end=2.0))
    assert instants(run, "c", "tick") == [round(k * 2 / 7 * 1e9) for k in range(8)]


def test_changing_clock_doubles_its_interval(tmp_path: Path) -> None:
    """0.1, then 0.2, 0.4, 0.8 after each tick."""
    fmu = describe_fmu(
        event_fmu(tmp_path, ["ticks", "growth", "interval"], 'intervalVariability="changing"')
    )
    run = run_of(system_of({"c": Component(fmu, {"growth": 2.0})}, end=2.0))
    assert instants(run, "c", "tick") == [100_000_000, 300_000_000, 700_000_000, 1_500_000_000]


def test_countdown_begins_with_an_event(tmp_path: Path) -> None:
    """0.3 after the input changed, which a time event of another component does at 0.4."""
    fmu = describe_fmu(event_fmu(tmp_path, ["u", "y", "alarm", "alarms", "alarm_after"]))
    cause = describe_fmu(event_fmu(tmp_path, ["y", "event_at"]))
    system = system_of(
        {
            "cause": Component(cause, {"event_at": 0.4}),
            "c": Component(fmu, {"alarm_after": 0.3}),
        },
        "cause.y c.u",
    )
    run = run_of(system)
    assert instants(run, "c", "alarm") == [700_000_000]
    assert run.signal("c", "alarms")[-1] == 1


def test_ticks_pass_along_a_chain_within_one_instant(tmp_path: Path) -> None:
    """Every second tick of the first fires the second, which fires the third, at the same row."""
    first = describe_fmu(event_fmu(tmp_path, ["ticks", "fired"], PERIODIC))
    chained = describe_fmu(event_fmu(tmp_path, ["trigger", "triggers", "fired"]))
    for order in (("a", "b", "c"), ("c", "b", "a")):  # named in any order
        described = {"a": first, "b": chained, "c": chained}
        components = {name: Component(described[name]) for name in order}
        run = run_of(system_of(components, "a.fired b.trigger", "b.fired c.trigger"))
        fired = instants(run, "a", "fired")
        assert fired == [round(k * 0.1 * 1e9) for k in range(1, 11, 2)]
        assert instants(run, "b", "trigger") == instants(run, "c", "trigger") == fired
        rows = np.flatnonzero(run.signal("a", "fired"))
        assert (run.signal("c", "triggers")[rows] == np.arange(1, 6)).all()
        assert (run.signal("c", "triggers")[rows - 1] == np.arange(5)).all()


@pytest.mark.parametrize("clock", ["tick", "alarm"])
def test_a_triggered_clock_follows_one_that_the_master_lets_tick(
    tmp_path: Path, clock: str
) -> None:
    """A periodic or a countdown Clock is a source, named before or behind the one that follows."""
    periodic = PERIODIC if clock == "tick" else ""
    first = describe_fmu(event_fmu(tmp_path, ["alarm", "alarm_after", "u"], periodic))
    cause = describe_fmu(event_fmu(tmp_path, ["y", "event_at"]))
    follower = describe_fmu(event_fmu(tmp_path, ["trigger", "triggers", "z"]))
    ramp = describe_fmu(event_fmu(tmp_path, ["ramp"]))
    for order in ("acfr", "frca"):
        described = {"a": first, "c": cause, "f": follower, "r": ramp}
        start = {"a": {"alarm_after": 0.125}, "c": {"event_at": 0.3}}
        components = {n: Component(described[n], start.get(n, {})) for n in order}
        run = run_of(system_of(components, "c.y a.u", f"a.{clock} f.trigger", "r.ramp f.z"))
        ticked = instants(run, "a", clock)
        wanted = [round(k * 0.1 * 1e9) for k in range(11)] if clock == "tick" else [425_000_000]
        assert ticked == instants(run, "f", "trigger") == wanted
        assert run.signal("f", "triggers")[-1] == len(wanted)


def test_an_array_of_one_element_meets_a_scalar(tmp_path: Path) -> None:
    """Either way; of two elements it does not."""
    fmu = describe_fmu(event_fmu(tmp_path, ["x", "ramp", "n", "row", "doubled"]))
    parts = {"a": Component(fmu, {"n": 1}), "b": Component(fmu, {"n": 1})}
    run = run_of(system_of(parts, "a.ramp b.row", "b.doubled a.x"))
    assert (run.signal("b", "row[1]") == run.signal("a", "ramp")).all()
    assert (run.signal("a", "x") == 2 * run.signal("a", "ramp")).all()
    with pytest.raises(InputError, match="differ in shape"):
        system_of({"a": Component(fmu), "b": Component(fmu)}, "a.ramp b.row")


def test_ticks_given_by_the_scenario(tmp_path: Path) -> None:
    """A triggered Clock that nothing is connected to ticks at the instants given for it."""
    fmu = describe_fmu(event_fmu(tmp_path, ["trigger", "triggers", "fired"]))
    run = run_of(system_of({"c": Component(fmu, clocks={"trigger": [0.0, 0.3, 1.0]})}))
    assert instants(run, "c", "trigger") == [0, 300_000_000, 1_000_000_000]
    assert run.signal("c", "triggers")[-1] == 3


def test_clocked_partition_samples_its_input_at_the_tick(tmp_path: Path) -> None:
    """It reads the sender's value of the instant of the tick, not of the last planned point."""
    sampler = describe_fmu(event_fmu(tmp_path, ["ticks", "x", "sampled"], PERIODIC))
    ramp = describe_fmu(event_fmu(tmp_path, ["ramp"]))
    system = system_of({"s": Component(sampler), "r": Component(ramp)}, "r.ramp s.x")
    run = run_of(system)
    ticking = run.signal("s", "tick") == 1.0
    assert ticking.sum() == 11
    np.testing.assert_allclose(
        run.signal("s", "sampled")[ticking], run.points_ns[ticking] / 1e9, atol=1e-12
    )


def test_early_return_is_a_point_of_all(tmp_path: Path) -> None:
    """The first to return early makes the point; the other, who had gone on, is taken back."""
    fmu = describe_fmu(event_fmu(tmp_path, ["y", "ramp", "stop_early"]))
    third = 1 / 3
    system = system_of(
        {
            "late": Component(fmu, {"stop_early": 0.4}),
            "soon": Component(fmu, {"stop_early": third}),
            "none": Component(fmu),
        }
    )
    run = run_of(system)
    early = [0, 0, 250_000_000, 333_333_333, 333_333_333, 400_000_000, 400_000_000]
    assert run.points_ns.tolist() == [*early, 500_000_000, 750_000_000, 1_000_000_000]
    assert run.signal("soon", "ramp")[3] == run.signal("none", "ramp")[3] == third
    assert run.signal("soon", "y").tolist() == [0.0] * 4 + [1000.0] * 6
    assert run.signal("late", "y").tolist() == [0.0] * 6 + [1000.0] * 4


def test_slave_without_states_returns_early_only_alone(tmp_path: Path) -> None:
    """Beside another one with events its own are handled at the end of its step."""
    fmu = describe_fmu(event_fmu(tmp_path, ["y", "stop_early"], state=False))
    one = Component(fmu, {"stop_early": 0.3})
    assert 300_000_000 in run_of(system_of({"one": one})).points_ns
    run = run_of(system_of({"one": one, "two": Component(fmu)}))
    assert 300_000_000 not in run.points_ns
    assert next(t for t, y in rows_of(run, "one", "y") if y) == 500_000_000


def test_binary_passes_and_arrays_have_the_given_size(tmp_path: Path) -> None:
    """Bytes of any length, zero included; an array as long as a structural parameter says."""
    fmu = describe_fmu(event_fmu(tmp_path, ["message", "echo", "n", "row", "doubled"]))
    first = Component(fmu, {"message": b"\x00\xffabc", "n": 4, "row": [1.0, 2.0, 3.0, 4.0]})
    system = system_of(
        {"a": first, "b": Component(fmu, {"n": 4})}, "a.echo b.message", "a.doubled b.row"
    )
    with Session(system) as session:
        session.run_until()
        assert session.read("b", "echo") == b"\x00\xffabc"
        assert session.value("a", "echo") == "636261ff00"
        run = session.result(complete=True)
    assert [run.signal("b", f"doubled[{i}]")[-1] for i in range(1, 5)] == [4.0, 8.0, 12.0, 16.0]


def test_array_that_is_too_long_is_refused_before_it_is_made(tmp_path: Path) -> None:
    """By the parameter, and by the start value in the model description."""
    path = event_fmu(tmp_path, ["n", "row", "doubled"])
    with pytest.raises(InputError, match="row has 1099511627776 elements"):
        Component(describe_fmu(path), {"n": 2**40})
    long = tmp_path / "long.fmu"
    with zipfile.ZipFile(path) as archive, zipfile.ZipFile(long, "w") as made:
        for name in archive.namelist():
            text = archive.read(name).replace(b'start="2"', b'start="%d"' % 2**40)
            made.writestr(name, text)
    with pytest.raises(InputError, match="row has 1099511627776 elements"):
        describe_fmu(long)


def test_links_send_what_events_left(tmp_path: Path) -> None:
    """A message of the instant of an event carries what it left; a late signal jumps as sent."""
    cause = describe_fmu(event_fmu(tmp_path, ["y", "event_at"]))
    effect = describe_fmu(event_fmu(tmp_path, ["u", "y", "limit"]))
    link = PacketLink("link", sample_time_ns=100_000_000, delay_ns=50_000_000)
    system = system_of(
        {"cause": Component(cause, {"event_at": 0.4}), "effect": Component(effect, {"limit": 999})},
        "cause.y effect.u link",
        links={"link": link},
    )
    run = run_of(system)
    received = [t for t, u in rows_of(run, "effect", "u") if u == 100.0]
    assert received[0] == 450_000_000
    assert next(t for t, y in rows_of(run, "effect", "y") if y == 101.0) == 450_000_000


@pytest.mark.parametrize("options", [{}, {"event_mode": False}, {"isolate": True}])
def test_outputs_are_read_within_steps(tmp_path: Path, options: dict[str, Any]) -> None:
    """At the quarters of each step, but for the second, which is of a step that is not finished."""
    fmu = describe_fmu(event_fmu(tmp_path, ["ramp", "stop_early"]))
    component = Component(fmu, {"stop_early": 0.3}, intermediate=["ramp"], **options)
    system = system_of({"c": component, "other": Component(fmu, {"stop_early": 0.35}, **options)})
    path = tmp_path / "within.mcap"
    with TraceWriter(path, run={}) as writer:
        with Session(system, [TraceRecorder(writer, system)]) as session:
            session.run_until()
            assert session.result(complete=True).status == "finished"
        writer.finish({"status": "finished"})
    table = Trace(path).read("/c/intermediate")
    ends = [0.0, 0.25, 0.3, 0.35, 0.5, 0.75, 1.0]
    if options.get("event_mode") is False:
        ends = [0.0, 0.25, 0.5, 0.75, 1.0]
    wanted = [a + share * (b - a) for a, b in pairwise(ends) for share in (0.25, 0.75, 1.0)]
    np.testing.assert_allclose(table["ramp"], wanted, atol=1e-12)
    assert table.log_time_ns.tolist() == [round(t * 1e9) for t in table["ramp"].tolist()]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"algorithm": "gauss-seidel"}, "the algorithm jacobi"),
        ({"threads": 2}, "run.threads"),
    ],
)
def test_what_events_do_not_go_together_with_is_refused(
    tmp_path: Path, options: dict[str, Any], message: str
) -> None:
    """By name, with the way out; steps alone are possible."""
    fmu = describe_fmu(event_fmu(tmp_path, ["y"]))
    with pytest.raises(InputError, match="events of component 'c'") as caught:
        system_of({"c": Component(fmu)}, **options)
    assert message in str(caught.value)
    assert "event_mode = false" in str(caught.value)
    system_of({"c": Component(fmu, event_mode=False)}, **options)


def test_run_without_event_mode_takes_the_kernel(tmp_path: Path) -> None:
    """The same FMU by steps alone, without its Clocks."""
    fmu = describe_fmu(event_fmu(tmp_path, ["ramp", "fired", "ticks"], PERIODIC))
    run = run_of(system_of({"c": Component(fmu, event_mode=False)}))
    assert run.points_ns.size == 5
    assert [c.name for c in run.instances[0].output_columns] == ["ramp", "ticks"]
