"""Guards: conditions on complete rows that an engine looks at after every point, and stops at.

Conditions of events, modes and stops change seldom. An engine carries on as long as each of them
is what it was; at the first row at which one is not, it stops behind that point, and Python acts.
The conditions are recorded as one program, operation by operation, which the kernel carries out
with the bits of `BoundExpression`: a row at which it does not stop is one at which nobody would
have found anything.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from cosim.master.component_instance import ComponentInstance
from cosim.tape import OPERATIONS, Scalar, Tape

Integers = NDArray[np.int64]
Reals = NDArray[np.float64]
AtPoints = Callable[[int, int], Reals]
"""Returns the values of a name at the points first to last - 1, (n,), also ahead of the run."""

NOT_WATCHED = -1
"""What `Guards.expected` has of a condition that is not looked at."""
_OPERATIONS = ("symbol", "constant", *OPERATIONS)
"""By number in the kernel."""
_NODE = np.dtype([("operation", "i8"), ("a", "i8"), ("b", "i8"), ("value", "f8")])
_SOURCE = np.dtype([("base", "i8"), ("index", "i8"), ("stride", "i8")])


class Condition(Protocol):
    """What is true or false in a row."""

    @property
    def names(self) -> tuple[str, ...]:
        """Whose values it depends on, in their order."""

    def __call__(self, values: Sequence[Any]) -> Any:
        """Return whether it holds at values of `names`."""

    def recorded(self, values: Sequence[Scalar], tape: Tape) -> Any:
        """Record it: 1.0 where it holds, else 0.0; a `Scalar` of the tape, or a number."""


class _Signal(NamedTuple):
    """An output or connected input: its instance, and its column of the rows."""

    instance: ComponentInstance
    column: int

    @property
    def is_input(self) -> bool:
        """Whether it is an input."""
        first = self.instance.input_column
        return first <= self.column < first + len(self.instance.input_columns)


class Guards:
    """Conditions, and what is expected of each.

    Parameters
    ----------
    conditions : in any order.
    signals : by name, of outputs and connected inputs: instance, and column of the rows.
    others : by name, of all other names.

    Attributes
    ----------
    expected : of each condition 1 (holds), 0 (does not), or -1: it is not watched; int64 (n,).
    reads_inputs : whether a condition depends on an input: then inputs must be in the rows.
    """

    def __init__(
        self,
        conditions: Sequence[Condition],
        signals: Mapping[str, tuple[ComponentInstance, int]],
        others: Mapping[str, AtPoints],
    ) -> None:
        self._conditions = conditions
        self.expected = np.full(len(conditions), NOT_WATCHED, np.int64)
        names = [*dict.fromkeys(name for one in conditions for name in one.names)]
        self._signals = {n: _Signal(*signals[n]) for n in names if n in signals}
        self._others = {n: others[n] for n in names if n not in self._signals}
        self.reads_inputs = any(signal.is_input for signal in self._signals.values())
        tape = Tape()
        symbols = {name: tape.symbol(name) for name in names}
        made = [one.recorded([symbols[n] for n in one.names], tape) for one in conditions]
        self.results = np.array([tape.scalar(x).place for x in made], np.int64)
        self.nodes = np.zeros(len(tape.operations), _NODE)
        for line, one in zip(self.nodes, tape.operations, strict=True):
            line["operation"] = _OPERATIONS.index(one.name)
            if one.operands:
                line["a"], line["b"] = one.operands[0], one.operands[-1]
            elif one.name == "symbol":
                line["a"] = names.index(one.text)
            else:
                line["value"] = float(one.text)
        self.slots = np.zeros(len(tape.operations))
        self.sources = np.zeros(len(names), _SOURCE)
        self._block = np.zeros((len(self._others), 0))
        for line, name in zip(self.sources, names, strict=True):
            if name in self._signals:
                instance, column = self._signals[name]
                line["base"] = instance.rows.ctypes.data + instance.rows.strides[1] * column
                line["index"] = instance.own_points.last.ctypes.data
                line["stride"] = instance.rows.strides[0] // instance.rows.strides[1]
        self._places = [names.index(name) for name in self._others]

    def prepare(self, first: int, last: int) -> None:
        """Look up what is no signal at the points first to last - 1, which come next."""
        if self._block.shape[1] < last - first:
            self._block = np.zeros((len(self._others), last - first))
            self.sources["base"][self._places] = [row.ctypes.data for row in self._block]
        for row, read in zip(self._block, self._others.values(), strict=True):
            row[: last - first] = read(first, last)

    def value(self, name: str, k: int) -> float:
        """Return the value of a name at point k, whose row is complete."""
        if name in self._signals:
            instance, column = self._signals[name]
            return float(instance.rows[instance.own_points.last[k], column])
        return float(self._others[name](k, k + 1)[0])

    def holds(self, number: int, k: int) -> bool:
        """Whether a condition holds in row k, which is complete."""
        condition = self._conditions[number]
        return bool(condition([self.value(name, k) for name in condition.names]))

    def are_met(self, k: int) -> bool:
        """Whether every condition is what is expected of it in row k: what the kernel asks."""
        return all(
            self.holds(i, k) == expected
            for i, expected in enumerate(self.expected.tolist())
            if expected != NOT_WATCHED
        )
