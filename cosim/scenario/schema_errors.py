"""Turn pydantic's validation errors into messages with file, line, key, expected and got."""

from __future__ import annotations

import difflib
from typing import Any

from pydantic import BaseModel, ValidationError

from cosim.core import InputError
from cosim.scenario.events import ConditionError
from cosim.scenario.fields import NAME_PATTERN, REFERENCE_PATTERN
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
    return [_refusal(model, detail, path, origin) for path, detail in found.items()]


def _rank(detail: Any) -> tuple[bool, bool, int]:
    """Sort key: the error with the longest path came closest to a match."""
    return not _of_other_branch(detail), detail["type"] != "missing", len(detail["loc"])


def _of_other_branch(detail: Any) -> bool:
    if isinstance(detail["input"], dict):
        return detail["type"] in _SCALAR_WANTED
    return detail["type"] in _NO_TABLE and detail["loc"][-1] == "BurstPart"


def _refusal(model: type[BaseModel], detail: Any, path: Path, origin: Origin) -> InputError:
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
        got=None if detail["type"] == "missing" else repr(detail["input"])[:200],
        hint=_hint(model, detail, path),
    )


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
    return message


_PATTERNS = {
    NAME_PATTERN: "a name: a letter, then letters, digits, _ or -",
    REFERENCE_PATTERN: "component.variable",
}


def _hint(model: type[BaseModel], detail: Any, path: Path) -> str | None:
    """Suggest the nearest allowed words, or the key that is meant."""
    if detail["type"] == "literal_error":
        words = [word.strip("'") for word in detail["ctx"]["expected"].split(" or ")]
        choices = [c.strip("' ") for word in words for c in word.split(",")]
        near = difflib.get_close_matches(str(detail["input"]), choices, n=2)
        return f"did you mean {' or '.join(near)}?" if near else None
    if detail["type"] != "extra_forbidden":
        return None
    return suggestion(str(path[-1]), path[:-1], model.model_json_schema())
