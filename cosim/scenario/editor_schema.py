"""JSON Schema of a scenario, for editors (taplo, Even Better TOML)."""

from __future__ import annotations

from typing import Any

from cosim.core import SCENARIO_FILE, SCHEMA
from cosim.scenario.built_in import builtin_names
from cosim.scenario.copies import MOST, NAMED
from cosim.scenario.schema import ScenarioPart

_LOOSE = "In_extension_"


def json_schema() -> dict[str, Any]:
    """Return the JSON schema of a scenario file, for editors.

        >>> import json
        >>> from pathlib import Path
        >>> from cosim.scenario import json_schema
        >>> schema = json_schema()
        >>> written = Path("scenario.schema.json").write_text(json.dumps(schema))
        >>> schema["title"], "links" in schema["else"]["properties"]
        ('A co-simulation scenario', True)

    With `extends`, or copies, no other key is needed.
    """
    whole = ScenarioPart.model_json_schema(by_alias=True)
    parts = whole.pop("$defs")
    for name in _COPIED:
        parts[name]["properties"] |= _COPIES
    parts["ForPart"] = _for_part(whole["properties"])
    whole["properties"]["for"] = {
        "description": "Parts that are there once per name or number.",
        "type": "array",
        "items": {"$ref": "#/$defs/ForPart"},
    }
    loose = {f"{_LOOSE}{name}": _optional(part) for name, part in parts.items()}
    extension = _optional(whole)
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
        "if": {"anyOf": [{"required": ["extends"]}, {"required": ["for"]}, *map(_copied, NAMED)]},
        "then": extension,
        "else": whole,
        "$defs": parts | loose,
    }


_COPIED = ("ComponentPart", "PacketPart", "TransportPart")
_COPIES: dict[str, Any] = {
    "count": {
        "description": "How many copies there are: NAME_1, NAME_2, ...; {i} is the number.",
        "type": "integer",
        "minimum": 1,
        "maximum": MOST,
    },
    "each": {
        "description": "In place of count, the names of the copies: NAME_alpha, ...; {each} is the "
        "name. Or a table per copy, whose keys stand in braces.",
        "type": "array",
        "items": {"type": ["string", "number", "object"]},
    },
    "as": {
        "description": 'What stands in braces instead of "each" (or "i", with count).',
        "type": "string",
    },
}


def _copied(table: str) -> dict[str, Any]:
    """Return the schema of a file in which an entry of this table has copies."""
    once = {"not": {"anyOf": [{"required": ["count"]}, {"required": ["each"]}]}}
    return {
        "required": [table],
        "properties": {table: {"not": {"additionalProperties": once}}},
    }


def _for_part(tables: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of [[for]]: any table may stand in it, with braces in texts and keys."""
    repeated = {
        name: {"description": value.get("description", "")}
        for name, value in tables.items()
        if name not in ("title", "description", "run", "log", "limits")
    }
    nested = {"for": {"description": "Further copies of each copy."}}
    text = "[[for]]: what stands in it, once per name or number.\n\nOne of `each` and `count`."
    return {
        "description": text,
        "type": "object",
        "properties": {**_COPIES, **repeated, **nested},
    }


def _optional(value: Any) -> Any:
    """Return a copy in which nothing is required, references included."""
    if isinstance(value, dict):
        kept = {k: v for k, v in value.items() if not (k == "required" and isinstance(v, list))}
        kept.pop("discriminator", None)
        if isinstance(kept.get("pattern"), str):  # or a placeholder of a copy
            kept["pattern"] = rf"{kept['pattern']}|[{{]"
        if "oneOf" in kept:  # without required keys, several alternatives may match
            kept["anyOf"] = kept.pop("oneOf")
        return {
            k: v.replace("#/$defs/", f"#/$defs/{_LOOSE}") if k == "$ref" else _optional(v)
            for k, v in kept.items()
        }
    if isinstance(value, list):
        return [_optional(item) for item in value]
    return value
