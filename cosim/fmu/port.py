"""A variable of an FMU as the master sees it: what it means, and how C moves it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import prod
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

FmiVersion = Literal["2.0", "3.0"]
SignalKind = Literal["float", "int", "bool", "string"]


class TypeMapping(NamedTuple):
    """How an FMI type is moved: its meaning, the function's name, the C type of an element."""

    kind: SignalKind | None
    getter_type: str
    c_type: str


_SIZED = {
    f"{sign}Int{bits}": TypeMapping("int", f"{sign}Int{bits}", f"{'u' if sign else 'i'}{bits // 8}")
    for sign in ("", "U")
    for bits in (8, 16, 32, 64)
}
TYPE_MAPPINGS: Mapping[FmiVersion, Mapping[str, TypeMapping]] = MappingProxyType(
    {
        "2.0": {
            "Real": TypeMapping("float", "Real", "f8"),
            "Integer": TypeMapping("int", "Integer", "i4"),
            "Enumeration": TypeMapping("int", "Integer", "i4"),
            "Boolean": TypeMapping("bool", "Boolean", "i4"),
            "String": TypeMapping("string", "String", "S"),
        },
        "3.0": {
            "Float64": TypeMapping("float", "Float64", "f8"),
            "Float32": TypeMapping("float", "Float32", "f4"),
            **_SIZED,
            "Enumeration": TypeMapping("int", "Int64", "i8"),
            "Boolean": TypeMapping("bool", "Boolean", "u1"),
            "String": TypeMapping("string", "String", "S"),
            "Binary": TypeMapping(None, "Binary", ""),
            "Clock": TypeMapping(None, "Clock", ""),
        },
    }
)
"""FMI version -> type in the model description -> how it is moved."""


@dataclass(frozen=True, slots=True)
class Port:
    """A variable.

    Attributes
    ----------
    reference : value reference.
    kind : what its values are; enumerations are "int"; None for what cannot be exchanged here
        (Binary, Clock).
    start : as declared, None where nothing is; a number, truth value or text; for an array a
        tuple of `size` of them, the last index running fastest.
    minimum, maximum : of a number, its own or else its type's.
    feedthrough : an output that some input reaches without delay.
    getter_type : what the FMI functions that move it are called: fmi3Get + getter_type.
    c_type : numpy's name of an element as C moves it; "S" for texts.
    shape : () for a scalar; dimensions that structural parameters give are at their values.
    dimensions : as declared: a number, or the name of a structural parameter.
    initial : "exact", "approx", "calculated", or None.
    items : the values that an enumeration may have.
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

    @property
    def size(self) -> int:
        """Number of scalars."""
        return prod(self.shape)

    def resized(self, lengths: Mapping[str, int]) -> Port:
        """The same variable where its dimensions' structural parameters have these values.

        Start values that differ from one another are those of the declared shape alone: in
        another one they are unknown.
        """
        shape = tuple(d if isinstance(d, int) else lengths[d] for d in self.dimensions)
        if shape == self.shape:
            return self
        uniform = self.start is not None and len(set(self.start)) == 1
        start = (self.start[0],) * prod(shape) if uniform else None
        return replace(self, shape=shape, start=start)


def parse_start(kind: SignalKind | None, texts: Sequence[str], shape: tuple[int, ...]) -> Any:
    """A start value from its words in the XML; one word is every element of an array."""
    if not texts or kind is None:
        return None
    values = tuple(parse_value(kind, text) for text in texts)
    if not shape:
        return values[0]
    return values * prod(shape) if len(values) == 1 else values


def parse_value(kind: SignalKind, text: str) -> Any:
    """A value as XML schema writes it.

    Raises
    ------
    ValueError : the text is no such value.
    """
    if kind == "string":
        return text
    if kind == "bool":
        return {"true": True, "1": True, "false": False, "0": False}[text.strip()]
    return float(text) if kind == "float" else int(text)
