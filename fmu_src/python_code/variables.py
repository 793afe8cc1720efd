"""FMI variables of a component whose steps are Python code."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from cosim.fmu.export import ComponentSpec, Variable

LARGEST = 2.0**53


def names_of(signals: Mapping[str, int]) -> list[str]:
    """Return the names of variables: `q` of one value, `x[1]`, `x[2]` of several."""
    return [
        name if count == 1 else f"{name}[{i}]"
        for name, count in signals.items()
        for i in range(1, count + 1)
    ]


def python_code_spec(
    name: str, inputs: Mapping[str, int], outputs: Mapping[str, int]
) -> ComponentSpec:
    """Specify the component.

    inputs, outputs : number of values by name.
    """
    read, written = names_of(inputs), names_of(outputs)
    place = "where the code is in this process; 0: nowhere"
    table = [
        *(Variable(one, "input", f"{one}, given to the code", None) for one in read),
        *(Variable(one, "output", f"{one}, returned by the code", None) for one in written),
        Variable("code.address", "parameter", place, None, 0.0, minimum=0.0, maximum=LARGEST),
        Variable("code.mark", "parameter", "by which it is known", None, 0.0),
    ]
    return ComponentSpec(
        name=name,
        description="Python code of the process that flies it",
        variables=tuple(table),
        behaviour="cosim.components.python_code.behaviour:PythonCode",
        sources=("cosim.components.python_code.behaviour",),
        readme=Path(__file__).with_name("readme.md"),
        stop_time=60.0,
        step_size=0.05,
        constants={"inputs": read, "outputs": written},
    )
