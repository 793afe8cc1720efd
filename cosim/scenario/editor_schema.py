"""JSON Schema of a scenario, for editors (taplo, Even Better TOML)."""

from __future__ import annotations

from typing import Any

from cosim.core import SCENARIO_FILE, SCHEMA
from cosim.scenario.extend import builtin_names
from cosim.scenario.schema import Scenario

_LOOSE = "In_extension_"


def json_schema() -> dict[str, Any]:
    """Return the schema of a scenario file; a file with `extends` needs no other key."""
    whole = Scenario.model_json_schema(by_alias=True)
    parts = whole.pop("$defs")
    loose = {f"{_LOOSE}{name}": _optional(part) for name, part in parts.items()}
    extension = _optional(whole)
    extension["required"] = ["extends"]
    for shape in (whole, extension):
        shape["properties"] = {
            SCHEMA: SCENARIO_FILE.json_schema(),
            "extends": {
                "description": "The scenario that this one extends: a name, or a file.",
                "anyOf": [{"enum": builtin_names()}, {"type": "string", "pattern": r"\.toml$"}],
            },
            "without": {
                "description": "What is taken away from it.",
                "type": "array",
                "items": {"type": "string"},
            },
            **shape["properties"],
        }
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "A co-simulation scenario",
        "type": "object",
        "if": {"required": ["extends"]},
        "then": extension,
        "else": whole,
        "$defs": parts | loose,
    }


def _optional(value: Any) -> Any:
    """Return a copy in which nothing is required, references included."""
    if isinstance(value, dict):
        kept = {k: v for k, v in value.items() if not (k == "required" and isinstance(v, list))}
        kept.pop("discriminator", None)
        if "oneOf" in kept:  # without required keys, several alternatives may match
            kept["anyOf"] = kept.pop("oneOf")
        return {
            k: v.replace("#/$defs/", f"#/$defs/{_LOOSE}") if k == "$ref" else _optional(v)
            for k, v in kept.items()
        }
    if isinstance(value, list):
        return [_optional(item) for item in value]
    return value
