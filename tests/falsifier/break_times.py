"""Faults of times: ages beyond their bounds, starts that hide them, rates and order of exchange."""

from __future__ import annotations

from falsifier.draft import Draft
from falsifier.faults import fault
from falsifier.loop import Age, packet, transport

AGES, STARTS, RATES = "ages", "starts", "rates"


def _link(d: Draft, age: Age) -> str:
    """The link of an age, made where there is none."""
    if age.link not in d.links:
        for wire in d.commands():
            d.relink(wire, age.link, transport(0.0))
    return age.link


@fault(AGES, "too old by a slow link", quick=True)
def _(d: Draft) -> None:
    age = d.pick(d.loop.ages)
    link = d.links[_link(d, age)]
    link.pop("playout", None)
    link["delay"] = round(age.greatest_ns / 1e9 + d.size(1.0, 0.001), 6)


@fault(AGES, "the second one is too old by a slow link", quick=True)
def _(d: Draft) -> None:
    d.needs(len(d.loop.ages) > 1)
    age = d.loop.ages[1]
    link = d.links[_link(d, age)]
    link.pop("playout", None)
    link["delay"] = round(age.greatest_ns / 1e9 + d.size(1.0, 0.001), 6)


@fault(AGES, "too old by rare messages", quick=True)
def _(d: Draft) -> None:
    age = d.pick(d.loop.ages)
    seldom = round(age.greatest_ns / 1e9 + d.size(1.5, 0.01), 2)
    d.links[_link(d, age)] = packet(0.0, seldom)


@fault(AGES, "too old by losses")
def _(d: Draft) -> None:
    age = d.loop.ages[0]
    link = d.links[_link(d, age)]
    if link["kind"] == "transport":
        link |= {"kind": "packet", "sample_time": 0.02}
    link["loss"] = d.size(0.97, 0.93)
    d.needs(age.greatest_ns < 2e9)


@fault(AGES, "too old by an event", quick=True)
def _(d: Draft) -> None:
    age = d.pick(d.loop.ages)
    late = round(age.greatest_ns / 1e9 + d.size(1.0, 0.001), 6)
    d.links[_link(d, age)].pop("playout", None)
    d.event(at=d.size(3.0), delay={age.link: late})


@fault(AGES, "too old by an outage")
def _(d: Draft) -> None:
    age = d.pick(d.loop.ages)
    d.needs(age.greatest_ns < 2e9)
    link = d.links[_link(d, age)]
    if link["kind"] == "transport":
        link |= {"kind": "packet", "sample_time": 0.02}
    d.event(at=2.0, outage=[age.link], **{"for": age.greatest_ns / 1e9 + d.size(5.0, 0.3)})


@fault(AGES, "too old by an outage on a condition")
def _(d: Draft) -> None:
    age = d.pick(d.loop.ages)
    d.needs(age.greatest_ns < 2e9)
    link = d.links[_link(d, age)]
    if link["kind"] == "transport":
        link |= {"kind": "packet", "sample_time": 0.02}
    d.event(when=f"t > {d.size(2.0)}", outage=[age.link])


@fault(AGES, "too young", quick=True)
def _(d: Draft) -> None:
    age = d.pick([x for x in d.loop.ages if x.least_ns])
    d.links[age.link]["delay"] = round(max(0.0, age.least_ns / 1e9 - d.size(0.9, 0.03)), 3)


@fault(AGES, "too young by an event")
def _(d: Draft) -> None:
    age = d.pick([x for x in d.loop.ages if x.least_ns])
    young = round(max(0.0, age.least_ns / 1e9 - d.size(0.9, 0.03)), 3)
    d.event(at=3.0, delay={age.link: young})


@fault(AGES, "jitter where a sampled age is proved", quick=True)
def _(d: Draft) -> None:
    d.needs(d.loop.name == "sampled")
    d.links["up"]["jitter"] = {"kind": "uniform", "width": d.size(0.1, 0.02)}


@fault(AGES, "a hold of the controller that is too long", quick=True)
def _(d: Draft) -> None:
    d.needs(d.loop.name != "auv-survey")
    long = max(x.greatest_ns for x in d.loop.ages) / 1e9 + d.size(1.5, 0.05)
    d.parameters("controller")["sample_time"] = round(long, 2)


@fault(AGES, "a slow sensor")
def _(d: Draft) -> None:
    d.needs(d.loop.observed)
    age = d.pick([x for x in d.loop.ages if x.name in d.sensors()])
    slow = round(age.greatest_ns / 1e9 + d.size(1.5, 0.05), 2)
    d.parameters(age.name)["sample_time"] = slow
    d.needs(slow < d.data["run"]["end"] / 2)


@fault(AGES, "the previous value is used, over a slow step")
def _(d: Draft) -> None:
    wire = d.pick([x for x in d.received() if "link" not in x] or d.commands())
    d.needs("link" not in wire)
    wire["policy"] = "previous"
    slow = max(x.greatest_ns for x in d.loop.ages) / 1e9
    d.needs(slow < 2.0)
    d.components["controller"]["step"] = round(slow, 2)


@fault(STARTS, "a later start hides that it is too old", quick=True)
def _(d: Draft) -> None:
    age = d.loop.ages[0]
    d.data["run"]["start"] = d.size(5.0, 0.06)
    d.data["run"]["end"] += d.data["run"]["start"]
    link = d.links[_link(d, age)]
    link.pop("playout", None)
    link["delay"] = round(age.greatest_ns / 1e9 + d.size(1.0, 0.001), 6)


@fault(STARTS, "a later start hides that it becomes too old", quick=True)
def _(d: Draft) -> None:
    age = d.loop.ages[0]
    start = round(d.size(0.06, 0.02), 3)
    d.data["run"]["start"] = start
    link = d.links[_link(d, age)]
    link.pop("playout", None)
    late = age.greatest_ns / 1e9 + (0.3 * start if age.greatest_ns < 500_000_000 else start)
    d.event(at=10.0, delay={age.link: round(late, 6)})


@fault(RATES, "a communication step that is too long", quick=True)
def _(d: Draft) -> None:
    long = max(x.greatest_ns for x in d.loop.ages) / 1e9 + d.size(1.5, 0.05)
    d.needs(long < 5.0)
    d.data["run"]["step"] = round(long, 2)
    d.data["run"]["events"] = "grid"


@fault(RATES, "a controller that communicates too seldom")
def _(d: Draft) -> None:
    long = max(x.greatest_ns for x in d.loop.ages) / 1e9 + d.size(1.5, 0.05)
    d.needs(long < 5.0)
    d.components["controller"]["step"] = round(long, 2)


@fault(RATES, "a plant that communicates too seldom")
def _(d: Draft) -> None:
    long = max(x.greatest_ns for x in d.loop.ages) / 1e9 + d.size(1.5, 0.05)
    d.needs(long < 5.0)
    d.components["plant"]["step"] = round(long, 2)


@fault(RATES, "a sensor that communicates too seldom")
def _(d: Draft) -> None:
    age = d.pick([x for x in d.loop.ages if x.name in d.sensors()])
    long = age.greatest_ns / 1e9 + d.size(1.5, 0.05)
    d.needs(long < 5.0)
    d.components[age.name]["step"] = round(long, 2)
