"""What a component is, apart from any FMI version: one table of variables, one behaviour.

Every flavour of an FMU (model description, pythonfmu slave, documentation page, native C) is
generated from a `ComponentSpec`.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

CERTIFICATE = "resources/certificate.json"
"""Where a controller carries the proof of its gain."""

Causality = Literal["input", "output", "parameter"]
FmuTarget = Literal["Real", "Integer"]


@dataclass(frozen=True)
class Variable:
    """One FMI variable.

    Attributes
    ----------
    name : structured FMI name, such as `eta.x` or `K[1,3]`.
    unit : a name of `cosim.fmu.export.units.UNITS`, or None for a pure number.
    start : start value; for an output, its value at the initial state.
    discrete : changes only at sample instants (or is not a Real).
    depends_on : for an output, the inputs that reach it without delay.
    """

    name: str
    causality: Causality
    description: str
    unit: str | None = None
    start: float = 0.0
    kind: FmuTarget = "Real"
    discrete: bool = False
    minimum: float | None = None
    maximum: float | None = None
    depends_on: tuple[str, ...] = ()

    @property
    def variability(self) -> str:
        """FMI variability: parameters are fixed once initialised."""
        if self.causality == "parameter":
            return "fixed"
        return "discrete" if self.discrete or self.kind == "Integer" else "continuous"


@dataclass(frozen=True)
class ComponentSpec:
    """A component: its variables, and where its behaviour is written.

    Attributes
    ----------
    name : FMU and model name (`AuvPlant`).
    variables : the table; value reference = position.
    behaviour : "module:Class" of the behaviour, numpy-free.
    sources : modules that the behaviour needs, copied into the FMU; behaviour included.
    constants : what is fixed when the FMU is built (dimensions, name lists), JSON values.
    resources : path below resources/ -> content of files that travel with the FMU.
    readme : the component's page, equations first.
    notes : more of the page, about this one of its kind, as Markdown.
    scenario : the page's example for this project's own master, a scenario as TOML.
    stop_time, step_size : default experiment [s].
    certificate : JSON of the proof about the start values, for a controller that has one.
    """

    name: str
    description: str
    variables: tuple[Variable, ...]
    behaviour: str
    sources: tuple[str, ...]
    readme: Path
    stop_time: float
    step_size: float
    constants: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    resources: Mapping[str, bytes] = field(default_factory=lambda: MappingProxyType({}))
    certificate: bytes | None = None
    notes: str = ""
    scenario: str = ""

    def __post_init__(self) -> None:
        names = [v.name for v in self.variables]
        twice = sorted({n for n in names if names.count(n) > 1})
        if twice:
            raise ValueError(f"{self.name}: variables named twice: {', '.join(twice)}")
        inputs = {v.name for v in self.variables if v.causality == "input"}
        for v in self.variables:
            unknown = sorted(set(v.depends_on) - inputs)
            if unknown:
                raise ValueError(f"{self.name}: {v.name} depends on {unknown}, not inputs")

    def table(self) -> list[dict[str, Any]]:
        """The variables as JSON values, in value-reference order."""
        return [
            {
                "name": v.name,
                "causality": v.causality,
                "kind": v.kind,
                "start": v.start,
                "minimum": v.minimum,
                "maximum": v.maximum,
            }
            for v in self.variables
        ]

    def resource_files(self) -> dict[str, bytes]:
        """Archive path -> content of `resources`, and the certificate."""
        found = {f"resources/{path}": content for path, content in self.resources.items()}
        if self.certificate is not None:
            found[CERTIFICATE] = self.certificate
        return found

    def guid(self, sources: Mapping[str, bytes]) -> str:
        """Hash of everything the FMU is made of, in the form FMI gives a GUID."""
        digest = hashlib.sha256()
        units = [(v.unit, v.description, v.variability, v.depends_on) for v in self.variables]
        parts = [self.name, self.description, self.behaviour, self.stop_time, self.step_size]
        text = json.dumps([parts, self.table(), units, dict(self.constants)], sort_keys=True)
        digest.update(text.encode())
        for path in sorted(sources):
            digest.update(path.encode() + b"\0" + sources[path] + b"\0")
        h = digest.hexdigest()
        return f"{{{h[:8]}-{h[8:12]}-{h[12:16]}-{h[16:20]}-{h[20:32]}}}"


def inputs(names: tuple[str, ...], unit: str | None, description: str) -> list[Variable]:
    """Several inputs of one unit, starting at zero; `{}` in the description is the name."""
    return [Variable(n, "input", description.format(n), unit) for n in names]
