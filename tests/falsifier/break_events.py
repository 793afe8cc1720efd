"""Faults by events, modes and set-points: what happens to the loop while it runs."""

from __future__ import annotations

from falsifier.draft import Draft
from falsifier.faults import fault

EVENTS = "events"


@fault(EVENTS, "the gain is set", quick=True)
def _(d: Draft) -> None:
    d.event(at=d.size(0.5), set={"controller.K[1,1]": 0.0})


@fault(EVENTS, "a number of the plant is set")
def _(d: Draft) -> None:
    name = d.pick([x for x in d.loop.parameters if x != "F.amplitude"])
    d.event(at=d.size(0.5), set={f"plant.{name}": 3.0})


@fault(EVENTS, "the control is overridden for a while", quick=True)
def _(d: Draft) -> None:
    wire = d.pick(d.commands())
    name = wire["to"] if wire["to"] != "plant.thruster" else "plant.thruster.surge"
    d.event(at=0.5, **{"for": d.size(10.0, 0.05), "override": {name: 0.0}})


@fault(EVENTS, "the control has a bias")
def _(d: Draft) -> None:
    wire = d.pick([x for x in d.commands() if x["to"] != "plant.thruster"])
    d.event(at=0.5, bias={wire["to"]: {"offset": d.size(0.5, 1e-6), "factor": d.size(1.0)}})


@fault(EVENTS, "a measurement has a bias", quick=True)
def _(d: Draft) -> None:
    wire = d.pick(d.received())
    d.event(at=0.5, bias={wire["to"]: {"offset": d.size(0.5, 1e-6)}})


@fault(EVENTS, "an output of the plant is overridden")
def _(d: Draft) -> None:
    wire = d.pick(d.measured())
    d.event(at=0.5, override={wire["from"]: d.size(0.01)})


@fault(EVENTS, "a measurement freezes")
def _(d: Draft) -> None:
    d.event(when=f"t > {d.size(1.0)}", freeze=[d.pick(d.received())["to"]])


@fault(EVENTS, "a command freezes")
def _(d: Draft) -> None:
    wire = d.pick([x for x in d.commands() if x["to"] != "plant.thruster"])
    d.event(at=d.size(0.5), freeze=[wire["to"]])


@fault(EVENTS, "a stamp is overridden")
def _(d: Draft) -> None:
    wire = d.pick(d.stamps())
    d.event(at=d.size(1.0), override={wire["to"]: 0.5})


@fault(EVENTS, "the controller is reset")
def _(d: Draft) -> None:
    d.event(at=d.size(0.4, 0.1), reset=["controller"])


@fault(EVENTS, "the plant is reset")
def _(d: Draft) -> None:
    d.event(at=d.size(2.0), reset=["plant"])


@fault(EVENTS, "a mode overrides the control")
def _(d: Draft) -> None:
    wire = d.pick([x for x in d.commands() if x["to"] != "plant.thruster"])
    idle = {"enter": {"override": {wire["to"]: 0.0}}}
    d.data["modes"] = {
        "phase": {
            "initial": "steer",
            "states": {"steer": {}, "idle": idle},
            "transitions": [{"from": "steer", "to": "idle", "when": f"t > {d.size(1.0)}"}],
        }
    }


@fault(EVENTS, "a series drives the state")
def _(d: Draft) -> None:
    d.event(at=0.5, bias={f"plant.{d.loop.states[0]}": {"offset": d.size(0.3, 1e-6)}})
