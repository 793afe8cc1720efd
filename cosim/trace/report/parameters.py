"""Parameters of the components: start values of the model descriptions, and values set.

Both are attached to the trace. A file of another tool may hold anything in their place: what
cannot be read is left out.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from lxml import etree

from cosim.trace.reader import Trace
from cosim.trace.rows.layout import DESIGN_ATTACHMENT, SCENARIO_ATTACHMENT

_MODEL = ".modelDescription.xml"
_SHARED = ("force", "moment")
"""Commands `force.x`, ... share the limit `limit.force`."""


@dataclass(frozen=True)
class Parameter:
    """One start value of a component."""

    start: str | None
    unit: str
    description: str


@dataclass(frozen=True)
class ChangedParameter:
    """A parameter that differs from its model description; `by` is "scenario" or "design"."""

    component: str
    name: str
    value: str
    start: str
    unit: str
    by: str


class Settings:
    """Parameters of the components of a trace."""

    def __init__(self, trace: Trace) -> None:
        self.scenario = _toml(trace.attachments.get(SCENARIO_ATTACHMENT))
        self.declared = {
            name.removesuffix(_MODEL): _declared(data)
            for name, data in trace.attachments.items()
            if name.endswith(_MODEL)
        }
        self.set = {
            name: part["parameters"]
            for name, part in _table(self.scenario.get("components")).items()
            if isinstance(part, dict) and isinstance(part.get("parameters"), dict)
        }
        self._gain = _gain(trace, self.scenario)

    def value(self, component: str, name: str) -> float | None:
        """Return the value a parameter was set to, or its start value; None if unknown."""
        given = self.set.get(component, {}).get(name)
        if given is None:
            known = self.declared.get(component, {}).get(name)
            given = None if known is None else known.start
        try:
            return None if given is None else float(given)
        except (TypeError, ValueError):
            return None

    def limit(self, component: str, command: str) -> float | None:
        """Return the limit of a component's output (forces share one, moments too), or None."""
        shared = command.partition(".")[0]
        return self.value(component, f"limit.{shared if shared in _SHARED else command}")

    def changes(self) -> Iterator[ChangedParameter]:
        """Yield the parameters that differ from the model descriptions."""
        for component, values in self.set.items():
            yield from self._changed(component, values, "scenario")
        for component, values in self._gain.items():
            yield from self._changed(component, values, "design")

    def _changed(
        self, component: str, values: Mapping[str, Any], by: str
    ) -> Iterator[ChangedParameter]:
        declared = self.declared.get(component, {})
        for name, value in values.items():
            known = declared.get(name, Parameter(None, "", ""))
            if not _same(value, known.start):
                start = "–" if known.start is None else known.start
                yield ChangedParameter(component, name, _formatted(value), start, known.unit, by)


def _same(value: Any, start: str | None) -> bool:
    if start is None:
        return False
    if isinstance(value, bool):
        return start in {"true", "1"} if value else start in {"false", "0"}
    try:
        return float(value) == float(start)
    except (TypeError, ValueError):
        return str(value) == start


def _formatted(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.12g}" if isinstance(value, float) else str(value)


def _gain(trace: Trace, scenario: Mapping[str, Any]) -> dict[str, dict[str, float]]:
    """Return the entries K[i,j] of the design's gain, by component."""
    part = _table(scenario.get("design"))
    try:
        rows = json.loads(trace.attachments.get(DESIGN_ATTACHMENT, "{}"))["K"]
        values = {
            f"K[{i},{j}]": float(value)
            for i, row in enumerate(rows, 1)
            for j, value in enumerate(row, 1)
        }
    except (ValueError, KeyError, TypeError, RecursionError):
        return {}
    return {str(part.get("controller", "controller")): values}


def _toml(data: bytes | None) -> dict[str, Any]:
    try:
        return tomllib.loads((data or b"").decode())
    except (ValueError, RecursionError):
        return {}


def _table(value: Any) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


def _declared(data: bytes) -> dict[str, Parameter]:
    """Read the variables of a model description with their start values."""
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False
    )
    try:
        root = etree.fromstring(data, parser)
    except (etree.XMLSyntaxError, ValueError):
        return {}
    found = {}
    for variable in root.iterfind("ModelVariables/*"):
        kind = variable.find("*") if variable.tag == "ScalarVariable" else variable
        name = variable.get("name")
        if name is not None and kind is not None:
            found[name] = Parameter(
                kind.get("start"), kind.get("unit") or "", variable.get("description") or ""
            )
    return found
