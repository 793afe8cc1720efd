"""FMI variables of a link FMU, from the keys that `cosim.network` declares."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from cosim.fmu.export import UNITS, ComponentSpec, Variable
from cosim.network import (
    MAX_NS,
    ChoiceKey,
    CountKey,
    DeclaredKey,
    DurationKey,
    GilbertElliott,
    LossChain,
    PacketLink,
    ProbabilityKey,
    TableKey,
    TransportLink,
    WordOrNumberKey,
    keys_of,
)

MOST_INTEGER = 2**31 - 1
"""Greatest Integer of FMI 2.0."""


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
    name: str, link: PacketLink, signals: Sequence[LinkSignal], step: float = 0.05
) -> ComponentSpec:
    """Specify a packet link.

    Parameters
    ----------
    name : of the FMU; the random streams depend on the name of the link.
    link : gives the start values of the parameters; its delay is constant.
    step : of the default experiment [s].
    """
    table = _signal_variables(signals)
    table += [
        Variable("age", "output", "time since what is delivered was sent", "s"),
        _integer("sequence", "output", "number of the message in use; -1: none yet, -2: lost", -1),
        _integer("dropped", "output", "messages and copies dropped so far", 0),
    ]
    return _spec(name, link.name, signals, table + packet_parameters(link), "packet", step)


def transport_spec(
    name: str, link: TransportLink, signals: Sequence[LinkSignal], step: float = 0.05
) -> ComponentSpec:
    """Specify a transport link of a constant delay; other arguments as for `packet_spec`."""
    table = _signal_variables(signals)
    table += [
        Variable("age", "output", "time since what is delivered was sent", "s"),
    ]
    delay = _parameters(keys_of(TransportLink)["delay"], link)
    return _spec(name, link.name, signals, table + delay, "transport", step)


def _signal_variables(signals: Sequence[LinkSignal]) -> list[Variable]:
    inputs, outputs, initial = [], [], []
    for i, signal in enumerate(signals, 1):
        known = signal.unit if signal.unit in UNITS else None, signal.initial
        inputs.append(Variable(f"u[{i}]", "input", f"{signal.text}, as sent", *known))
        outputs.append(Variable(f"y[{i}]", "output", f"{signal.text}, as received", *known))
        text = f"y[{i}] until something arrives"
        initial.append(Variable(f"initial[{i}]", "parameter", text, *known))
    return [*inputs, *outputs, *initial]


def packet_parameters(link: PacketLink) -> list[Variable]:
    """Return the parameters of a packet link beside `initial[i]`; they start at its values."""
    return [v for key in keys_of(PacketLink).values() for v in _parameters(key, link)]


def _parameters(declared: DeclaredKey, link: object, prefix: str = "") -> list[Variable]:
    """Return the parameters for a key of a link: FMI has numbers, no unions and no None."""
    name, key = prefix + declared.name, declared.key
    value: Any = getattr(link, declared.field)
    text, absent = key.text, declared.default is None
    match key:
        case TableKey():
            inner = keys_of(key.of).values()
            found = [v for own in inner for v in _parameters(own, value, f"{name}.")]
        case DurationKey():
            text += "; 0: no bound" if absent else ""
            found = [_real(name, text, (value or 0) / 1e9, key.least_ns / 1e9, MAX_NS / 1e9, "s")]
        case ProbabilityKey(instead=()):
            found = [_real(name, text, value, 0.0, 1.0)]
        case ProbabilityKey():
            found = _losses(value, text)
        case WordOrNumberKey():
            number = 0.0 if isinstance(value, str) else value
            words = f"1: hold the last message, 0: {name}.value"
            found = [
                _integer(f"{name}.hold", "parameter", words, int(value == "hold"), 0, 1),
                _real(f"{name}.value", f"{text}, without {name}.hold", number),
            ]
        case ChoiceKey(words=words):
            text = ", ".join(f"{number}: {word}" for number, word in enumerate(words))
            place = words.index(value)
            found = [_integer(name, "parameter", text, place, 0, len(words) - 1)]
        case CountKey(unit=None):
            text += "; -1: any number" if absent else ""
            low = -1 if absent else 0
            start = low if value is None else min(value, MOST_INTEGER) if absent else value
            found = [_integer(name, "parameter", text, start, low, MOST_INTEGER)]
        case _:
            found = [_real(name, text, value, 0.0, getattr(key, "most", None))]
    return found


def _losses(loss: float | GilbertElliott | LossChain, text: str) -> list[Variable]:
    """Return the parameters of independent losses, of bursts, and of the chain that a link has."""
    chain = loss if isinstance(loss, LossChain) else None
    bursts = loss if isinstance(loss, GilbertElliott) else GilbertElliott(0.0, 1.0)
    good = loss if isinstance(loss, int | float) else bursts.loss_good
    kind = 2 if chain else int(isinstance(loss, GilbertElliott))
    choice = "0: independent losses, 1: Gilbert-Elliott" + (", 2: loss.state" if chain else "")
    found = [
        _integer("loss.bursts", "parameter", choice, kind, 0, 2 if chain else 1),
        _real("loss.good", f"{text}; with bursts, in the good state", good, 0.0, 1.0),
    ]
    for name in ("loss_bad", "p_enter", "p_exit"):
        words = f"with bursts, {keys_of(GilbertElliott)[name].key.text}"
        start = getattr(bursts, name)
        found.append(_real(f"loss.{name.removeprefix('loss_')}", words, start, 0.0, 1.0))
    for i, one in enumerate(chain.losses if chain else (), 1):
        found.append(_real(f"loss.state[{i}]", f"{text} in state {i}", one, 0.0, 1.0))
    for i, row in enumerate(chain.moves if chain else (), 1):
        for j, move in zip([j for j in range(1, len(row) + 2) if j != i], row, strict=True):
            words = f"from state {i} to state {j}, per message"
            found.append(_real(f"loss.move[{i},{j}]", words, move, 0.0, 1.0))
    return found


def _real(
    name: str,
    text: str,
    start: float,
    low: float | None = None,
    high: float | None = None,
    unit: str | None = None,
) -> Variable:
    high = None if high is None else float(high)
    return Variable(name, "parameter", text, unit, float(start), minimum=low, maximum=high)


def _integer(
    name: str,
    causality: Literal["output", "parameter"],
    text: str,
    start: int,
    low: int | None = None,
    high: int | None = None,
) -> Variable:
    return Variable(name, causality, text, None, start, "Integer", minimum=low, maximum=high)


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
