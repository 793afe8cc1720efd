"""Faults of numbers: parameters of plant and controller that are not those of the proof."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path

from falsifier.draft import Draft
from falsifier.faults import fault
from falsifier.parts import SYSTEMS

NUMBERS = "parameters"
AUV = {"mass": 5454.0, "inertia.z": 13587.0, "damping.u": 0.05, "delay.d": 0.5}
"""Of the built-in vehicle; values of a vehicle in a design are not told in the scenario."""


def _designed(d: Draft, name: str) -> float:
    """The number of the design's system, from its file."""
    if name in AUV:
        d.needs(d.loop.name == "station")
        return AUV[name]
    if name == "F.amplitude":
        return 1.0
    system = tomllib.loads(_file(d).read_text("utf-8"))["system"]
    if name.startswith("delay."):
        return float(system["delays"][0]["d"])
    letters, _, rest = name.partition("[")
    row, column = (int(x) for x in rest.rstrip("]").split(","))
    matrix = system["delays"][0]["A"] if letters == "A1" else system[letters]
    return float(matrix[row - 1][column - 1])


def _file(d: Draft) -> Path:
    return SYSTEMS / f"{d.components['plant']['fmu'].removesuffix('-plant.fmu')}.toml"


@fault(NUMBERS, "a number of the plant is much larger", quick=True)
def _(d: Draft) -> None:
    name = d.pick(d.loop.parameters)
    d.parameters("plant")[name] = _designed(d, name) * (1.0 + d.size(5.0, 1e-9))


@fault(NUMBERS, "a number of the plant is much smaller")
def _(d: Draft) -> None:
    name = d.pick([x for x in d.loop.parameters if x not in {"F.amplitude", "delay.d"}])
    value = _designed(d, name)
    d.parameters("plant")[name] = value - abs(value) * d.size(3.0 if name not in AUV else 0.9, 1e-9)


@fault(NUMBERS, "a number of the plant is the next double", quick=True)
def _(d: Draft) -> None:
    name = d.pick([x for x in d.loop.parameters if x not in {"F.amplitude", "delay.d"}])
    d.parameters("plant")[name] = math.nextafter(_designed(d, name), math.inf)


@fault(NUMBERS, "the disturbance enters more strongly", quick=True)
def _(d: Draft) -> None:
    d.needs("C[2,1]" in d.loop.parameters)
    d.parameters("plant")["C[2,1]"] = 1.0 + d.size(19.0, 0.01)


@fault(NUMBERS, "the control enters the other way round")
def _(d: Draft) -> None:
    d.needs("B[2,1]" in d.loop.parameters)
    d.parameters("plant")["B[2,1]"] = -d.size(1.0)


@fault(NUMBERS, "an output of the plant is weighed more")
def _(d: Draft) -> None:
    d.needs("C[2,1]" in d.loop.parameters)
    d.parameters("plant")["D[1,1]"] = 1.0 + d.size(9.0, 0.01)


@fault(NUMBERS, "more uncertainty than is proved", quick=True)
def _(d: Draft) -> None:
    d.needs("F.amplitude" in d.loop.parameters)
    d.parameters("plant")["F.amplitude"] = 1.0 + d.size(40.0, 1e-3)


@fault(NUMBERS, "a plant delay that is too short", quick=True)
def _(d: Draft) -> None:
    d.needs(d.loop.plant_delay == "exactly")
    d.parameters("plant")["delay.d"] = 1.0 - d.size(0.99, 1e-9)


@fault(NUMBERS, "a plant delay that is too long", quick=True)
def _(d: Draft) -> None:
    d.needs(d.loop.plant_delay)
    old = 0.5 if "delay.d" in d.loop.parameters else 1.0
    d.parameters("plant")["delay.d"] = old + d.size(3.0, 1e-9)


@fault(NUMBERS, "no plant delay")
def _(d: Draft) -> None:
    d.needs(d.loop.plant_delay == "exactly")
    d.parameters("plant")["delay.d"] = 0.0


@fault(NUMBERS, "a coarse integration of the plant", quick=True)
def _(d: Draft) -> None:
    d.needs(d.loop.name == "stiff")  # elsewhere a communication step is fine enough
    d.parameters("plant")["solver.step"] = d.size(1.0, 0.05)


OVERWRITTEN = "the numbers of [design] replace it before the run"


@fault(NUMBERS, "another gain in the controller", quick=True)
def _(d: Draft) -> None:
    d.needs("design" not in d.data)
    d.parameters("controller")["K[1,1]"] = d.pick([1.0, 0.0, -100.0])


@fault(NUMBERS, "a gain in the controller beside [design]", covered=OVERWRITTEN)
def _(d: Draft) -> None:
    d.needs("design" in d.data)
    d.parameters("controller")["K[1,1]"] = d.pick([7.0, 0.0, -0.5])


@fault(NUMBERS, "a model of the observer that is another", quick=True)
def _(d: Draft) -> None:
    d.needs(d.loop.observed and "design" not in d.data)
    name = d.pick(["A[2,1]", "A[1,2]", "B[2,1]"])
    d.parameters("controller")[name] = d.pick([-5.0, 3.0])


@fault(NUMBERS, "a model of the observer beside [design]", covered=OVERWRITTEN)
def _(d: Draft) -> None:
    d.needs(d.loop.observed and "design" in d.data)
    name = d.pick(["A[2,1]", "A[1,2]"])
    d.parameters("controller")[name] = d.pick([-5.0, 3.0])


@fault(NUMBERS, "a measurement of the observer that is another")
def _(d: Draft) -> None:
    d.needs(d.loop.observed and "design" not in d.data)
    d.parameters("controller")[f"C.{d.pick(d.sensors())}[1,1]"] = d.pick([-1.0, 0.3])


@fault(NUMBERS, "an injection that is another", quick=True)
def _(d: Draft) -> None:
    d.needs(d.loop.observed and "design" not in d.data)
    d.parameters("controller")[f"L.{d.pick(d.sensors())}[2,1]"] = d.pick([-4.0, 0.0, 40.0])


@fault(NUMBERS, "an injection beside [design]", covered=OVERWRITTEN)
def _(d: Draft) -> None:
    d.needs(d.loop.observed and "design" in d.data)
    d.parameters("controller")[f"L.{d.pick(d.sensors())}[2,1]"] = d.pick([-4.0, 0.0, 40.0])


@fault(NUMBERS, "a delay of commands that the observer takes wrongly", quick=True)
def _(d: Draft) -> None:
    d.needs(d.loop.observed)
    old = d.parameters("controller").get("command.delay", 0.0)
    d.parameters("controller")["command.delay"] = old + d.size(0.5, 0.02)


@fault(NUMBERS, "a watchdog of the observer that acts")
def _(d: Draft) -> None:
    d.needs(d.loop.observed)
    d.parameters("controller")[f"age.{d.pick(d.sensors())}"] = 0.005


@fault(NUMBERS, "a thrust map without surge", quick=True)
def _(d: Draft) -> None:
    d.needs(d.loop.name.startswith("auv") or d.loop.name == "station")
    d.parameters("controller")["thrust_map[1,1]"] = 0.0


@fault(NUMBERS, "a limit that is reached", quick=True)
def _(d: Draft) -> None:
    limits = {"limited": "limit.u[1]", "station": "limit.force"}
    d.needs(d.loop.name in limits)
    d.parameters("controller")[limits[d.loop.name]] = d.size(0.2, 0.01)


@fault(NUMBERS, "a state outside the envelope", quick=True)
def _(d: Draft) -> None:
    d.needs(d.loop.name == "station")
    d.parameters("plant")["initial.nu.u"] = d.size(2.0, 0.2)
