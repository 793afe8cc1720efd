"""FMI variables of a link FMU."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cosim.fmu import UNITS, ComponentSpec, Variable

from .behaviour import JITTERS, ORDERS

LONGEST_S = 1e8
"""Longest time of a link and of a run [s]."""

MOST_BITS = 2.0**53


@dataclass(frozen=True)
class LinkSignal:
    """A signal that passes the link.

    unit : of the signal; one that `cosim.fmu.export.units` does not have is left out.
    initial : what comes out until something else has arrived.
    text : which signal it is.
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
    """A packet link.

    Parameters
    ----------
    name : of the FMU.
    link : of the link: its random streams depend on it.
    signals : the signals.
    starts : start values of parameters, those of `PACKET_PARAMETERS`.
    step : of the default experiment [s].
    """
    table = _signal_variables(signals)
    table += [
        Variable("age", "output", "time since what is delivered was sent", "s"),
        _integer("sequence", "output", "number of the message in use; -1: none yet, -2: lost", -1),
        _integer("dropped", "output", "messages and copies dropped so far", 0),
    ]
    table += [
        Variable(
            v.name,
            v.causality,
            v.description,
            v.unit,
            starts.get(v.name, v.start),
            v.kind,
            minimum=v.minimum,
            maximum=v.maximum,
        )
        for v in PACKET_PARAMETERS
    ]
    return _spec(name, link, signals, table, "packet", step)


def transport_spec(
    name: str, link: str, signals: Sequence[LinkSignal], delay: float, step: float = 0.05
) -> ComponentSpec:
    """A transport link of a constant `delay` [s]; the others as for `packet_spec`."""
    table = _signal_variables(signals)
    table += [
        Variable("age", "output", "time since what is delivered was sent", "s"),
        _time("delay", "from sending to receiving", delay),
    ]
    return _spec(name, link, signals, table, "transport", step)


def _signal_variables(signals: Sequence[LinkSignal]) -> list[Variable]:
    known = [signal.unit if signal.unit in UNITS else None for signal in signals]
    table = [
        Variable(f"u[{i}]", "input", f"{signal.text}, as sent", unit, signal.initial)
        for i, (signal, unit) in enumerate(zip(signals, known, strict=True), 1)
    ]
    table += [
        Variable(f"y[{i}]", "output", f"{signal.text}, as received", unit, signal.initial)
        for i, (signal, unit) in enumerate(zip(signals, known, strict=True), 1)
    ]
    return table + [
        Variable(f"initial[{i}]", "parameter", f"y[{i}] until something arrives", u, signal.initial)
        for i, (signal, u) in enumerate(zip(signals, known, strict=True), 1)
    ]


def _time(name: str, text: str, start: float = 0.0, minimum: float = 0.0) -> Variable:
    return Variable(
        name, "parameter", text, "s", start, minimum=minimum, maximum=max(minimum, LONGEST_S)
    )


def _share(name: str, text: str, start: float = 0.0) -> Variable:
    return Variable(name, "parameter", text, None, start, minimum=0.0, maximum=1.0)


def _integer(
    name: str,
    causality: str,
    text: str,
    start: int,
    low: int | None = None,
    high: int | None = None,
) -> Variable:
    kind = "output" if causality == "output" else "parameter"
    return Variable(name, kind, text, None, start, "Integer", minimum=low, maximum=high)  # type: ignore[arg-type]


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
    Variable(
        "data_rate",
        "parameter",
        "bits per second, whole; 0: sending takes no time",
        minimum=0.0,
        maximum=MOST_BITS,
    ),
    Variable("frame_size", "parameter", "bits of a message", minimum=0.0, maximum=MOST_BITS),
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
