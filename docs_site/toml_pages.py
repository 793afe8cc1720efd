"""The reference of the TOML files, from the schemas that read them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from cosim.hinf.problem import system_schema
from cosim.scenario import json_schema
from cosim.study import Study
from cosim.vehicle import vehicle_schema

_HEADS = Path(__file__).parent / "heads"
_WITH_UNIT = "one with a unit"
Json = dict[str, Any]


def pages() -> dict[str, str]:
    """Return the pages by their path: systems, vehicles, scenarios, studies."""
    scenario = json_schema()
    found = {
        "systems": "\n\n".join(tables(system_schema())),
        "vehicle-files": "\n\n".join(tables(vehicle_schema())),
        "scenarios": "\n\n".join(tables(scenario["else"] | {"$defs": scenario["$defs"]})),
        "studies": "\n\n".join(tables(Study.model_json_schema(by_alias=True))),
    }
    return {
        f"reference/{name}.md": f"{(_HEADS / f'{name}.md').read_text('utf-8')}\n{text}\n"
        for name, text in found.items()
    }


def tables(schema: Json) -> Iterator[str]:
    """Give a section for each table of a file with this JSON schema, from the top down."""
    parts = schema["$defs"]
    waiting, done = [("Top level", schema)], set()
    while waiting:
        heading, part = waiting.pop(0)
        rows = []
        for name, value in part["properties"].items():
            required = "required" if name in part.get("required", ()) else _default(value)
            meaning = _cell(value.get("description", ""))
            rows.append(f"| `{name}` | {values(value, parts)} | {required} | {meaning} |")
            for kind, inner in _inner(value):
                if inner not in done:
                    done.add(inner)
                    waiting.append((_heading(heading, name, kind, parts[inner]), parts[inner]))
        yield _section(heading, _purpose(part), rows)


def values(value: Json, parts: Json) -> str:
    """Return in words what a key may be."""
    if "$ref" in value:
        return "table"
    if "const" in value or "enum" in value:
        words = value.get("enum", [value.get("const")])
        return ", ".join(f"`{json.dumps(one)}`" for one in words)
    several = [*value.get("anyOf", ()), *value.get("oneOf", ())]
    if several:
        kinds = [values(one, parts) for one in several if one.get("type") != "null"]
        if _WITH_UNIT in kinds and "number" in kinds:
            kinds = [f"number, or {_WITH_UNIT}", *kinds]
            kinds = [kind for kind in kinds if kind not in ("number", _WITH_UNIT)]
        return " or ".join(dict.fromkeys(kinds))
    return _simple(value, parts)


def _simple(value: Json, parts: Json) -> str:
    """Return in words what a key of one type may be."""
    kind = str(value.get("type"))
    if kind == "array":
        return f"list of {values(value.get('items', {}), parts)}".replace(
            "of table", "of tables"
        ).replace("of list ", "of lists ")
    if kind == "object":
        return "tables by name" if _inner(value) else "table"
    if kind == "string" and "unit" in value.get("description", ""):
        return _WITH_UNIT
    if kind in ("number", "integer"):
        return ("whole number" if kind == "integer" else "number") + _range(value)
    return {"string": "text", "boolean": "true or false"}.get(kind, "any value")


def _range(value: Json) -> str:
    if "exclusiveMinimum" in value:
        return f" > {value['exclusiveMinimum']:g}"
    low, high = value.get("minimum"), value.get("maximum")
    if low is not None and high is not None:
        return f" from {low:g} to {high:g}"
    return "" if low is None else f" ≥ {low:g}"


def _inner(value: Any) -> list[tuple[str, str]]:
    """Return the parts that a key refers to, with what they are: table, list, by name."""
    found = []
    if isinstance(value, dict):
        if "$ref" in value:
            found.append(("table", value["$ref"].rpartition("/")[2]))
        for either in ("anyOf", "oneOf"):
            found += [pair for one in value.get(either, ()) for pair in _inner(one)]
        found += [("list", inner) for _, inner in _inner(value.get("items"))]
        named = [value.get("additionalProperties"), *value.get("patternProperties", {}).values()]
        found += [("by name", inner) for one in named for _, inner in _inner(one)]
    return found


def _heading(above: str, name: str, kind: str, part: Json) -> str:
    """Return the heading of a table: as it is written in a file."""
    base = above.strip("`[]").split("]")[0]
    path = name if above == "Top level" else f"{base}.{name}"
    chosen = part["properties"].get("kind", {}).get("const")
    more = f", `kind = {json.dumps(chosen)}`" if chosen else ""
    if not more and len(part["properties"]) and kind == "table" and above != "Top level":
        keys = ", ".join(part.get("required") or [*part["properties"]][:2])
        return f"`[{path}]` with {keys}"
    text = {"table": f"[{path}]", "list": f"[[{path}]]", "by name": f"[{path}.NAME]"}[kind]
    return f"`{text}`{more}"


def _purpose(part: Json) -> str:
    text = str(part.get("description", "")).split("\n\n")
    first = text[0].split("]: ", 1)[-1] if text[0].startswith("[") else text[0]
    first = first[:1].upper() + first[1:]
    return "\n\n".join([" ".join(first.split()), *(" ".join(t.split()) for t in text[1:])])


def _default(value: Json) -> str:
    default = value.get("default")
    if default is None or default in ([], {}, ""):
        return ""
    return f"`{json.dumps(default)}`"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _section(heading: str, purpose: str, rows: list[str]) -> str:
    head = ["| key | value | default | meaning |", "|---|---|---|---|"]
    return "\n".join([f"## {heading}", "", purpose, "", *head, *rows])
