"""From a name or a file to a validated `Scenario`."""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from cosim.errors import InputError
from cosim.hinf.files import parse_toml
from cosim.scenario.locate import line_of
from cosim.scenario.schema import Scenario


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
    return LoadedScenario(name, _validated(text, parse_toml(text, where), where), text, folder)


def _validated(text: str, data: dict[str, Any], where: str) -> Scenario:
    try:
        return Scenario.model_validate(data)
    except ValidationError as error:
        first = _most_telling(error)
        path = [part for part in first["loc"] if not _is_branch(part, data)]
        line = line_of(text, path)
        key = ".".join(str(part) for part in path)
        others = len(error.errors()) - 1
        raise InputError(
            _sentence(first, key),
            where=f"{where}:{line}" if line else where,
            expected=_expected(first),
            got=None if first["type"] == "missing" else repr(first["input"])[:200],
            hint=_hint(first, path) or (f"{others} more after this one" if others else None),
        ) from error


def _most_telling(error: ValidationError) -> Any:
    # a value that fits no branch of a union is reported once per branch: the longest path
    # is the branch that came closest
    details = error.errors(include_url=False)
    return max(details, key=lambda d: (d["type"] != "missing", len(d["loc"])))


def _is_branch(part: Any, data: dict[str, Any]) -> bool:
    del data
    return isinstance(part, str) and (
        part in ("packet", "transport", "float", "int", "bool", "constrained-float")
        or "[" in part
        or part.endswith("Part")
    )


def _sentence(detail: Any, key: str) -> str:
    match detail["type"]:
        case "extra_forbidden":
            return f"there is no key {key!r}"
        case "missing":
            return f"the key {key!r} is missing"
        case _:
            return f"the value of {key!r} is not allowed"


def _expected(detail: Any) -> str | None:
    if detail["type"] in ("extra_forbidden", "missing"):
        return None
    message: str = detail["msg"].removeprefix("Value error, ").removeprefix("Input should be ")
    return message


def _hint(detail: Any, path: list[Any]) -> str | None:
    if detail["type"] != "extra_forbidden":
        return None
    known = set(Scenario.model_json_schema()["properties"])
    for part in Scenario.model_json_schema()["$defs"].values():
        known |= set(part.get("properties", {}))
    near = difflib.get_close_matches(str(path[-1]), sorted(known), n=2)
    return f"did you mean {' or '.join(near)}?" if near else None
