"""Which connections of a system are cut, and which loops are left to be solved."""

from __future__ import annotations

import dataclasses
import itertools
import math
import random
from collections.abc import Sequence
from typing import Any

import pytest
from loops import LOOP, PAIR, STEP, STOP, declared, undeclared
from scalar import end, ns, scalars

from cosim.core import InputError
from cosim.fmu import describe_fmu
from cosim.master import Component, Connection, System, make_schedule, receiving_order


def graph(known: Sequence[str], edges: list[tuple[str, str]], **more: Any) -> System:
    """Components by letter, those in `known` declare; each edge leads to an input of its own.

    Only their order is asked for: the inputs are described, but the FMU does not have them.
    """
    names = sorted({name for edge in edges for name in edge})
    described = {True: describe_fmu(declared()), False: describe_fmu(undeclared())}
    components = {}
    for name in names:
        description = described[name in known]
        u = description.ports["u"]
        inputs = {
            f"u{i}": dataclasses.replace(u, name=f"u{i}")
            for i, edge in enumerate(edges)
            if edge[1] == name
        }
        ports = {**description.ports, **inputs}
        components[name] = Component(dataclasses.replace(description, ports=ports), {})
    return System(
        components,
        [Connection(end(f"{a}.y"), end(f"{b}.u{i}")) for i, (a, b) in enumerate(edges)],
        {},
        {},
        make_schedule({}, ns(STEP), ns(STOP), "align"),
        1e6,
        **more,
    )


def cuts_of(system: System) -> set[tuple[str, str]]:
    return {(c.source.component, c.target.component) for c in receiving_order(system).cut}


def test_fewest_connections_are_cut() -> None:
    """Against every order of the components, for 200 random graphs; some senders declare."""
    draws = random.Random(8)  # noqa: S311 - no secrets
    refused = cut = 0
    for _ in range(200):
        names = "abcde"[: draws.randint(2, 5)]
        known = draws.sample(names, draws.randint(0, len(names) // 2))
        pairs = [(a, b) for a in names for b in names]
        edges = [pair for pair in pairs for _ in range(draws.choice((0, 0, 0, 1, 2)))]
        if not edges:
            continue
        system = graph(known, edges, unknown_feedthrough="previous")
        fewest = min(cost(order, edges, known) for order in itertools.permutations(names))
        if fewest == math.inf:
            refused += 1
            with pytest.raises(InputError, match="algebraic loop"):
                receiving_order(system)
            continue
        found = receiving_order(system)
        assert len(found.cut) == fewest
        cut += fewest > 0
        order = [*found.order, *(name for name in names if name not in found.order)]
        assert cost(order, [e for e in edges if e not in cuts_of(system)], known) == 0
    assert cut > 50
    assert refused > 20


def cost(order: Sequence[str], edges: Sequence[tuple[str, str]], known: Sequence[str]) -> float:
    """How many connections do not lead forwards in an order; infinite if one is declared."""
    back = [a for a, b in edges if order.index(a) >= order.index(b)]
    return math.inf if any(a in known for a in back) else len(back)


def test_cut_is_decided_by_the_order_of_names() -> None:
    """Equal choices: into the component that is named first; fewer connections come before."""

    def cut(*edges: str, **more: Any) -> set[tuple[str, str]]:
        pairs = [(edge[0], edge[1]) for edge in edges]
        return cuts_of(graph("", pairs, unknown_feedthrough="previous", **more))

    assert cut("ab", "ba") == {("b", "a")}
    assert cut("ba", "ab") == {("b", "a")}
    assert cut("ab", "ba", "ba") == {("a", "b")}
    assert cut("ab", "bc", "ca") == {("c", "a")}
    assert cut("aa", "ab") == {("a", "a")}
    assert cut("ab", "ba", "cd", "dc", "bc") == {("b", "a"), ("d", "c")}
    given = {"algorithm": "gauss-seidel", "order": ("b", "a")}
    assert cut("ab", "ba", **given) == {("a", "b")}


def test_long_ring_is_cut_once() -> None:
    """More components than are ordered exactly; the connection that is cheapest is the cut."""
    names = [f"n{i:02d}" for i in range(30)]
    ring = list(zip(names, [*names[1:], names[0]], strict=True))
    twice = [edge for edge in ring for _ in range(1 + (edge[0] != "n17"))]
    for edges, expected in ((ring, ("n29", "n00")), (twice, ("n17", "n18"))):
        system = graph("", edges, unknown_feedthrough="previous")
        assert cuts_of(system) == {expected}


def test_declared_loop_inside_an_unknown_one() -> None:
    """Only what is unknown is cut: the rest is refused by name, or left to be solved."""
    edges = [("a", "b"), ("b", "a"), ("b", "c"), ("c", "a")]
    system = graph("ab", edges, unknown_feedthrough="previous")
    with pytest.raises(InputError, match="a -> b -> a: the connections form"):
        receiving_order(system)
    found = receiving_order(dataclasses.replace(system, solve=True))
    assert found.loops == (("a", "b"),)
    assert [str(c.source) for c in found.cut] == ["c.y"]
    assert found.order == ("a", "b", "c")


def test_solved_loops_are_the_strongly_connected_components() -> None:
    """Against reachability, for 100 random graphs: loops stay together, and in order."""
    draws = random.Random(3)  # noqa: S311 - no secrets
    for _ in range(100):
        names = "abcdefgh"[: draws.randint(1, 8)]
        edges = [(a, b) for a in names for b in names if draws.random() < 0.15]
        if not edges:
            continue
        found = receiving_order(graph(names, edges, solve=True))
        reached = {(a, b) for a, b in edges}
        for via in names:
            reached |= {(a, b) for a in names for b in names if {(a, via), (via, b)} <= reached}
        used = sorted({name for edge in edges for name in edge})
        loops = {tuple(sorted(b for b in used if {(a, b), (b, a)} <= reached)) for a in used} - {()}
        assert {tuple(sorted(loop)) for loop in found.loops} == loops
        place = {name: i for i, name in enumerate(found.order)}
        for loop in found.loops:
            assert [place[n] for n in loop] == list(
                range(place[loop[0]], place[loop[0]] + len(loop))
            )
        member = {name: loop for loop in found.loops for name in loop}
        apart = [(a, b) for a, b in edges if a not in member.get(b, ())]
        assert all(place[a] < place[b] for a, b in apart)
        assert sorted(found.loops, key=lambda loop: place[loop[0]]) == list(found.loops)


def test_a_loop_is_solved_under_jacobi_only() -> None:
    system = scalars(
        declared(), PAIR, LOOP, step=STEP, stop=STOP, solve=True, algorithm="gauss-seidel"
    )
    with pytest.raises(InputError, match="expected: the algorithm jacobi"):
        receiving_order(system)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"solve_tolerance": 0.0}, "solve_tolerance > 0"),
        ({"solve_tolerance": math.nan}, "solve_tolerance > 0"),
        ({"solve_limit": 0}, "solve_limit >= 1"),
        ({"unknown_feedthrough": "previus"}, "did you mean previous"),
    ],
)
def test_invalid_choice_is_refused(more: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        scalars(declared(), PAIR, (), step=STEP, stop=STOP, **more)
