"""What the settings of a scenario say of the age of the feedback, before any run.

From plant to controller and back a measurement passes three stages: the link to the controller, the
controller's step, the link back. Each takes what is there at its own instants, offset + k period,
and passes it on a delay later. The age of the feedback is *sampled* where every measurement that
comes into use has the same age at that instant, whatever is lost: it then grows at rate one until
the next one comes into use. That holds where the delay behind each stage is constant (no jitter, or
a play-out buffer), all instants lie on the grid of the communication step, and no stage can send a
measurement a second time after it was lost once. Anything else is an interval: the age is never
less than the delays together.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from cosim.master import Component, Connection, Link, System, receiving_order
from cosim.network import (
    DelayProfile,
    GilbertElliott,
    LossChain,
    PacketLink,
    TransportLink,
)
from cosim.scenario.measure import sample_period_ns


@dataclass(frozen=True)
class FeedbackAge:
    """What the settings say of the age of the feedback.

    Attributes
    ----------
    least_ns : it is never less [ns].
    greatest_ns : it is never more [ns]; None: losses, or an unknown delay, leave it unbounded.
    sampled : it is exactly `least_ns` whenever a measurement comes into use.
    why : of `sampled`, or what prevents it; a sentence.
    """

    least_ns: int
    greatest_ns: int | None
    sampled: bool
    why: str


class _Stage(NamedTuple):
    """A stage that takes what is there at offset + k period, and passes it on `delay` later [ns].

    `may_lose` : what it passes on may be lost.
    """

    name: str
    period: int
    offset: int
    delay: int
    may_lose: bool


class _NotSampledError(Exception):
    """Why the age of the feedback is not known to be sampled; a sentence."""


def feedback_age(system: System, plant: str, controller: str) -> FeedbackAge | None:
    """Return what is known of the age of the feedback; None where nothing feeds back."""
    up = _links_between(system, plant, controller)
    down = _links_between(system, controller, plant)
    if not up or not down:
        return None
    least = sum(min(_least_ns(link) for link in links) for links in (up, down))
    # "midpoint" and "linear" give the value of a later instant of the step
    ways = [*_between(system, plant, controller), *_between(system, controller, plant)]
    if any(c.policy in ("midpoint", "linear") for c in ways):
        least = max(0, least - 2 * system.comm_schedule.step_ns)
    try:
        stages = _stages(system, up, controller, down)
        age, period, may_lose = _sampled_age(stages)
    except _NotSampledError as error:
        greatest = _greatest_ns(system, up, controller, down)
        return FeedbackAge(least, greatest, sampled=False, why=str(error))
    words = "every measurement that comes into use is exactly this old, whatever is lost"
    return FeedbackAge(age, None if may_lose else age + period, sampled=True, why=words)


def _links_between(system: System, source: str, target: str) -> list[Link | None]:
    """Return the links that connect two components, each once; None stands for a wire."""
    names = sorted({c.link or "" for c in _between(system, source, target)})
    return [system.links[name] if name else None for name in names]


def _between(system: System, source: str, target: str) -> list[Connection]:
    """Return the connections from one component to another."""
    return [
        c
        for c in system.connections
        if c.source.component == source and c.target.component == target
    ]


def _least_ns(link: Link | None) -> int:
    if link is None:
        return 0
    if isinstance(link, PacketLink):
        return int(link.playout_ns or link.least_transit_ns)
    return link.delay_ns if link.delay is None else int(link.delay.delays_ns.min())


def _greatest_ns(
    system: System, up: Sequence[Link | None], controller: str, down: Sequence[Link | None]
) -> int | None:
    """Return an upper bound of the age [ns]; None where messages may be lost, or never come."""
    try:
        _check_exchange(system)
        own = _controller_stage(system.components[controller], controller, 1)
    except _NotSampledError:
        return None
    step = system.comm_schedule.step_ns
    most: float = max(own.period, step) + step
    for links in (up, down):
        most += max(0 if link is None else _oldest_ns(link, step) for link in links)
    return int(most) if math.isfinite(most) else None


def _oldest_ns(link: Link, step: int) -> float:
    """Return how old at most what a link brings is when the next one replaces it [ns]."""
    if isinstance(link, TransportLink):
        return step + (link.delay_ns if link.delay is None else int(link.delay.delays_ns.max()))
    if _may_lose(link) or (link.order == "as-arrived" and not link.playout_ns):
        return math.inf
    # on a grid the sending and the arrival each wait for a point
    return link.sample_time_ns + 2 * step + (link.playout_ns or _latest_ns(link))


def _stages(
    system: System,
    up: Sequence[Link | None],
    controller: str,
    down: Sequence[Link | None],
) -> list[_Stage]:
    if len(up) > 1 or len(down) > 1:
        raise _NotSampledError("parts of the feedback take different ways, with ages of their own")
    step = system.comm_schedule.step_ns
    _check_points(system)
    _check_exchange(system)
    return [
        _stage(up[0], system, step),
        _controller_stage(system.components[controller], controller, step),
        _stage(down[0], system, step),
    ]


def _check_exchange(system: System) -> None:
    """Refuse what adds delays that are not the same for every measurement."""
    if system.algorithm != "jacobi":
        raise _NotSampledError("only of the algorithm jacobi is the delay of the coupling derived")
    policies = {c.policy for c in system.connections if _feeds_back(system, c)}
    if policies - {"hold"} or receiving_order(system).cut:
        raise _NotSampledError('a connection has another policy than "hold"')
    if any(component.every_ns is not None for component in system.components.values()):
        raise _NotSampledError("a component has a communication step of its own")


def _feeds_back(system: System, connection: Connection) -> bool:
    return not system.is_state(connection.source)


def _check_points(system: System) -> None:
    """Refuse communication points off the grid of the step."""
    schedule = system.comm_schedule
    off = schedule.given_ns is not None or (schedule.instants_ns % schedule.step_ns).any()
    if off:
        raise _NotSampledError("communication points lie off the grid of the step")
    if schedule.events == "grid":
        return
    for name, link in system.links.items():
        if isinstance(link, PacketLink):
            instants = [link.sample_time_ns, link.offset_ns, _constant_ns(link, name)]
            if any(instant % schedule.step_ns for instant in instants):
                raise _NotSampledError(f"{name}: its messages lie off the grid of the step")


def _constant_ns(link: PacketLink, name: str) -> int:
    """Return the time from sending to use, which is the same for every message."""
    if link.playout_ns:
        return link.playout_ns
    if link.hop is not None:
        raise _NotSampledError(f"{name}: it shares a medium with others, and has no playout")
    if link.jitter.kind != "none":
        raise _NotSampledError(f"{name}: its messages arrive with jitter, and without playout")
    recorded = link.recording is not None and link.recording.delay_ns is not None
    if link.delay is not None or recorded:
        raise _NotSampledError(f"{name}: its delay varies, and it has no playout")
    if link.frame_ns > link.sample_time_ns:
        raise _NotSampledError(f"{name}: its messages wait in a queue, and it has no playout")
    return link.delay_ns + link.frame_ns


def _stage(link: Link | None, system: System, step: int) -> _Stage:
    if link is None:
        return _Stage("a wire", step, 0, 0, may_lose=False)
    if isinstance(link, TransportLink):
        if link.delay is not None or link.delay_ns % step:
            raise _NotSampledError(f"{link.name}: its delay is no multiple of the step")
        return _Stage(link.name, step, 0, link.delay_ns, may_lose=False)
    delay = _constant_ns(link, link.name)
    if link.sample_time_ns % step or link.offset_ns % step:
        raise _NotSampledError(f"{link.name}: its messages are sent off the grid of the step")
    if system.comm_schedule.events == "grid":
        delay = -(-delay // step) * step
    return _Stage(link.name, link.sample_time_ns, link.offset_ns, delay, may_lose=_may_lose(link))


def _controller_stage(controller: Component, name: str, step: int) -> _Stage:
    """The controller samples at the multiples of its period, and answers a step later."""
    ports = controller.description.ports
    period = sample_period_ns(controller)
    if any(p.causality == "output" and p.feedthrough for p in ports.values()):
        raise _NotSampledError(f"{name}: its commands follow its inputs at once")
    if step > 1 and period and step % period and period % step:
        raise _NotSampledError(f"{name}: its sample time is no multiple of the step")
    return _Stage(name, max(period, step), 0, step, may_lose=False)


def _may_lose(link: PacketLink) -> bool:
    """Whether a message may be lost, refused by the queue, or late for its play-out."""
    chance = link.loss
    if isinstance(chance, GilbertElliott | LossChain):
        chance = max(chance.losses)
    recording = link.recording
    if recording is not None and not recording.arrived.all():
        return True
    if link.hop is not None or link.adjustable or chance > 0:
        return True
    if any(window.loss > 0 for window in link.windows):
        return True
    return 0 < link.playout_ns < _latest_ns(link)


def _latest_ns(link: PacketLink) -> float:
    """Return the greatest time from sending to arrival [ns]; infinity where it is not bounded."""
    if link.is_live or link.hop is not None or link.frame_ns > link.sample_time_ns:
        return math.inf
    jitter = link.jitter
    extra = {"none": 0, "uniform": max(jitter.width_ns - 1, 0)}.get(jitter.kind, jitter.max_ns)
    if extra is None:
        return math.inf
    most = link.delay_ns
    if isinstance(link.delay, DelayProfile):
        most = int(link.delay.delays_ns.max())
    if link.recording is not None:
        most += link.recording.greatest_ns
    # under fifo a message waits for those before it, which were sent earlier
    return link.frame_ns + most + extra


def _sampled_age(stages: Sequence[_Stage]) -> tuple[int, int, bool]:
    """Return the age at which measurements come into use, how often [ns], and whether some may not.

    After each stage a new measurement is there at phase + k period, k >= 0, unless it is lost.
    """
    first = stages[0]
    period, phase, age = first.period, first.offset + first.delay, first.delay
    may_lose = first.may_lose
    for stage in stages[1:]:
        if period % stage.period == 0:
            # each measurement is taken at the first instant of the stage, and again at later ones
            if stage.may_lose and (may_lose or period > stage.period):
                raise _NotSampledError(
                    f"{stage.name} may lose a measurement and then pass it on in a later message"
                )
            wait = (stage.offset - phase) % stage.period
            instant = phase + wait
            if stage.offset > instant:
                raise _NotSampledError(f"{stage.name} begins after the first measurement came")
        elif stage.period % period == 0:
            if may_lose:
                raise _NotSampledError(
                    f"{stage.name} takes an older measurement where the newest one was lost"
                )
            wait = (stage.offset - phase) % period
            period = stage.period
            instant = stage.offset + max(0, -(-(phase - stage.offset) // period)) * period
        else:
            raise _NotSampledError(f"the period of {stage.name} does not go with that before it")
        age += wait + stage.delay
        phase = instant + stage.delay
        may_lose |= stage.may_lose
    return age, period, may_lose
