"""The keys of links: one declaration, and the same range in every form of a link."""

from __future__ import annotations

import random
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

import cosim
from cosim.core import InputError
from cosim.fmu.export import component_module
from cosim.network import (
    ChoiceKey,
    CountKey,
    DeclaredKey,
    DelaySignal,
    DurationKey,
    GilbertElliott,
    Jitter,
    LogFormat,
    LossChain,
    Medium,
    NumberKey,
    PacketLink,
    ProbabilitiesKey,
    ProbabilityKey,
    RangeLogit,
    Recording,
    TextKey,
    TransportLink,
    WordOrNumberKey,
    keys_of,
)
from cosim.scenario import ScenarioPart, json_schema, link_of

VARIABLES = component_module("link_channel.variables")
DOCS = Path(cosim.__file__).parents[1] / "docs" / "reference" / "links.md"
SCHEMA = json_schema()["$defs"]
PARTS: dict[type, Any] = {
    PacketLink: SCHEMA["PacketPart"],
    TransportLink: SCHEMA["TransportPart"],
    Jitter: SCHEMA["JitterPart"],
    GilbertElliott: SCHEMA["BurstPart"],
    LossChain: SCHEMA["ChainPart"],
    Recording: SCHEMA["RecordingFilePart"],
    LogFormat: SCHEMA["LogFormatPart"],
    DelaySignal: SCHEMA["SignalDelayPart"],
    Medium: SCHEMA["MediumPart"],
    RangeLogit: SCHEMA["RangeLogitPart"],
}
"""What a scenario has for each of them, as the JSON schema says it."""
NOT_KEYS = {"name", "delay", "windows", "recording", "hop", "adjustable", "nodes", "slots", "loss"}
NOT_KEYS |= {"greatest_age_ns", "on_age", "hints"}
ROWS = {"sent_ns", "lost", "delay_ns", "range_m", "size", "start_ns"}
RATE = {"data_rate": 1000, "frame_size": 10}


def test_every_field_is_a_key() -> None:
    """A field of a link is declared with meaning and range, or has none in a scenario."""
    for declared in PARTS:
        named = {key.field for key in keys_of(declared).values()}
        assert {f.name for f in fields(declared)} - named <= (
            ROWS if declared is Recording else NOT_KEYS
        )


@pytest.mark.parametrize("declared", PARTS)
def test_a_scenario_has_the_same_keys(declared: type) -> None:
    """Each key once, in order, with its meaning in the JSON schema; nothing else but a few."""
    properties = PARTS[declared]["properties"]
    others = ("kind", "signal", "recording", "file", "node", "medium", "from", "to", "packet")
    others += ("nodes", "slots", "loss", "greatest_age", "on_age", "count", "each", "as")
    others += ("format",)
    own = [n for n in properties if n not in others or n in keys_of(declared)]
    assert own == [*keys_of(declared)]
    for name, found in keys_of(declared).items():
        assert properties[name]["description"] == found.key.text


def edges(found: DeclaredKey, r: random.Random) -> list[Any]:
    """Values of a key, in the link's units, inside, at and beyond the ends of its range."""
    values: list[Any] = [None, True, "other", float("nan"), -1]
    match found.key:
        case DurationKey(least_ns=least):
            inside = r.randint(least, 2**50)  # a double of seconds has it to the nanosecond
            values = [least, least - 1, 2**53, 2**53 + 2**20, -inside, inside, None]
        case ProbabilityKey():
            values += [0.0, 1.0, r.random(), -1e-9, 1.0 + 1e-9]
        case NumberKey():
            values += [0.0, 1.0, -1.0, 1e-100, 1e-101, 1e300, float("inf")]
        case CountKey(most=most):
            values += [0, 1, most, most + 1, r.randint(0, most), 1.5]
        case ChoiceKey(words=words):
            values += [*words, 2.5]
    return values


def beside(found: DeclaredKey) -> dict[str, Any]:
    """Keys without which this one has no meaning."""
    return RATE if found.name in ("data_rate", "frame_size", "queue_limit") else {}


def in_network(found: DeclaredKey, value: Any) -> PacketLink | str:
    """The packet link with this value, or what is said against it."""
    given = {"name": "up", "sample_time_ns": 10**8, **beside(found), found.field: value}
    try:
        return PacketLink(**given)
    except InputError as error:
        return str(error.where)


def read_link(table: dict[str, Any]) -> Any:
    """The link of [links.up] with these keys; a ValidationError where one is refused."""
    data = {"title": "t", "run": {"end": 1.0, "step": 0.1}, "links": {"up": table}}
    part = ScenarioPart.model_validate({**data, "components": {"a": {"fmu": "WaveField"}}}).links[
        "up"
    ]
    return link_of("up", part, 0)  # a value that the table lets through makes a link


def in_scenario(found: DeclaredKey, value: Any) -> Any:
    """The link of [links.up] with this value, or what is said against it."""
    seconds = isinstance(found.key, DurationKey) and value is not None
    table = {"kind": "packet", "sample_time": 0.1, **beside(found)}
    table[found.name] = value / 1e9 if seconds else value
    try:
        return read_link(table)
    except ValidationError as error:
        return str(error)


@pytest.mark.parametrize("name", [n for n in keys_of(PacketLink) if n != "jitter"])
def test_a_range_is_the_same_everywhere(name: str) -> None:
    """Link and scenario accept the same values; a link FMU those that FMI has numbers for."""
    found = keys_of(PacketLink)[name]
    values = edges(found, random.Random(name))  # noqa: S311 - cases, not secrets
    if name in ("data_rate", "frame_size"):  # zero goes with zero; a frame must not take for ever
        values = [v for v in values if isinstance(v, str) or v is None or not (v == 0 or v > 10**6)]
    accepted = 0
    for value in values:
        made, read = in_network(found, value), in_scenario(found, value)
        if isinstance(made, str):
            assert found.field in made
            if (name, value) != ("seed", None):  # a scenario has another one: that of the run
                assert isinstance(read, str), value
                assert name in read
            continue
        assert read == made, value
        accepted += 1
        if name == "seed" and made.seed > VARIABLES.MOST_INTEGER:
            continue
        for variable in VARIABLES.packet_parameters(made):
            low, high = variable.minimum, variable.maximum
            assert low is None or low <= variable.start
            assert high is None or variable.start <= high
    assert accepted


@pytest.mark.parametrize("kind", ["uniform", "exponential", "normal"])
@pytest.mark.parametrize("name", ["width", "mean", "sigma", "max"])
def test_a_range_of_jitter_is_the_same_everywhere(kind: str, name: str) -> None:
    """Link and scenario accept the same jitter."""
    found = keys_of(Jitter)[name]
    needed = {"uniform": "width", "exponential": "mean", "normal": "sigma"}[kind]
    for value in edges(found, random.Random(name)):  # noqa: S311 - cases, not secrets
        try:
            made: Jitter | None = Jitter(**{"kind": kind, f"{needed}_ns": 1000, found.field: value})
        except InputError:
            made = None
        try:
            table = {"kind": kind, needed: 1e-6, name: None if value is None else value / 1e9}
            given = {"kind": "packet", "sample_time": 0.1, "jitter": table}
            link = read_link(given)
            assert isinstance(link, PacketLink)
            read: Jitter | None = link.jitter
        except ValueError:
            read = None
        assert read == made, value


def values_in_words(found: DeclaredKey) -> str:
    """The range of a key, for people."""
    key, words = found.key, "a table"
    match key:
        case DurationKey(least_ns=least):
            words = f"{f'{least / 1e9:.4g}'.replace('e+0', 'e')} to 9.007e6 s"
            words = words.replace("1e-09", "1e-9")
        case TextKey(several=several):
            words = "a text, or several" if several else "a text"
        case ProbabilityKey(instead=instead):
            words = "0 to 1" + (", or a table" if instead else "")
        case ProbabilitiesKey(least=least, most=most, rows=rows):
            words = f"{least} to {most} " + ("rows that add to 1" if rows else "numbers, 0 to 1")
        case NumberKey(positive=True):
            words = "greater than 0"
        case NumberKey(least=least):
            words = "any number" if least is None else f"0, or from {least:g} up"
        case CountKey(most=most, unit=unit):
            words = f"whole, 0 to {'2^53' if most == 2**53 else '2^63 - 1'} {unit or ''}".rstrip()
        case ChoiceKey():
            words = ", ".join(f'`"{w}"`' for w in key.words if w != "none")
            words += ", or a number" if isinstance(key, WordOrNumberKey) else ""
    return words


def rows(declared: type) -> list[str]:
    """The rows of a table of the documentation."""
    lines = ["| key | values | default | meaning |", "|---|---|---|---|"]
    for name, found in keys_of(declared).items():
        part = PARTS[declared]
        given = part["properties"][name].get("default")
        default = "none" if given is None else f"{given}"
        if isinstance(given, int | float):
            default = f"{given:g}"
        elif isinstance(given, str):
            default = f'`"{default}"`'
        if name in part.get("required", ()):
            default = "required"
        lines.append(f"| `{name}` | {values_in_words(found)} | {default} | {found.key.text} |")
    return lines


@pytest.mark.parametrize("declared", PARTS)
def test_the_documentation_has_the_table(declared: type) -> None:
    """Each key of scenarios with its values, its default and its meaning."""
    table = "\n".join(rows(declared))
    assert f"\n{table}\n" in DOCS.read_text("utf-8"), f"{DOCS.name} needs:\n{table}"
