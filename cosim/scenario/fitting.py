"""Which outputs of some FMUs fit which inputs of others: by name, terminal, type, size and unit.

An output fits an input of another component where

1. both have one name; or both are members of terminals of one name, which the rule of the terminals
   connects (`terminal_rules`);
2. a run connects them: types, sizes and units (`cosim.master.check_ends`). Units that their FMUs
   define are compared by their base units, and converted by a gain and an offset where they differ.

An input is wired where one output fits by name, or where none does and one fits by terminals. All
others are left open: nothing is guessed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

from cosim.core import InputError, counted
from cosim.fmu import FmuDescription, Port
from cosim.master import Endpoint, check_ends
from cosim.scenario.terminal_rules import Ends, joined_by_terminals
from cosim.scenario.units import DeclaredUnit, unit_of


@dataclass(frozen=True)
class FittingWire:
    """A connection: the input is gain * output + offset, in the units of the two.

    Attributes
    ----------
    converted : the two units in words, where they differ.
    is_clock : it is between two Clocks, which no link can transmit.
    """

    source: Endpoint
    target: Endpoint
    gain: float = 1.0
    offset: float = 0.0
    converted: str | None = None
    is_clock: bool = False


@dataclass(frozen=True)
class OpenInput:
    """An input that nothing was connected to.

    Attributes
    ----------
    why : in words.
    possible : outputs of other names that a run would connect, all of them with its very unit.
    """

    target: Endpoint
    why: str
    possible: tuple[Endpoint, ...] = ()


@dataclass(frozen=True)
class Fitting:
    """What fits, and what is left open, in the order of components and inputs."""

    wires: tuple[FittingWire, ...]
    open_inputs: tuple[OpenInput, ...]

    @property
    def inputs(self) -> int:
        """Number of inputs."""
        return len(self.wires) + len(self.open_inputs)

    @property
    def summary(self) -> str:
        """How many inputs are wired, in words."""
        of = counted(self.inputs, "input")
        return f"{len(self.wires)} of {of} wired" if self.inputs else "no inputs to wire"


def fitting_of(fmus: Mapping[str, FmuDescription]) -> Fitting:
    """Return which outputs of these components fit which inputs.

    >>> from cosim.fmu import describe_fmu
    >>> from cosim import build_fmu
    >>> from cosim.scenario import fitting_of
    >>> names = "PaperController", "DelayedPlant"
    >>> fitting = fitting_of({name: describe_fmu(build_fmu(name)) for name in names})
    >>> [f"{wire.source} -> {wire.target}" for wire in fitting.wires][:2]
    ['DelayedPlant.x[1] -> PaperController.x[1]', 'DelayedPlant.x[2] -> PaperController.x[2]']
    >>> [str(one.target) for one in fitting.open_inputs]
    ['DelayedPlant.w[1]']
    """
    search = _Search(fmus)
    wires, left = [], []
    for target in search.inputs():
        found = search.wire_to(target)
        if isinstance(found, FittingWire):
            wires.append(found)
        else:
            left.append(found)
    return Fitting(tuple(wires), tuple(left))


@dataclass
class _Search:
    fmus: Mapping[str, FmuDescription]
    _pairs: dict[tuple[str, str, str], list[Ends]] = field(default_factory=dict)

    def inputs(self) -> Iterator[Endpoint]:
        """Give every input, without the Clocks that tick by the time."""
        for name, fmu in self.fmus.items():
            for variable in fmu.model.variables:
                port = fmu.ports.get(variable.name)
                if variable.causality == "input" and not (port and port.ticks_by_time):
                    yield Endpoint(name, variable.name)

    def wire_to(self, target: Endpoint) -> FittingWire | OpenInput:
        """Return what fits an input."""
        unusable = self.fmus[target.component].unusable.get(target.variable)
        if unusable is not None or not target.variable.isprintable():
            return OpenInput(target, unusable or "its name cannot be written in a scenario")
        refused: list[str] = []
        by_name = self._outputs(target.variable, besides=target.component)
        for sources in (by_name, self._over_terminals(target)):
            fitting = []
            for source in sources:
                wire = self._fitted(source, target)
                if isinstance(wire, str):
                    refused.append(f"{source} does not fit: {wire}")
                else:
                    fitting.append(wire)
            if len(fitting) == 1:
                return fitting[0]
            if fitting:
                several = ", ".join(str(wire.source) for wire in fitting)
                return OpenInput(target, f"{len(fitting)} outputs fit: {several}")
        why = "; ".join(dict.fromkeys(refused)) or "no output has this name"
        return OpenInput(target, why, self._possible(target))

    def _outputs(self, variable: str, *, besides: str) -> list[Endpoint]:
        return [
            Endpoint(name, variable)
            for name, fmu in self.fmus.items()
            if name != besides and (port := fmu.ports.get(variable)) and port.causality == "output"
        ]

    def _over_terminals(self, target: Endpoint) -> list[Endpoint]:
        """Return the outputs that terminals of one name connect to an input."""
        return list(
            dict.fromkeys(
                ends[0]
                for terminal in self.fmus[target.component].terminals
                for name, fmu in self.fmus.items()
                if name != target.component and terminal in fmu.terminals
                for ends in self._joined(terminal, name, target.component)
                if ends[1] == target
            )
        )

    def _joined(self, terminal: str, one: str, other: str) -> list[Ends]:
        key = terminal, one, other
        if key not in self._pairs:
            try:
                ends = Endpoint(one, terminal), Endpoint(other, terminal)
                self._pairs[key] = joined_by_terminals(self.fmus, *ends)
            except InputError:  # of two kinds or rules, or members that do not meet
                self._pairs[key] = []
        return self._pairs[key]

    def _fitted(self, source: Endpoint, target: Endpoint) -> FittingWire | str:
        """Return the connection of two ends, or why there is none."""
        sender, receiver = self.fmus[source.component], self.fmus[target.component]
        sends, receives = sender.ports[source.variable], receiver.ports[target.variable]
        wire = FittingWire(source, target, is_clock=sends.kind == "clock")
        units = unit_of(sender, sends), unit_of(receiver, receives)
        given = _converted(wire, sends, receives, *units)
        if isinstance(given, str):
            return given
        if given.converted is not None:
            sends = replace(sends, unit=receives.unit)
        try:
            check_ends(sends, receives, "")
        except InputError as error:
            return f"{error.what} ({error.got})"
        return given

    def _possible(self, target: Endpoint) -> tuple[Endpoint, ...]:
        """Return what a run would connect of outputs that have its unit, if these are few."""
        wanted = self.fmus[target.component].ports[target.variable]
        if not wanted.unit:
            return ()
        found = [
            Endpoint(name, port.name)
            for name, fmu in self.fmus.items()
            for port in fmu.ports.values()
            if name != target.component and port.causality == "output" and port.unit == wanted.unit
        ]
        fitting = [one for one in found if isinstance(self._fitted(one, target), FittingWire)]
        return tuple(fitting) if len(fitting) <= _FEW else ()


_FEW = 1
"""So many outputs are named beside an open input, at most."""


def _converted(
    wire: FittingWire,
    source: Port,
    target: Port,
    given: DeclaredUnit | None,
    wanted: DeclaredUnit | None,
) -> FittingWire | str:
    """Return the connection with what converts its units; why not, where that cannot be done.

    A unit that nobody defines is compared by its name, and no unit fits all of them, as in a run.
    """
    if given is None or wanted is None or given.dimension is None or wanted.dimension is None:
        return wire
    words = f"{given.name} -> {wanted.name}"
    if given.dimension != wanted.dimension:
        return f"the units of the two ends differ ({words})"
    alike = (given.factor, given.offset) == (wanted.factor, wanted.offset)
    if alike and given.name == wanted.name:
        return wire
    if source.kind != "float" or source.shape or target.shape:
        return f"only single real numbers are converted ({words})"
    if not wanted.factor or not given.factor:
        return f"a factor of zero converts nothing ({words})"
    gain = given.factor / wanted.factor
    offset = (given.offset - wanted.offset) / wanted.factor
    return replace(wire, gain=gain, offset=offset, converted=words)
