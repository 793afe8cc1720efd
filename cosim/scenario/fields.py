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
        **dict.fromkeys(("time", "instant"), "at"),
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


class Part(core.Part):
    """A table of a scenario, of a study or of a vehicle."""

    meant = _MEANT
    patterns = _PATTERNS

    @classmethod
    def advice(cls, wrong: str, path: KeyPath, value: Any, data: Any) -> str | None:
        """Return what to do about a fault that scenarios are known for."""
        match wrong, path:
            case "extra_forbidden", ("design", word) if word in _MATRICES:
                return 'matrices are in the file of a system: system = "my-system.toml"'
            case "union_tag_not_found", ("links", *_):
                others = [name for name in data["links"] if name != path[-1]]
                there = f"; the links that are there: {', '.join(others)}" if others else ""
                return f'a new link has kind = "packet" or "transport"{there}'
            case "less_than_equal", (*_, "loss" | "duplicate"):
                return f'a probability: "{value} %" is {value} in a hundred'
            case _, (*_, "jitter") if not isinstance(value, dict):
                return f'jitter = {{ kind = "uniform", width = "{value}" }}'
            case _ if "parameters" in path[:-1] and isinstance(value, dict):
                name = f"{path[-1]}.{next(iter(value), 'x')}"
                return f'a name with a dot is written in quotes: "{name}" = ...'
        return None


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
