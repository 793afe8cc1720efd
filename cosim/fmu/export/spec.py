"""A component apart from any FMI version: a table of variables and a behaviour.

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
"""Path of the proof of a controller's gain inside its FMU."""

SLAVE = "cosim.fmu.export.python.slave:BehaviourSlave"
"""The slave in Python of most components."""

UNITS = MappingProxyType(
    {
        "m": {"m": 1},
        "m/s": {"m": 1, "s": -1},
        "m/s2": {"m": 1, "s": -2},
        "rad": {"rad": 1},
        "rad/s": {"rad": 1, "s": -1},
        "rad/s2": {"rad": 1, "s": -2},
        "rad/m": {"rad": 1, "m": -1},
        "1/s": {"s": -1},
        "s": {"s": 1},
        "kg": {"kg": 1},
        "kg.m": {"kg": 1, "m": 1},
        "kg.m2": {"kg": 1, "m": 2},
        "kg/m": {"kg": 1, "m": -1},
        "kg/s": {"kg": 1, "s": -1},
        "kg.m/s": {"kg": 1, "m": 1, "s": -1},
        "kg.m2/s": {"kg": 1, "m": 2, "s": -1},
        "m2": {"m": 2},
        "s/m": {"s": 1, "m": -1},
        "kg/m3": {"kg": 1, "m": -3},
        "N": {"kg": 1, "m": 1, "s": -2},
        "N.m": {"kg": 1, "m": 2, "s": -2},
    }
)
"""SI unit of variables -> exponents of kg, m, s, rad."""

Causality = Literal["input", "output", "parameter"]
FmiType = Literal["Real", "Integer"]


@dataclass(frozen=True)
class Variable:
    """One FMI variable.

    Attributes
    ----------
    name : structured FMI name, such as `eta.x` or `K[1,3]`.
    unit : a name of `UNITS`, or None for a pure number.
    start : start value; for an output, its value at the initial state.
    discrete : changes only at sample instants (or is not a Real).
    depends_on : for an output, the inputs with direct feedthrough to it.
    """

    name: str
    causality: Causality
    description: str
    unit: str | None = None
    start: float = 0.0
    kind: FmiType = "Real"
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
class ClockVariable:
    """An input Clock of a component.

    Attributes
    ----------
    variability : of its intervals, which the FMU gives.
    variables : the names of the variables that it clocks.
    """

    name: str
    variability: Literal["fixed", "countdown"]
    description: str
    variables: tuple[str, ...]


@dataclass(frozen=True)
class ComponentSpec:
    """A component: its variables, and the class of its behaviour.

    Attributes
    ----------
    name : FMU and model name (`AuvPlant`).
    variables : the table; value reference = position, counted from 1.
    behaviour : "module:Class" of the behaviour, numpy-free.
    sources : modules that the behaviour needs, copied into the FMU; behaviour included.
    constants : fixed when the FMU is built (dimensions, name lists), JSON values.
    resources : path below resources/ -> content of files in the FMU.
    readme : the component's page, equations first.
    notes : further text of the page about this component, as Markdown.
    scenario : the page's example for this project's own master, a scenario as TOML.
    stop_time, step_size : default experiment [s].
    certificate : JSON of the proof about a controller's start values, if it has one.
    clocks : its Clocks, in an FMU with event mode (FMI 3.0).
    slave : "module:Class" of its slave in Python.
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
    clocks: tuple[ClockVariable, ...] = ()
    slave: str = SLAVE

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
        """Return the variables as JSON values, in value-reference order."""
        keys = ("name", "causality", "kind", "start", "minimum", "maximum")
        return [{key: getattr(v, key) for key in keys} for v in self.variables]

    def resource_files(self) -> dict[str, bytes]:
        """Return by archive path the content of `resources` and the certificate."""
        found = {f"resources/{path}": content for path, content in self.resources.items()}
        if self.certificate is not None:
            found[CERTIFICATE] = self.certificate
        return found

    def guid(self, sources: Mapping[str, bytes]) -> str:
        """Return the hash of everything in the FMU, written as a GUID."""
        digest = hashlib.sha256()
        units = [(v.unit, v.description, v.variability, v.depends_on) for v in self.variables]
        parts = [self.name, self.description, self.behaviour, self.stop_time, self.step_size]
        text = json.dumps([parts, self.table(), units, dict(self.constants)], sort_keys=True)
        digest.update(text.encode())
        for path in sorted(sources):
            digest.update(path.encode() + b"\0" + sources[path] + b"\0")
        h = digest.hexdigest()
        return f"{{{h[:8]}-{h[8:12]}-{h[12:16]}-{h[16:20]}-{h[20:32]}}}"


def solver_step(start: float) -> Variable:
    """Return the parameter of the internal integration step of a delay equation [s]."""
    text = "largest internal integration step"
    return Variable("solver.step", "parameter", text, "s", start, minimum=min(1e-6, start))
