"""An FMU from the outside: what it declares, without loading its binary."""

from __future__ import annotations

import hashlib
import math
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

from fmpy import read_model_description

from cosim.errors import InputError

SignalKind = Literal["float", "int", "bool", "string"]
_TYPES: Mapping[str, tuple[SignalKind, str, str]] = MappingProxyType(
    {
        "Real": ("float", "Real", "f8"),
        "Integer": ("int", "Integer", "i4"),
        "Enumeration": ("int", "Integer", "i4"),
        "Boolean": ("bool", "Boolean", "i4"),
        "String": ("string", "String", "S"),
    }
)


@dataclass(frozen=True, slots=True)
class Port:
    """A variable as the master sees it; `kind` is None for what it cannot exchange."""

    name: str
    reference: int
    causality: str
    variability: str
    kind: SignalKind | None
    unit: str | None
    start: float | None
    minimum: float | None
    maximum: float | None
    description: str | None
    feedthrough: bool  # an output that some input reaches without delay
    getter_type: str = "Real"
    c_type: str = "f8"
    shape: tuple[int, ...] = ()

    @property
    def size(self) -> int:
        """Number of scalars."""
        return math.prod(self.shape)


@dataclass(frozen=True, slots=True)
class FmuDescription:
    """What an FMU declares.

    Attributes
    ----------
    path, sha256 : the file and the hash of its bytes.
    model : fmpy's model description.
    ports : variable name -> Port.
    xml : modelDescription.xml as it stands in the FMU.
    """

    path: Path
    sha256: str
    model: Any
    ports: Mapping[str, Port]
    xml: bytes

    @property
    def version(self) -> Literal["2.0", "3.0"]:
        """Of FMI."""
        return "2.0"

    @property
    def variable_step(self) -> bool:
        """Whether the FMU takes communication steps of changing size."""
        return bool(self.model.coSimulation.canHandleVariableCommunicationStepSize)

    def port(self, name: str, *, where: str) -> Port:
        """The variable `name`; an `InputError` with the nearest names if there is none."""
        found = self.ports.get(name)
        if found is None:
            raise InputError.unknown("variable", name, self.ports, where=where)
        return found


def describe_fmu(path: Path) -> FmuDescription:
    """Read and validate the model description of an FMU 2.0 for co-simulation.

    Raises
    ------
    InputError : no such file, not an FMU, a model description that breaks the standard, or an
        FMI version or type that is not supported.
    """
    if not path.is_file():
        raise InputError("no such FMU", where=str(path), hint="build it: python build_fmu.py")
    try:
        with zipfile.ZipFile(path) as archive:
            xml = archive.read("modelDescription.xml")
        model = read_model_description(str(path))
    except Exception as error:  # fmpy and zipfile raise many kinds; each means the same here
        raise InputError(
            "not a valid FMU", where=str(path), expected="an FMU 2.0", got=str(error)
        ) from error
    if model.fmiVersion != "2.0" or model.coSimulation is None:
        offered = [k for k in ("coSimulation", "modelExchange") if getattr(model, k, None)]
        raise InputError(
            "this FMU cannot be run",
            where=str(path),
            expected="FMI 2.0 for co-simulation",
            got=f"FMI {model.fmiVersion}, {', '.join(offered) or 'neither type'}",
        )
    direct = _outputs_with_feedthrough(model)
    ports = {}
    for variable in model.modelVariables:
        start = variable.start
        kind, getter_type, c_type = _TYPES.get(variable.type, (None, "", ""))
        ports[variable.name] = Port(
            name=variable.name,
            reference=variable.valueReference,
            causality=variable.causality,
            variability=variable.variability,
            kind=kind,
            unit=variable.unit
            or (variable.declaredType.unit if variable.declaredType is not None else None),
            start=None if start is None or kind in (None, "string") else _number(start),
            minimum=None if variable.min is None else _number(variable.min),
            maximum=None if variable.max is None else _number(variable.max),
            description=variable.description,
            feedthrough=variable.name in direct,
            getter_type=getter_type,
            c_type=c_type,
        )
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    return FmuDescription(path, digest, model, MappingProxyType(ports), xml)


def _outputs_with_feedthrough(model: Any) -> set[str]:
    """Outputs with a direct dependency on an input; undeclared dependencies mean all."""
    names = set()
    for unknown in model.outputs:
        dependencies = unknown.dependencies
        if dependencies is None:
            if any(v.causality == "input" for v in model.modelVariables):
                names.add(unknown.variable.name)
        elif any(v.causality == "input" for v in dependencies):
            names.add(unknown.variable.name)
    return names


def _number(text: Any) -> float:
    lowered = str(text).strip().lower()
    if lowered in ("true", "false"):
        return 1.0 if lowered == "true" else 0.0
    return float(lowered)
