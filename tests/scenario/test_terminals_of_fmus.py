"""Connections of terminals: which variables they join, by the rule that both name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from master.events import event_fmu
from shared import fmu_store

from cosim.core import InputError
from cosim.master import Connection, Session, System
from cosim.scenario import FmuCache, assembled_system, load, parse, prepare

TRANSCEIVER = "org.fmi-ls-bus.transceiver"
PERIODIC = 'intervalVariability="constant" intervalDecimal="0.1"'


def terminals(rule: str, *listed: str, kind: str = "", name: str = "port") -> str:
    """A file with one terminal; `listed` : MEMBER=VARIABLE."""
    members = "".join(
        f'<TerminalMemberVariable variableKind="signal" memberName="{member}" '
        f'variableName="{variable}"/>'
        for member, variable in (one.split("=") for one in listed)
    )
    of_kind = f' terminalKind="{kind}"' if kind else ""
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<fmiTerminalsAndIcons fmiVersion="3.0"><Terminals>'
        f'<Terminal name="{name}" matchingRule="{rule}"{of_kind}>{members}</Terminal>'
        "</Terminals></fmiTerminalsAndIcons>\n"
    )


def system_of(folder: Path, *wires: str) -> System:
    """The components `a` and `b`, of the FMUs e0 and e1 in the folder."""
    listed = ", ".join(f'"{wire}"' for wire in wires)
    text = (
        f'title = "t"\nconnect = [{listed}]\n[run]\nend = 1.0\nstep = 0.25\n'
        '[components.a]\nfmu = "e0.fmu"\n[components.b]\nfmu = "e1.fmu"\n'
    )
    loaded = parse(text, name="t", where="t.toml", folder=folder)
    return assembled_system(prepare(loaded, FmuCache(folder, folder)))[0]


def joined(connections: list[Connection]) -> list[str]:
    return sorted(f"{one.source} -> {one.target}" for one in connections)


@pytest.mark.parametrize("wire", ["a.port -> b.port", "b.port -> a.port"])
def test_what_one_transceiver_sends_the_other_one_receives(tmp_path: Path, wire: str) -> None:
    """Named either way round; a Clock that the master lets tick is sent."""
    sending = terminals(TRANSCEIVER, "Tx_Clock=tick", "Tx_Data=ticks", "Rx_Data=u")
    event_fmu(tmp_path, ["ticks", "u"], PERIODIC, terminals=sending)
    receiving = terminals(TRANSCEIVER, "Rx_Clock=trigger", "Rx_Data=u", "Tx_Data=y")
    event_fmu(tmp_path, ["trigger", "triggers", "u", "y"], terminals=receiving)
    system = system_of(tmp_path, wire)
    assert joined(system.connections) == [
        "a.tick -> b.trigger", "a.ticks -> b.u", "b.y -> a.u",
    ]  # fmt: skip
    with Session(system) as session:
        session.run_until()
        run = session.result(complete=True)
    assert (run.signal("a", "tick") == run.signal("b", "trigger")).all()
    assert run.signal("b", "triggers")[-1] == 11
    assert np.array_equal(run.signal("b", "u"), run.signal("a", "ticks"))


def test_a_plug_joins_members_of_one_name_both_ways(tmp_path: Path) -> None:
    """The names of the variables are others; a parameter is none that is connected."""
    for members in (("flow=y", "level=u"), ("flow=u", "level=y")):
        of_plug = terminals("plug", *members, "most=limit")
        event_fmu(tmp_path, ["u", "y", "limit"], terminals=of_plug)
    assert joined(system_of(tmp_path, "a.port -> b.port").connections) == [
        "a.y -> b.u", "b.y -> a.u",
    ]  # fmt: skip


def test_a_bus_joins_what_both_have_and_a_sequence_goes_by_place(tmp_path: Path) -> None:
    event_fmu(tmp_path, ["y", "ramp"], terminals=terminals("bus", "n=y", "t=ramp"))
    event_fmu(tmp_path, ["u", "x"], terminals=terminals("bus", "t=x", "free=u"))
    assert joined(system_of(tmp_path, "a.port -> b.port").connections) == ["a.ramp -> b.x"]
    for file in tmp_path.glob("*.fmu"):
        file.unlink()
    event_fmu(tmp_path, ["y", "ramp"], terminals=terminals("sequence", "n=y", "t=ramp"))
    event_fmu(tmp_path, ["u", "x"], terminals=terminals("sequence", "k=u", "z=x"))
    found = joined(system_of(tmp_path, "a.port -> b.port").connections)
    assert found == ["a.ramp -> b.x", "a.y -> b.u"]


def test_a_terminal_inside_another_one_is_named_with_it(tmp_path: Path) -> None:
    """And its members count among those of the outer one."""
    inner = (
        terminals("plug", "t=ramp", name="inner").split("<Terminals>")[1].split("</Terminals")[0]
    )
    outer = terminals("plug", "n=y").replace("</Terminal>", f"{inner}</Terminal>")
    event_fmu(tmp_path, ["y", "ramp"], terminals=outer)
    event_fmu(tmp_path, ["u", "x"], terminals=outer.replace('="y"', '="u"').replace("ramp", "x"))
    both = joined(system_of(tmp_path, "a.port -> b.port").connections)
    assert both == ["a.ramp -> b.x", "a.y -> b.u"]
    one = joined(system_of(tmp_path, "a.port.inner -> b.port.inner").connections)
    assert one == ["a.ramp -> b.x"]


@pytest.mark.parametrize(
    ("first", "second", "message"),
    [
        (terminals("plug", "v=y"), terminals("bus", "v=u"), "of different kinds"),
        (
            terminals("plug", "v=y", kind="a"),
            terminals("plug", "v=u", kind="b"),
            "of different kind",
        ),
        (terminals("own.rule", "v=y"), terminals("own.rule", "v=u"), "by this rule"),
        (terminals("plug", "v=y", "w=ramp"), terminals("plug", "v=u"), "not have the same members"),
        (terminals("sequence", "v=y", "w=ramp"), terminals("sequence", "v=u"), "the same members"),
        (terminals(TRANSCEIVER, "Tx_D=y"), terminals(TRANSCEIVER, "Tx_D=u"), "the same members"),
        (terminals("plug", "v=y"), terminals("plug", "v=y"), "cannot be connected"),
        (terminals("plug", "v=y"), terminals("plug", "v=gone"), "no variable"),
    ],
)
def test_terminals_that_do_not_meet_are_refused(
    tmp_path: Path, first: str, second: str, message: str
) -> None:
    """With the place in the scenario and what the two have."""
    event_fmu(tmp_path, ["y", "ramp"], terminals=first)
    event_fmu(tmp_path, ["u", "y"], terminals=second)
    with pytest.raises(InputError, match=message) as caught:
        system_of(tmp_path, "a.port -> b.port")
    assert "connect[0]" in str(caught.value)


def test_a_file_of_terminals_that_is_no_xml_keeps_nothing_from_running(tmp_path: Path) -> None:
    """It is named as a break of the standard, and there are no terminals."""
    event_fmu(tmp_path, ["y"], terminals="<fmiTerminalsAndIcons")
    event_fmu(tmp_path, ["u"])
    system = system_of(tmp_path, "a.y -> b.u")
    (departure,) = system.components["a"].description.departures
    assert departure.startswith("terminalsAndIcons/terminalsAndIcons.xml")
    with pytest.raises(InputError, match="no output 'port'"):
        system_of(tmp_path, "a.port -> b.u")


def test_groups_of_our_own_fmus_are_joined_as_groups(tmp_path: Path) -> None:
    """Their terminals join the same variables, or are named otherwise."""
    loaded = load("station-keeping")
    system = assembled_system(prepare(loaded, FmuCache(fmu_store(), tmp_path)))[0]
    found = joined(system.connections)
    assert "sea.disturbance.u -> plant.disturbance.u" in found
    assert [one for one in found if one.split(" -> ")[0].startswith("plant")] == [
        f"plant.{one} -> controller.{one}"
        for one in ("eta.psi", "eta.x", "eta.y", "eta.z", "nu.r", "nu.u", "nu.v", "nu.w")
    ]
