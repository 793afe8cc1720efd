"""Random systems: both engines have the bits of a run that follows from the definition alone."""

from __future__ import annotations

import random
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from naive_run import NaiveRun
from scalar import end, scalar_fmu
from shared import made_once, sampled, share_of

from cosim.fmu import FmuDescription, describe_fmu
from cosim.master import Component, Connection, Link, System, make_schedule, simulate
from cosim.network import GilbertElliott, Jitter, PacketLink, TransportLink

MS = 10**6


def fmu() -> FmuDescription:
    """The scalar, compiled once."""
    return describe_fmu(made_once("naive", _make) / "scalar-11.fmu")


def _make(folder: Path) -> None:
    scalar_fmu(folder)


def random_link(r: random.Random, name: str) -> Link:
    """A packet link of any kind whose delay is constant, or a delayed continuous signal."""
    if r.random() < 0.25:
        return TransportLink(name, r.choice([0, 10, 25, 37]) * MS + r.choice([0, 1]))
    if r.random() < 0.15:  # at some steps a wire
        return PacketLink(name, r.choice([20, 7, 13]) * MS, quantization=r.choice([0.0, 0.01]))
    every, wide = r.randint(5, 45) * MS, r.choice([0, 10, 80]) * MS
    p = [r.choice([0.0, 0.2, 0.6, 1.0]) for _ in range(4)]
    link = PacketLink(
        name,
        every,
        r.choice([0, 0, r.randint(0, 30)]) * MS,
        r.randint(0, 60) * MS,
        jitter=Jitter("uniform", width_ns=wide) if wide else Jitter(),
        loss=r.choice([0.0, 0.0, 0.3, GilbertElliott(*p)]),
        duplicate=r.choice([0.0, 0.0, 0.5]),
        order=r.choice(["newest-wins", "fifo", "as-arrived"]),
        on_loss=r.choice(["hold", "zero", 2.5]),
        quantization=r.choice([0.0, 0.0, 0.01]),
        seed=r.randrange(2**31),
        **r.choice([{}, {}, {"data_rate": 10**6, "frame_size": r.randint(1, 60_000)}]),
    )
    if link.data_rate:
        link = replace(link, queue_limit=r.choice([None, 0, 2]))
    if r.random() < 0.2:
        late = r.choice([0, 5, 40]) * MS
        link = replace(link, playout_ns=max(1, link.least_transit_ns + late))
    return link


def random_system(number: int) -> System:
    """Scalars in chains and rings, over links of all kinds, some with steps of their own."""
    r = random.Random(number)  # noqa: S311 - cases, not secrets
    algorithm: Any = r.choice(["jacobi", "jacobi", "gauss-seidel"])
    step, steps = r.choice([20, 7, 13]) * MS, r.randint(2, 25)
    stop = step * steps + r.choice([0, 0, 3 * MS])
    links = {name: random_link(r, name) for name in [f"l{i}" for i in range(r.randint(0, 4))]}
    names = [f"s{i}" for i in range(r.randint(1, 5))]
    every = {name: step * r.randint(1, 4) for name in names if r.random() < 0.25}
    every = {name: own for name, own in every.items() if own <= stop}
    schedule = make_schedule(links, step, stop, r.choice(["align", "grid"]), every.values())
    components, connections = {}, []
    for i, name in enumerate(names):
        given = {"a": r.choice([r.uniform(-3, 0.5), 0.0]), "b": r.uniform(-2, 2)}
        given |= {"x0": r.uniform(-1, 1), "c": r.uniform(0.5, 2)}
        through = algorithm == "jacobi" and i > 0 and r.random() < 0.5
        given["e"] = r.choice([0.0, 0.3]) if algorithm == "jacobi" else 0.0
        components[name] = Component(fmu(), given, every.get(name))
        if r.random() < 0.9:
            source = f"{r.choice(names[:i])}.y" if through else f"{r.choice(names)}.x"
            connections.append(Connection(end(source), end(f"{name}.u"), r.choice([None, *links])))
    system = System(components, connections, links, {}, schedule, 1e9, algorithm)
    order = tuple(r.sample(names, len(names))) if algorithm == "gauss-seidel" else None
    return replace(system, order=order)


def check(number: int) -> None:
    """Points, states, outputs and inputs, in both engines, bit for bit."""
    system = random_system(number)
    naive = NaiveRun(system)
    inputs = {connection.target.component for connection in system.connections}
    for engine in ("python", "kernel"):
        run = simulate(system, engine=engine)
        assert run.status == "finished", run.reason
        assert run.points_ns.tolist() == naive.points
        for name in system.components:
            of = {t: k for k, t in enumerate(naive.points)}
            rows = [of[t] for t in naive.own[name]]
            x = [naive.x(name, t) for t in naive.own[name]]
            assert run.signal(name, "x")[rows].tolist() == x, (number, engine, name)
            if name in inputs and system.algorithm == "jacobi":
                u = [naive.u(name, t) for t in naive.own[name]]
                assert run.signal(name, "u")[rows].tolist() == u, (number, engine, name)
                y = [naive.y(name, t) for t in naive.own[name]]
                assert run.signal(name, "y")[rows].tolist() == y, (number, engine, name)


@pytest.mark.parametrize("part", sampled(range(10), 1))
def test_both_engines_have_the_bits_of_the_definition(part: int) -> None:
    """1000 random systems, 100 of them in every test run."""
    for number in range(100 * part, 100 * (part + 1)):
        check(number)


@pytest.mark.slow
@pytest.mark.parametrize("part", share_of(range(10)))
def test_both_engines_have_the_bits_of_the_definition_on_ten_thousand(part: int) -> None:
    """10 000 random systems."""
    for number in range(1000 * (part + 1), 1000 * (part + 2)):
        check(number)
