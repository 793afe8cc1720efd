"""Convert an inspection to plain data: what an FMU is and what it needs."""

from __future__ import annotations

from collections import Counter
from typing import Any

from cosim.fmu.inspect.binaries import platform_of
from cosim.fmu.inspect.declared_model import DeclaredModel
from cosim.fmu.inspect.findings import LEVELS
from cosim.fmu.inspect.inspection import Inspection
from cosim.fmu.inspect.library import Binary
from cosim.fmu.inspect.platforms import this_machine

_FLAGS = ("can", "needs", "provides", "has", "might")
_HEAD = ("description", "author", "version", "license", "copyright", "generationTool")


def fmu_facts(inspection: Inspection) -> dict[str, Any]:
    """Return what `cosim fmu info --json` prints; `model` is None if it cannot be read."""
    names = inspection.names
    return {
        "file": str(inspection.path),
        "sha256": inspection.sha256,
        "bytes": inspection.size,
        "unpacked_bytes": inspection.unpacked_bytes,
        "files": len(names),
        "model": None if inspection.model is None else _model(inspection.model),
        "binaries": [_binary(each) for each in inspection.binaries],
        "sources": sum(name.startswith("sources/") for name in names),
        "resources": sum(name.startswith("resources/") for name in names),
        "documentation": any(name.startswith("documentation/") for name in names),
        "runs_here": _runs_here(inspection),
        "findings": {
            level: sum(each.level == level for each in inspection.findings) for level in LEVELS
        },
    }


_WIRED = ("input", "output", "parameter", "structuralParameter")
"""Causalities of variables that a user connects or sets."""


def _model(model: DeclaredModel) -> dict[str, Any]:
    attributes = model.attributes
    roles = Counter((v.causality, v.type) for v in model.variables)
    units = sorted({v.unit for v in model.variables if v.unit is not None})
    return {
        "fmi_version": model.version,
        "name": attributes.get("modelName"),
        "token": model.token,
        **{_snake(key): attributes.get(key) for key in _HEAD},
        "generated": attributes.get("generationDateAndTime"),
        "naming": attributes.get("variableNamingConvention", "flat"),
        "kinds": [
            {
                "kind": interface.kind,
                "identifier": interface.identifier,
                "capabilities": sorted(
                    key
                    for key in interface.attributes
                    if key.startswith(_FLAGS) and interface.is_true(key)
                ),
            }
            for interface in model.interfaces
        ],
        "variables": [
            {"causality": causality, "type": kind, "count": count}
            for (causality, kind), count in sorted(roles.items())
        ],
        "interface": [
            {
                "name": v.name,
                "causality": v.causality,
                "type": v.type,
                "unit": v.unit or None,
                "start": v.start,
                "description": v.attributes.get("description"),
            }
            for v in model.variables
            if v.causality in _WIRED
        ],
        "units": units,
        "default_experiment": model.experiment_times,
    }


def _binary(binary: Binary) -> dict[str, Any]:
    return {
        "folder": binary.folder,
        "file": binary.name,
        "damage": binary.damage,
        "unread": binary.unread,
        "unexamined": binary.unexamined,
        "images": [
            {
                "format": image.format,
                "system": image.platform.system,
                "architecture": image.platform.architecture,
                "libraries": list(image.libraries),
                "glibc": None if image.libc is None else ".".join(map(str, image.libc)),
                "needs_python": image.needs_python,
                "fmi_functions": None if image.exports is None else len(image.functions),
                "other_symbols": None
                if image.exports is None
                else len(image.exports - image.functions),
            }
            for image in binary.images
        ],
    }


def _runs_here(inspection: Inspection) -> bool:
    """Whether a binary is for this machine, by its folder and headers."""
    machine = this_machine()
    return any(
        platform_of(binary.folder) == machine
        and (
            binary.unexamined is not None
            or any(image.platform == machine for image in binary.images)
        )
        for binary in inspection.binaries
    )


def _snake(name: str) -> str:
    return "".join(f"_{c.lower()}" if c.isupper() else c for c in name)
