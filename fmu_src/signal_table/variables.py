"""FMI variables of a table of signals."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from cosim.fmu.export import UNITS, ComponentSpec, Variable

MOST_NUMBERS = 2_000_000
"""Greatest number of values in a table: they are part of the FMU's C source."""


def table_spec(
    name: str,
    outputs: Sequence[tuple[str, str | None]],
    instants_ns: Sequence[int],
    rows: Sequence[Sequence[float]],
    step: float,
) -> ComponentSpec:
    """Specify a table of signals.

    Parameters
    ----------
    outputs : names and units.
    instants_ns : strictly increasing [ns], (n,), n >= 1.
    rows : values at the instants, (n, outputs).
    step : of the default experiment [s].

    Raises
    ------
    ValueError : more than `MOST_NUMBERS` values.
    """
    if len(rows) * len(outputs) > MOST_NUMBERS:
        raise ValueError(f"{len(rows)} x {len(outputs)} values; at most {MOST_NUMBERS} fit")
    return ComponentSpec(
        name=name,
        description="Signals given as a table",
        variables=tuple(
            Variable(n, "output", f"signal {n}", unit if unit in UNITS else None, float(first))
            for (n, unit), first in zip(outputs, rows[0], strict=True)
        ),
        behaviour="cosim.components.signal_table.behaviour:SignalTable",
        sources=("cosim.components.signal_table.behaviour",),
        readme=Path(__file__).with_name("readme.md"),
        stop_time=max(instants_ns[-1] / 1e9, step),
        step_size=step,
        constants={
            "outputs": [n for n, _ in outputs],
            "instants_ns": [int(t) for t in instants_ns],
            "rows": [[float(x) for x in row] for row in rows],
        },
    )
