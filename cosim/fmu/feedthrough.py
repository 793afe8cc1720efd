"""Direct feedthrough as a user declares it, in place of what an FMU declares or leaves out.

Many exporters leave the dependencies of outputs out of the model description. By the standard
each such output then depends on all inputs at once, and a loop through it is an algebraic one.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal

from cosim.core import InputError, is_inside
from cosim.fmu.port import Port

Feedthrough = Literal["none"] | Sequence[str]
"""The outputs that depend on some input at the same instant: "none", or their names."""

_ELEMENT = re.compile(r"(?P<array>.+)\[(?P<place>[0-9]+(?:,[0-9]+)*)\]", re.ASCII)


def declared_feedthrough(
    ports: Mapping[str, Port], given: Feedthrough, *, where: str
) -> dict[str, Port]:
    """Return the ports with direct feedthrough to the named outputs and to no other.

    Parameters
    ----------
    given : "none", or names: of an output, of an element of an array (which stands for the whole
        array, since FMI declares dependencies of variables), or of a group: "eta" for every
        output `eta.*` or `eta[...]`.
    where : the place of `given`, for messages.

    Raises
    ------
    InputError : a name that is no output.
    """
    if given != "none" and isinstance(given, str):
        raise InputError(
            "this does not say which outputs depend on inputs at once",
            where=where,
            expected='"none", or a list of the names of outputs',
            got=repr(given),
        )
    outputs = {name: port for name, port in ports.items() if port.causality == "output"}
    named: set[str] = set()
    for name in () if given == "none" else given:
        found = _named(outputs, name)
        if not found:
            raise InputError.unknown("output", name, outputs, where=where)
        named |= found
    return {
        name: replace(port, feedthrough=name in named, feedthrough_declared=True)
        if name in outputs
        else port
        for name, port in ports.items()
    }


def _named(outputs: Mapping[str, Port], name: str) -> set[str]:
    """Return the outputs that a name stands for; empty if there is none."""
    if name in outputs:
        return {name}
    element = _ELEMENT.fullmatch(name)
    array = outputs.get(element["array"]) if element is not None else None
    if element is not None and array is not None and array.shape:
        place = [int(number) for number in element["place"].split(",")]
        inside = len(place) == len(array.shape) and all(
            1 <= i <= size for i, size in zip(place, array.shape, strict=True)
        )
        return {array.name} if inside else set()
    return {other for other in outputs if name and is_inside(other, name)}
