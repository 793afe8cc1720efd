"""Field types of scenarios: names, times, numbers with or without a unit.

A plain number is in SI; a text is a quantity with a unit of the right dimension.
"""

from __future__ import annotations

import math
import re
from typing import Annotated, Any

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    StringConstraints,
    WithJsonSchema,
)

from cosim.core import with_field_docs
from cosim.network import MAX_NS
from cosim.scenario.quantity import (
    NUMBER_ONLY,
    TIME,
    Dimension,
    QuantityError,
    dimension,
)
from cosim.scenario.values import VALUE_PATTERN, parse_value, value_in

NAME_PATTERN = r"^[A-Za-z][A-Za-z0-9_-]*$"
"""Regular expression of the name of a component or a link."""

REFERENCE_PATTERN = r"^[A-Za-z][A-Za-z0-9_-]*\..+$"
COLUMN_PATTERN = r"^[A-Za-z][A-Za-z0-9_.-]*$"
"""Regular expression of the name of a column in the table of a study."""
OUTPUT_PATTERN = r"^[A-Za-z_][A-Za-z0-9_.\[\],]*$"
Name = Annotated[str, StringConstraints(pattern=NAME_PATTERN)]
Reference = Annotated[str, StringConstraints(pattern=REFERENCE_PATTERN)]
Text = Annotated[str, StringConstraints(min_length=1)]


class Part(BaseModel):
    """A table of a scenario."""

    # strict: "5.0" is not a number and true is not 1, as in TOML
    # built at first use: most tables are only used as parts of others, which build them again
    model_config = ConfigDict(
        extra="forbid", frozen=True, populate_by_name=True, strict=True, defer_build=True
    )

    @classmethod
    def __get_pydantic_json_schema__(cls, core: Any, handler: Any) -> Any:
        """Return the JSON schema, in which each key has the string below its field."""
        return with_field_docs(cls, core, handler)


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
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
"""A finite number > 0."""
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
"""A finite number >= 0."""
Number = Annotated[float, Field(allow_inf_nan=False)]
"""A finite number."""
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
