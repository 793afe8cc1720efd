"""Which entries of a certificate decide nothing: notes, names, what another program reads.

A file may hold more than its proof: figures of the nominal loop, names of systems, how the states
of a controller are made. A check says which of them it passed by, so that nobody takes them for
proved.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

_LOOP = ("kind", "claim", "theorem", "system", "variables", "K", "guarantees")
_READ: dict[Any, tuple[str, ...]] = {
    None: tuple(key for key in _LOOP if key != "kind"),
    "analysis": _LOOP,
    "ages": _LOOP,
    "norm": ("kind", "claim", "theorem", "system", "K", "gamma", "end", "steps"),
    "refutation": ("kind", "claim", "theorem", "system", "at", "multipliers"),
    "gamma floor": ("kind", "claim", "theorem", "system", "gamma", "w"),
    "output-feedback": (
        *("kind", "claim", "theorem", "plant", "measurements", "estimated"),
        *("command_age", "command_any_age", "K", "L", "pair"),
    ),
}
"""The keys of each kind that a proof is about; the checkers refuse unknown keys below these."""

_LABELS = ("name", "integrals")  # of a system: what it is called, who keeps its last states
_WAYS = ("over",)  # of a measurement


def not_read(data: dict[str, Any]) -> tuple[str, ...]:
    """Return the keys of a certificate on which its check does not depend, as `system.name`."""
    return tuple(_not_read(data))


def _not_read(data: dict[str, Any]) -> Iterator[str]:
    yield from (key for key in data if key not in _READ[data.get("kind")])
    for own in ("system", "plant"):
        yield from (f"{own}.{key}" for key in _LABELS if key in data.get(own, ()))
    for i, measurement in enumerate(data.get("measurements", ())):
        yield from (f"measurements[{i}].{key}" for key in _WAYS if key in measurement)
    if "pair" in data:
        yield from (f"pair.{key}" for key in _not_read(data["pair"]))
