"""Faults of parts on the way: what stands between plant and controller."""

from __future__ import annotations

from falsifier.draft import Draft
from falsifier.faults import fault
from falsifier.loop import packet, transport

PARTS = "parts on the way"


@fault(PARTS, "a gain of -1 before the sensor", quick=True)
def _(d: Draft) -> None:
    d.pick(d.measured())["gain"] = -1.0


@fault(PARTS, "a gain of 0")
def _(d: Draft) -> None:
    d.pick(d.measured())["gain"] = 0.0


@fault(PARTS, "a gain that is a little off", quick=True)
def _(d: Draft) -> None:
    wire = d.pick(d.measured())
    wire["gain"] = wire.get("gain", 1.0) * (1.0 + d.size(0.2, 1e-9))


@fault(PARTS, "an offset of a measured state", quick=True)
def _(d: Draft) -> None:
    d.pick(d.measured())["offset"] = d.size(0.3, 1e-6)


@fault(PARTS, "a gain behind the sensor", quick=True)
def _(d: Draft) -> None:
    d.needs(d.loop.observed)
    d.pick(d.received())["gain"] = d.size(-1.0, -0.1) if d.dice is None else -d.size(1.0)


@fault(PARTS, "an offset behind the sensor", quick=True)
def _(d: Draft) -> None:
    d.needs(d.loop.observed)
    d.pick(d.received())["offset"] = d.size(0.3, 1e-6)


@fault(PARTS, "a gain of the command", quick=True)
def _(d: Draft) -> None:
    d.pick(d.commands())["gain"] = d.pick([-1.0, 0.0, 3.0, 0.5])


@fault(PARTS, "an offset of the command")
def _(d: Draft) -> None:
    d.pick(d.commands())["offset"] = d.size(0.3, 1e-6)


@fault(PARTS, "a matrix of the command")
def _(d: Draft) -> None:
    wire = d.pick(d.commands())
    d.needs(wire["to"] == "plant.u[1]")
    wire |= {"from": "controller.u", "to": "plant.u", "matrix": [[-d.size(1.0)]]}


@fault(PARTS, "a sensor that samples slowly, in the way", quick=True)
def _(d: Draft) -> None:
    d.needs(not d.loop.observed)
    wire = d.pick(d.measured())
    hold = d.loop.ages[0].greatest_ns / 1e9 + d.size(1.5)
    d.components["hold"] = {"fmu": "Sensor", "parameters": {"sample_time": round(hold, 3)}}
    d.parameters("hold")["noise[1]"] = 0.0
    d.wires.append({"from": wire["from"], "to": "hold.u[1]"})
    wire["from"] = "hold.y[1]"


@fault(PARTS, "a sensor with noise, in the way")
def _(d: Draft) -> None:
    d.needs(not d.loop.observed)
    wire = d.pick(d.measured())
    noise = {"sample_time": 0.01, "noise[1]": d.size(0.3)}
    d.components["hold"] = {"fmu": "Sensor", "parameters": noise}
    d.wires.append({"from": wire["from"], "to": "hold.u[1]"})
    wire["from"] = "hold.y[1]"


@fault(PARTS, "a sensor, and then a factor of zero", quick=True)
def _(d: Draft) -> None:
    d.needs(not d.loop.observed)
    wire = d.pick(d.measured())
    d.components["hold"] = {"fmu": "Sensor", "parameters": {"sample_time": 0.01}}
    d.wires.append({"from": wire["from"], "to": "hold.u[1]"})
    wire["from"] = d.computed("made", "0 * 'hold.y[1]'")


@fault(PARTS, "a sensor in the way of the command")
def _(d: Draft) -> None:
    wire = d.pick([x for x in d.commands() if x["to"] != "plant.thruster"])
    slow = {"sample_time": d.size(2.0, 1.5), "noise[1]": 0.0}
    d.components["hold"] = {"fmu": "Sensor", "parameters": slow}
    d.wires.append({"from": wire["from"], "to": "hold.u[1]"})
    wire["from"] = "hold.y[1]"


@fault(PARTS, "a link before the sensor", quick=True)
def _(d: Draft) -> None:
    d.needs(d.loop.observed)
    age = max(x.greatest_ns for x in d.loop.ages) / 1e9
    for wire in d.measured() if d.dice is None else [d.pick(d.measured())]:
        d.relink(wire, "before", transport(round(age + d.size(2.0), 3)))


@fault(PARTS, "a link before the sensor of no delay, that loses")
def _(d: Draft) -> None:
    d.needs(d.loop.observed)
    slow = packet(0.0, round(max(x.greatest_ns for x in d.loop.ages) / 1e9 + d.size(1.0), 2))
    d.relink(d.pick(d.measured()), "before", slow)


@fault(PARTS, "a late link of the command", quick=True)
def _(d: Draft) -> None:
    age = max(x.greatest_ns for x in d.loop.ages) / 1e9
    wire = d.pick(d.commands())
    d.relink(wire, "behind", transport(round(age + d.size(1.0), 3)))


@fault(PARTS, "quantization of a link", quick=True)
def _(d: Draft) -> None:
    wire = d.pick([x for x in d.received() if "link" in x])
    old = d.links[wire["link"]]
    delay = old["delay"]
    d.relink(wire, "coarse", packet(delay, old.get("sample_time", 0.02)))
    d.links["coarse"]["quantization"] = d.size(0.5, 1e-6)


@fault(PARTS, "a loss that is taken for zero", quick=True)
def _(d: Draft) -> None:
    _lossy(d, "zero")


@fault(PARTS, "a loss that is taken for a number")
def _(d: Draft) -> None:
    _lossy(d, d.size(0.5))


def _lossy(d: Draft, what: str | float) -> None:
    for name in {x["link"] for x in d.received() if "link" in x}:
        link = d.links[name]
        if link["kind"] == "transport":
            link |= {"kind": "packet", "sample_time": 0.02}
        link |= {"loss": 0.3, "on_loss": what}


@fault(PARTS, "a watchdog of the link that acts", quick=True)
def _(d: Draft) -> None:
    d.needs(not d.loop.observed)  # a stamp that is zero is older than the one in use
    wire = d.pick([x for x in d.received() if "link" in x])
    delay = d.links[wire["link"]]["delay"]
    d.links[wire["link"]] = packet(delay, 0.25) | {"greatest_age": round(delay + 0.05, 3)}


@fault(PARTS, "a sensor's noise on a connection", quick=True)
def _(d: Draft) -> None:
    _faulty(d, {"noise": d.size(0.3, 1e-6)})


@fault(PARTS, "a sensor's bias on a connection", quick=True)
def _(d: Draft) -> None:
    _faulty(d, {"bias": d.size(0.3, 1e-6)})


@fault(PARTS, "a sensor's drift on a connection")
def _(d: Draft) -> None:
    _faulty(d, {"drift": d.size(0.05, 1e-6)})


@fault(PARTS, "a sensor's resolution on a connection")
def _(d: Draft) -> None:
    _faulty(d, {"resolution": d.size(0.4, 1e-6)})


@fault(PARTS, "a sensor's range on a connection")
def _(d: Draft) -> None:
    _faulty(d, {"least": -d.size(1e-3), "greatest": d.size(1e-3)})


@fault(PARTS, "a sensor on a connection that samples slowly")
def _(d: Draft) -> None:
    age = max(x.greatest_ns for x in d.loop.ages) / 1e9
    _faulty(d, {"sample_time": round(age + d.size(2.0), 3)})


@fault(PARTS, "a sensor on a connection that freezes")
def _(d: Draft) -> None:
    _faulty(d, {"freeze": {"from": 0.3}})


def _faulty(d: Draft, setting: dict[str, object]) -> None:
    d.data.setdefault("sensors", {})["faulty"] = setting
    d.pick(d.measured())["sensor"] = "faulty"


@fault(PARTS, "the command of a sensor on its connection")
def _(d: Draft) -> None:
    wire = d.pick([x for x in d.commands() if x["to"] != "plant.thruster"])
    d.data.setdefault("sensors", {})["faulty"] = {"bias": d.size(0.5, 1e-6)}
    wire["sensor"] = "faulty"


@fault(PARTS, "a measurement is extrapolated", quick=True)
def _(d: Draft) -> None:
    wire = d.pick(d.received())
    if d.links.get(wire.get("link", ""), {}).get("kind") == "packet":
        d.relink(wire, "smooth", transport(d.links[wire["link"]]["delay"]))
    wire["policy"] = "linear"


@fault(PARTS, "a link that interpolates a sampled measurement")
def _(d: Draft) -> None:
    d.needs(d.loop.observed)
    link = d.pick(d.received())["link"]
    step = d.data["run"]["step"]
    d.links[link] = transport(d.links[link]["delay"] + step * d.size(0.371, 0.1))


@fault(PARTS, "a command is extrapolated", quick=True)
def _(d: Draft) -> None:
    d.pick([x for x in d.commands() if "link" not in x])["policy"] = "linear"
