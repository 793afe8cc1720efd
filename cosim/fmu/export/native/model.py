"""A component as its native body has it: variables, recorded equations, tables of references.

It is written as C (`model_c`) or as data for a binary of its kind (`model_data`).
"""

from __future__ import annotations

import importlib
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from cosim.fmu.export.spec import ComponentSpec
from cosim.tape import FIXED, VARYING, Functions, Scalar, Tape, run_constants

_GIVEN = "const double *v, const double *c"
_STATE = f"const double *x, {_GIVEN}"
SIGNATURES = {
    "model_constants": "const double *v, double *c",
    "model_rates": f"double t, const double *x, const double *late, {_GIVEN}, double *dx",
    "model_other_outputs": f"{_STATE}, double *out",
    "model_outputs_change": f"{_STATE}, const double *change, double *out",
    "model_law": f"double elapsed, {_GIVEN}, double *out",
    "model_compared": f"{_STATE}, double *out",
    "model_decided": f"{_STATE}, double *out",
}
"""Program -> its parameters in C, as c/equations.h has them; the last takes the results."""


@dataclass(frozen=True)
class Program:
    """Recorded results, with the parameters and the targets that they have in C.

    `targets` : for each result where C puts it, such as "dx[2]". `hoisted` : whether it finds
    what depends on parameters alone among the constants of the run.
    """

    parameters: str
    targets: Sequence[tuple[str, Scalar]]
    hoisted: bool = True


@dataclass
class NativeModel:
    """What is recorded of a component.

    Attributes
    ----------
    kind : of behaviour; it names the hand-written C that runs it (`kinds.FILES`).
    v : FMI name -> recorded scalar.
    numbers : macro -> value.
    tables : name of a table of value references -> names of the variables.
    programs : name of a function -> what it computes.
    known : place on the tape -> number among the constants of a run.
    conditions : quantities that must be positive, each with the message if one is not.
    rows : instants [ns] and values of a signal table.
    text : the name of its random streams, or the expressions of its outputs.
    own : declarations and definitions in C that its kind alone has, for model.h and model.c.
    absent : variables that the C of the kind names and this component does not need.
    """

    spec: ComponentSpec
    kind: str = ""
    tape: Tape = field(default_factory=Tape)
    v: dict[str, Scalar] = field(init=False)
    numbers: dict[str, int | str] = field(default_factory=dict)
    tables: dict[str, Sequence[str]] = field(default_factory=dict)
    programs: dict[str, Program] = field(default_factory=dict)
    known: dict[int, int] = field(default_factory=dict)
    conditions: Sequence[tuple[Scalar, str]] = ()
    rows: tuple[Sequence[int], Sequence[Sequence[float]]] = ((), ())
    text: str = ""
    own: list[tuple[str, str]] = field(default_factory=list)
    absent: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        self.ns = Functions(self.tape)
        self.v = {
            v.name: self.tape.symbol(
                f"v[{enumerator(v.name)}]", FIXED if v.causality == "parameter" else VARYING
            )
            for v in self.spec.variables
        }

    def symbols(self, array: str, count: int, first: int = 0) -> list[Scalar]:
        """Return entries of an array that the hand-written C passes."""
        return [self.tape.symbol(f"{array}[{first + i}]") for i in range(count)]

    def add_programs(self, **results: Sequence[Scalar | float]) -> None:
        """Add programs by name without "model_", and what all share: the constants of a run."""
        recorded = {
            name: [self.tape.scalar(value) for value in values] for name, values in results.items()
        }
        constants = run_constants(
            self.tape, [one for values in recorded.values() for one in values]
        )
        self.known = {place: i for i, place in enumerate(constants)}
        recorded = {"constants": [Scalar(self.tape, place) for place in constants], **recorded}
        for name, values in recorded.items():
            parameters = SIGNATURES[f"model_{name}"]
            into = parameters.rpartition("*")[2]
            targets = [(f"{into}[{i}]", value) for i, value in enumerate(values)]
            self.programs[f"model_{name}"] = Program(parameters, targets, name != "constants")


def enumerator(name: str) -> str:
    """Return the C name of a variable's value reference: `K[1,3]` becomes V_K_1_3."""
    return "V_" + re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")


def distinct_enumerators(spec: ComponentSpec) -> None:
    """Refuse variables with the same C name.

    Raises
    ------
    ValueError : two names become the same C name.
    """
    seen: dict[str, str] = {}
    for v in spec.variables:
        name = enumerator(v.name)
        if name in seen:
            raise ValueError(f"{spec.name}: {seen[name]} and {v.name} would both be {name} in C")
        seen[name] = v.name


def behaviour_of(spec: ComponentSpec) -> Any:
    """Instantiate the component's behaviour, to record its equations."""
    module, cls = spec.behaviour.split(":")
    constants = json.loads(json.dumps(dict(spec.constants)))
    return getattr(importlib.import_module(module), cls)(constants)
