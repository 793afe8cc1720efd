"""Algebraic loops of FMUs that do not declare their feedthrough, and what is declared for them."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from foreign.c_fmu import c_fmu, every
from loops import ENGINES, LOOP, PAIR, POINTS, STEP, STOP, advanced, cut_at_p, declared, undeclared
from scalar import end, ns, scalars

from cosim.core import InputError
from cosim.fmu import describe_fmu
from cosim.master import (
    Component,
    Connection,
    EngineName,
    System,
    make_schedule,
    receiving_order,
    simulate,
)


def test_undeclared_dependencies_are_known_as_such(tmp_path: Path) -> None:
    """FMI 2 and FMI 3; an output that is declared, even to depend, is not unknown."""
    for path, known in ((declared(), {"x": False, "y": True}), (undeclared(), {})):
        for name, port in describe_fmu(path).ports.items():
            if port.causality == "output":
                assert port.feedthrough == known.get(name, True)
                assert port.feedthrough_declared == (name in known)
    xml = every().replace('dependencies=""', "")
    assert xml != every()
    ports = describe_fmu(c_fmu("every_fmi3.c", xml, tmp_path)).ports
    of = {p.feedthrough_declared for p in ports.values() if p.causality == "output"}
    assert of == {False}
    assert all(p.feedthrough_declared for p in ports.values() if p.causality != "output")


def test_loop_of_unknown_feedthrough_is_refused_with_its_cures() -> None:
    with pytest.raises(InputError) as caught:
        simulate(scalars(undeclared(), PAIR, LOOP, step=STEP, stop=STOP))
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


def test_what_is_declared_is_not_called_unknown() -> None:
    """No cure is named that would not help."""
    for more in ({}, {"unknown_feedthrough": "previous"}):
        with pytest.raises(InputError) as caught:
            simulate(scalars(declared(), PAIR, LOOP, step=STEP, stop=STOP, **more))
        assert "not declared" not in str(caught.value)
        assert "unknown_feedthrough" not in str(caught.value)


@pytest.mark.parametrize("engine", ENGINES)
def test_loop_of_unknown_feedthrough_is_cut_once(engine: EngineName) -> None:
    """Into the component that is named first; every value is that of the recurrence by hand."""
    system = scalars(undeclared(), PAIR, LOOP, step=STEP, stop=STOP, unknown_feedthrough="previous")
    assert receiving_order(system).cut == (Connection(end("q.y"), end("p.u")),)
    run = simulate(system, engine=engine)
    for name, values in cut_at_p().items():
        assert run.signal(*name.split(".")) == pytest.approx(values, rel=1e-11), name


@pytest.mark.parametrize("engine", ENGINES)
def test_policy_previous_is_the_same_cut(engine: EngineName) -> None:
    """Chosen by hand, where everything is declared: the same bits."""
    policy = (LOOP[0], ("q.y", "p.u", "", "previous"))
    runs = [
        simulate(scalars(declared(), PAIR, policy, step=STEP, stop=STOP), engine=engine),
        simulate(
            scalars(undeclared(), PAIR, LOOP, step=STEP, stop=STOP, unknown_feedthrough="previous")
        ),
    ]
    for name in cut_at_p():
        one, other = (run.signal(*name.split(".")) for run in runs)
        assert np.array_equal(one, other), name


def test_declared_feedthrough_makes_no_delay() -> None:
    """x does not depend on u at once, though the FMU does not say so: as if it did."""
    x = {name: given | {"e": 0.0, "c": 1.0} for name, given in PAIR.items()}
    loop = (("p.x", "q.u"), ("q.x", "p.u"))
    given = scalars(undeclared(), x, loop, step=STEP, stop=STOP)
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


def test_feedthrough_names_outputs_elements_and_groups(tmp_path: Path) -> None:
    described = describe_fmu(undeclared())
    ports = Component(described, {}, feedthrough=["y"]).description.ports
    assert {n: p.feedthrough for n, p in ports.items() if p.causality == "output"} == {
        "x": False,
        "y": True,
    }
    assert all(p.feedthrough_declared for p in ports.values())
    arrays = describe_fmu(c_fmu("every_fmi3.c", every(), tmp_path))
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


def test_arrays_texts_and_integers_are_cut_alike(tmp_path: Path) -> None:
    """A loop of two FMI 3.0 slaves of every type that declare nothing: all at one place."""
    xml = every().replace('dependencies=""', "")
    fmu = describe_fmu(c_fmu("every_fmi3.c", xml, tmp_path))
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
