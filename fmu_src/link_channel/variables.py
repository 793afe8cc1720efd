"""FMI variables of a link FMU."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from cosim.fmu import UNITS, ComponentSpec, Variable

from .behaviour import JITTERS, ORDERS

LONGEST_S = 1e8
"""Longest time of a link and of a run [s]."""

MOST_BITS = 2.0**53


@dataclass(frozen=True)
class LinkSignal:
    """A signal that goes through the link.

    unit : of the signal; left out if `UNITS` does not have it.
    initial : output until the first message arrives.
    text : names the signal in descriptions.
    """

    unit: str | None = None
    initial: float = 0.0
    text: str = "signal"


def packet_spec(
    name: str,
    link: str,
    signals: Sequence[LinkSignal],
    starts: dict[str, float],
    step: float = 0.05,
) -> ComponentSpec:
    """Specify a packet link.

    Parameters
    ----------
    name, link : of the FMU, and of the link: its random streams depend on it.
    starts : start values of some of `PACKET_PARAMETERS`.
    step : of the default experiment [s].
    """
    table = _signal_variables(signals)
    table += [
        Variable("age", "output", "time since what is delivered was sent", "s"),
        _integer("sequence", "output", "number of the message in use; -1: none yet, -2: lost", -1),
        _integer("dropped", "output", "messages and copies dropped so far", 0),
    ]
    table += [replace(v, start=starts.get(v.name, v.start)) for v in PACKET_PARAMETERS]
    return _spec(name, link, signals, table, "packet", step)


def transport_spec(
    name: str, link: str, signals: Sequence[LinkSignal], delay: float, step: float = 0.05
) -> ComponentSpec:
    """Specify a transport link of a constant `delay` [s]; other arguments as for `packet_spec`."""
    table = _signal_variables(signals)
    table += [
        Variable("age", "output", "time since what is delivered was sent", "s"),
        _time("delay", "from sending to receiving", delay),
    ]
    return _spec(name, link, signals, table, "transport", step)


def _signal_variables(signals: Sequence[LinkSignal]) -> list[Variable]:
    inputs, outputs, initial = [], [], []
    for i, signal in enumerate(signals, 1):
        known = signal.unit if signal.unit in UNITS else None, signal.initial
        inputs.append(Variable(f"u[{i}]", "input", f"{signal.text}, as sent", *known))
        outputs.append(Variable(f"y[{i}]", "output", f"{signal.text}, as received", *known))
        text = f"y[{i}] until something arrives"
        initial.append(Variable(f"initial[{i}]", "parameter", text, *known))
    return [*inputs, *outputs, *initial]


def _time(name: str, text: str, start: float = 0.0, minimum: float = 0.0) -> Variable:
    return Variable(
        name, "parameter", text, "s", start, minimum=minimum, maximum=max(minimum, LONGEST_S)
    )


def _share(name: str, text: str, start: float = 0.0) -> Variable:
    return Variable(name, "parameter", text, None, start, minimum=0.0, maximum=1.0)


def _bits(name: str, text: str) -> Variable:
    return Variable(name, "parameter", text, minimum=0.0, maximum=MOST_BITS)


def _integer(
    name: str,
    causality: Literal["output", "parameter"],
    text: str,
    start: int,
    low: int | None = None,
    high: int | None = None,
) -> Variable:
    return Variable(name, causality, text, None, start, "Integer", minimum=low, maximum=high)


def _numbered(names: Sequence[str]) -> str:
    return ", ".join(f"{number}: {name}" for number, name in enumerate(names))


PACKET_PARAMETERS = (
    _time("sample_time", "time between two messages", 0.1, 1e-9),
    _time("offset", "instant of the first message"),
    _time("delay", "least time from sending to arrival"),
    _integer("jitter.kind", "parameter", _numbered(JITTERS), 0, 0, len(JITTERS) - 1),
    _time("jitter.width", "uniform jitter is less than this"),
    _time("jitter.mean", "mean of exponential or normal jitter, before truncation"),
    _time("jitter.sigma", "standard deviation of normal jitter, before truncation"),
    _time("jitter.max", "greatest exponential or normal jitter; 0: no bound"),
    _integer("loss.bursts", "parameter", "0: independent losses, 1: Gilbert-Elliott", 0, 0, 1),
    _share("loss.good", "probability of a loss; with bursts, in the good state"),
    _share("loss.bad", "with bursts, probability of a loss in the bad state", 1.0),
    _share("loss.p_enter", "with bursts, from the good to the bad state, per message"),
    _share("loss.p_exit", "with bursts, from the bad to the good state, per message", 1.0),
    _share("duplicate", "probability that what is not lost arrives twice"),
    _integer("order", "parameter", _numbered(ORDERS), 0, 0, len(ORDERS) - 1),
    _integer("on_loss.hold", "parameter", "1: hold the last message, 0: on_loss.value", 1, 0, 1),
    Variable("on_loss.value", "parameter", "what comes out after a loss, without on_loss.hold"),
    Variable("quantization", "parameter", "step of the values sent; 0: none", minimum=0.0),
    _bits("data_rate", "bits per second, whole; 0: sending takes no time"),
    _bits("frame_size", "bits of a message"),
    _integer(
        "queue_limit", "parameter", "messages that may wait; -1: any number", -1, -1, 2**31 - 1
    ),
    _integer("seed", "parameter", "seed of the run", 0, 0, 2**31 - 1),
)
"""Parameters of a packet link beside `initial[i]`."""


def _spec(
    name: str,
    link: str,
    signals: Sequence[LinkSignal],
    table: list[Variable],
    kind: str,
    step: float,
) -> ComponentSpec:
    return ComponentSpec(
        name=name,
        description=f"The {kind} link {link} as a component",
        variables=tuple(table),
        behaviour="cosim.components.link_channel.behaviour:LinkChannel",
        sources=("cosim.components.link_channel.behaviour",),
        readme=Path(__file__).with_name(f"{kind}.md"),
        stop_time=200 * step,
        step_size=step,
        constants={"link": link, "lanes": len(signals), "kind": kind},
    )
