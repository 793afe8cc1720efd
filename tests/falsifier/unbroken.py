"""Changes that break no hypothesis: a run with one of them must still claim its guarantee."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass

from falsifier.draft import Draft
from falsifier.loop import packet


@dataclass(frozen=True)
class Variant:
    """One change that the proof covers.

    Attributes
    ----------
    name : what is changed.
    why : why the proof covers it.
    apply : changes a draft.
    options : of the run.
    quick : whether it is in the small share.
    """

    name: str
    why: str
    apply: Callable[[Draft], None]
    options: dict[str, str]
    quick: bool = False


VARIANTS: list[Variant] = []


def variant(
    name: str, why: str, *, quick: bool = False, **options: str
) -> Callable[[Callable[[Draft], None]], Callable[[Draft], None]]:
    """Add a function that changes a draft to the list."""

    def add(apply: Callable[[Draft], None]) -> Callable[[Draft], None]:
        VARIANTS.append(Variant(name, why, apply, options, quick))
        return apply

    return add


@variant("a later start", "every time is counted from the start", quick=True)
def _(d: Draft) -> None:
    d.needs("inputs" not in d.data and "reference" not in d.data)
    start = d.size(100.0)
    d.data["run"]["start"] = start
    d.data["run"]["end"] += start


@variant("an event sets the disturbance", "w is anything in L2", quick=True)
def _(d: Draft) -> None:
    target = f"plant.{d.pick(d.loop.disturbances)}"
    taken = [x for x in d.wires if x["to"] == target]
    d.needs(not taken and "inputs" not in d.data)
    d.event(at=1.0, **{"for": 0.5, "set": {target: d.size(0.02)}})


@variant("an event overrides the disturbance", "w is anything in L2")
def _(d: Draft) -> None:
    wires = [x["to"] for x in d.wires if x["to"].startswith("plant.disturbance")]
    given = [y for x in d.data.get("inputs", []) for y in x.get("values", {})]
    d.event(at=1.0, **{"for": 0.5, "override": {d.pick(wires + given): d.size(0.02)}})


@variant("Gauss-Seidel in default order", "it makes ages shorter, which are measured", quick=True)
def _(d: Draft) -> None:
    # a sensor would stamp what is newer than its stamp, and a sampled age is of its rhythm
    d.needs(not d.loop.observed and d.loop.name != "sampled")
    d.data["run"]["algorithm"] = "gauss-seidel"


@variant("the plant has a step of its own", "the age grows by it, and is measured", quick=True)
def _(d: Draft) -> None:
    d.needs(d.loop.name not in {"sampled", "station"})  # of a grid, and of little to spare
    d.needs(d.loop.name not in {"auv-remote", "auv-survey"})  # they know when commands act
    d.components["plant"]["step"] = 2 * d.data["run"]["step"]


@variant("half the communication step", "no proof is about it")
def _(d: Draft) -> None:
    d.needs(d.loop.name != "sampled")  # the step is a part of its least age
    d.data["run"]["step"] /= 2


@variant("losses within the bound", "what is held grows older, which is measured", quick=True)
def _(d: Draft) -> None:
    name = d.pick([x["link"] for x in d.received() if "link" in x])
    d.needs(d.loop.name not in {"auv-remote", "auv-survey"})
    old = d.links[name]
    often = {"loss": 0.05, "seed": 3}
    delay = old["delay"] if d.loop.name in {"sampled", "least"} else 0.0
    d.links[name] = packet(delay, 0.02) | often
    d.needs(d.loop.name != "station")


def _beside_the_steps(d: Draft) -> str:
    """A link whose arrivals may lie between steps."""
    d.needs(d.loop.name != "sampled")  # its settings justify a sampled age on the grid alone
    d.needs(d.loop.name != "auv-survey")  # what is measured on board is as old as it may be
    name: str = d.pick([x["link"] for x in d.received() if "link" in x])
    if d.loop.observed and d.links[name]["kind"] == "transport":
        d.links[name] = packet(d.links[name]["delay"], 0.02)  # the other kind interpolates
    return name


@variant("a link of no whole number of steps", "arrivals are points of their own", quick=True)
def _(d: Draft) -> None:
    name = _beside_the_steps(d)
    d.links[name]["delay"] += d.size(0.00371)


@variant("a link on a grid", "the rounding is a part of the age, which is measured")
def _(d: Draft) -> None:
    name = _beside_the_steps(d)
    d.links[name]["delay"] += d.size(0.00371)
    d.data["run"]["events"] = "grid"


@variant("messages that overtake each other", "any age within the bound is covered")
def _(d: Draft) -> None:
    d.needs(d.loop.name in {"any", "packed", "limited", "analysed", "upto", "two"})
    name = d.loop.ages[0].link
    d.links[name] = packet(0.0, 0.02) | {
        "jitter": {"kind": "uniform", "width": 0.05},
        "order": "newest-wins",
    }


@variant("a finer integration", "it is no coarser than what is compared with", quick=True)
def _(d: Draft) -> None:
    d.parameters("plant")["solver.step"] = 0.001


@variant("a controller that holds within the bound", "the hold is a part of the age")
def _(d: Draft) -> None:
    d.needs(d.loop.name in {"any", "packed", "limited", "analysed", "upto", "exact", "uncertain"})
    d.parameters("controller")["sample_time"] = 0.04


@variant("another plant beside the loop", "nothing of it acts on the loop", quick=True)
def _(d: Draft) -> None:
    d.components["twin"] = deepcopy(d.components["plant"])


@variant("another plant that listens to the command", "nothing of it acts on the loop")
def _(d: Draft) -> None:
    d.needs(d.loop.name != "inside")  # without [design], two that listen are no one's plant
    d.components["twin"] = deepcopy(d.components["plant"])
    for wire in d.commands():
        target = wire["to"].replace("plant.", "twin.", 1)
        d.wires.append({"from": wire["from"], "to": target})


@variant("a computed value that nothing takes", "nothing of it acts on the loop", quick=True)
def _(d: Draft) -> None:
    d.computed("shown", f"2 * 'plant.{d.loop.states[0]}'")


@variant("a link to a listener", "nothing of it acts on the loop")
def _(d: Draft) -> None:
    d.components["listener"] = {"fmu": "Sensor", "parameters": {"sample_time": 0.1}}
    d.links["aside"] = packet(1.0, 0.3) | {"loss": 0.5}
    d.wires.append({"from": f"plant.{d.loop.states[0]}", "to": "listener.u[1]", "link": "aside"})


@variant("another initial state", "the proof is of every initial state", quick=True)
def _(d: Draft) -> None:
    d.needs("inputs" not in d.data and d.loop.initial[0] == "initial.x[1]")
    d.parameters("plant")["initial.x[1]"] = -d.size(3.0)
    d.parameters("plant")["initial.x[2]"] = 1.0


@variant("another initial estimate", "the proof is of every initial state")
def _(d: Draft) -> None:
    d.needs(d.loop.observed and "inputs" not in d.data)
    taken_for = d.parameters("controller")
    first = taken_for.get("initial.estimate[1]", 0.0)
    # a vehicle that is taken to be far from where it is leaves its envelope
    taken_for["initial.estimate[1]"] = round(first - d.size(0.1), 6)


@variant("another seed", "every noise that is declared is covered")
def _(d: Draft) -> None:
    d.data["run"]["seed"] = 12


@variant("connections in another order", "an order of writing says nothing", quick=True)
def _(d: Draft) -> None:
    d.wires.reverse()


@variant("an assertion", "it looks on")
def _(d: Draft) -> None:
    d.data["assertions"] = [{"always": f"abs(plant.{d.loop.states[0]}) < 1000"}]


@variant("an event that stops the run", "what was flown was flown as designed")
def _(d: Draft) -> None:
    d.event(at=d.data["run"]["end"] * 0.8, stop="enough")


@variant("less uncertainty", "the proof is of every F with F'F <= 1")
def _(d: Draft) -> None:
    d.needs("F.amplitude" in d.loop.parameters)
    d.parameters("plant")["F.amplitude"] = d.size(0.5)


@variant("a shorter plant delay where shorter ones are proved", "up to its bound", quick=True)
def _(d: Draft) -> None:
    d.needs(d.loop.plant_delay == "up to")
    d.parameters("plant")["delay.d"] = d.size(0.1)


@variant("numbers of the plant as they are", "a parameter that is written out is the same one")
def _(d: Draft) -> None:
    d.needs("A[2,1]" in d.loop.parameters)
    d.parameters("plant")["B[2,1]"] = 1.0


@variant("the engine in Python", "the results are the same, bit for bit", engine="python")
def _(d: Draft) -> None:
    d.needs(d.loop.name in {"any", "two"})


def _flavoured(d: Draft, flavour: str) -> None:
    d.needs(d.loop.name in {"any", "two"})
    for name in ("plant", "controller"):
        d.components[name]["fmu"] = f"{d.loop.name}-{name}-{flavour}.fmu"


@variant("FMUs of FMI 3.0", "the equations are the same", flavour="native-fmi3")
def _(d: Draft) -> None:
    _flavoured(d, "native-fmi3")


@variant("FMUs in Python", "the equations are the same", flavour="python")
def _(d: Draft) -> None:
    _flavoured(d, "python")


@variant("steps side by side", "the results are the same, bit for bit")
def _(d: Draft) -> None:
    d.data["run"]["threads"] = 2


@variant("an outage within the bound", "the traffic of a link is no assumption", quick=True)
def _(d: Draft) -> None:
    d.needs(d.loop.ages[0].greatest_ns < 1_000_000_000)
    name = d.pick([x["link"] for x in d.received() if "link" in x])
    d.needs(d.loop.name not in {"sampled", "least", "auv-remote", "auv-survey"})
    d.links[name] = packet(0.0, 0.02)
    d.event(at=1.0, outage=[name], **{"for": 0.02})


@variant("an age of its own for each state", "each is proved for its own", quick=True)
def _(d: Draft) -> None:
    d.needs(d.loop.name == "structured")
    d.relink(d.received()[0], "slow", packet(0.15, 0.05))
