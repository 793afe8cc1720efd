"""Runs whose links share a medium: fixed nodes, nodes that move, both engines, snapshots."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scalar import end, ns, scalar_fmu, scalars

from cosim.core import InputError
from cosim.master import EngineName, PositionSource, Run, Session, Snapshot, System, simulate
from cosim.network import REASONS, Hop, Medium, Node, PacketLink

PAIR = {"a": {"a": -1.0, "b": 1.5, "x0": 1.0}, "b": {"a": -0.5, "b": -2.0, "x0": 0.8}}
STOP = 3.0
MOVING = (Node("a", (None, 0.0)), Node("b", (0.3, None)), Node("base", (0.0, 0.0)))
FIXED = (Node("a", (1.0, 0.0)), Node("b", (0.3, 0.8)), Node("base", (0.0, 0.0)))
CSMA = {"access": "csma", "backoff_ns": ns(0.03)}


@pytest.fixture(scope="module")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return scalar_fmu(tmp_path_factory.mktemp("scalar"))


def shared(fmu: Path, nodes: tuple[Node, ...] = MOVING, **more: Any) -> System:
    """a tells b and b tells a over one medium; a third link disturbs. Places are their states."""
    medium = Medium("bay", nodes, 1000, **{"speed": 20.0, **more.pop("medium", {})})
    links = [
        PacketLink(name, ns(every), 0, frame_size=size, hop=Hop(medium, *way), on_loss=0.5)
        for name, every, size, way in (
            ("there", 0.11, 20, ("a", "b")),
            ("back", 0.13, 20, ("b", "a")),
            ("noise", 0.17, 9, ("base", "a")),
        )
    ]
    moves = {"medium.bay": PositionSource((end("a.x"), end("b.x")))} if medium.moves else {}
    given: dict[str, Any] = {"step": 0.1, "stop": STOP, "links": links, "delays": moves}
    pairs = (("a.x", "b.u", "there"), ("b.x", "a.u", "back"))
    return scalars(fmu, PAIR, pairs, **given | more)


def rows(run: Run) -> list[bytes]:
    return [run.signal(c, v).tobytes() for c in ("a", "b") for v in ("x", "u")]


def check_ways(run: Run) -> int:
    """Each packet took the range at the point at which it began; return how many there were."""
    count = 0
    for name, one, other in (("there", "a", "b"), ("back", "b", "a")):
        d = run.deliveries[name]
        arrived = d.arrivals().arrival_ns
        assert np.isin(arrived, run.points_ns).all()
        a, b = (run.signal(c, "x") for c in ("a", "b"))
        travel = 1e9 * np.sqrt((a - 0.3) ** 2 + (0.0 - b) ** 2) / 20.0
        for at in arrived.tolist():  # it began at a point, from which its way is as long as that
            way = at - d.link.frame_ns - run.points_ns
            assert np.abs(way - travel).min() < 0.51, (one, other)
        count += arrived.size
    return count


@pytest.mark.parametrize("medium", [{}, CSMA, {"access": "tdma", "slot_ns": ns(0.07)}])
def test_range_at_the_beginning_of_each_packet_decides_its_way(
    fmu: Path, medium: dict[str, Any]
) -> None:
    """With queues, waiting and slots packets begin between sendings, which become points."""
    slots = {"slots": ("a", "b", "base")} if "slot_ns" in medium else {}
    systems = [shared(fmu, medium=medium | slots) for _ in range(2)]
    runs = [
        simulate(system, engine=engine) for system, engine in zip(systems, ENGINES, strict=True)
    ]
    assert rows(runs[0]) == rows(runs[1])
    assert check_ways(runs[0]) > 20
    fates = {REASONS[k] for d in runs[0].deliveries.values() for k in d.arrivals().status.tolist()}
    assert "delivered" in fates


ENGINES: tuple[EngineName, EngineName] = ("python", "kernel")


@pytest.mark.parametrize("nodes", [MOVING, FIXED])
def test_on_a_grid_messages_wait_for_points(fmu: Path, nodes: tuple[Node, ...]) -> None:
    """Sent and delivered at points; on the way in between the packets are as they are."""
    runs = [simulate(shared(fmu, nodes, step=0.01, events="grid"), engine=e) for e in ENGINES]
    assert rows(runs[0]) == rows(runs[1])
    assert runs[0].points_ns.size == 301
    for d in runs[0].deliveries.values():
        arrived, sent, _, _ = d.arrivals()
        assert arrived.size > 10
        assert (arrived % ns(0.01) == 0).all()
        assert (sent % ns(0.01) == 0).all()


def test_nodes_that_do_not_move_deliver_as_is_known_before_the_run(fmu: Path) -> None:
    """Fixed nodes: the points are known before, and what is computed in the run is the same."""
    system = shared(fmu, FIXED, medium=CSMA)
    run = simulate(system)
    assert system.comm_schedule.points_ns.tolist() == run.points_ns.tolist()
    for name, d in system.comm_schedule.begin().items():
        d.advance(run.end_ns)
        assert repr(d.arrivals()) == repr(run.deliveries[name].arrivals())
        assert d.statistics(run.end_ns) == run.statistics[name]


@pytest.mark.parametrize("nodes", [MOVING, FIXED])
def test_restore_and_continue(fmu: Path, tmp_path: Path, nodes: tuple[Node, ...]) -> None:
    """From a snapshot, also a portable one in a file, the run goes on to the same rows."""
    with Session(shared(fmu, nodes, medium=CSMA)) as session:
        session.run_until(0.75)
        before = session.snapshot()
        session.snapshot(portable=True).save(tmp_path / "s.npz")
        session.run_until()
        whole = rows(session.result())
        session.restore(before)
        session.override("a", "x", 3.0)
        session.run_until()
        assert rows(session.result()) != whole
        session.restore(before)
        session.run_until()
        assert rows(session.result()) == whole
    with Session(shared(fmu, nodes, medium=CSMA)) as session:
        session.restore(Snapshot.load(tmp_path / "s.npz"))
        session.run_until()
        assert rows(session.result()) == whole
    with Session(shared(fmu, nodes)) as other, pytest.raises(InputError, match="another system"):
        other.restore(Snapshot.load(tmp_path / "s.npz"))


def test_a_way_that_takes_too_long_ends_the_run(fmu: Path) -> None:
    """The medium is named, as it is where the signals of its nodes are missing."""
    system = shared(fmu, medium={"speed": 1e-9})
    run = simulate(system)
    assert run.status == "failed"
    assert "medium 'bay', a to b: the way takes too long" in str(run.reason)
    with pytest.raises(InputError, match=r"medium\.bay: nodes"):
        replace(system, delays={})
