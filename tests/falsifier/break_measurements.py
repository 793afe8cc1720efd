"""Faults of measurements: their noise, what they take in, and their stamps."""

from __future__ import annotations

from falsifier.draft import Draft
from falsifier.faults import fault
from falsifier.loop import transport

NOISE, STAMPS = "sensors", "stamps"


def _sensor(d: Draft) -> str:
    d.needs(d.loop.observed)
    return d.pick(d.sensors())


@fault(NOISE, "more noise than is declared", quick=True)
def _(d: Draft) -> None:
    d.parameters(_sensor(d))["noise[1]"] = d.size(20.0, 3.0)


@fault(NOISE, "noise that is not declared")
def _(d: Draft) -> None:
    d.needs(d.loop.name in {"inner", "mapped", "played"})
    d.parameters(_sensor(d))["noise[1]"] = d.size(0.5, 1e-6)


@fault(NOISE, "a bias", quick=True)
def _(d: Draft) -> None:
    d.parameters(_sensor(d))["bias[1]"] = d.size(1.0, 1e-3)


@fault(NOISE, "two sensors are swapped")
def _(d: Draft) -> None:
    wires = d.measured()
    d.needs(d.loop.observed and len(wires) > 1)
    a, b = wires[0], wires[-1]
    d.needs(a["to"] != b["to"])
    a["to"], b["to"] = b["to"], a["to"]


@fault(NOISE, "a sensor that hangs with fresh stamps", quick=True)
def _(d: Draft) -> None:
    d.event(at=d.size(3.0), freeze=[f"{_sensor(d)}.y[1]"])


@fault(NOISE, "a sensor overridden for a while")
def _(d: Draft) -> None:
    d.event(at=2.0, **{"for": d.size(10.0), "override": {f"{_sensor(d)}.y[1]": 1.0}})


@fault(STAMPS, "a late value with a fresh stamp", quick=True)
def _(d: Draft) -> None:
    d.needs(d.loop.observed)
    age = max(x.greatest_ns for x in d.loop.ages) / 1e9
    wire = d.pick(d.received())
    d.relink(wire, "tardy", transport(round(age + d.size(1.0), 3)))


@fault(STAMPS, "a value a little later than its stamp", quick=True)
def _(d: Draft) -> None:
    d.needs(d.loop.observed)
    wire = d.pick(d.received())
    old = d.links[wire["link"]]["delay"]
    d.relink(wire, "tardy", transport(round(old + d.size(0.1, 0.02), 2)))


@fault(STAMPS, "a stamp that is the time", quick=True)
def _(d: Draft) -> None:
    wire = d.pick(d.stamps())
    source, link = wire["from"].partition(".")[0], wire.pop("link", None)
    wire["from"] = d.computed("clock", "t")
    age = max(x.greatest_ns for x in d.loop.ages) / 1e9
    for value in d.received():
        if link is not None and value["from"].startswith(f"{source}."):
            d.relink(value, "tardy", transport(round(age + d.size(1.0), 3)))


@fault(STAMPS, "a stamp that is computed from another", quick=True)
def _(d: Draft) -> None:
    wire = d.pick(d.stamps())
    wire["from"] = d.computed("clock", f"'{wire['from']}' + {d.size(0.015, 1e-6)}")


@fault(STAMPS, "a stamp that stands still")
def _(d: Draft) -> None:
    wire = d.pick(d.stamps())
    d.wires.remove(wire)
    d.series(wire["to"], [0.0], [d.size(0.0)])


@fault(STAMPS, "a stamp that goes back")
def _(d: Draft) -> None:
    wire = d.pick(d.stamps())
    wire["from"] = d.computed("clock", f"-1 * '{wire['from']}' - {d.size(1.0)}")


@fault(STAMPS, "a stamp in the future")
def _(d: Draft) -> None:
    wire = d.pick(d.stamps())
    wire["from"] = d.computed("clock", f"'{wire['from']}' + {d.size(5.0, 1.0)}")


@fault(STAMPS, "the stamp of another sensor")
def _(d: Draft) -> None:
    wire = d.pick(d.stamps())
    slow = {"sample_time": 0.01, "noise[1]": 0.0}
    d.components["stranger"] = {"fmu": "Sensor", "parameters": slow}
    wire["from"] = "stranger.stamp"


@fault(STAMPS, "a gain of a stamp")
def _(d: Draft) -> None:
    d.pick(d.stamps())["gain"] = 1.0 - d.size(0.5, 1e-9)


@fault(STAMPS, "a stamp with an offset", quick=True)
def _(d: Draft) -> None:
    d.pick(d.stamps())["offset"] = -d.size(0.1, 1e-6)
