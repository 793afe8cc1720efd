"""FMI variables of values computed from signals."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

from cosim.fmu.export import UNITS, ComponentSpec, Variable

Named = tuple[str, str | None, str]
"""Name, unit (None: without one) and description of a variable."""


def computed_spec(
    name: str,
    inputs: Sequence[Named],
    outputs: Sequence[Named],
    nodes: Sequence[Sequence[Any]],
    results: Sequence[int],
    reads: Sequence[Sequence[str]],
    step: float,
    integers: Collection[str] = (),
) -> ComponentSpec:
    """Specify a component whose outputs are computed from its inputs at the same instant.

    Parameters
    ----------
    nodes : operations in order: ["symbol", input or "t"], ["constant", number], or the name of an
        operation and the places of its operands.
    results : the place of each output.
    reads : by output, the inputs that it depends on.
    step : of the default experiment [s].
    integers : the inputs that are Integers.
    """
    known = [(n, unit if unit in UNITS else None, text) for n, unit, text in inputs]
    table = [
        Variable(n, "input", text, unit, kind="Integer" if n in integers else "Real")
        for n, unit, text in known
    ]
    table += [
        Variable(n, "output", text, unit if unit in UNITS else None, depends_on=tuple(used))
        for (n, unit, text), used in zip(outputs, reads, strict=True)
    ]
    return ComponentSpec(
        name=name,
        description="Values computed from signals",
        variables=tuple(table),
        behaviour="cosim.components.computed.behaviour:Computed",
        sources=("cosim.components.computed.behaviour",),
        readme=Path(__file__).with_name("readme.md"),
        stop_time=60.0,
        step_size=step,
        constants={
            "inputs": [n for n, _, _ in inputs],
            "outputs": [n for n, _, _ in outputs],
            "texts": [" ".join(text.split()) for _, _, text in outputs],
            "nodes": [list(node) for node in nodes],
            "results": list(results),
        },
    )
