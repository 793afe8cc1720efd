"""Write a component as straight C: model.h and model.c, its tape in the recorded order."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence

from cosim.fmu.export.native.model import NativeModel, Program, enumerator
from cosim.fmu.export.spec import Variable
from cosim.tape import Scalar, Tape, statements


def c_files(model: NativeModel, identity: str) -> dict[str, str]:
    """Return model.h and model.c by name; `identity` : what the binary checks."""
    name = model.spec.name.replace("*/", "* /")
    references = {
        f"const unsigned {table}[{max(1, len(names))}]": ", ".join(map(enumerator, names)) or "0"
        for table, names in model.tables.items()
    }
    count, values = len(model.rows[0]), [value for row in model.rows[1] for value in row]
    if count:
        instants = ", ".join(f"INT64_C({t})" for t in model.rows[0])
        references[f"const int64_t model_instants[{count}]"] = instants
        references[f"const double model_table[{len(values)}]"] = ", ".join(map(repr, values))
    header = [
        f"/* {name}: its variables as value references, and the sizes of its tables.",
        "   Generated from the component's table of variables and its Python source. */",
        *("", "#ifndef MODEL_H", "#define MODEL_H", "", '#include "equations.h"', ""),
        *(f"#define {macro} {value}" for macro, value in _numbers(model, identity).items()),
        *("", "enum {", *(f"    {enumerator(v.name)}," for v in model.spec.variables), "};", ""),
        *(declared for declared, _ in model.own if declared),
        *(f"extern {array};" for array in references),
        *("", "#endif", ""),
    ]
    body = [
        f"/* {name}: variables and equations.",
        "   Generated, operation by operation in the order of the Python source. */",
        *("", '#include "variable.h"', '#include "arithmetic.h"', '#include "model.h"', ""),
        "const Variable model_variables[MODEL_VARIABLES] = {",
        *(f"    {_row(v)}," for v in model.spec.variables),
        *("};", "", f"const char model_text[] = {c_string(model.text)};"),
        *(
            textwrap.fill(f"{array} = {{{listed}}};", 100, subsequent_indent="    ")
            for array, listed in references.items()
        ),
        *(defined for _, defined in model.own if defined),
        *(function(model.tape, name, one, model.known) for name, one in model.programs.items()),
        *(_objection(model), ""),
    ]
    return {"model.h": "\n".join(header), "model.c": "\n".join(body)}


def _numbers(model: NativeModel, identity: str) -> dict[str, object]:
    """Return macro -> value."""
    return {
        "MODEL_GUID": c_string(identity),
        "MODEL_VARIABLES": len(model.spec.variables),
        **{table.upper(): len(names) for table, names in model.tables.items()},
        "MODEL_CONSTANTS": len(model.known),
        "MODEL_ROWS": len(model.rows[0]),
        **model.numbers,
        **{enumerator(name): 0 for name in model.absent},
    }


def function(tape: Tape, name: str, one: Program, known: dict[int, int]) -> str:
    """Return the definition of a function that computes recorded results."""
    constants = {place: f"c[{i}]" for place, i in known.items()} if one.hoisted else None
    inside = statements(tape, one.targets, constants)
    arguments = re.findall(r"(\w+)(?:,|$)", one.parameters)
    unused = [a for a in arguments if not re.search(rf"\b{a}\b", inside)]
    silenced = "".join(f"    (void)({a});\n" for a in unused)
    signature = textwrap.fill(f"void {name}({one.parameters})", 98, subsequent_indent="    ")
    return f"\n{signature} {{\n{silenced}{inside}}}"


def c_string(text: str) -> str:
    """Return a string literal of C, UTF-8 whatever encoding the compiler assumes."""
    return '"' + "".join(_escaped(byte) for byte in text.encode()) + '"'


def _objection(model: NativeModel) -> str:
    """Return the function that finds invalid parameters."""
    conditions: Sequence[tuple[Scalar, str]] = model.conditions
    targets = [(f"q[{i}]", value) for i, (value, _) in enumerate(conditions)]
    messages = "".join(
        f"    if (!(q[{i}] > 0)) return {c_string(message)};\n"
        for i, (_, message) in enumerate(conditions)
    )
    return (
        "\nconst char *model_objection(const double *v) {\n"
        f"    double q[{max(1, len(conditions))}];\n    (void)(q);\n    (void)(v);\n"
        f"{statements(model.tape, targets)}{messages}    return 0;\n}}"
    )


def _escaped(byte: int) -> str:
    plain = 32 <= byte < 127 and chr(byte) not in '"\\?'
    return chr(byte) if plain else f"\\{byte:03o}"


def _row(v: Variable) -> str:
    causality = {"input": "INPUT", "output": "OUTPUT", "parameter": "PARAMETER"}[v.causality]
    kind = {"Real": "REAL", "Integer": "INTEGER"}[v.kind]
    low = "-HUGE_VAL" if v.minimum is None else repr(float(v.minimum))
    high = "HUGE_VAL" if v.maximum is None else repr(float(v.maximum))
    return f"{{{c_string(v.name)}, {causality}, {kind}, {float(v.start)!r}, {low}, {high}}}"
