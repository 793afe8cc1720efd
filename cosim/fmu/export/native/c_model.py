"""Write model.h and model.c of a component: its table of variables and its equations as C."""

from __future__ import annotations

import importlib
import json
import re
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from cosim.fmu.export.spec import ComponentSpec, Variable
from cosim.tape import FIXED, VARYING, Functions, Scalar, Tape, run_constants, statements


@dataclass
class ModelWriter:
    """A model being written: its tape, variables and C so far.

    Attributes
    ----------
    v : FMI name -> recorded scalar.
    header, body : lines for model.h and model.c.
    defined : macro -> value.
    tables : name of a table of value references -> names of the variables.
    programs : name of a function -> its targets.
    conditions : quantities that must be positive, each with the message if one is not.
    rows : instants [ns] and values of a signal table.
    """

    spec: ComponentSpec
    tape: Tape = field(default_factory=Tape)
    header: list[str] = field(default_factory=list)
    body: list[str] = field(default_factory=list)
    v: dict[str, Scalar] = field(init=False)
    defined: dict[str, object] = field(default_factory=dict)
    tables: dict[str, Sequence[str]] = field(default_factory=dict)
    programs: dict[str, Sequence[tuple[str, Scalar]]] = field(default_factory=dict)
    conditions: Sequence[tuple[Scalar, str]] = ()
    rows: tuple[Sequence[int], Sequence[Sequence[float]]] = ((), ())

    def __post_init__(self) -> None:
        self.ns = Functions(self.tape)
        self._place = {v.name: reference for reference, v in enumerate(self.spec.variables)}
        self.v = {
            v.name: self.tape.symbol(
                f"v[{enumerator(v.name)}]", FIXED if v.causality == "parameter" else VARYING
            )
            for v in self.spec.variables
        }
        self.known: dict[int, str] = {}

    def symbols(self, array: str, count: int, first: int = 0) -> list[Scalar]:
        """Return entries of an array that the C shell passes."""
        return [self.tape.symbol(f"{array}[{first + i}]") for i in range(count)]

    def define(self, name: str, value: object) -> None:
        """Add a macro to model.h."""
        self.defined[name] = value
        self.header.append(f"#define {name} {value}")

    def references(self, name: str, names: Sequence[str], size: str) -> None:
        """Add a table of value references, and the macro `size` of its length."""
        self.define(size, len(names))
        self.tables[name] = names
        listed = ", ".join(enumerator(n) for n in names) or "0"
        array = f"const unsigned {name}[{max(1, len(names))}]"
        self.header.append(f"extern {array};")
        self.body.append(textwrap.fill(f"{array} = {{{listed}}};", 100, subsequent_indent="    "))

    def hoist(self, roots: Sequence[Scalar]) -> None:
        """Move the parts of `roots` that depend on parameters alone into `model_constants`."""
        places = run_constants(self.tape, roots)
        self.define("MODEL_CONSTANTS", len(places))
        targets = [(f"c[{k}]", Scalar(self.tape, place)) for k, place in enumerate(places)]
        self.function("void model_constants(const double *v, double *c)", targets)
        self.known = {place: f"c[{k}]" for k, place in enumerate(places)}

    def function(
        self,
        signature: str,
        targets: Sequence[tuple[str, Scalar]],
        *,
        hoisted: bool = False,
    ) -> None:
        """Add a function to model.c that assigns the targets."""
        name = signature[: signature.index("(")].rsplit(maxsplit=1)[-1].lstrip("*")
        self.programs[name] = targets
        inside = statements(self.tape, targets, self.known if hoisted else None)
        self.header.append(f"{signature};")
        arguments = re.findall(r"(\w+)(?:,|\))", signature)
        unused = [a for a in arguments if not re.search(rf"\b{a}\b", inside)]
        silenced = "".join(f"    (void)({a});\n" for a in unused if a != "void")
        self.body.append(f"\n{signature} {{\n{silenced}{inside}}}")

    def parameter_check(self, conditions: Sequence[tuple[Scalar, str]]) -> None:
        """Add the function that finds invalid parameters."""
        self.conditions = conditions
        signature = "const char *model_objection(const double *v)"
        targets = [(f"q[{i}]", value) for i, (value, _) in enumerate(conditions)]
        lines = [f"    double q[{max(1, len(conditions))}];\n    (void)(q);\n    (void)(v);\n"]
        lines.append(statements(self.tape, targets))
        lines += [
            f"    if (!(q[{i}] > 0)) return {c_string(message)};\n"
            for i, (_, message) in enumerate(conditions)
        ]
        self.header.append(f"{signature};")
        self.body.append(f"\n{signature} {{\n{''.join(lines)}    return 0;\n}}")

    def files(self, identity: str) -> dict[str, str]:
        """Return model.h and model.c by name."""
        spec = self.spec
        names = "".join(
            f"    {enumerator(v.name)}{' = 0' if i == 0 else ''},\n"
            for i, v in enumerate(spec.variables)
        )
        head = (
            f"/* {_comment(spec.name)}: its variables as value references, and its equations.\n"
            "   Generated from the component's table of variables and its Python source. */\n\n"
            "#ifndef MODEL_H\n#define MODEL_H\n\n"
            f"#define MODEL_NAME {c_string(spec.name)}\n"
            f"#define MODEL_GUID {c_string(identity)}\n"
            f"#define MODEL_VARIABLES {len(spec.variables)}\n\n"
            f"enum {{\n{names}}};\n\n"
        )
        table = "".join(f"    {_row(v)},\n" for v in spec.variables)
        body = (
            f"/* {_comment(spec.name)}: variables and equations.\n"
            "   Generated, operation by operation in the order of the Python source. */\n\n"
            '#include "variable.h"\n#include "arithmetic.h"\n#include "model.h"\n\n'
            f"const Variable model_variables[MODEL_VARIABLES] = {{\n{table}}};\n\n"
        )
        return {
            "model.h": head + "\n".join(self.header) + "\n\n#endif\n",
            "model.c": body + "\n".join(self.body) + "\n",
        }


def c_string(text: str) -> str:
    """Return a string literal of C, UTF-8 whatever encoding the compiler assumes."""
    return '"' + "".join(_escaped(byte) for byte in text.encode()) + '"'


def _escaped(byte: int) -> str:
    plain = 32 <= byte < 127 and chr(byte) not in '"\\?'
    return chr(byte) if plain else f"\\{byte:03o}"


def _comment(text: str) -> str:
    return text.replace("*/", "* /")


def enumerator(name: str) -> str:
    """Return the C name of a variable's value reference: `K[1,3]` becomes V_K_1_3."""
    return "V_" + re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")


def _row(v: Variable) -> str:
    causality = {"input": "INPUT", "output": "OUTPUT", "parameter": "PARAMETER"}[v.causality]
    kind = {"Real": "REAL", "Integer": "INTEGER"}[v.kind]
    low = "-HUGE_VAL" if v.minimum is None else repr(float(v.minimum))
    high = "HUGE_VAL" if v.maximum is None else repr(float(v.maximum))
    return f"{{{c_string(v.name)}, {causality}, {kind}, {float(v.start)!r}, {low}, {high}}}"


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
