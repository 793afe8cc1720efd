"""Make link FMUs of links; refuse or name what such an FMU cannot do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

from cosim.core import InputError
from cosim.fmu import ComponentSpec, component_module
from cosim.master import Link
from cosim.network import PacketLink, keys_of

_VARIABLES = component_module("link_channel.variables")


def link_spec(
    name: str, link: Link, signals: Sequence[Any], step_ns: int
) -> tuple[ComponentSpec, list[str]]:
    """Specify the link FMU `name` of a link; return it with warnings.

    Raises
    ------
    InputError : a link whose delay varies or that shares a medium, or a seed too large for an
        Integer of FMI.
    """
    _refuse(link)
    step = step_ns / 1e9
    if isinstance(link, PacketLink):
        return _VARIABLES.packet_spec(name, link, signals, step), [*_late(link), *_unknown(link)]
    warnings = []
    if link.delay_ns < step_ns:
        warnings.append(
            f"link {link.name!r}: its delay of {link.delay_ns / 1e9:g} s is shorter than the "
            f"step of {step:g} s; in other tools it is one step"
        )
    return _VARIABLES.transport_spec(name, link, signals, step), warnings


def _refuse(link: Link) -> None:
    where = f"link {link.name!r}"
    if link.delay is not None:
        raise InputError(
            "a link FMU has a constant delay",
            where=where,
            expected="delay as a number",
            got=type(link.delay).__name__,
            hint="export it as an annotation: --links annotate",
        )
    if not isinstance(link, PacketLink):
        return
    if link.recording is not None:
        raise InputError(
            "a link FMU cannot replay a recording",
            where=where,
            expected="delay, jitter and loss as numbers",
            got=repr(link.recording),
            hint="export what cosim link fit makes of it, or an annotation: --links annotate",
        )
    if link.hop is not None:
        raise InputError(
            "a link FMU has a channel of its own, and this link shares a medium with others",
            where=where,
            expected="a link without a medium",
            got=f"medium {link.hop.medium.name!r}",
            hint="export it as an annotation: --links annotate",
        )
    if link.seed > _VARIABLES.MOST_INTEGER:
        raise InputError(
            "the seed is too large for an Integer of FMI",
            where=where,
            expected=f"at most {_VARIABLES.MOST_INTEGER}",
            got=str(link.seed),
        )
    if "\0" in link.name:
        raise InputError("a name in C has no null character", where=where, got=repr(link.name))


def _late(link: PacketLink) -> list[str]:
    if link.delay_ns + link.frame_ns > 0:
        return []
    warning = "messages without delay arrive one step late in other tools: a link FMU has no direct"
    return [f"link {link.name!r}: {warning} feedthrough"]


def _unknown(link: PacketLink) -> list[str]:
    """Warn of fields of the link that its FMU does not have."""
    known = {"name", "delay", *(key.field for key in keys_of(PacketLink).values())}
    return [
        f"link {link.name!r}: its {field.name} are not in the link FMU"
        for field in fields(link)
        if field.name not in known and getattr(link, field.name) != field.default
    ]
