"""From a name or a file to a validated `Scenario`."""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from cosim.errors import InputError
from cosim.hinf.files import parse_toml
from cosim.scenario.locate import line_of
from cosim.scenario.schema import NAME_PATTERN, REFERENCE_PATTERN, Scenario

Model = TypeVar("Model", bound=BaseModel)


@dataclass(frozen=True)
class LoadedScenario:
    """A scenario with the text it was read from.

    Attributes
    ----------
    name : the built-in name, or the file's stem.
    text : the TOML as it stands.
    folder : where relative FMU paths are looked up.
    """

    name: str
    scenario: Scenario
    text: str
    folder: Path


def builtin_names() -> list[str]:
    """Names of the scenarios that come with the package."""
    library = files("cosim.scenario").joinpath("library")
    return sorted(
        p.name.removesuffix(".toml") for p in library.iterdir() if p.name.endswith(".toml")
    )


def load(name_or_path: str) -> LoadedScenario:
    """A built-in scenario by name, or a TOML file by path.

    Raises
    ------
    InputError : no such scenario, malformed TOML, or a scenario that breaks the schema.
    """
    names = builtin_names()
    if name_or_path in names:
        text = (
            files("cosim.scenario").joinpath("library", f"{name_or_path}.toml").read_text("utf-8")
        )
        return parse(text, name=name_or_path, where=f"{name_or_path}.toml", folder=Path.cwd())
    path = Path(name_or_path)
    if path.suffix != ".toml" and not path.exists():
        raise InputError.unknown("scenario", name_or_path, names)
    text = read_text(path)
    return parse(text, name=path.stem, where=str(path), folder=path.resolve().parent)


def read_text(path: Path) -> str:
    """Text of a file that a user named; an `InputError` if it cannot be read."""
    try:
        return path.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(
            "the file cannot be read", where=str(path), expected="a text file", got=str(error)
        ) from error


def parse(text: str, *, name: str, where: str, folder: Path) -> LoadedScenario:
    """Validate the TOML text of a scenario; `where` stands in the messages."""
    scenario = validated(Scenario, text, parse_toml(text, where), where)
    return LoadedScenario(name, scenario, text, folder)


def validated(model: type[Model], text: str, data: dict[str, Any], where: str) -> Model:
    """The `data` of a TOML `text` as an object of `model`.

    Raises
    ------
    InputError : it breaks the model; says file, line, key, and the nearest keys there are.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        first = _most_telling(error)
        path = _path(first, data)
        line = line_of(text, path)
        key = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path)[1:]
        others = len(error.errors()) - 1
        raise InputError(
            _sentence(first, key),
            where=f"{where}:{line}" if line else where,
            expected=_expected(first),
            got=None if first["type"] == "missing" else repr(first["input"])[:200],
            hint=_hint(model, first, path) or (f"{others} more after this one" if others else None),
        ) from error


def _most_telling(error: ValidationError) -> Any:
    # a value that fits no branch of a union is reported once per branch: that a table is no
    # number says less than what is wrong in the table; else the longest path came closest
    def rank(detail: Any) -> tuple[bool, bool, int]:
        scalar_wanted = isinstance(detail["input"], dict) and detail["type"] in _SCALAR_WANTED
        return not scalar_wanted, detail["type"] != "missing", len(detail["loc"])

    return max(error.errors(include_url=False), key=rank)


_SCALAR_WANTED = ("float_type", "int_type", "bool_type", "literal_error")


def _path(detail: Any, data: Any) -> list[str | int]:
    """The place of a fault as keys of the file; pydantic's names of union branches are none."""
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


def _hint(model: type[BaseModel], detail: Any, path: list[Any]) -> str | None:
    if detail["type"] != "extra_forbidden":
        return None
    schema = model.model_json_schema()
    known = set(schema["properties"])
    for part in schema.get("$defs", {}).values():
        known |= set(part.get("properties", {}))
    near = difflib.get_close_matches(str(path[-1]), sorted(known), n=2)
    return f"did you mean {' or '.join(near)}?" if near else None
