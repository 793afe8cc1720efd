"""Random scenarios of a plant and a controller, with all that links, policies and steps can be."""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import tomli_w
from as_scenario import scenario_of
from master.scalar import end, ns

from cosim.core import InputError
from cosim.fmu import FmuDescription, describe_fmu
from cosim.master import (
    Component,
    Connection,
    DelaySource,
    Link,
    Run,
    System,
    make_schedule,
)
from cosim.network import DelayProfile, DelaySignal, Jitter, PacketLink, TransportLink
from cosim.scenario import (
    FmuCache,
    Outcome,
    PreparedScenario,
    assembled_system,
    execute_unrecorded,
    parse,
    prepare,
)

POSE, RATES = ("x", "y", "z", "psi"), ("u", "v", "w", "r")
COMMANDS = ("force.x", "force.y", "force.z", "moment.z")


def random_link(r: random.Random, name: str, step: float, *, live: bool) -> Link:
    """A link of any kind; live: its delay may follow a signal."""
    kind = r.random()
    if kind < 0.3:
        if r.random() < 0.3:
            profile = DelayProfile.from_seconds([0.0, 5 * step, 9 * step], [0.0, step, 2.3 * step])
            return TransportLink(name, 0, profile)
        return TransportLink(name, ns(r.choice([0, step, step * 2.5, step * 7.3])))
    given: dict[str, Any] = {"order": r.choice(["newest-wins", "fifo", "as-arrived"])}
    if r.random() < 0.4:
        given["jitter"] = Jitter("uniform", width_ns=ns(r.uniform(0, 3 * step)))
    if r.random() < 0.4:
        given["loss"] = r.choice([0.1, 0.5])
    if r.random() < 0.4:
        given["on_loss"] = r.choice([0.0, 2.5, "hold"])
    if r.random() < 0.2:
        given["duplicate"] = 0.3
    delay = r.choice([0.3, 1, 4.1]) if "jitter" in given else r.choice([0, 0.3, 4.1])
    period, offset = r.uniform(step, 4 * step), r.choice([0, 0.02])
    if live and kind < 0.6:
        return PacketLink(name, ns(period), ns(offset), delay=DelaySignal(step, ns(step)), **given)
    seed = r.randint(0, 9)
    return PacketLink(name, ns(period), ns(offset), ns(delay * step), seed=seed, **given)


def _nothing(_: random.Random, __: System) -> dict[str, Any]:
    return {}


class RandomRun(NamedTuple):
    """A scenario, its system, and a run of it that has kept its rows."""

    prepared: PreparedScenario
    system: System
    outcome: Outcome
    run: Run


class RandomRuns:
    """Random scenarios of vehicles, of the loop of Section 5, and of scalars without a design."""

    def __init__(self, fmus: Path, scalar: Path, undeclared: Path) -> None:
        names = ("AuvPlant", "HinfController", "DelayedPlant", "PaperController")
        self._fmus = {n: describe_fmu(fmus / f"{n}.fmu") for n in names}
        self._scalar, self._undeclared = describe_fmu(scalar), describe_fmu(undeclared)
        self._cache = FmuCache(fmus.parent, scalar.parent, flavour="native")

    def run(
        self, seed: int, more: Callable[[random.Random, System], dict[str, Any]] = _nothing
    ) -> RandomRun | None:
        """One that is stopped early now and then; None where the system is refused.

        more : returns further tables.
        """
        r = random.Random(seed)  # noqa: S311 - reproducible choices
        make = r.choice([self._vehicle, self._paper, self._scalars])
        try:
            system, tables = make(r)
            end_s = float(system.comm_schedule.points_ns[-1]) / 1e9
            if r.random() < 0.3:
                tables["events"] = [{"at": round(r.uniform(0, end_s), 9), "stop": "enough"}]
            at_once = tables.pop("at_once", False)
            data = scenario_of(system, **tables, **more(r, system))
            if at_once:  # its commands are read behind its inputs, at the same point
                data["components"]["controller"]["feedthrough"] = ["u"]
            text = tomli_w.dumps(data)
            folder = self._cache.folder
            prepared = prepare(parse(text, name="r", where="r.toml", folder=folder), self._cache)
            made, _ = assembled_system(prepared)
            outcome, run = execute_unrecorded(prepared, engine="python")
        except InputError:
            return None
        assert set(made.connections) == set(system.connections)
        assert {k: x for k, x in made.links.items() if k not in system.delays} == {
            k: x for k, x in system.links.items() if k not in system.delays
        }
        return RandomRun(prepared, made, outcome, run)

    def _vehicle(self, r: random.Random) -> tuple[System, dict[str, Any]]:
        limits = {"limit.force": r.choice([30.0, 2500.0]), "limit.moment": r.choice([5.0, 2500.0])}
        start = r.choice([{}, {"initial.eta.x": 5.0, "initial.eta.psi": 0.5}])
        fmus = {
            "plant": (
                self._fmus["AuvPlant"],
                {**start, "disturbance.u": r.choice([0, 0.1])},
            ),
            "controller": (
                self._fmus["HinfController"],
                {**limits, "sample_time": r.choice([0.0, 0.05, 0.17])},
            ),
        }
        eta = [(f"plant.eta.{a}", f"controller.eta.{a}") for a in POSE]
        nu = [(f"plant.nu.{a}", f"controller.nu.{a}") for a in RATES]
        back = [(f"controller.{c}", f"plant.{c}") for c in COMMANDS]
        signal = DelaySource((end("plant.eta.x"),), (0.0,))
        largest = r.choice([1e6, 1e6, 5.01, 4.9])
        system = _system(r, fmus, [eta, nu, back[:3], back[3:]], signal, largest)
        return system, {"design": {"file": "auv-1.25s"}}

    def _paper(self, r: random.Random) -> tuple[System, dict[str, Any]]:
        start = r.choice([{}, {"initial.x[1]": 0.0, "initial.x[2]": 0.0}])
        fmus = {
            "plant": (self._fmus["DelayedPlant"], {**start, "w[1]": r.choice([0.0, 0.1])}),
            "controller": (self._fmus["PaperController"], {}),
        }
        parts = [
            [("plant.x[1]", "controller.x[1]")],
            [("plant.x[2]", "controller.x[2]")],
            [("controller.u[1]", "plant.u[1]")],
        ]
        signal = DelaySource((end("plant.x[1]"),), (0.0,))
        system = _system(r, fmus, parts, signal, r.choice([1e6, 1e6, 9.0]))
        return system, {"design": {"file": "paper-late"}, "at_once": r.random() < 0.5}

    def _scalars(self, r: random.Random) -> tuple[System, dict[str, Any]]:
        fmu = r.choice([self._scalar, self._undeclared])
        fmus = {
            name: (fmu, {"a": r.uniform(-2, 0.5), "b": r.uniform(-2, 2), "x0": 1.0, "e": 0.3})
            for name in ("plant", "controller", "other")
        }
        parts = [
            [(f"plant.{r.choice('xxy')}", "controller.u")],
            [(f"controller.{r.choice('xy')}", "plant.u")],
            [(f"{r.choice(['plant', 'controller'])}.x", "other.u")],
        ]
        signal = DelaySource((end("plant.x"),), (0.0,))
        return _system(r, fmus, parts, signal, r.choice([1e6, 1e6, 1.5])), {}


def _system(
    r: random.Random,
    fmus: Mapping[str, tuple[FmuDescription, Mapping[str, Any]]],
    parts: list[list[tuple[str, str]]],
    signal: DelaySource,
    divergence: float,
) -> System:
    """Connect parts, each over a link or none, with one policy."""
    step, algorithm = r.choice([0.05, 0.1, 0.013]), r.choice(["jacobi", "jacobi", "gauss-seidel"])
    live = algorithm == "jacobi" and r.random() < 0.3
    every = {n: ns(step) * r.randint(1, 4) for n in fmus if not live and r.random() < 0.3}
    links: dict[str, Link] = {}
    connections = []
    for i, part in enumerate(parts):
        name = f"l{i}" if r.random() < 0.7 else None
        if name is not None:
            links[name] = random_link(r, name, step, live=live)
        packet = isinstance(links.get(name or ""), PacketLink)
        ahead = [] if packet or algorithm != "jacobi" or live else ["linear", "midpoint"]
        policy: Any = r.choice(["hold", "hold", "hold", "previous", *ahead])
        connections += [Connection(end(a), end(b), name, policy) for a, b in part]
    stop, events = step * r.uniform(2, 90), r.choice(["align", "grid"])
    delays = {
        name: signal
        for name, link in links.items()
        if isinstance(link, PacketLink) and isinstance(link.delay, DelaySignal)
    }
    return System(
        {n: Component(fmu, given, every.get(n)) for n, (fmu, given) in fmus.items()},
        connections,
        links,
        {},
        make_schedule(links, ns(step), ns(stop), events, sorted(every.values())),
        divergence,
        algorithm,  # type: ignore[arg-type]
        delays=delays,
        unknown_feedthrough="previous",
    )
