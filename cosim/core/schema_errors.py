"""Validate the data of a file; pydantic's errors become messages with file, line, key, expected."""

from __future__ import annotations

import difflib
from typing import Any

from pydantic import ValidationError

from cosim.core.errors import InputError, did_you_mean, format_value
from cosim.core.known_keys import keys_of_table, suggestion
from cosim.core.origin import KeyPath, Layer, Origin, dotted, placed
from cosim.core.part import Part, PartType

_NO_TABLE = ("model_type", "model_attributes_type", "dict_type")
_LONGEST, _LISTED = 200, 20


def validated(model: type[PartType], text: str, data: dict[str, Any], where: str) -> PartType:
    """Validate the `data` of a TOML `text` as an object of `model`.

    Raises
    ------
    InputError : it breaks the model; says file, line, key, and the nearest known keys.
    """
    return valid(model, data, Origin((Layer(where, text),)))


def valid(model: type[PartType], data: Any, origin: Origin) -> PartType:
    """Validate data that come from several layers, as `validated`."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        first, *more = refusals(model, error, data, origin)
        if first.hint is None and more:
            command = f": {model.lists_faults}" if model.lists_faults else ""
            first.hint = f"{len(more)} more after this one{command}"
            first.args = (first.text(),)
        raise first from error


def all_refusals(
    model: type[Part], text: str, data: dict[str, Any], where: str
) -> list[InputError]:
    """Return an error for every key of the `data` of a TOML `text` that breaks the model."""
    try:
        model.model_validate(data)
    except ValidationError as error:
        return refusals(model, error, data, Origin((Layer(where, text),)))
    return []


def refusals(
    model: type[Part], error: ValidationError, data: Any, origin: Origin
) -> list[InputError]:
    """Return one error per place of the file, the most specific first."""
    details = sorted(error.errors(include_url=False), key=_rank, reverse=True)
    found: dict[KeyPath, Any] = {}
    for detail in details:
        found.setdefault(_path(detail, data), detail)
    # a value that fits no branch of a union is reported once per branch: report what is wrong
    # inside it rather than that it is not of another kind
    inner = [p for p in found if not any(q[: len(p)] == p and q != p for q in found)]
    return [_refusal(model, found[path], path, origin, data) for path in inner]


def _rank(detail: Any) -> tuple[bool, bool, int]:
    """Sort key: the error with the longest path came closest to a match."""
    return detail["type"] not in _NO_TABLE, detail["type"] != "missing", len(detail["loc"])


def _refusal(
    model: type[Part], detail: Any, path: KeyPath, origin: Origin, data: Any
) -> InputError:
    cause = detail.get("ctx", {}).get("error")
    if isinstance(cause, InputError):
        return placed(cause, path, origin)
    return InputError(
        _sentence(detail, dotted(path)),
        where=origin.place(path),
        expected=_expected(model, detail, path),
        got=_got(detail),
        hint=_hint(model, detail, path, data),
    )


def _got(detail: Any) -> str | None:
    """Return what was found; not the content of a table whose key is wrong."""
    whole = detail["type"] == "extra_forbidden" and isinstance(detail["input"], dict | list)
    return None if whole or detail["type"] == "missing" else format_value(detail["input"], _LONGEST)


def _path(detail: Any, data: Any) -> KeyPath:
    """Return the path of an error in the file, without pydantic's names of union branches."""
    path: list[str | int] = []
    for i, part in enumerate(detail["loc"]):
        here = (isinstance(data, dict) and part in data) or (
            isinstance(data, list) and isinstance(part, int)
        )
        if here:
            data = data[part]
        if here or (detail["type"] == "missing" and i == len(detail["loc"]) - 1):
            path.append(part)
    return tuple(path)


def _sentence(detail: Any, key: str) -> str:
    match detail["type"]:
        case "extra_forbidden":
            return f"there is no key {key!r}"
        case "missing":
            return f"the key {key!r} is missing"
        case _:
            return f"the value of {key!r} is not allowed" if key else "not a table of keys"


def _expected(model: type[Part], detail: Any, path: KeyPath) -> str | None:
    match detail["type"]:
        case "extra_forbidden":
            known = keys_of_table(path[:-1], model)
            return ", ".join(known) if len(known) <= _LISTED else f"one of {len(known)} keys"
        case "missing":
            return None
        case "string_pattern_mismatch":
            return model.patterns[detail["ctx"]["pattern"]]
        case "union_tag_invalid":
            return f"kind = {detail['ctx']['expected_tags'].replace(',', ' or')}"
        case "union_tag_not_found":
            message = "a key 'kind' that says which kind this is"
        case kind if kind in _NO_TABLE:
            message = "a table"
        case _:
            message = detail["msg"].removeprefix("Value error, ").removeprefix("Input should be ")
    got = format_value(detail["input"], len(message))
    return _PLAIN.get(message, message).removesuffix(f"; got {got}")


_PLAIN = {
    "a valid list": "a list, in brackets",
    "a valid tuple": "a list, in brackets",
    "a valid number": "a number",
    "a valid integer": "a whole number",
    "a valid string": "a text, in quotes",
    "a valid boolean": "true or false",
}


def _hint(model: type[Part], detail: Any, path: KeyPath, data: Any) -> str | None:
    """Suggest the nearest allowed words, the key that is meant, or how the value is written."""
    value, wrong = detail["input"], detail["type"]
    advice = model.advice(wrong, path, value, data)
    if advice is not None:
        return advice
    match wrong:
        case "literal_error":
            words = [word.strip("'") for word in detail["ctx"]["expected"].split(" or ")]
            choices = [c.strip("' ") for word in words for c in word.split(",")]
            return did_you_mean(difflib.get_close_matches(str(value), choices, n=2))
        case "extra_forbidden":
            return suggestion(str(path[-1]), path[:-1], model)
        case "list_type" | "tuple_type" if isinstance(value, str):
            return f'in brackets: ["{value}"]'
        case "list_type" | "tuple_type" if isinstance(value, dict):
            return f"double brackets: [[{dotted(path)}]]"
    return None
