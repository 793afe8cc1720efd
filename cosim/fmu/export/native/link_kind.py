"""How links and tables of signals are told to C: sizes, names, numbers; the loops are in c/."""

from __future__ import annotations

import textwrap
from typing import Any

from cosim.fmu.export.components import component_module
from cosim.fmu.export.native.c_model import ModelWriter, c_string


def record_link(writer: ModelWriter, behaviour: Any) -> tuple[str, ...]:
    """A link; the names of its C files."""
    numbers = range(1, behaviour.signals + 1)
    for array, name, size in (
        ("model_inputs", "u", "MODEL_LANES"),
        ("model_outputs", "y", "MODEL_OUTPUTS"),
        ("model_initials", "initial", "MODEL_INITIALS"),
    ):
        writer.references(array, [f"{name}[{i}]" for i in numbers], size)
    if behaviour.kind == "transport":
        return ("transport_link.c",)
    for number, order in enumerate(component_module("link_channel.behaviour").ORDERS):
        writer.define(f"ORDER_{order.upper().replace('-', '_')}", number)
    writer.header.append("extern const char model_link_name[];")
    writer.body.append(f"const char model_link_name[] = {c_string(behaviour.name)};")
    return ("draws.c", "packet_link.c")


def record_table(writer: ModelWriter, behaviour: Any) -> tuple[str, ...]:
    """A table of signals; the names of its C files."""
    count, width = len(behaviour.rows), len(behaviour.outputs)
    writer.references("model_outputs", behaviour.outputs, "MODEL_OUTPUTS")
    writer.define("MODEL_ROWS", count)
    writer.header.append("extern const int64_t model_instants[MODEL_ROWS];")
    writer.header.append(f"extern const double model_table[MODEL_ROWS][{width}];")
    instants = ", ".join(f"INT64_C({t})" for t in behaviour.instants_ns)
    listed = textwrap.fill(instants, 100, initial_indent="    ", subsequent_indent="    ")
    writer.body.append(f"const int64_t model_instants[MODEL_ROWS] = {{\n{listed}\n}};\n")
    rows = "\n".join(f"    {{{', '.join(map(repr, row))}}}," for row in behaviour.rows)
    writer.body.append(f"const double model_table[MODEL_ROWS][{width}] = {{\n{rows}\n}};\n")
    writer.header.insert(0, "#include <stdint.h>\n")
    return ("table.c",)
