"""Make tables of scenarios, and links of such tables, from the keys that `cosim.network` declares.

Times are in seconds in a scenario and in integer nanoseconds in a link.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import MISSING
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, Field, create_model

from cosim.core import InputError, NotNegative, Number, Text
from cosim.network import (
    MAX_NS,
    ChoiceKey,
    CountKey,
    DeclaredKey,
    DurationKey,
    NumberKey,
    ProbabilitiesKey,
    ProbabilityKey,
    TextKey,
    WordOrNumberKey,
    keys_of,
)
from cosim.scenario.fields import SECONDS, UNITS_OF_COUNTS, Part, Probability

T = TypeVar("T")
_LITERAL: Any = Literal


def part_of(
    declared: type,
    first: Mapping[str, tuple[Any, Any]] | None = None,
    optional: Collection[str] = (),
    **given: tuple[Any, Any],
) -> Any:
    """Make the model of a table with the keys of a link, or of a part of one.

    Parameters
    ----------
    first : further keys, which stand before these: type and default by name.
    optional : keys that a scenario may leave out: their value is None.
    given : type and default of keys that have another type in a scenario.
    """
    keys: dict[str, Any] = dict(first or {})
    for found in keys_of(declared).values():
        kind, default = given.get(found.name) or (_type(found), _default(found))
        if found.name in optional or default is None:
            kind, default = kind | None, None
        keys[found.name] = Annotated[kind, Field(description=found.key.text)], default
    return create_model(f"{declared.__name__}Keys", __base__=Part, **keys)


def of_part(declared: type[T], part: Part, **given: Any) -> T:
    """Make a link, or a part of one, of a table; `given` : fields that the table alone lacks.

    Raises
    ------
    InputError : keys that do not go together.
    """
    own = {
        found.field: _declared(found, getattr(part, found.name))
        for found in keys_of(declared).values()
        if found.field not in given
    }
    return declared(**own, **given)


def nanoseconds(seconds: float) -> int:
    """Round seconds to the nearest nanosecond."""
    return round(seconds * 1e9)


def _declared(found: DeclaredKey, value: Any) -> Any:
    if isinstance(found.key, ProbabilitiesKey):
        return tuple(tuple(row) for row in value) if found.key.rows else tuple(value)
    if isinstance(value, list):
        return tuple(value)
    return nanoseconds(value) if isinstance(found.key, DurationKey) and value is not None else value


def _default(found: DeclaredKey) -> Any:
    if found.default is MISSING:
        return ...
    if isinstance(found.key, DurationKey) and found.default is not None:
        return found.default / 1e9
    return found.default


def _type(found: DeclaredKey) -> Any:
    if isinstance(found.key, ProbabilitiesKey | TextKey):
        return _type_of_lists(found.key)
    match found.key:
        case DurationKey(least_ns=least):
            limits = Field(ge=least / 1e9, le=MAX_NS / 1e9, allow_inf_nan=False)
            return Annotated[float, limits, SECONDS]
        case ProbabilityKey():
            return Probability
        case NumberKey(least=least):
            return Number if least is None else Annotated[NotNegative, _in_range(found)]
        case CountKey():
            limits = Field(ge=0, le=found.key.most)
            return Annotated[int, limits, *UNITS_OF_COUNTS[found.key.unit]]
        case ChoiceKey(words=words):
            word = _LITERAL[words]
            return word | Number if isinstance(found.key, WordOrNumberKey) else word
    raise TypeError(f"{found.name}: scenarios have no type for a {type(found.key).__name__}")


def _type_of_lists(key: ProbabilitiesKey | TextKey) -> Any:
    if isinstance(key, TextKey):
        return Text | list[Text] if key.several else Text
    limits = Field(min_length=key.least, max_length=key.most)
    numbers = Annotated[list[Probability], limits]
    return Annotated[list[numbers], limits] if key.rows else numbers


def _in_range(found: DeclaredKey) -> AfterValidator:
    def check(value: Any) -> Any:
        try:
            found.key.check("", found.name, value)
        except InputError as error:
            raise ValueError(error.expected) from error
        return value

    return AfterValidator(check)
