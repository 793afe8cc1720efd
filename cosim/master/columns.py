"""Which column of the rows holds which variable, or element of one."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import product
from typing import NamedTuple

from cosim.fmu import Port


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
    """One column per scalar, arrays in row-major order."""
    return tuple(Column(port, name) for port in ports for name in element_names(port))


def element_names(port: Port) -> Sequence[str]:
    """The variable's own name; for an array, those of its elements."""
    if not port.shape:
        return (port.name,)
    places = product(*(range(1, size + 1) for size in port.shape))
    return tuple(f"{port.name}[{','.join(map(str, place))}]" for place in places)
