"""Gauss-Seidel and own steps against recurrences, and what is refused of them."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scalar import ns, scalar_fmu, scalars

from cosim.core import InputError
from cosim.master import EngineName, simulate
from cosim.network import PacketLink, TransportLink

ENGINES: tuple[EngineName, ...] = ("python", "kernel")
PAIR = {"a": {"a": -1.0, "b": 1.5, "x0": 1.0}, "b": {"a": -0.5, "b": -2.0, "x0": -0.5}}
LOOP = (("a.x", "b.u"), ("b.x", "a.u"))


@pytest.fixture(scope="module")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return scalar_fmu(tmp_path_factory.mktemp("scalar"))


def exact_step(which: str, x: float, u: float, h: float) -> float:
    """One exact step of `a` or `b` with its input held."""
    a, b = PAIR[which]["a"], PAIR[which]["b"]
    return math.exp(a * h) * x + math.expm1(a * h) / a * b * u


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("order", [("a", "b"), ("b", "a")])
def test_gauss_seidel_passes_on_the_outputs_just_computed(
    fmu: Path, engine: EngineName, order: tuple[str, str]
) -> None:
    system = scalars(fmu, PAIR, LOOP, step=0.1, stop=1.0, algorithm="gauss-seidel", order=order)
    run = simulate(system, engine=engine)
    first, second = order
    x = {"a": 1.0, "b": -0.5}
    for k in range(10):
        assert {n: run.signal(n, "x")[k] for n in x} == pytest.approx(x, rel=1e-14)
        u = x[second]
        assert run.signal(first, "u")[k] == pytest.approx(u, rel=1e-14)
        x[first] = exact_step(first, x[first], u, 0.1)
        assert run.signal(second, "u")[k] == pytest.approx(x[first], rel=1e-14)
        x[second] = exact_step(second, x[second], x[first], 0.1)
    assert run.status == "finished"


def test_gauss_seidel_does_not_change_deliveries_of_a_link(fmu: Path) -> None:
    """A message is delivered at its own time, even if its sender has already stepped."""
    link = PacketLink("l", ns(0.2), delay_ns=ns(0.1))
    pairs = (("a.x", "b.u", "l"),)
    runs = [
        simulate(scalars(fmu, PAIR, pairs, step=0.1, stop=1.0, links=[link], algorithm=algorithm))
        for algorithm in ("jacobi", "gauss-seidel")
    ]
    for name, variable in (("a", "x"), ("b", "x"), ("b", "u")):
        one, other = (run.signal(name, variable) for run in runs)
        assert one.tolist() == other.tolist()


def test_order_follows_direct_feedthrough(fmu: Path) -> None:
    """y of the second has direct feedthrough: it steps after the first."""
    parts = {"late": {"c": 0.0, "e": 1.0}, "early": {"x0": 1.0}, "last": {"b": 1.0}}
    pairs = (("early.x", "late.u"), ("late.y", "last.u"))
    system = scalars(fmu, parts, pairs, step=0.1, stop=0.3, algorithm="gauss-seidel")
    run = simulate(system)
    # last gets in the same step what early has just reached, through late
    state = run.signal("early", "x")
    assert run.signal("last", "u")[:-1].tolist() == state[1:].tolist()
    with pytest.raises(InputError, match="late before last"):
        simulate(
            scalars(
                fmu,
                parts,
                pairs,
                step=0.1,
                stop=0.3,
                algorithm="gauss-seidel",
                order=("last", "early", "late"),
            )
        )


@pytest.mark.parametrize("algorithm", ["jacobi", "gauss-seidel"])
def test_algebraic_loop_is_named(fmu: Path, algorithm: str) -> None:
    pairs = (("a.y", "b.u"), ("b.y", "a.u"))
    with pytest.raises(InputError, match="algebraic loop") as caught:
        simulate(scalars(fmu, PAIR, pairs, step=0.1, stop=0.3, algorithm=algorithm))
    assert {"a", "b"} <= set(str(caught.value.where).split(" -> "))


def test_invalid_order_is_refused(fmu: Path) -> None:
    for more in ({"order": ("a", "b")}, {"order": ("a",), "algorithm": "gauss-seidel"}):
        with pytest.raises(InputError, match="order"):
            scalars(fmu, PAIR, LOOP, step=0.1, stop=0.3, **more)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("algorithm", ["jacobi", "gauss-seidel"])
def test_components_with_their_own_steps(fmu: Path, engine: EngineName, algorithm: str) -> None:
    system = scalars(fmu, PAIR, LOOP, step=0.1, stop=1.0, every={"b": 0.3}, algorithm=algorithm)
    run = simulate(system, engine=engine)
    a, b, state_of_b = 1.0, -0.5, -0.5
    for k in range(10):
        if k % 3 == 0:
            b = state_of_b
        assert run.signal("a", "x")[k] == pytest.approx(a, rel=1e-13), k
        assert run.signal("b", "x")[k] == pytest.approx(b, rel=1e-13), k
        next_a = exact_step("a", a, b, 0.1)
        if k % 3 == 0:
            size = min(0.3, 1.0 - 0.1 * k)
            state_of_b = exact_step("b", b, next_a if algorithm == "gauss-seidel" else a, size)
        a = next_a
    assert run.signal("b", "x")[10] == pytest.approx(state_of_b, rel=1e-13)


def test_a_fixed_step_slave_runs_among_events_with_its_own_step(
    tmp_path: Path,
) -> None:
    fmu = scalar_fmu(tmp_path, variable_step=False)
    link = PacketLink("l", ns(0.07), delay_ns=ns(0.033))
    given: dict[str, Any] = {"step": 0.1, "stop": 1.0, "links": [link]}
    with pytest.raises(InputError, match="steps of one size only"):
        scalars(fmu, PAIR, (("a.x", "b.u", "l"),), **given)
    system = scalars(fmu, PAIR, (("a.x", "b.u", "l"),), every={"a": 0.05, "b": 0.1}, **given)
    assert simulate(system).status == "finished"


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"every": {"a": 0.05}, "events": "grid"}, "own step does not fit"),
        ({"every": {"a": 0.25}, "events": "grid"}, "a multiple of the communication step"),
        ({"every": {"a": 7.0}}, "own step does not fit"),
    ],
)
def test_own_step_that_does_not_fit_is_refused(
    fmu: Path, more: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        scalars(fmu, PAIR, LOOP, step=0.1, stop=1.0, **more)


def test_own_step_must_be_in_the_communication_schedule(fmu: Path) -> None:
    """A schedule made for another step than that of the component is refused."""
    system = scalars(fmu, PAIR, LOOP, step=0.1, stop=1.0, every={"a": 0.05})
    parts = {
        **system.components,
        "a": dataclasses.replace(system.components["a"], every_ns=ns(0.02)),
    }
    with pytest.raises(InputError, match="does not fall on communication points") as caught:
        simulate(dataclasses.replace(system, components=parts))
    assert caught.value.got == "none at 0.02 s"


def test_midpoint_needs_a_delay_of_half_a_step(fmu: Path) -> None:
    for link, policy in ((TransportLink("l", ns(0.04)), "midpoint"), (None, "midpoint")):
        pairs = (("a.x", "b.u", link.name if link else "", policy),)
        system = scalars(fmu, PAIR, pairs, step=0.1, stop=1.0, links=[link] if link else [])
        with pytest.raises(InputError, match=r"at least 0\.05 s"):
            simulate(system)


def test_packets_need_the_policy_hold(fmu: Path) -> None:
    pairs = (("a.x", "b.u", "l", "linear"),)
    system = scalars(fmu, PAIR, pairs, step=0.1, stop=1.0, links=[PacketLink("l", ns(0.1))])
    with pytest.raises(InputError, match="expected: the policy hold"):
        simulate(system)


@pytest.mark.parametrize("engine", ENGINES)
def test_extrapolation_ignores_events_close_together(fmu: Path, engine: EngineName) -> None:
    """No slope is computed from points a nanosecond apart."""
    links = [PacketLink("l", ns(0.1), 1, 0), TransportLink("t", 0)]
    pairs = (("a.x", "b.u", "l"), ("b.x", "a.u", "t", "linear"))
    run = simulate(scalars(fmu, PAIR, pairs, step=0.1, stop=2.0, links=links), engine=engine)
    inputs, outputs = run.signal("a", "u"), run.signal("b", "x")
    assert np.abs(inputs - outputs).max() < 0.2
