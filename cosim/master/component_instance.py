"""A component of a run: its slave, its part of the rows, its routes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.fmu import FmuSlave, Port
from cosim.master.columns import Column
from cosim.master.communication_points import CommunicationPoints
from cosim.master.component_points import ComponentPoints
from cosim.master.routes import Route
from cosim.master.system import Component, Endpoint, Signal

Rows = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Group:
    """Variables of one type, side by side in the rows: one FMI call moves them.

    Attributes
    ----------
    getter_type, c_type : as those of the `Port`s; what is not a double is carried as one,
        which holds it exactly, a text as its number among the texts of the run.
    references : value references, uint32 (m,).
    size : number of values.
    column : their first column in the rows.
    route : number of the station's route that brings them; None for outputs, and for inputs
        that follow a given signal.
    """

    getter_type: str
    c_type: str
    references: NDArray[np.uint32]
    size: int
    column: int
    route: int | None = None


@dataclass(eq=False)
class ComponentInstance:
    """A component of a run: its slave, its part of the rows, its routes.

    Attributes
    ----------
    outputs : (points, outputs), a view of the rows; valid at its own points up to the last
        one reached.
    output_columns, input_columns : what the columns of its outputs and connected inputs hold.
    comm_points : the points of the run.
    outputs_without_feedthrough : outputs that do not wait for the inputs of the same point.
    connected_inputs : connected inputs.
    outputs_with_feedthrough : outputs that follow the inputs of the same point.
    driven : inputs that follow a signal, or the state of a link.
    direct_routes : numbers of the routes whose values are set straight from the sender's row.
    """

    name: str
    component: Component
    own_points: ComponentPoints
    output_columns: tuple[Column, ...]
    input_columns: tuple[Column, ...]
    outputs: Rows
    outputs_without_feedthrough: tuple[Group, ...]
    connected_inputs: tuple[Group, ...]
    outputs_with_feedthrough: tuple[Group, ...]
    routes: tuple[Route, ...]
    rows: Rows = field(repr=False)
    texts: Texts = field(repr=False)
    comm_points: CommunicationPoints = field(repr=False)
    driven: Mapping[str, Signal | Endpoint] = field(default_factory=dict, repr=False)
    slave: FmuSlave = field(init=False)
    direct_routes: set[int] = field(init=False)

    def __post_init__(self) -> None:
        self._settled = 0
        whole = {g.route: g for g in self.connected_inputs if g.c_type == "f8"}
        self.direct_routes = {
            i
            for i, route in enumerate(self.routes)
            if route.verbatim and i in whole and whole[i].size == route.targets.size
        }

    @property
    def output_column(self) -> int:
        """The first column of its outputs in the rows."""
        return min(
            (
                group.column
                for group in (*self.outputs_without_feedthrough, *self.outputs_with_feedthrough)
            ),
            default=0,
        )

    @property
    def input_column(self) -> int:
        """The first column of its inputs in the rows."""
        return self.connected_inputs[0].column if self.connected_inputs else 0

    def place(self, variable: str, kind: str = "signal") -> tuple[int, Column]:
        """The column of the rows that holds an output or connected input.

        Raises
        ------
        InputError : it is none of them; called `kind` in the message.
        """
        for columns, first in (
            (self.output_columns, self.output_column),
            (self.input_columns, self.input_column),
        ):
            for j, column in enumerate(columns):
                if column.name == variable:
                    return first + j, column
        known = [c.name for c in (*self.output_columns, *self.input_columns)]
        raise InputError.unknown(kind, variable, known, where=f"component {self.name!r}")

    def inputs(self, count: int) -> Rows:
        """Connected inputs at the first points, (reached, inputs), valid at its own points.

        What is set straight from a sender's row is written down here, when it is asked for.
        """
        for i in self.direct_routes:
            self._write_down(self.routes[i], self._settled, count)
        self._settled = max(self._settled, count)
        first = self.input_column
        return self.rows[:count, first : first + len(self.input_columns)]

    def forget(self, count: int) -> None:
        """Rows from `count` on are to come about anew."""
        self._settled = min(self._settled, count)

    def copy_from(self, number: int, count: int) -> None:
        """From `count` on, bring what a straight route brings into the rows first."""
        if number in self.direct_routes:
            self.inputs(count)
            self.direct_routes.discard(number)

    def values(self, rows: Any, columns: Sequence[Column]) -> list[list[Any]]:
        """Rows of doubles -> rows of values of the columns' own types."""
        types = [_TYPES[column.port.kind or "float"] for column in columns]
        text = self.texts
        return [
            [text[int(v)] if to is str else to(v) for to, v in zip(types, row, strict=True)]
            for row in rows.tolist()
        ]

    def _write_down(self, route: Route, first: int, last: int) -> None:
        source = slice(int(route.columns[0]), int(route.columns[-1]) + 1)
        target = slice(int(route.targets[0]), int(route.targets[-1]) + 1)
        used = route.row[first:last]
        there = np.flatnonzero(used >= 0)
        self.rows[first + there, target] = self.rows[used[there], source]


_TYPES: Mapping[str, type] = {"float": float, "int": int, "bool": bool, "string": str}


class Texts:
    """The texts of a run, each once; rows hold their numbers. Number 0 is the empty text."""

    def __init__(self) -> None:
        self._texts = [""]
        self._numbers = {"": 0}

    def number(self, text: str) -> int:
        """The number of a text, new if it has none."""
        found = self._numbers.get(text)
        if found is None:
            found = self._numbers[text] = len(self._texts)
            self._texts.append(text)
        return found

    def __getitem__(self, number: int) -> str:
        return self._texts[number]

    def all(self) -> tuple[str, ...]:
        """Every text, by its number."""
        return tuple(self._texts)

    def restore(self, texts: Sequence[str]) -> None:
        """Take over the texts of a snapshot, numbers and all."""
        for number, text in enumerate(texts):
            if self.number(text) != number:
                raise ValueError(f"expected number {number} for {text!r}")

    def doubles(self, value: Any, port: Port) -> Any:
        """A value of a variable, None for none, as it stands in a row."""
        if port.kind == "string":
            return [self.number(text) for text in np.ravel(value if value is not None else "")]
        return np.ravel(0.0 if value is None else value).astype(np.float64)
