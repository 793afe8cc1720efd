"""Turn pydantic's validation errors into messages with file, line, key, expected and got."""

from __future__ import annotations

import difflib
from typing import Any

from pydantic import BaseModel, ValidationError

from cosim.core import InputError, did_you_mean
from cosim.scenario.events import ConditionError
from cosim.scenario.fields import COLUMN_PATTERN, NAME_PATTERN, OUTPUT_PATTERN, REFERENCE_PATTERN
from cosim.scenario.known_keys import suggestion
from cosim.scenario.origin import Origin, Path, key

_SCALAR_WANTED = ("float_type", "int_type", "bool_type", "literal_error", "value_error")
_NO_TABLE = ("model_type", "model_attributes_type", "dict_type")


def refusals(
    model: type[BaseModel], error: ValidationError, data: Any, origin: Origin
) -> list[InputError]:
    """Return one error per place of the file, the most specific first."""
    found: dict[Path, Any] = {}
    for detail in sorted(error.errors(include_url=False), key=_rank, reverse=True):
        path = tuple(_path(detail, data))
        # a value that fits no branch of a union is reported once per branch: report what is wrong
        # in a table rather than that it is not a number
        if path in found or (
            _of_other_branch(detail) and any(p[: len(path)] == path for p in found)
        ):
            continue
        found[path] = detail
    return [_refusal(model, detail, path, origin, data) for path, detail in found.items()]


def _rank(detail: Any) -> tuple[bool, bool, int]:
    """Sort key: the error with the longest path came closest to a match."""
    return not _of_other_branch(detail), detail["type"] != "missing", len(detail["loc"])


def _of_other_branch(detail: Any) -> bool:
    if isinstance(detail["input"], dict):
        return detail["type"] in _SCALAR_WANTED
    return detail["type"] in _NO_TABLE and detail["loc"][-1] == "BurstPart"


def _refusal(
    model: type[BaseModel], detail: Any, path: Path, origin: Origin, data: Any
) -> InputError:
    cause = detail.get("ctx", {}).get("error")
    if isinstance(cause, ConditionError):
        found = cause.error
        return InputError(
            f"{key(path)}, {found.where}: {found.what}",
            where=origin.place(path),
            expected=found.expected,
            got=found.got,
            hint=found.hint,
        )
    return InputError(
        _sentence(detail, key(path)),
        where=origin.place(path),
        expected=_expected(detail),
        got=_got(detail),
        hint=_hint(model, detail, path, data),
    )


def _got(detail: Any) -> str | None:
    """Return what was found; not the content of a table whose key is wrong."""
    whole = detail["type"] == "extra_forbidden" and isinstance(detail["input"], dict | list)
    return None if whole or detail["type"] == "missing" else repr(detail["input"])[:200]


def _path(detail: Any, data: Any) -> list[str | int]:
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
    return path


def _sentence(detail: Any, key: str) -> str:
    match detail["type"]:
        case "extra_forbidden":
            return f"there is no key {key!r}"
        case "missing":
            return f"the key {key!r} is missing"
        case _:
            return f"the value of {key!r} is not allowed"


def _expected(detail: Any) -> str | None:
    match detail["type"]:
        case "extra_forbidden" | "missing":
            return None
        case "string_pattern_mismatch":
            return _PATTERNS[detail["ctx"]["pattern"]]
        case "union_tag_not_found":
            return "a key 'kind' that says which kind this is"
        case "union_tag_invalid":
            return f"kind = {detail['ctx']['expected_tags'].replace(',', ' or')}"
    message: str = detail["msg"].removeprefix("Value error, ").removeprefix("Input should be ")
    return _PLAIN.get(message, message).removesuffix(f"; got {detail['input']!r}")


_PLAIN = {
    "a valid list": "a list, in brackets",
    "a valid number": "a number",
    "a valid integer": "a whole number",
    "a valid string": "a text, in quotes",
    "a valid boolean": "true or false",
    "a valid dictionary": "a table",
}


_PATTERNS = {
    NAME_PATTERN: "a name: a letter, then letters, digits, _ or -",
    REFERENCE_PATTERN: "component.variable",
    COLUMN_PATTERN: "the name of a column: a letter, then letters, digits, _ . or -",
    OUTPUT_PATTERN: "the name of an output: a letter or _, then letters, digits and _ . [ ] ,",
}


def _hint(model: type[BaseModel], detail: Any, path: Path, data: Any) -> str | None:
    """Suggest the nearest allowed words, the key that is meant, or how the value is written."""
    value = detail["input"]
    match detail["type"]:
        case "literal_error":
            words = [word.strip("'") for word in detail["ctx"]["expected"].split(" or ")]
            choices = [c.strip("' ") for word in words for c in word.split(",")]
            return did_you_mean(difflib.get_close_matches(str(value), choices, n=2))
        case "extra_forbidden":
            return suggestion(str(path[-1]), path[:-1], model.model_json_schema())
        case "union_tag_not_found" if path[0] == "links":
            others = [name for name in data["links"] if name != path[-1]]
            there = f"; the links that are there: {', '.join(others)}" if others else ""
            return f'a new link has kind = "packet" or "transport"{there}'
    return _written(value, detail["type"], path)


def _written(value: Any, wrong: str, path: Path) -> str | None:
    """Return how a value of the wrong type is written."""
    if wrong == "list_type" and isinstance(value, str):
        return f'in brackets: ["{value}"]'
    if wrong == "less_than_equal" and path[-1] in ("loss", "duplicate"):
        return f'a probability: "{value} %" is {value} in a hundred'
    if "parameters" in path[:-1] and isinstance(value, dict):
        name = f"{path[-1]}.{next(iter(value), 'x')}"
        return f'a name with a dot is written in quotes: "{name}" = ...'
    return None
