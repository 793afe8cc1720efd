"""Validate the data of a file; pydantic's errors become messages with file, line, key, expected."""

from __future__ import annotations

import difflib
from typing import Any

from pydantic import ValidationError

from cosim.core.errors import InputError, did_you_mean, format_value
from cosim.core.known_keys import example_of, keys_of_table, suggestion
from cosim.core.origin import KeyPath, Layer, Origin, dotted, placed
from cosim.core.part import Part, PartType

_WRITTEN = 1e15
"""Numbers below are written out in a hint; Python refuses to write the longest integers."""
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
        if more:
            command = f": {model.lists_faults}" if model.lists_faults else ""
            others = f"{len(more)} more after this one{command}"
            first.hint = others if first.hint is None else f"{first.hint}; {others}"
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
    advice = model.advice(detail["type"], path, detail["input"], data) or _by_type(
        model, detail, path
    )
    if advice is None and detail["type"] != "extra_forbidden":
        example = example_of(path, model)
        advice = None if example is None else f"as in {example}"
    if advice is None and model.described_by is not None:
        advice = f"{model.described_by} describes every key"
    return advice


def _by_type(model: type[Part], detail: Any, path: KeyPath) -> str | None:
    """Return what to do about a fault of this type."""
    value, wrong = detail["input"], detail["type"]
    if wrong == "extra_forbidden":
        return suggestion(str(path[-1]), path[:-1], model)
    if wrong == "literal_error":
        words = [word.strip("'") for word in detail["ctx"]["expected"].split(" or ")]
        return _one_of(value, [c.strip("' ") for word in words for c in word.split(",")])
    if wrong == "union_tag_invalid":
        tags = [tag.strip("' ") for tag in detail["ctx"]["expected_tags"].split(",")]
        return _one_of(detail["ctx"]["tag"], tags)
    return _brackets_and_quotes(wrong, value, dotted(path))


def _brackets_and_quotes(wrong: str, value: Any, key: str) -> str | None:
    """Return how a value of another type is written; None where that says nothing."""
    hint = None
    match wrong:
        case "list_type" | "tuple_type" if isinstance(value, str):
            hint = f'in brackets: ["{value}"]'
        case "list_type" | "tuple_type" if isinstance(value, dict):
            hint = f"double brackets: [[{key}]]"
        case "dict_type" if isinstance(value, list):
            hint = f"a table for each, with its name: [{key}.NAME]"
        case kind if kind in _NO_TABLE and isinstance(value, list):
            hint = f"single brackets: [{key}]"
        case "string_type" if isinstance(value, int | float) and abs(value) < _WRITTEN:
            hint = f'in quotes: "{value}"'
        case "string_type" if isinstance(value, int | float):
            hint = "a text, in quotes"
        case _ if isinstance(value, str):
            hint = number_in_quotes(value)
    return hint


def _one_of(value: Any, choices: list[str]) -> str:
    return did_you_mean(difflib.get_close_matches(str(value), choices, n=2)) or (
        f'one of these, such as "{choices[0]}"'
    )


def number_in_quotes(text: str) -> str | None:
    """Return what to do about a text that is a number; None for another one."""
    try:
        float(text)
    except ValueError:
        return None
    return f"a number is written without quotes: {text.strip()}"
