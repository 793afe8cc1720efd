"""A variable of an FMU: its meaning, its C type, and when it may be set."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import prod
from types import MappingProxyType
from typing import Any, Final, Literal, NamedTuple

from cosim.fmu.clock import Clock

FmiVersion = Literal["1.0", "2.0", "3.0"]
SignalKind = Literal["float", "int", "bool", "string", "binary", "clock"]
"""Kind of the values of a signal."""


class TypeMapping(NamedTuple):
    """How an FMI type is exchanged: kind of value, name in the functions, C type of an element."""

    kind: SignalKind | None
    getter_type: str
    c_type: str


_SIZED = {
    f"{sign}Int{bits}": TypeMapping("int", f"{sign}Int{bits}", f"{'u' if sign else 'i'}{bits // 8}")
    for sign in ("", "U")
    for bits in (8, 16, 32, 64)
}
_FMI2 = {
    "Real": TypeMapping("float", "Real", "f8"),
    "Integer": TypeMapping("int", "Integer", "i4"),
    "Enumeration": TypeMapping("int", "Integer", "i4"),
    "Boolean": TypeMapping("bool", "Boolean", "i4"),
    "String": TypeMapping("string", "String", "S"),
}
TYPE_MAPPINGS: Mapping[FmiVersion, Mapping[str, TypeMapping]] = MappingProxyType(
    {
        "1.0": {**_FMI2, "Boolean": TypeMapping("bool", "Boolean", "u1")},
        "2.0": _FMI2,
        "3.0": {
            "Float64": TypeMapping("float", "Float64", "f8"),
            "Float32": TypeMapping("float", "Float32", "f4"),
            **_SIZED,
            "Enumeration": TypeMapping("int", "Int64", "i8"),
            "Boolean": TypeMapping("bool", "Boolean", "u1"),
            "String": TypeMapping("string", "String", "S"),
            "Binary": TypeMapping("binary", "Binary", "V"),
            "Clock": TypeMapping("clock", "Clock", "u1"),
        },
    }
)
"""FMI version -> type in the model description -> how it is exchanged."""

Phase = Literal["instantiated", "initialising", "stepping", "failed", "closed"]
PHASE_TEXT: Mapping[Phase, str] = MappingProxyType(
    {
        "instantiated": "before the initialisation",
        "initialising": "during the initialisation",
        "stepping": "after the initialisation",
    }
)
"""Phase of a slave in which variables may be set -> how messages name it."""


@dataclass(frozen=True, slots=True)
class Port:
    """A variable of an FMU.

        >>> from cosim import DelaySystem, pack
        >>> from cosim.fmu import describe_fmu
        >>> fmu = describe_fmu(pack(DelaySystem([[-1]], [[1]]), "lag.fmu"))
        >>> state = fmu.ports["x[1]"]
        >>> state.causality, state.variability, state.kind, state.feedthrough
        ('output', 'continuous', 'float', False)

    Attributes
    ----------
    reference : value reference.
    kind : what its values are; enumerations are "int"; None for what cannot be exchanged here
        (a Clock without event mode).
    start : as declared, or None; a number, truth value, text or bytes; for an array a tuple of
        `size` of them, the last index running fastest.
    minimum, maximum : of a number, its own or else its type's.
    feedthrough : an output with direct feedthrough from some input.
    feedthrough_declared : whether `feedthrough` is declared, by the FMU or on its behalf; an
        output whose dependencies are not declared counts as one with feedthrough from all inputs.
    getter_type : type in the names of its functions: fmi3Get + getter_type.
    c_type : numpy's name of the C type of an element; "S" for texts, "V" for Binary.
    shape : () for a scalar; structural parameters at their present values.
    dimensions : as declared: a number, or the name of a structural parameter.
    initial : "exact", "approx", "calculated", or None.
    items : the values that an enumeration may have.
    nominal : nominal value of a real number, its own or else its type's; None: not declared.
    clock : how it ticks, if it is a Clock.
    clocks : names of the Clocks of a clocked variable: it has a value while one of them is active.
    intermediate : whether it may be read within a step (intermediateUpdate).
    """

    name: str
    reference: int
    causality: str
    variability: str
    kind: SignalKind | None
    unit: str | None
    start: Any
    minimum: float | None
    maximum: float | None
    description: str | None
    feedthrough: bool
    getter_type: str
    c_type: str
    shape: tuple[int, ...]
    dimensions: tuple[int | str, ...] = ()
    initial: str | None = None
    items: tuple[int, ...] = ()
    nominal: float | None = None
    feedthrough_declared: bool = True
    clock: Clock | None = None
    clocks: tuple[str, ...] = ()
    intermediate: bool = False

    @property
    def size(self) -> int:
        """Number of scalars."""
        return prod(self.shape)

    @property
    def ticks_by_time(self) -> bool:
        """Whether it is an input Clock that the master lets tick."""
        return self.clock is not None and self.clock.time_based and self.causality == "input"

    @property
    def is_source(self) -> bool:
        """Whether a connection may begin at it: an output, or a Clock that the master lets tick."""
        return self.causality == "output" or self.ticks_by_time

    def resized(self, lengths: Mapping[str, int]) -> Port:
        """Return the variable with these values of the structural parameters in its dimensions.

        Start values that differ from each other hold for the declared shape only: None in another.

        Raises
        ------
        ValueError : see `checked_shape`.
        """
        lengths_now = (d if isinstance(d, int) else lengths[d] for d in self.dimensions)
        shape = checked_shape(self.name, tuple(lengths_now))
        if shape == self.shape:
            return self
        uniform = self.start is not None and len(set(self.start)) == 1
        start = (self.start[0],) * prod(shape) if uniform else None
        return replace(self, shape=shape, start=start)


MOST_ELEMENTS: Final = 1 << 20
"""Elements of one array. Each has a name and a column in the rows of a run."""


def checked_shape(name: str, shape: tuple[int, ...]) -> tuple[int, ...]:
    """Return the shape of an array; a ValueError if it has too many elements."""
    if prod(shape) > MOST_ELEMENTS:
        lengths = " x ".join(map(str, shape))
        raise ValueError(f"{name} has {lengths} elements; at most {MOST_ELEMENTS} are exchanged")
    return shape


def parse_start(kind: SignalKind | None, texts: Sequence[str], shape: tuple[int, ...]) -> Any:
    """Return a start value from its words in the XML; one word sets all elements of an array."""
    if not texts or kind is None:
        return None
    values = tuple(parse_value(kind, text) for text in texts)
    if not shape:
        return values[0]
    return values * prod(shape) if len(values) == 1 else values


def parse_value(kind: SignalKind, text: str) -> Any:
    """Return a value from its text in XML schema.

    Raises
    ------
    ValueError : a text that is not one of a number.
    """
    if kind == "string":
        return text
    if kind == "binary":
        return bytes.fromhex(text)
    if kind == "bool":
        return {"true": True, "1": True, "false": False, "0": False}[text.strip()]
    return float(text) if kind == "float" else int(text)


def may_be_set(port: Port, phase: Phase) -> bool:
    """Whether the standard lets a variable be set in a phase (FMI 2.0.4 4.2.4, FMI 3.0 2.3.1).

    Structural parameters have a mode of their own, entered before the initialisation.
    """
    if port.variability == "constant" or port.causality == "independent" or port.clock is not None:
        return False  # a Clock is not set to a value: the master lets it tick
    if phase == "instantiated":
        return port.initial in ("exact", "approx") or port.causality == "input"
    if port.causality == "structuralParameter":
        return False
    if phase == "initialising":
        return port.initial == "exact" or port.causality == "input"
    tunable = port.causality == "parameter" and port.variability == "tunable"
    return phase == "stepping" and (tunable or port.causality == "input")


def describe_settable(port: Port) -> str:
    """Say in words when a variable may be set."""
    when = [text for phase, text in PHASE_TEXT.items() if may_be_set(port, phase)]
    return f"{port.variability} {port.causality}: {' and '.join(when) or 'never'}"
