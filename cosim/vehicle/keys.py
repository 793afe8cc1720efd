"""The keys of a vehicle file, as its schema declares them: for messages, the command line, docs."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple

from cosim.vehicle.schema import VehicleFile

_UNIT = re.compile(r"\[((?:k?[gNm]|rad|1/|s\b|N)[^\]]*)\]")
_TABLES = {
    "body": "[body]",
    "hydro": "[hydro]",
    "cross_flow": "[cross_flow]",
    "lift_drag": "[lift_drag]",
    "onboard_damping": "[onboard_damping]",
    "thrusters": "[[thrusters]]",
    "fins": "[[fins]]",
    "sensors": "[[sensors]]",
    "trim": "[trim]",
    "control": "[control]",
}


_KINDS = {
    "boolean": "true or false",
    "string": "text",
    "integer": "whole number",
    "object": "table of numbers",
}


class VehicleKey(NamedTuple):
    """A key of a vehicle file: the value it takes, its unit, its meaning, whether it is needed."""

    value: str
    unit: str
    text: str
    required: bool


def vehicle_schema() -> dict[str, Any]:
    """Return the JSON Schema of a vehicle file."""
    return VehicleFile.model_json_schema()


@cache
def vehicle_tables() -> Mapping[str, tuple[str, Mapping[str, VehicleKey]]]:
    """Return the tables of a vehicle file: heading -> what it is for, and its keys."""
    schema = vehicle_schema()
    parts = schema["$defs"]
    tables = {"top of the file": ("What the vehicle is.", _keys(schema, parts, _TABLES))}
    for name, heading in _TABLES.items():
        part = parts[_part_of(schema["properties"][name])]
        purpose = " ".join(part["description"].split()).partition(": ")[2]
        tables[heading] = purpose[:1].upper() + purpose[1:], _keys(part, parts, ())
    return tables


def _part_of(key: dict[str, Any]) -> str:
    """Return the name of the model that the value of a key is of."""
    for each in (key, *key.get("anyOf", ()), key.get("items", {})):
        if "$ref" in each:
            return str(each["$ref"]).rpartition("/")[2]
    raise KeyError(key)


def _keys(part: dict[str, Any], parts: dict[str, Any], without: Any) -> dict[str, VehicleKey]:
    required = part.get("required", ())
    keys = {}
    for name, key in part["properties"].items():
        if name not in without:
            text = key["description"]
            units = _UNIT.findall(text)
            keys[name] = VehicleKey(_value(key, parts), ", ".join(units), text, name in required)
    return keys


def _value(key: dict[str, Any], parts: dict[str, Any]) -> str:
    """Return the kind of value in words."""
    choices = [each for each in key.get("anyOf", ()) if each.get("type") != "null"]
    if choices:
        return " or ".join(dict.fromkeys(_value(each, parts) for each in choices))
    if "enum" in key or "const" in key:
        words = key.get("enum") or [key["const"]]
        return " or ".join(f'"{e}"' if isinstance(e, str) else str(e) for e in words)
    kind = key.get("type", "")
    if kind == "array":
        count = key.get("minItems") if key.get("minItems") == key.get("maxItems") else None
        return f"list of {count or ''} {_value(key['items'], parts)}".replace("  ", " ")
    bounds = {"minimum": ">=", "exclusiveMinimum": ">"}
    limits = [f" {sign} {key[b]:g}" for b, sign in bounds.items() if b in key]
    return _KINDS.get(kind, "number") + ("" if kind == "integer" else "".join(limits))
