"""Kinds of files that users write, and the versions of their keys.

Scenarios, systems, studies, vehicles (TOML) and designs (JSON) may say `schema = 1` at the top;
without it a file is of version 1. A file of an older version is brought to the newest one as it is
read, one step per version; one of a newer version is refused by name. `cosim migrate` writes the
newest version (`cosim.core.migration`). docs/schema-versions.md has the rule of how versions come
and go.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from cosim.core.errors import InputError, format_value
from cosim.core.toml_text import parse_toml

SCHEMA: Final = "schema"
"""The key of the version, at the top of a file."""

Step = Callable[[dict[str, Any]], dict[str, Any]]
"""Makes the content of one version of that of the version before."""


@dataclass(frozen=True)
class FileKind:
    """A kind of file.

    Attributes
    ----------
    name : in messages.
    use : what to do with such a file, for somebody who gave it to a command for another kind.
    steps : the first makes version 2 of version 1, and so on.
    """

    name: str
    use: str
    steps: tuple[Step, ...] = ()

    @property
    def version(self) -> int:
        """The newest version, which is written."""
        return 1 + len(self.steps)

    def version_of(self, data: Mapping[str, Any], where: str) -> int:
        """Return the version that a file says it has; 1 without the key.

        Raises
        ------
        InputError : not a version, or one that is newer than this software.
        """
        found = data.get(SCHEMA, 1)
        if not isinstance(found, int) or isinstance(found, bool) or found < 1:
            raise InputError(
                "not a schema version",
                where=f"{where}: {SCHEMA}",
                expected="a whole number from 1 on",
                got=format_value(found),
            )
        if found > self.version:
            raise InputError(
                f"this {self.name} has schema version {format_value(found)}, which this version of "
                "auv-cosim does not know",
                where=f"{where}: {SCHEMA}",
                expected=f"at most {self.version}",
                got=format_value(found),
                hint="a newer auv-cosim reads it: pip install --upgrade auv-cosim",
            )
        return found

    def current(self, data: dict[str, Any], where: str) -> dict[str, Any]:
        """Return the content of a file in the newest version, without the key of the version.

        Raises
        ------
        InputError : as `version_of`.
        """
        version = self.version_of(data, where)
        content = {key: value for key, value in data.items() if key != SCHEMA}
        for step in self.steps[version - 1 :]:
            content = step(content)
        return content

    def from_toml(self, text: str, where: str) -> dict[str, Any]:
        """Return the content of a TOML text as `current`.

        Raises
        ------
        InputError : as `version_of`; malformed TOML; a file of another kind.
        """
        data = parse_toml(text, where)
        other = kind_by_keys(data)
        if other is not None and other.name != self.name:
            raise InputError(
                f"this file is a {other.name}, not a {self.name}",
                where=where,
                hint=other.use.format(file=where),
            )
        return self.current(data, where)

    def stamped(self, data: Mapping[str, Any]) -> dict[str, Any]:
        """Return the content of a new file, with its version first."""
        return {SCHEMA: self.version, **data}

    def json_schema(self) -> dict[str, Any]:
        """Return the JSON Schema of the key."""
        return {
            "description": f"Version of the keys of this {self.name}; 1 if absent.",
            "type": "integer",
            "minimum": 1,
            "maximum": self.version,
        }


SCENARIO_FILE: Final = FileKind("scenario", "cosim run {file} runs it")
"""A scenario, TOML."""

SYSTEM_FILE: Final = FileKind(
    "system",
    "cosim design {file} designs a gain for it, cosim fmu build {file} makes its FMU; a scenario "
    'names it: [design] system = "{file}"',
)
"""A system, TOML."""

STUDY_FILE: Final = FileKind("study", "cosim study run {file} runs it")
"""A study, TOML."""

VEHICLE_FILE: Final = FileKind(
    "vehicle",
    "cosim vehicle check {file} checks it, cosim fmu build {file} makes its FMU, "
    "cosim vehicle fly {file} designs for it and flies",
)
"""A vehicle, TOML."""

DESIGN_FILE: Final = FileKind(
    "design",
    "cosim certificate check {file} proves it, cosim fmu controller {file} makes its FMU; a "
    'scenario names it: [design] file = "{file}"',
)
"""A design with its certificate, JSON."""

PLANT_NOTE: Final = "plant_note"
"""Key of the note in a design file on how the FMU of its plant is seen as its linear system."""

_OF_SCENARIOS = ("run", "components", "connections", "connect", "extends")


def kind_by_keys(data: Mapping[str, Any]) -> FileKind | None:
    """Return the kind of a file that its keys show; None where they do not show one."""
    if isinstance(data.get("claim"), dict):
        return DESIGN_FILE
    if isinstance(data.get("system"), dict):
        return SYSTEM_FILE
    if isinstance(data.get("body"), dict) and "degrees_of_freedom" in data:
        return VEHICLE_FILE
    if isinstance(data.get("vary"), list):
        return STUDY_FILE
    return SCENARIO_FILE if any(key in data for key in _OF_SCENARIOS) else None
