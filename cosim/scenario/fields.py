"""Field types of scenarios: names, times, numbers with or without a unit.

A plain number is in SI; a text is a quantity with a unit of the right dimension.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Any

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    StringConstraints,
    WithJsonSchema,
)

from cosim import core
from cosim.core import (
    NUMBER_ONLY,
    TIME,
    Dimension,
    KeyPath,
    QuantityError,
    dimension,
)
from cosim.network import MAX_NS
from cosim.scenario.values import VALUE_PATTERN, parse_value, value_in

NAME_PATTERN = r"^[A-Za-z][A-Za-z0-9_-]*$"
"""Regular expression of the name of a component or a link."""

REFERENCE_PATTERN = r"^[A-Za-z][A-Za-z0-9_-]*\..+$"
COLUMN_PATTERN = r"^[A-Za-z][A-Za-z0-9_.-]*$"
"""Regular expression of the name of a column in the table of a study."""
OUTPUT_PATTERN = r"^[A-Za-z_][A-Za-z0-9_.\[\],]*$"
Name = Annotated[str, StringConstraints(pattern=NAME_PATTERN)]
Reference = Annotated[str, StringConstraints(pattern=REFERENCE_PATTERN)]
_MATRICES = frozenset(("A", "B", "C", "D", "D1", "D2", "E", "H", "A1", "H1", "d"))


_MEANT: Mapping[str, str] = MappingProxyType(
    {
        **dict.fromkeys(
            ("stop", "until", "finish", "stoptime", "duration", "tend", "tstop", "endtime", "tmax"),
            "end",
        ),
        **dict.fromkeys(("stepsize", "timestep", "dt", "h", "communicationstepsize"), "step"),
        **dict.fromkeys(("latency", "lag", "tau"), "delay"),
        **dict.fromkeys(("packetloss", "dropout", "lossrate", "lossprobability", "per"), "loss"),
        **dict.fromkeys(("bitrate", "bandwidth", "datarate"), "data_rate"),
        **dict.fromkeys(
            ("period", "ts", "interval", "sampleperiod", "samplingtime"), "sample_time"
        ),
        **dict.fromkeys(("path", "file", "model", "filename"), "fmu"),
        **dict.fromkeys(("start", "init", "params", "initial", "startvalues"), "parameters"),
        **dict.fromkeys(("source", "output"), "from"),
        **dict.fromkeys(("target", "destination", "input"), "to"),
        **dict.fromkeys(("randomseed", "rng"), "seed"),
        **dict.fromkeys(("assert", "checks", "requirements"), "assertions"),
        **dict.fromkeys(("name",), "title"),
        **dict.fromkeys(("time", "instant", "t"), "at"),
        **dict.fromkeys(("events.start", "events.begin", "events.starttime"), "at"),
        **dict.fromkeys(("drop", "drops", "dropprobability"), "loss"),
        **dict.fromkeys(("channel", "via", "through"), "link"),
        **dict.fromkeys(("simulation", "simulate", "experiment"), "run"),
        **dict.fromkeys(("fmus", "models", "instances", "slaves"), "components"),
        **dict.fromkeys(("wires", "wiring"), "connections"),
        **dict.fromkeys(("channels", "network"), "links"),
        **dict.fromkeys(("loglevel", "verbosity"), "log.level"),
        **dict.fromkeys(("condition", "require", "must", "check"), "always"),
        **dict.fromkeys(("std", "stddev", "standarddeviation"), "sigma"),
        "author": "description",
    }
)
_EXAMPLES: Mapping[str, str] = MappingProxyType(
    {
        "end": '10.0, or "10 s"',
        "step": '0.01, or "10 ms"',
        "run.start": "0.0",
        "seed": "1",
        "threads": "1",
        "fmu": '"AuvPlant", or "my-plant.fmu"',
        "from": '"plant.y"',
        "to": '"controller.y"',
        "kind": '"packet"',
        "sample_time": '0.1, or "100 ms"',
        "links.delay": '0.2, or "200 ms"',
        "loss": '0.05, or "5 %"',
        "at": '1.0, or "1 s"',
        "for": '0.5, or "500 ms"',
        "width": '"5 ms"',
        "sigma": '"5 ms"',
        "mean": '"5 ms"',
        "always": '"plant.y < 2"',
        "eventually": '"plant.y < 2"',
        "points": "[[0.0, 1.0], [10.0, 2.0]]",
        "reference.axes": '["x", "y"]',
        "title": '"My first scenario"',
        "scenario": '"mine.toml"',
        "values": "[0.1, 0.2]",
        "path": '"links.up.delay"',
        "count": "10",
        "data_rate": '"1200 bit/s"',
    }
)
_PATTERNS: Mapping[str, str] = MappingProxyType(
    {
        NAME_PATTERN: "a name: a letter, then letters, digits, _ or -",
        REFERENCE_PATTERN: "component.variable",
        COLUMN_PATTERN: "the name of a column: a letter, then letters, digits, _ . or -",
        OUTPUT_PATTERN: "the name of an output: a letter or _, then letters, digits and _ . [ ] ,",
    }
)


_CONDITION = 'a condition in one text: always = "plant.y < 2"'
_OF_A_LINK = 'that belongs to a link: link = "up" here, and a table [links.up]'
_INSTEAD: Mapping[tuple[str, str], str] = MappingProxyType(
    {
        **dict.fromkeys(
            (("design", word) for word in _MATRICES),
            'matrices are in the file of a system: system = "my-system.toml"',
        ),
        **dict.fromkeys(
            ((word, word) for word in ("record", "recording", "outputs", "logging")),
            "every signal is recorded: leave it out",
        ),
        **{("assertions", word): _CONDITION for word in ("signal", "max", "min", "limit", "never")},
        **{("connections", word): _OF_A_LINK for word in ("delay", "latency", "loss", "jitter")},
        **dict.fromkeys(
            (("run", word) for word in ("solver", "integrator", "method")),
            "each FMU has its own solver: its step is a parameter, as solver.step",
        ),
    }
)
"""Table and key that it does not have -> what to do."""


class Part(core.Part):
    """A table of a scenario, of a study or of a vehicle."""

    meant = _MEANT
    patterns = _PATTERNS
    examples = _EXAMPLES

    @classmethod
    def advice(cls, wrong: str, path: KeyPath, value: Any, data: Any) -> str | None:
        """Return what to do about a fault that scenarios are known for."""
        if wrong == "extra_forbidden" and path:
            return _INSTEAD.get((str(path[0]), str(path[-1])))
        hint = None
        match wrong, path:
            case "union_tag_not_found", ("links", *_):
                others = [name for name in data["links"] if name != path[-1]]
                there = f"; the links that are there: {', '.join(others)}" if others else ""
                hint = f'a new link has kind = "packet" or "transport"{there}'
            case "less_than_equal", (*_, "loss" | "duplicate"):
                hint = f'a probability: "{value} %" is {value} in a hundred'
            case _, (*_, "jitter") if not isinstance(value, dict):
                width = f'"{value}"' if isinstance(value, str) else value
                hint = f'jitter = {{ kind = "uniform", width = {width} }}'
            case "value_error", ("events", int()) if "stop" not in value:
                hint = 'as in at = 1.0, for = 0.5, outage = ["up"]'
            case "string_pattern_mismatch", ("connections", _, "from" | "to"):
                hint = f'the variable with its component: "{value}.x"'
            case _ if "parameters" in path[:-1] and isinstance(value, dict):
                name = f"{path[-1]}.{next(iter(value), 'x')}"
                hint = f'a name with a dot is written in quotes: "{name}" = ...'
        return hint


def _quantity(wanted: Dimension) -> BeforeValidator:
    def convert(value: Any) -> Any:
        if not isinstance(value, str):
            return value
        try:
            return value_in(value, wanted)
        except QuantityError as error:
            raise ValueError(f"a number, or {error}") from error

    return BeforeValidator(convert, json_schema_input_type=float | QuantityText)


QuantityText = Annotated[
    str,
    WithJsonSchema(
        {
            "type": "string",
            "pattern": VALUE_PATTERN,
            "description": 'a number and a unit, as in "50 ms", or an expression of such',
        }
    ),
]
SECONDS = _quantity(TIME)
_PLAIN = _quantity(NUMBER_ONLY)
# constraints before validators: a constraint then applies to the validator's result
# 1e8 s are three years: sums of a few such times still fit into 64-bit nanoseconds
Duration = Annotated[float, Field(gt=0, le=1e8, allow_inf_nan=False), SECONDS]
Delay = Annotated[float, Field(ge=0, le=1e8, allow_inf_nan=False), SECONDS]
LinkTime = Annotated[float, Field(ge=0, le=MAX_NS / 1e9, allow_inf_nan=False), SECONDS]
Instant = Annotated[float, Field(ge=0, le=1e8, allow_inf_nan=False), SECONDS]
Seconds = Annotated[float, Field(ge=-1e8, le=1e8, allow_inf_nan=False), SECONDS]
Length = Annotated[float, Field(allow_inf_nan=False), _quantity(dimension(m=1))]
Probability = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False), _PLAIN]
Speed = Annotated[float, Field(gt=0, allow_inf_nan=False), _quantity(dimension(m=1, s=-1))]
Rate = Annotated[float, Field(gt=0, allow_inf_nan=False), _quantity(dimension(rad=1, s=-1))]
Frequency = Annotated[float, Field(ge=0, allow_inf_nan=False), _quantity(dimension(rad=1, s=-1))]
Angle = Annotated[float, Field(gt=0, allow_inf_nan=False), _quantity(dimension(rad=1))]
PerSecond = Annotated[float, Field(ge=0, allow_inf_nan=False), _quantity(dimension(s=-1))]


def _coordinate(value: Any) -> Any:
    if isinstance(value, str) and re.fullmatch(REFERENCE_PATTERN, value):
        return value
    try:
        found = value_in(value, dimension(m=1)) if isinstance(value, str) else value
    except QuantityError as error:
        raise ValueError(f"a length, a signal (component.variable), or {error}") from error
    if isinstance(found, bool) or not isinstance(found, int | float) or not math.isfinite(found):
        raise ValueError("a length, or a signal: component.variable")
    return float(found)


Place = Annotated[
    list[
        Annotated[
            Any,
            AfterValidator(_coordinate),
            WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "string"}]}),
        ]
    ],
    Field(min_length=1, max_length=3),
]
"""A position: one to three coordinates, each a length or a signal `component.variable`."""


def _whole(wanted: Dimension) -> BeforeValidator:
    plain = _quantity(wanted)

    def convert(value: Any) -> Any:
        if not isinstance(value, str):
            return value
        found = plain.func(value)  # type: ignore[call-arg]
        if found != round(found):
            raise ValueError(f"a whole number of {wanted}; got {value!r}")
        return round(found)

    return BeforeValidator(convert, json_schema_input_type=int | QuantityText)


UNITS_OF_COUNTS = {
    None: (),
    "bit": (_whole(dimension(bit=1)),),
    "bit/s": (_whole(dimension(bit=1, s=-1)),),
}
"""Unit of a count -> what reads a text with such a unit."""


def _finite(value: Any) -> Any:
    if isinstance(value, str):
        try:
            parse_value(value)
        except QuantityError as error:
            raise ValueError(f"a number, or {error}") from error
        return value
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError("a number, or a text with a unit")  # noqa: TRY004 - pydantic's way
    if not math.isfinite(value):
        raise ValueError("a finite number")
    return float(value)


SignalValue = Annotated[
    Any,
    AfterValidator(_finite),
    WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "string"}]}),
]
"""A number, or a text with a unit; the FMU's variable determines its dimension later."""


def _of_fmi(value: Any, *, depth: int = 0) -> Any:
    if isinstance(value, list) and depth <= 8:
        for item in value:
            _of_fmi(item, depth=depth + 1)
    elif isinstance(value, float) and not math.isfinite(value):
        raise ValueError("a finite number")
    elif not isinstance(value, bool | int | float | str):
        raise ValueError("a number, a truth value, a text, or nested lists of them")
    return value


FmiValue = Annotated[
    Any,
    AfterValidator(_of_fmi),
    WithJsonSchema({"type": ["number", "boolean", "string", "array"]}),
]
"""A value of a variable of any FMI type; a text may be a quantity with a unit."""
