"""Faults of the wiring: what feeds each input of the loop."""

from __future__ import annotations

from copy import deepcopy

from falsifier.draft import Draft
from falsifier.faults import fault

WIRING = "wiring"


@fault(WIRING, "a measured state is not connected", quick=True)
def _(d: Draft) -> None:
    d.wires.remove(d.pick(d.measured()))


@fault(WIRING, "a measurement does not reach the controller")
def _(d: Draft) -> None:
    d.needs(d.loop.observed)
    d.wires.remove(d.pick(d.received()))


@fault(WIRING, "a command is not connected")
def _(d: Draft) -> None:
    d.wires.remove(d.pick(d.commands()))


@fault(WIRING, "a stamp is not connected", quick=True)
def _(d: Draft) -> None:
    d.wires.remove(d.pick(d.stamps()))


@fault(WIRING, "an input has a start value in place of a wire")
def _(d: Draft) -> None:
    wire = d.pick(d.received())
    d.wires.remove(wire)
    component, _, name = wire["to"].partition(".")
    d.parameters(component)[name] = d.size(0.1)


@fault(WIRING, "a state is measured in place of another", quick=True)
def _(d: Draft) -> None:
    wire = d.pick(d.measured())
    others = [f"plant.{x}" for x in d.loop.states if f"plant.{x}" != wire["from"]]
    wire["from"] = d.pick(others)


@fault(WIRING, "two measurements are swapped")
def _(d: Draft) -> None:
    wires = d.received()
    d.needs(len(wires) > 1)
    one = d.pick(wires)
    two = d.pick([x for x in wires if x is not one])
    one["to"], two["to"] = two["to"], one["to"]


@fault(WIRING, "two stamps are swapped")
def _(d: Draft) -> None:
    wires = d.stamps()
    d.needs(len(wires) > 1)
    wires[0]["to"], wires[1]["to"] = wires[1]["to"], wires[0]["to"]


@fault(WIRING, "two commands are swapped")
def _(d: Draft) -> None:
    wires = d.commands()
    d.needs(len(wires) > 1)
    wires[0]["to"], wires[1]["to"] = wires[1]["to"], wires[0]["to"]


def _twin(d: Draft) -> None:
    """Add a second plant at rest."""
    part = deepcopy(d.components["plant"])
    part["parameters"] = {
        x: y for x, y in part.get("parameters", {}).items() if not x.startswith("initial.")
    }
    d.components["twin"] = part


@fault(WIRING, "a state of another plant is measured", quick=True)
def _(d: Draft) -> None:
    _twin(d)
    wire = d.pick(d.measured())
    wire["from"] = wire["from"].replace("plant.", "twin.", 1)


@fault(WIRING, "another plant is steered", quick=True)
def _(d: Draft) -> None:
    _twin(d)
    for wire in d.commands():
        wire["to"] = wire["to"].replace("plant.", "twin.", 1)


@fault(WIRING, "a twin plant adds its state to a measured one")
def _(d: Draft) -> None:
    _twin(d)
    d.parameters("twin")[d.pick(d.loop.initial)] = d.size(0.5)
    wire = d.pick(d.measured())
    wire["add"] = True
    d.wires.append(wire | {"from": wire["from"].replace("plant.", "twin.", 1)})


@fault(WIRING, "a measurement comes from a time series", quick=True)
def _(d: Draft) -> None:
    wire = d.pick(d.received())
    d.wires.remove(wire)
    d.series(wire["to"], [0.0, 1.0], [0.0, d.size(0.1)])


@fault(WIRING, "a sensor follows a time series")
def _(d: Draft) -> None:
    d.needs(d.loop.observed)
    wire = d.pick(d.measured())
    d.wires.remove(wire)
    d.series(wire["to"], [0.0, 1.0], [0.0, d.size(0.1)])


@fault(WIRING, "the command comes from a time series")
def _(d: Draft) -> None:
    wire = d.pick(d.commands())
    d.needs(wire["to"] != "plant.thruster")
    d.wires.remove(wire)
    d.series(wire["to"], [0.0, 1.0], [0.0, d.size(0.1)])


@fault(WIRING, "a computed value of zero is measured", quick=True)
def _(d: Draft) -> None:
    wire = d.pick(d.measured())
    wire["from"] = d.computed("made", f"0 * '{wire['from']}'")


@fault(WIRING, "a computed value that is turned is measured")
def _(d: Draft) -> None:
    wire = d.pick(d.measured())
    wire["from"] = d.computed("made", f"-{d.size(1.0)} * '{wire['from']}'")


@fault(WIRING, "a computed value with a wave is measured")
def _(d: Draft) -> None:
    wire = d.pick(d.measured())
    wire["from"] = d.computed("made", f"'{wire['from']}' + {d.size(0.2)} * sin(3 * t)")


@fault(WIRING, "the command is computed anew")
def _(d: Draft) -> None:
    wire = d.pick([x for x in d.commands() if x["to"] != "plant.thruster"])
    wire["from"] = d.computed("made", f"-{d.size(0.5)} * '{wire['from']}'")


def _rogue(d: Draft) -> None:
    """Add another controller, with a gain of its own, fed by the plant at once."""
    d.needs(d.loop.states == ("x[1]", "x[2]") and len(d.loop.controls) == 1)
    gain = {"K[1,1]": d.size(0.6), "K[1,2]": 0.5}
    d.components["rogue"] = {"fmu": "PaperController", "parameters": gain}
    for x in d.loop.states:
        d.wires.append({"from": f"plant.{x}", "to": f"rogue.{x}"})


@fault(WIRING, "another controller steers, the designed one listens", quick=True)
def _(d: Draft) -> None:
    _rogue(d)
    d.pick(d.commands())["from"] = "rogue.u[1]"


@fault(WIRING, "a second controller adds to the command", quick=True)
def _(d: Draft) -> None:
    _rogue(d)
    wire = d.pick(d.commands())
    wire["add"] = True
    d.wires.append({"from": "rogue.u[1]", "to": wire["to"], "add": True})


@fault(WIRING, "the controller is another component")
def _(d: Draft) -> None:
    d.needs("design" in d.data and not d.loop.observed)
    d.needs(d.loop.states == ("x[1]", "x[2]"))
    d.components["idle"] = deepcopy(d.components["controller"])
    d.data["design"]["controller"] = "idle"
    d.components["controller"] = {
        "fmu": "PaperController",
        "parameters": {"K[1,1]": d.size(0.6), "K[1,2]": 0.5},
    }


@fault(WIRING, "the disturbance follows the state", quick=True)
def _(d: Draft) -> None:
    target = f"plant.{d.pick(d.loop.disturbances)}"
    taken = [x for x in d.wires if x["to"] == target]
    named = [y for x in d.data.get("inputs", []) for y in x.get("values", {})]
    d.needs(not taken and target not in named)
    source = f"plant.{d.loop.states[0]}"
    d.wires.append({"from": source, "to": target, "gain": d.size(50.0, 10.0)})
