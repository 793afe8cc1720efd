"""Limits of a supervised run: [limits] in scenarios, --limit on the command line."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, ValidationError

from cosim.core import InputError, QuantityError, dimension, quantity_in
from cosim.scenario.fields import Delay, Part, QuantityText

_NONE = "none"


def _no_limit(value: Any) -> Any:
    return 0.0 if value == _NONE else value


def _bytes(value: Any) -> Any:
    """Return bytes of a text with a unit: "2 GB", "512 MiB"."""
    if not isinstance(value, str):
        return value
    try:
        return float(quantity_in(value, dimension(bit=1))) / 8
    except QuantityError as error:
        raise ValueError(f"a number of bytes, or {error}") from error


_Words = float | QuantityText | Literal["none"]
TimeLimit = Annotated[Delay, BeforeValidator(_no_limit, json_schema_input_type=_Words)]
MemoryLimit = Annotated[
    float,
    Field(ge=0, allow_inf_nan=False),
    BeforeValidator(_bytes),
    BeforeValidator(_no_limit, json_schema_input_type=_Words),
]


class LimitsPart(Part):
    """[limits]: what a supervised run may use; 0 or "none": no limit."""

    call: TimeLimit | None = None
    """Wall-clock time of one FMI call during the run (1 h)."""
    run: TimeLimit | None = None
    """Wall-clock time of the whole run (none)."""
    start: TimeLimit | None = None
    """Of loading and initialising the components (1 h)."""
    end: TimeLimit | None = None
    """Of terminating and freeing them (10 min)."""
    memory: MemoryLimit | None = None
    """Of all components together, as in "2 GB" (nine tenths of the machine's; Linux)."""


def parse_limits(limits: Sequence[str]) -> dict[str, Any]:
    """Parse limits given as texts: "call=30", "memory=2 GB", "run=none".

    Raises
    ------
    InputError : a limit that does not exist, or is not one.
    """
    found: dict[str, Any] = {}
    for text in limits:
        key, _, value = (part.strip() for part in text.partition("="))
        if key not in LimitsPart.model_fields:
            raise InputError.unknown("limit", key, LimitsPart.model_fields, where=f"`limit` {text}")
        found[key] = _limit(key, value, f"`limit` {text}")
    return found


def time_limit(text: str, where: str) -> float | None:
    """Parse a wall-clock time [s]: "30", "2 min"; None for none.

    Raises
    ------
    InputError : it is no time; `where` names the option.
    """
    seconds: float = _limit("run", text, where)
    return seconds or None


def _limit(key: str, text: str, where: str) -> Any:
    """Return the value of a limit; 0 for none."""
    try:
        plain: Any = float(text)
    except ValueError:
        plain = text
    try:
        return getattr(LimitsPart.model_validate({key: plain}), key)
    except ValidationError as error:
        raise InputError(
            "not a limit",
            where=where,
            expected='a number, one with a unit as in "2 min" or "1 GB", or none',
            got=text,
        ) from error
