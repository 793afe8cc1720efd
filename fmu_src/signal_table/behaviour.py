"""What the C of a table of signals needs when it is built; see c/table.c."""

from __future__ import annotations

from typing import Any


class SignalTable:
    """Outputs that follow a table.

    Attributes
    ----------
    outputs : their names.
    instants_ns : strictly increasing [ns], (n,).
    rows : values, (n, outputs).
    """

    def __init__(self, constants: dict[str, Any]) -> None:
        self.outputs: list[str] = constants["outputs"]
        self.instants_ns: list[int] = constants["instants_ns"]
        self.rows: list[list[float]] = constants["rows"]
