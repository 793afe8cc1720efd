"""The page's section on connecting an FMU, with programs that run unchanged."""

from __future__ import annotations

import html
import textwrap

from cosim.fmu.export.page.text import block
from cosim.fmu.export.spec import ComponentSpec

_MOST_NAMES = 3  # names that an example lists


def connect_section(spec: ComponentSpec) -> str:
    """Return HTML about FMPy, this project's own master, and any other tool."""
    parts = ["<h3>In Python, with FMPy</h3>\n", block(fmpy_program(spec), "python")]
    if spec.scenario:
        parts.append(
            "<h3>With its partners, over a link</h3>\n"
            "<p>As a scenario, <code>my-scenario.toml</code>, beside the FMUs; "
            "<code>cosim run my-scenario.toml</code> runs it and records a trace. Where a "
            "connection names groups, <code>plant.x</code>, members of one name are joined.</p>\n"
            f"{block(spec.scenario, 'toml')}"
        )
    parts.append(f"<h3>In any other tool</h3>\n<p>{_elsewhere(spec)}</p>\n")
    return "".join(parts)


def fmpy_program(spec: ComponentSpec) -> str:
    """Return a program that simulates NAME.fmu alone, with a step on its first input."""
    of = {
        causality: [v.name for v in spec.variables if v.causality == causality]
        for causality in ("input", "output", "parameter")
    }
    initial = next((name for name in of["parameter"] if name.startswith("initial.")), None)
    lines = ["from fmpy import simulate_fmu", ""]
    if of["input"]:
        listed = ", ".join(f'"{name}"' for name in of["input"])
        half = repr(spec.stop_time / 2)
        lines = [
            "import numpy as np",
            *lines,
            *textwrap.wrap(f"inputs = [{listed}]", 88, subsequent_indent="    "),
            'signal = np.zeros(3, [(name, float) for name in ["time", *inputs]])',
            f'signal["time"] = [0.0, {half}, {half}]',
            f'signal["{of["input"][0]}"] = [0.0, 0.0, 0.1]  # a step',
        ]
    lines += [
        "result = simulate_fmu(",
        f'    "{spec.name}.fmu",',
        f"    stop_time={spec.stop_time!r},",
        f"    output_interval={spec.step_size!r},",
    ]
    if initial is not None:
        lines.append(f'    start_values={{"{initial}": 1.0}},')
    if of["input"]:
        lines.append("    input=signal,")
    listed = ", ".join(f'"{name}"' for name in of["output"][:_MOST_NAMES])
    lines += [f"    output=[{listed}],", ")"]
    lines.append(f'print(result["time"][-1], result["{of["output"][0]}"][-1])')
    return "\n".join(lines) + "\n"


def _elsewhere(spec: ComponentSpec) -> str:
    through = [v.name for v in spec.variables if v.causality == "output" and v.depends_on]
    direct = "No output depends on an input without delay, so that no algebraic loop can arise."
    if through:
        listed = ", ".join(f"<code>{html.escape(name)}</code>" for name in through[:_MOST_NAMES])
        more = ", …" if len(through) > _MOST_NAMES else ""
        direct = (
            f"Only {listed}{more} depend on inputs without delay; the model description lists them."
        )
    return (
        "Import the file as an FMU for co-simulation and join inputs and outputs by their names. "
        "Any communication step is possible, also a varying one. Parameters are set before "
        "initialisation ends and fixed from then on. The whole state can be saved, restored and "
        f"serialised. {direct} If <code>needsExecutionTool</code> is set in the model "
        "description, this is the flavour in Python, for Python hosts; the native flavour of the "
        "same component loads everywhere."
    )
