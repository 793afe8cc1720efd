"""Component instances: the components of a run, with their columns of the rows."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import groupby, product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.fmu import FmuSlave, Port
from cosim.master.communication_points import CommunicationPoints
from cosim.master.component_points import ComponentPoints
from cosim.master.parts import Component, Endpoint, Signal
from cosim.master.routes import Route

Rows = NDArray[np.float64]


class Column(NamedTuple):
    """One number of a row.

    Attributes
    ----------
    port : the variable.
    name : of the variable, or of an element of an array: `x[2,1]`, counted from 1.
    """

    port: Port
    name: str


def columns_of(ports: Iterable[Port]) -> tuple[Column, ...]:
    """Return one column per scalar, arrays in row-major order."""
    return tuple(Column(port, name) for port in ports for name in element_names(port))


def element_names(port: Port) -> Sequence[str]:
    """Return the name of a scalar, or the names of the elements of an array."""
    if not port.shape:
        return (port.name,)
    places = product(*(range(1, size + 1) for size in port.shape))
    return tuple(f"{port.name}[{','.join(map(str, place))}]" for place in places)


@dataclass(frozen=True, eq=False)
class Group:
    """Variables of one type in neighbouring columns of the rows, exchanged by one FMI call.

    Attributes
    ----------
    getter_type, c_type : as those of the `Port`s; in the rows every value is a double, what is
        none the number of its text in `Texts`.
    references : value references, uint32 (m,).
    size : number of values.
    column : their first column in the rows.
    route : index of the route of the instance that they come by; None for outputs, and for
        inputs that follow a given signal.
    clocks : names of the Clocks of clocked variables.
    """

    getter_type: str
    c_type: str
    references: NDArray[np.uint32]
    size: int
    column: int
    route: int | None = None
    clocks: tuple[str, ...] = ()

    @classmethod
    def of_all(cls, groups: Sequence[Group]) -> Group:
        """Return neighbours of one type as one group, whatever they come by."""
        if len(groups) == 1:
            return groups[0]
        references = np.concatenate([group.references for group in groups])
        size = sum(group.size for group in groups)
        return replace(groups[0], references=references, size=size, route=None)


@dataclass(eq=False)
class ComponentInstance:
    """A component during a run: its FMU instance and its columns of the rows.

    Attributes
    ----------
    outputs : (points, outputs), a view of the rows; valid at its own points so far.
    output_columns, input_columns : the columns of its outputs and of its connected inputs.
    comm_points : the points of the run.
    outputs_without_feedthrough : outputs that are read before the inputs of the same point.
    outputs_with_feedthrough : outputs that depend on the inputs of the same point.
    driven : inputs that follow a signal, or the state of a link.
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

    @property
    def output_column(self) -> int:
        """The first column of its outputs in the rows."""
        groups = (*self.outputs_without_feedthrough, *self.outputs_with_feedthrough)
        return min((group.column for group in groups), default=0)

    @property
    def input_column(self) -> int:
        """The first column of its inputs in the rows."""
        return self.connected_inputs[0].column if self.connected_inputs else 0

    @cached_property
    def input_sets(self) -> tuple[tuple[Group, ...], ...]:
        """The groups of connected inputs that one FMI call sets together: neighbours of one type.

        Groups are set one by one where a value in the middle of a step is another one than at its
        point, and in event mode, in which what is set is looked at group by group.
        """
        looks_ahead = any(route.at_point is not None for route in self.routes)
        if looks_ahead or self.component.has_events:
            return tuple((group,) for group in self.connected_inputs)
        return tuple(
            tuple(groups)
            for _, groups in groupby(self.connected_inputs, lambda g: (g.getter_type, g.clocks))
        )

    def place(self, variable: str, kind: str = "signal") -> tuple[int, Column]:
        """Return the column of the rows that contains an output or connected input.

        Raises
        ------
        InputError : there is no such variable; called `kind` in the message.
        """
        for columns, first in (
            (self.output_columns, self.output_column),
            (self.input_columns, self.input_column),
        ):
            for j, column in enumerate(columns):
                if column.name == variable:
                    return first + j, column
        raise InputError.unknown(
            kind, variable, self.column_names, where=f"component {self.name!r}"
        )

    @property
    def inputs(self) -> Rows:
        """Its connected inputs, (points, inputs), a view of the rows."""
        first = self.input_column
        return self.rows[:, first : first + len(self.input_columns)]

    @property
    def column_names(self) -> list[str]:
        """The names of its outputs and connected inputs, elements of arrays one by one."""
        return [column.name for column in (*self.output_columns, *self.input_columns)]

    def with_rows(self, rows: Rows) -> ComponentInstance:
        """Return the instance with a copy of all of its rows so far, (points, columns)."""
        first = self.output_column
        return replace(
            self,
            rows=rows,
            outputs=rows[:, first : first + len(self.output_columns)],
            own_points=self.own_points.copied(len(rows)),
        )

    def values(self, rows: Any, columns: Sequence[Column]) -> list[list[Any]]:
        """Convert rows of doubles to rows of values of the columns' own types."""
        convert: dict[str, Callable[[float], Any]] = {
            "float": float,
            "int": self.texts.integer,
            "bool": bool,
            "clock": bool,
        }
        of = [convert.get(c.port.kind or "float", self.texts.text) for c in columns]
        return [[to(v) for to, v in zip(of, row, strict=True)] for row in rows.tolist()]


MOST_EXACT = 2**53
"""Integers of a greater magnitude may be none of the doubles."""
_WIDE, _SPACING = 2.0**60, 256
"""In a row _WIDE + _SPACING * number stands for an integer that is written as a text: each is a
double, and none of those that stand for themselves."""


class Texts:
    """What a double cannot hold, in a run; rows contain its number. Number 0 is the empty string.

    A String is its text, Binary the hexadecimal text of its bytes, and an integer of a magnitude
    above 2**53 its digits.
    """

    def __init__(self) -> None:
        self.on_new: Callable[[int, str], None] | None = None
        """Called with each new number and text."""
        self._texts = [""]
        self._numbers = {"": 0}

    def number(self, text: str) -> int:
        """Return the number of a text; a new text gets the next number."""
        found = self._numbers.get(text)
        if found is None:
            found = self._numbers[text] = len(self._texts)
            self._texts.append(text)
            if self.on_new is not None:
                self.on_new(found, text)
        return found

    def __getitem__(self, number: int) -> str:
        return self._texts[number]

    def all(self) -> tuple[str, ...]:
        """Return every text, by its number."""
        return tuple(self._texts)

    def restore(self, texts: Sequence[str]) -> None:
        """Add the texts of a snapshot under their numbers."""
        for number, text in enumerate(texts):
            if self.number(text) != number:
                raise ValueError(f"expected number {number} for {text!r}")

    def text(self, value: float) -> str:
        """Return the text that a value of a row stands for."""
        return self._texts[int(value)]

    def integer(self, value: float) -> int:
        """Return the integer that a value of a row stands for."""
        if abs(value) <= MOST_EXACT:
            return int(value)
        return int(self._texts[(int(value) - int(_WIDE)) // _SPACING])

    def of_integers(self, values: Any) -> list[float]:
        """Return what stands for integers in a row."""
        return [
            float(v) if abs(v) <= MOST_EXACT else _WIDE + _SPACING * self.number(str(v))
            for v in map(int, values)
        ]

    def of_bytes(self, values: Iterable[bytes]) -> list[int]:
        """Return what stands for values of type Binary in a row."""
        return [self.number(value.hex()) for value in values]

    def doubles(self, value: Any, port: Port) -> Any:
        """Convert the value of a variable, None for none, to the doubles of a row."""
        if port.kind == "string":
            return [self.number(text) for text in np.ravel(value if value is not None else "")]
        if port.kind == "binary":
            given = [b""] if value is None else [value] if isinstance(value, bytes | str) else value
            return self.of_bytes(v if isinstance(v, bytes) else bytes.fromhex(v) for v in given)
        if port.kind == "int" and port.c_type in ("i8", "u8") and value is not None:
            return self.of_integers(np.ravel(np.array(value, dtype=object)))
        return np.ravel(0.0 if value is None else value).astype(np.float64)
