"""Make link FMUs of links, and say which links cannot be one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

from cosim.core import InputError
from cosim.fmu.export import ComponentSpec, component_module
from cosim.master import Link
from cosim.network import PacketLink, keys_of

_VARIABLES = component_module("link_channel.variables")


def link_spec(
    name: str, link: Link, signals: Sequence[Any], step_ns: int
) -> tuple[ComponentSpec, list[str]]:
    """Specify the link FMU `name` of a link that can be one; return it with warnings.

    Raises
    ------
    InputError : a name that C cannot have.
    """
    if "\0" in link.name:
        where = f"link {link.name!r}"
        raise InputError("a name in C has no null character", where=where, got=repr(link.name))
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


def no_link_fmu(link: Link) -> str | None:
    """Return what of a link its FMU could not do, in words; None: it does all."""
    if link.delay is not None:
        return "its delay varies"
    if not isinstance(link, PacketLink):
        return None
    if link.recording is not None:
        return "it replays a recording; cosim link fit makes numbers of one"
    if link.hop is not None:
        return f"it shares the medium {link.hop.medium.name!r} with others"
    if link.seed > _VARIABLES.MOST_INTEGER:
        return f"its seed is above {_VARIABLES.MOST_INTEGER}, the greatest Integer of FMI"
    return None


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
