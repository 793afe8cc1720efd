"""Every kind of loop that the falsifier attacks."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from typing import Any

from falsifier.loop import MS, Age, Data, Loop, packet, transport, wire
from falsifier.parts import LIMIT
from falsifier.vehicles import vehicles


def _scenario(name: str, words: str, wires: list[Data], links: Data, end: float) -> Data:
    return {
        "title": words,
        "run": {"end": end, "step": 0.01},
        "components": {
            "plant": {"fmu": f"{name}-plant.fmu", "parameters": {"initial.x[1]": 0.5}},
            "controller": {"fmu": f"{name}-controller.fmu", "parameters": {}},
        },
        "connections": wires,
        "links": links,
        "design": {"file": f"{name}.json"},
    }


def _driven(data: Data) -> Data:
    """From rest, with a pulse of two seconds in the disturbance."""
    found = deepcopy(data)
    for part in found["components"].values():
        parameters = part.get("parameters", {})
        for name in [x for x in parameters if x.startswith("initial.")]:
            del parameters[name]
    pulse = {"times": [0.0, 0.5, 2.5], "values": {"plant.w[1]": [0.0, 1.0, 0.0]}}
    found["inputs"] = [pulse | {"interpolation": "hold"}]
    return found


def _feedback(
    name: str,
    words: str,
    links: Data,
    ages: tuple[Age, ...],
    *,
    end: float = 15.0,
    **more: Any,
) -> Loop:
    wires = [wire(f"plant.x[{j}]", f"controller.x[{j}]", "up") for j in (1, 2)]
    wires.append(wire("controller.u[1]", "plant.u[1]"))
    data = _scenario(name, words, wires, links, end)
    return Loop(name, words, data, _driven(data), ages, **more)


def _both(greatest_ms: int, least_ms: int = 0) -> tuple[Age, ...]:
    return (Age("x", ("x[1]", "x[2]"), "up", greatest_ms * MS, least_ms * MS),)


def _output(
    name: str,
    words: str,
    sensors: dict[str, tuple[str, ...]],
    links: Data,
    ages: tuple[Age, ...],
    *,
    down: str | None = None,
    end: float = 15.0,
    noise: float = 0.0,
    **more: Any,
) -> Loop:
    """An observer with a sensor for each measurement: its name -> the states it takes in."""
    wires = []
    for sensor, states in sensors.items():
        wires += [wire(f"plant.{x}", f"{sensor}.u[{j}]") for j, x in enumerate(states, 1)]
        count = range(1, len(states) + 1)
        wires += [wire(f"{sensor}.y[{j}]", f"controller.{sensor}[{j}]", sensor) for j in count]
        wires.append(wire(f"{sensor}.stamp", f"controller.stamp.{sensor}", sensor))
    wires.append(wire("controller.u[1]", "plant.u[1]", down))
    data = _scenario(name, words, wires, links, end)
    quiet = {"sample_time": 0.02, "noise[1]": noise}
    data["components"] |= {x: {"fmu": "Sensor", "parameters": dict(quiet)} for x in sensors}
    data["components"]["controller"]["parameters"] = {
        "initial.estimate[1]": 0.4,
        "sample_time": 0.02,
    }
    return Loop(name, words, data, _driven(data), ages, **more)


def _stamped(name: str, greatest_ms: int, least_ms: int = 0) -> Age:
    return Age(name, (f"stamp.{name}",), name, greatest_ms * MS, least_ms * MS)


def _command(greatest_ms: int) -> Age:
    return Age("command", ("u[1]",), "down", greatest_ms * MS)


def _any() -> Loop:
    return _feedback("any", "any age", {"up": packet(0.05)}, _both(300))


def _with_limits() -> Loop:
    """The commands have limits, which are not reached."""
    one = _feedback("any", "limits of the commands", {"up": packet(0.05)}, _both(300))
    runs = [deepcopy(one.scenario), deepcopy(one.driven) or {}]
    for data in runs:
        data["components"]["controller"]["fmu"] = "limited-controller.fmu"
        data["components"]["controller"]["parameters"]["limit.u[1]"] = LIMIT
    return Loop("limited", one.words, *runs, one.ages)


def _analysed() -> Loop:
    """The gain is given in the scenario, and analysed for its system file."""
    one = _feedback("any", "gain in the scenario", {"up": packet(0.05)}, _both(300))
    runs = [deepcopy(one.scenario), deepcopy(one.driven) or {}]
    for data in runs:
        data["design"] = {"system": "any.toml", "gain": [[-3.4, -2.6]]}
    return Loop("analysed", one.words, *runs, one.ages)


def _without_design(loop: Loop, name: str, words: str) -> Loop:
    """The same loop, whose design is that in its controller's FMU."""
    runs = [deepcopy(loop.scenario), deepcopy(loop.driven) or {}]
    for data in runs:
        del data["design"]
    return replace(loop, name=name, words=words, scenario=runs[0], driven=runs[1])


def _two() -> Loop:
    return _output(
        "two",
        "two measurements",
        {"position": ("x[1]",), "speed": ("x[2]",)},
        {"position": packet(0.04, 0.02), "speed": packet(0.02, 0.02)},
        (_stamped("position", 200), _stamped("speed", 100), _command(100)),
    )


def _mapped() -> Loop:
    """A measurement of a combination of states: its C is in the connections, before the sensor."""
    found = _output(
        "mapped",
        "measurement of x1 + 0.5 x2",
        {"mixed": ("x[1]", "x[2]")},
        {"mixed": transport(0.02)},
        (_stamped("mixed", 200), _command(100)),
    )
    for data in (found.scenario, found.driven or {}):
        wires = data["connections"]
        wires[0] |= {"add": True}
        wires[1] |= {"to": "mixed.u[1]", "add": True, "gain": 0.5}
        del wires[3]  # there is one value
    return found


def _played() -> Loop:
    """Commands act by play-out, which the observer knows."""
    found = _output(
        "remote",
        "commands by play-out",
        {"position": ("x[1]",), "speed": ("x[2]",)},
        {"position": transport(0.02), "speed": transport(0.02), "down": packet(0.04, 0.02)},
        (_stamped("position", 100), _stamped("speed", 100), _command(250)),
        down="down",
    )
    for data in (found.scenario, found.driven or {}):
        data["links"]["down"]["playout"] = 0.1
        data["components"]["controller"]["parameters"]["command.delay"] = 0.1
    return replace(found, name="played")


def _stiff() -> Loop:
    """A plant whose integration matters at the communication step."""
    found = _feedback("stiff", "a stiff plant", {"up": packet(0.05)}, _both(300), end=20.0)
    for data in (found.scenario, found.driven or {}):
        data["run"]["step"] = 0.05
    return replace(found, parameters=("A[1,1]", "B[2,1]", "C[2,1]"))


SAMPLED = "a measurement that is held is no constant age"
LOOPS: tuple[Loop, ...] = (
    _any(),
    _stiff(),
    _without_design(_any(), "packed", "design in the controller"),
    _with_limits(),
    _analysed(),
    _feedback("least", "any age from a least one", {"up": packet(0.45)}, _both(600, 400)),
    _feedback(
        "sampled", "sampled from a least age", {"up": packet(0.39)}, _both(600, 400), end=90.0
    ),
    _feedback(
        "uncertain",
        "uncertainty in the plant",
        {"up": packet(0.05)},
        _both(300),
        parameters=("A[2,1]", "B[2,1]", "C[2,1]", "E[2,1]", "H[1,1]", "F.amplitude"),
    ),
    _feedback(
        "exact",
        "plant delay exactly 1 s",
        {"up": packet(0.05)},
        _both(200),
        end=150.0,
        plant_delay="exactly",
        parameters=("A[2,1]", "A1[2,1]", "B[2,1]", "C[2,1]"),
    ),
    _feedback(
        "upto",
        "plant delay up to 1 s",
        {"up": packet(0.05)},
        _both(200),
        plant_delay="up to",
        parameters=("A[2,1]", "A1[2,1]", "B[2,1]", "C[2,1]"),
    ),
    _feedback(
        "structured",
        "an age for each state",
        {"up": packet(0.02, 0.02)},
        (Age("x[2]", ("x[2]",), "up", 100 * MS),),
    ),
    _feedback("integral", "integral action", {"up": packet(0.02, 0.02)}, _both(150)),
    _feedback(
        "immediate",
        "at once",
        {"up": transport(0.0)},
        _both(0),
        unproved="the coupling makes every age at least a step",
    ),
    _output(
        "one",
        "one measurement with noise",
        {"position": ("x[1]",)},
        {"position": transport(0.02)},
        (_stamped("position", 200), _command(100)),
        noise=0.001,
    ),
    _two(),
    _output(
        "inner",
        "observer, plant delay exactly 1 s",
        {"position": ("x[1]",)},
        {"position": transport(0.02)},
        (_stamped("position", 200), _command(100)),
        end=150.0,
        plant_delay="exactly",
        parameters=("A[2,1]", "A1[2,1]", "B[2,1]", "C[2,1]"),
    ),
    _output(
        "constant",
        "constant age of 1 s",
        {"position": ("x[1]",)},
        {"position": transport(0.95)},
        (_stamped("position", 1000, 1000),),
        end=100.0,
        unproved=SAMPLED,
    ),
    _without_design(_two(), "inside", "design in the observer"),
    _mapped(),
    _played(),
    *vehicles(),
)
