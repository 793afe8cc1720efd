"""Algebraic loops that are cut, by declaration or at connections of unknown feedthrough."""

from __future__ import annotations

import dataclasses
import itertools
import math
import random
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foreign.c_fmu import c_fmu, every
from scalar import end, ns, scalar_fmu, scalars

from cosim.core.errors import ComponentError, InputError
from cosim.fmu import describe_fmu
from cosim.master import (
    Component,
    Connection,
    DelaySource,
    EngineName,
    Session,
    System,
    make_schedule,
    receiving_order,
    simulate,
)
from cosim.network import DelayProfile, DelaySignal, PacketLink, TransportLink

PAIR = {
    "p": {"a": -1.0, "b": 1.5, "x0": 1.0, "e": 0.3},
    "q": {"a": -0.5, "b": -2.0, "x0": -0.5, "e": 0.2, "c": 2.0},
}
LOOP = (("p.y", "q.u"), ("q.y", "p.u"))
STEP, STOP, POINTS = 0.1, 1.0, 11


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("scalar")


@pytest.fixture(scope="module")
def fmu(folder: Path) -> Path:
    return scalar_fmu(folder)


@pytest.fixture(scope="module")
def unknown(folder: Path) -> Path:
    """The same, but it does not declare which outputs depend on the input."""
    return scalar_fmu(folder, declared=False)


@pytest.fixture(params=["python", "kernel"])
def engine(request: pytest.FixtureRequest) -> EngineName:
    name: EngineName = request.param
    return name


def output(name: str, x: float, u: float) -> float:
    return PAIR[name].get("c", 1.0) * x + PAIR[name]["e"] * u


def advanced(name: str, x: float, u: float, h: float = STEP) -> float:
    a, b = PAIR[name]["a"], PAIR[name]["b"]
    return math.exp(a * h) * x + math.expm1(a * h) / a * b * u


def settled() -> tuple[float, float]:
    """y of p and q at the start, from the two linear equations."""
    (cp, ep), (cq, eq) = ((PAIR[n].get("c", 1.0), PAIR[n]["e"]) for n in PAIR)
    solved = np.linalg.solve([[1.0, -ep], [-eq, 1.0]], [cp * PAIR["p"]["x0"], cq * PAIR["q"]["x0"]])
    return float(solved[0]), float(solved[1])


def cut_at_p() -> dict[str, list[float]]:
    """The loop with q.y -> p.u one step late, Jacobi: by hand."""
    x = {name: given["x0"] for name, given in PAIR.items()}
    rows: dict[str, list[float]] = {"p.u": [], "q.u": [], "p.y": [], "q.y": []}
    u = settled()[1]
    for _ in range(POINTS):
        y = output("p", x["p"], u)
        z = output("q", x["q"], y)
        for name, value in (("p.u", u), ("p.y", y), ("q.u", y), ("q.y", z)):
            rows[name].append(value)
        x = {"p": advanced("p", x["p"], u), "q": advanced("q", x["q"], y)}
        u = z
    return rows


def test_undeclared_dependencies_are_known_as_such(fmu: Path, unknown: Path, folder: Path) -> None:
    """FMI 2 and FMI 3; an output that is declared, even to depend, is not unknown."""
    for path, known in ((fmu, {"x": False, "y": True}), (unknown, {})):
        for name, port in describe_fmu(path).ports.items():
            if port.causality == "output":
                assert port.feedthrough == known.get(name, True)
                assert port.feedthrough_declared == (name in known)
    xml = every().replace('dependencies=""', "")
    assert xml != every()
    ports = describe_fmu(c_fmu("every_fmi3.c", xml, folder)).ports
    of = {p.feedthrough_declared for p in ports.values() if p.causality == "output"}
    assert of == {False}
    assert all(p.feedthrough_declared for p in ports.values() if p.causality != "output")


def test_loop_of_unknown_feedthrough_is_refused_with_its_cures(unknown: Path) -> None:
    with pytest.raises(InputError) as caught:
        simulate(scalars(unknown, PAIR, LOOP, step=STEP, stop=STOP))
    text = str(caught.value)
    assert text.startswith("p -> q -> p: the connections form an algebraic loop\n")
    for connection in ("p.y -> q.u", "q.y -> p.u"):
        assert f"{connection} (dependencies not declared)" in text
    for cure in (
        'components.p.feedthrough = "none"',
        'policy = "previous"',
        'run.unknown_feedthrough = "previous"',
        "run.solve = true",
    ):
        assert cure in text


def test_what_is_declared_is_not_called_unknown(fmu: Path) -> None:
    """No cure is named that would not help."""
    for more in ({}, {"unknown_feedthrough": "previous"}):
        with pytest.raises(InputError) as caught:
            simulate(scalars(fmu, PAIR, LOOP, step=STEP, stop=STOP, **more))
        assert "not declared" not in str(caught.value)
        assert "unknown_feedthrough" not in str(caught.value)


def test_loop_of_unknown_feedthrough_is_cut_once(unknown: Path, engine: EngineName) -> None:
    """Into the component that is named first; every value is that of the recurrence by hand."""
    system = scalars(unknown, PAIR, LOOP, step=STEP, stop=STOP, unknown_feedthrough="previous")
    assert receiving_order(system).cut == (Connection(end("q.y"), end("p.u")),)
    run = simulate(system, engine=engine)
    for name, values in cut_at_p().items():
        assert run.signal(*name.split(".")) == pytest.approx(values, rel=1e-11), name


def test_policy_previous_is_the_same_cut(fmu: Path, unknown: Path, engine: EngineName) -> None:
    """Chosen by hand, where everything is declared: the same bits."""
    policy = (LOOP[0], ("q.y", "p.u", "", "previous"))
    runs = [
        simulate(scalars(fmu, PAIR, policy, step=STEP, stop=STOP), engine=engine),
        simulate(
            scalars(unknown, PAIR, LOOP, step=STEP, stop=STOP, unknown_feedthrough="previous")
        ),
    ]
    for name in cut_at_p():
        one, other = (run.signal(*name.split(".")) for run in runs)
        assert np.array_equal(one, other), name


def test_declared_feedthrough_makes_no_delay(unknown: Path) -> None:
    """x does not depend on u at once, though the FMU does not say so: as if it did."""
    x = {name: given | {"e": 0.0, "c": 1.0} for name, given in PAIR.items()}
    loop = (("p.x", "q.u"), ("q.x", "p.u"))
    given = scalars(unknown, x, loop, step=STEP, stop=STOP)
    declared = {
        name: Component(c.description, c.parameters, feedthrough=feedthrough)
        for (name, c), feedthrough in zip(given.components.items(), (["y"], "none"), strict=True)
    }
    run = simulate(dataclasses.replace(given, components=declared))
    state = {"p": 1.0, "q": -0.5}
    for k in range(POINTS):
        assert run.signal("p", "u")[k] == pytest.approx(state["q"], rel=1e-12)
        assert run.signal("q", "u")[k] == pytest.approx(state["p"], rel=1e-12)
        state = {
            "p": advanced("p", state["p"], state["q"]),
            "q": advanced("q", state["q"], state["p"]),
        }


def test_feedthrough_names_outputs_elements_and_groups(folder: Path, unknown: Path) -> None:
    described = describe_fmu(unknown)
    ports = Component(described, {}, feedthrough=["y"]).description.ports
    assert {n: p.feedthrough for n, p in ports.items() if p.causality == "output"} == {
        "x": False,
        "y": True,
    }
    assert all(p.feedthrough_declared for p in ports.values())
    arrays = describe_fmu(c_fmu("every_fmi3.c", every(), folder))
    outputs = [n for n, p in arrays.ports.items() if p.causality == "output"]
    for names, expected in (
        (["Float64.reversed[2,1]"], {"Float64.reversed"}),
        (["Float64"], {n for n in outputs if n.startswith("Float64.")}),
        ([], set()),
    ):
        found = Component(arrays, {"n": 3}, feedthrough=names).description.ports
        assert {n for n in outputs if found[n].feedthrough} == expected
    for wrong in (["z"], ["u"], "y", ["y[1]"], [""]):
        with pytest.raises(InputError, match="feedthrough") as caught:
            Component(described, {}, feedthrough=wrong)
        assert "y" in str(caught.value)
    for wrong in (["Float64.reversed[4,1]"], ["Float64.reversed[1]"], ["Float64.reverse"]):
        with pytest.raises(InputError, match="there is no output"):
            Component(arrays, {"n": 3}, feedthrough=wrong)


def test_arrays_texts_and_integers_are_cut_alike(folder: Path) -> None:
    """A loop of two FMI 3.0 slaves of every type that declare nothing: all at one place."""
    xml = every().replace('dependencies=""', "")
    fmu = describe_fmu(c_fmu("every_fmi3.c", xml, folder))
    row = {"n": 3, "Float64.row": np.arange(9.0), "String.row": ["a", "b"], "Int8.in": 7}
    ways = [
        ("Float64.reversed", "Float64.row"),
        ("Int8.out", "Int8.in"),
        ("Boolean.out", "Boolean.in"),
        ("String.reversed", "String.row"),
    ]
    pairs = [("a", "b"), ("b", "a")]
    system = System(
        {"a": Component(fmu, row), "b": Component(fmu, {"n": 3})},
        [Connection(end(f"{s}.{out}"), end(f"{t}.{into}")) for s, t in pairs for out, into in ways],
        {},
        {},
        make_schedule({}, ns(0.25), ns(2.0), "grid"),
        1e12,
        unknown_feedthrough="previous",
    )
    cut = receiving_order(system).cut
    assert [str(c.source) for c in cut] == [f"b.{out}" for out, _ in ways]
    run = simulate(system)
    assert run.status == "finished", run.reason
    element = {"Float64.reversed": "[3,1]", "Float64.row": "[3,1]"}
    element |= {"String.reversed": "[1]", "String.row": "[1]"}
    for out, into in ([name + element.get(name, "") for name in way] for way in ways):
        assert np.array_equal(run.signal("b", into), run.signal("a", out)), out
        assert np.array_equal(run.signal("a", into)[1:], run.signal("b", out)[:-1]), out
        assert run.signal("a", into)[0] == run.signal("b", out)[0], out


SOURCE = {"a": -1.0, "x0": 1.0, "g": 0.5, "e": 0.3}
AFTER = {
    "wire": (),
    "transport": (TransportLink("l", ns(0.13)),),
    "varying transport": (
        TransportLink("l", 0, DelayProfile.from_seconds([0.0, 1.0], [0.25, 0.1], "linear")),
    ),
    "packet": (PacketLink("l", ns(0.07), ns(0.01), ns(0.0331)),),
    "packet at once": (PacketLink("l", ns(0.1), quantization=0.01),),
    "lost packets": (
        PacketLink("l", ns(0.1), loss=0.5, on_loss="zero", seed=3, delay_ns=ns(0.03)),
    ),
    "live": (PacketLink("l", ns(0.07), 0, delay=DelaySignal(0.05, ns(0.02))),),
}


@pytest.mark.parametrize("events", ["align", "grid"])
@pytest.mark.parametrize("algorithm", ["jacobi", "gauss-seidel"])
@pytest.mark.parametrize("case", AFTER)
def test_previous_is_hold_one_point_later(
    fmu: Path, case: str, algorithm: str, events: str, engine: EngineName
) -> None:
    """One sender, two receivers: what one reads at a point, the other reads at the next."""
    names = {n: {"a": -1.0} for n in ("one", "other")}
    over = "l" if AFTER[case] else ""
    run = simulate(
        scalars(
            fmu,
            {"source": SOURCE, "feed": {"a": -0.2, "x0": 1.0}, **names},
            (
                ("feed.x", "source.u"),
                ("source.y", "one.u", over),
                ("source.y", "other.u", over, "previous"),
            ),
            step=STEP,
            stop=STOP,
            links=AFTER[case],
            algorithm=algorithm,
            events=events,
            delays={"l": DelaySource((end("feed.x"),))} if case == "live" else {},
        ),
        engine=engine,
    )
    assert run.status == "finished"
    one, other = run.signal("one", "u"), run.signal("other", "u")
    assert other[0] == one[0] or algorithm == "gauss-seidel"
    assert np.array_equal(other[1:], one[:-1])
    assert len(set(other.tolist())) > 4


@pytest.mark.parametrize("case", ["wire", "transport", "varying transport", "packet at once"])
@pytest.mark.parametrize("algorithm", ["jacobi", "gauss-seidel"])
def test_previous_where_points_are_added(
    fmu: Path, case: str, algorithm: str, engine: EngineName
) -> None:
    """A live link elsewhere adds points during the run: the point before may be one of them."""
    over = "l" if AFTER[case] else ""
    system = scalars(
        fmu,
        {"source": SOURCE, "one": {}, "other": {}, "far": {}},
        (
            ("source.y", "one.u", over),
            ("source.y", "other.u", over, "previous"),
            ("source.x", "far.u", "live"),
        ),
        step=STEP,
        stop=STOP,
        links=[*AFTER[case], PacketLink("live", ns(0.07), 0, delay=DelaySignal(0.05, ns(0.02)))],
        algorithm=algorithm,
        delays={"live": DelaySource((end("source.x"),))},
    )
    assert system.grows
    run = simulate(system, engine=engine)
    assert run.status == "finished"
    one, other = run.signal("one", "u"), run.signal("other", "u")
    assert np.array_equal(other[1:], one[:-1])
    assert run.points_ns.size > 30
    assert len(set(one.tolist())) > 8


@pytest.mark.parametrize("every_s", [{"source": 0.2}, {"one": 0.3, "other": 0.3}])
def test_previous_with_own_steps(fmu: Path, every_s: dict[str, float], engine: EngineName) -> None:
    """The communication point before: for a slow receiver too, that of the run."""
    run = simulate(
        scalars(
            fmu,
            {"source": SOURCE, "one": {}, "other": {}},
            (("source.y", "one.u"), ("source.y", "other.u", "", "previous")),
            step=STEP,
            stop=1.2,
            every=every_s,
        ),
        engine=engine,
    )
    y = run.signal("source", "y")
    for k in range(run.points_ns.size):
        if "one" in every_s and k % 3:
            continue
        before = max(k - 1, 0)
        assert run.signal("other", "u")[k] == y[before // 2 * 2 if "source" in every_s else before]


def test_start_of_a_cut_survives_a_restore(fmu: Path) -> None:
    """Back to before the first step: the value of the initialisation is in its row again."""
    policy = (LOOP[0], ("q.y", "p.u", "", "previous"))
    with Session(scalars(fmu, PAIR, policy, step=STEP, stop=STOP)) as session:
        start = session.snapshot()
        session.run_until()
        first = session.result().signal("p", "y").copy()
        session.restore(start)
        session.run_until()
        assert np.array_equal(session.result().signal("p", "y"), first)
    assert first[0] == pytest.approx(settled()[0], rel=1e-11)


@pytest.mark.parametrize("delay", [0.1, 0.25])
@pytest.mark.parametrize("both", [True, False])
def test_transport_delay_cuts_a_loop(
    fmu: Path, delay: float, engine: EngineName, *, both: bool
) -> None:
    """Read at once only at the start, where the initialisation solves it; then by hand."""
    link = TransportLink("l", ns(delay))
    pairs = (LOOP[0], ("q.y", "p.u", "l")) if not both else tuple((*c, "l") for c in LOOP)
    system = scalars(fmu, PAIR, pairs, step=STEP, stop=STOP, links=[link])
    order = receiving_order(system)
    assert (order.cut, order.loops) == ((), ())
    assert len(order.initialised) == 1 + both
    run = simulate(system, engine=engine)
    x, y = {"p": 1.0, "q": -0.5}, dict(zip(PAIR, settled(), strict=True))
    sent: dict[str, list[float]] = {"p": [], "q": []}

    def read(name: str, k: int) -> float:
        t = max(k - delay / STEP, 0.0)
        i = math.floor(t + 1e-9)
        share = t - i if t - i > 1e-9 else 0.0
        if not sent[name]:
            return y[name]
        return sent[name][i] * (1 - share) + (share and sent[name][i + 1] * share)

    for k in range(POINTS):
        u = {"p": read("q", k), "q": read("p", k)}
        sent["p"].append(output("p", x["p"], u["p"]))
        if not both:
            u["q"] = sent["p"][k]
        sent["q"].append(output("q", x["q"], u["q"]))
        x = {name: advanced(name, x[name], u[name]) for name in x}
    for name, values in sent.items():
        assert run.signal(name, "y") == pytest.approx(values, rel=1e-10), name


@pytest.mark.parametrize(
    ("link", "policy", "cuts"),
    [
        (TransportLink("l", ns(0.1)), "hold", True),
        (TransportLink("l", ns(0.099)), "hold", False),
        (TransportLink("l", ns(0.15)), "midpoint", True),
        (TransportLink("l", ns(0.1)), "midpoint", True),
        (TransportLink("l", ns(0.1)), "linear", True),
        (TransportLink("l", ns(0.099)), "linear", False),
        (TransportLink("l", 0, DelayProfile.from_seconds([0, 1], [0.3, 0.1], "linear")), "hold", 1),
        (TransportLink("l", 0, DelayProfile.from_seconds([0, 1], [0.3, 0.0], "linear")), "hold", 0),
        (PacketLink("l", ns(0.1), delay_ns=1), "hold", True),
        (PacketLink("l", ns(0.1)), "hold", False),
    ],
)
def test_link_cuts_a_loop_if_it_never_reads_the_present_row(
    fmu: Path, link: Any, policy: str, *, cuts: bool
) -> None:
    pairs = (LOOP[0], ("q.y", "p.u", "l", policy))
    system = scalars(fmu, PAIR, pairs, step=STEP, stop=STOP, links=[link])
    if cuts:
        assert simulate(system).status == "finished"
        return
    with pytest.raises(InputError, match="algebraic loop"):
        receiving_order(system)


def test_transport_delay_of_a_step_cuts_where_points_are_added(fmu: Path) -> None:
    """The points are not known before the run, but no two are more than a step apart."""
    live = PacketLink("live", ns(0.07), 0, delay=DelaySignal(0.05, ns(0.02)))
    for delay, cuts in ((0.1, True), (0.09, False)):
        system = scalars(
            fmu,
            {**PAIR, "r": {}},
            (LOOP[0], ("q.y", "p.u", "l"), ("p.x", "r.u", "live")),
            step=STEP,
            stop=STOP,
            links=[TransportLink("l", ns(delay)), live],
            delays={"live": DelaySource((end("p.x"),), (0.0,))},
        )
        assert system.grows
        if not cuts:
            with pytest.raises(InputError, match="algebraic loop"):
                receiving_order(system)
            continue
        run = simulate(system)
        assert run.status == "finished"
        assert run.signal("p", "u")[0] == pytest.approx(settled()[1], rel=1e-11)
        t = run.points_ns / 1e9
        expected = np.interp(np.maximum(t - delay, 0.0), t, run.signal("q", "y"))
        assert run.signal("p", "u") == pytest.approx(expected, rel=1e-9)


def test_loop_that_does_not_settle_at_the_start_is_named(fmu: Path) -> None:
    strong = {name: given | {"e": 2.0} for name, given in PAIR.items()}
    pairs = (LOOP[0], ("q.y", "p.u", "", "previous"))
    with pytest.raises(ComponentError, match="the initial values do not settle"):
        simulate(scalars(fmu, strong, pairs, step=STEP, stop=STOP))


# ---- which connections are cut


def graph(
    fmu: Path, unknown: Path, known: Sequence[str], edges: list[tuple[str, str]], **more: Any
) -> System:
    """Components by letter, those in `known` declare; each edge leads to an input of its own.

    Only their order is asked for: the inputs are described, but the FMU does not have them.
    """
    names = sorted({name for edge in edges for name in edge})
    described = {True: describe_fmu(fmu), False: describe_fmu(unknown)}
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


def test_fewest_connections_are_cut(fmu: Path, unknown: Path) -> None:
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
        system = graph(fmu, unknown, known, edges, unknown_feedthrough="previous")
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


def test_cut_is_decided_by_the_order_of_names(fmu: Path, unknown: Path) -> None:
    """Equal choices: into the component that is named first; fewer connections come before."""

    def cut(*edges: str, **more: Any) -> set[tuple[str, str]]:
        pairs = [(edge[0], edge[1]) for edge in edges]
        return cuts_of(graph(fmu, unknown, "", pairs, unknown_feedthrough="previous", **more))

    assert cut("ab", "ba") == {("b", "a")}
    assert cut("ba", "ab") == {("b", "a")}
    assert cut("ab", "ba", "ba") == {("a", "b")}
    assert cut("ab", "bc", "ca") == {("c", "a")}
    assert cut("aa", "ab") == {("a", "a")}
    assert cut("ab", "ba", "cd", "dc", "bc") == {("b", "a"), ("d", "c")}
    given = {"algorithm": "gauss-seidel", "order": ("b", "a")}
    assert cut("ab", "ba", **given) == {("a", "b")}


def test_long_ring_is_cut_once(fmu: Path, unknown: Path) -> None:
    """More components than are ordered exactly; the connection that is cheapest is the cut."""
    names = [f"n{i:02d}" for i in range(30)]
    ring = list(zip(names, [*names[1:], names[0]], strict=True))
    twice = [edge for edge in ring for _ in range(1 + (edge[0] != "n17"))]
    for edges, expected in ((ring, ("n29", "n00")), (twice, ("n17", "n18"))):
        system = graph(fmu, unknown, "", edges, unknown_feedthrough="previous")
        assert cuts_of(system) == {expected}


def test_declared_loop_inside_an_unknown_one(fmu: Path, unknown: Path) -> None:
    """Only what is unknown is cut: the rest is refused by name, or left to be solved."""
    edges = [("a", "b"), ("b", "a"), ("b", "c"), ("c", "a")]
    system = graph(fmu, unknown, "ab", edges, unknown_feedthrough="previous")
    with pytest.raises(InputError, match="a -> b -> a: the connections form"):
        receiving_order(system)
    found = receiving_order(dataclasses.replace(system, solve=True))
    assert found.loops == (("a", "b"),)
    assert [str(c.source) for c in found.cut] == ["c.y"]
    assert found.order == ("a", "b", "c")


# ---- what is to be solved


def test_solved_loops_are_the_strongly_connected_components(fmu: Path, unknown: Path) -> None:
    """Against reachability, for 100 random graphs: loops stay together, and in order."""
    draws = random.Random(3)  # noqa: S311 - no secrets
    for _ in range(100):
        names = "abcdefgh"[: draws.randint(1, 8)]
        edges = [(a, b) for a in names for b in names if draws.random() < 0.15]
        if not edges:
            continue
        found = receiving_order(graph(fmu, unknown, names, edges, solve=True))
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


def test_a_loop_is_solved_under_jacobi_only(fmu: Path) -> None:
    system = scalars(fmu, PAIR, LOOP, step=STEP, stop=STOP, solve=True, algorithm="gauss-seidel")
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
def test_invalid_choice_is_refused(fmu: Path, more: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        scalars(fmu, PAIR, (), step=STEP, stop=STOP, **more)


def test_unknown_policy_is_refused(fmu: Path) -> None:
    with pytest.raises(InputError, match="did you mean previous"):
        scalars(fmu, PAIR, (("p.y", "q.u", "", "previuos"),), step=STEP, stop=STOP)
