"""Make [computed.NAME] into a component: its expressions are recorded, operation by operation.

What is recorded is the tree that `cosim.scenario.binding` makes, so that a value computed from
signals has the bits of the same expression in a condition.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import Any

from cosim.core import Dimension, InputError, dimension
from cosim.fmu.export import UNITS, ComponentSpec, component_module
from cosim.scenario.binding import BoundExpression, Meaning, Scope, bind
from cosim.scenario.expression import Expression
from cosim.tape import Tape

_SPECS = component_module("computed.variables")
_UNIT_OF = {dimension(**exponents): name for name, exponents in reversed([*UNITS.items()])}


def unit_named(of: Dimension | None) -> str | None:
    """Return the unit of FMUs made here for a dimension; None where there is none."""
    return None if of is None else _UNIT_OF.get(of)


class ComputedTable:
    """The expressions of one [computed.NAME], bound one by one; they may name each other.

    Parameters
    ----------
    name : of the component.
    texts : the expressions by output.
    scope : resolves the names of other components.
    constant : returns the value of a name that is a constant, in its unit; None for a signal.

    Attributes
    ----------
    signals : the names that it reads, in order, without t and constants.

    Raises
    ------
    InputError : an output that is computed from itself.
    ExpressionError : as `bind`, with the output in `where`.
    """

    def __init__(
        self,
        name: str,
        texts: Mapping[str, str],
        scope: Scope,
        constant: Callable[[str], float | None],
    ) -> None:
        self.name, self._texts, self._scope, self._constant = name, texts, scope, constant
        self._bound: dict[str, BoundExpression] = {}
        self._pending: list[str] = []
        self.signals: list[str] = []

    def meaning(self, reference: str) -> Meaning:
        """Return the meaning of a name: of another output of the table, or of the scope."""
        component, _, output = reference.partition(".")
        if component != self.name:
            found = self._scope.meaning(reference)
            if self._constant(reference) is None and reference not in self.signals:
                self.signals.append(reference)
            return found
        if output not in self._texts:
            raise InputError.unknown("value", reference, [f"{self.name}.{o}" for o in self._texts])
        node = self.bind(output).node
        return Meaning(node.kind, node.dimension)

    def bind(self, output: str) -> BoundExpression:
        """Bind one output, and those that it names."""
        if output in self._pending:
            way = [*self._pending[self._pending.index(output) :], output]
            raise InputError(
                f"{self.name}.{output} is computed from itself: "
                + " -> ".join(f"{self.name}.{one}" for one in way)
            )
        if output not in self._bound:
            self._pending.append(output)
            try:
                self._bound[output] = bind(Expression(self._texts[output]), self, None)
            finally:
                self._pending.remove(output)
        return self._bound[output]

    def spec(
        self, units: Mapping[str, str | None], step: float, integers: Collection[str] = ()
    ) -> ComponentSpec:
        """Specify the component; `units` : of the signals that it reads, `integers` : which are.

        Raises
        ------
        InputError : two names that would be one in C.
        """
        tape = Tape()
        known: dict[str, tuple[Any, frozenset[str]]] = {}
        made = [self._recorded(output, tape, known) for output in self._texts]
        results = [tape.scalar(value).place for value, _ in made]
        outputs = [
            (output, unit_named(self._bound[output].node.dimension), text)
            for output, text in self._texts.items()
        ]
        nodes = [
            [one.name, one.text]
            if one.name == "symbol"
            else [one.name, float(one.text)]
            if one.name == "constant"
            else [one.name, *one.operands]
            for one in tape.operations
        ]
        spec: ComponentSpec = _SPECS.computed_spec(
            self.name,
            [(signal, units[signal], f"signal {signal}") for signal in self.signals],
            outputs,
            nodes,
            results,
            [[signal for signal in self.signals if signal in reads] for _, reads in made],
            step,
            integers,
        )
        return spec

    def _recorded(
        self, output: str, tape: Tape, known: dict[str, tuple[Any, frozenset[str]]]
    ) -> tuple[Any, frozenset[str]]:
        """Record an output; return its value and the signals that it reads."""
        if output not in known:
            bound, reads = self._bound[output], set[str]()
            values: list[Any] = []
            for name in bound.names:
                component, _, other = name.partition(".")
                constant = None if name == "t" or component == self.name else self._constant(name)
                if component == self.name:
                    value, read = self._recorded(other, tape, known)
                    values.append(value)
                    reads |= read
                elif constant is not None:
                    values.append(constant)
                else:
                    values.append(tape.symbol(name))
                    reads |= {name} - {"t"}
            known[output] = bound.recorded(values, tape, raises=True), frozenset(reads)
        return known[output]
