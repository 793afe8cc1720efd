"""Figures in what a run says, by dotted path: `links.uplink.max_age_s`, `final.plant.eta.x`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cosim.core import InputError
from cosim.scenario import inside, kind_of, split


def value_at(data: Any, path: str) -> Any:
    """What stands at a path into figures; keys may hold dots themselves (`final.plant.eta.x`).

    Raises
    ------
    InputError : nothing stands there; says the nearest keys that do.
    """
    here, rest = data, list(split(path))
    while rest:
        if here is None:
            return None
        if isinstance(rest[0], int):
            here = inside(here, rest.pop(0), path)
            continue
        if not isinstance(here, Mapping):
            raise InputError(f"{rest[0]!r} lies in what is no table", where=path, got=kind_of(here))
        # the longest key that fits: values by `component.variable` are one table
        for n in range(len(rest), 0, -1):
            key = _joined(rest[:n])
            if key in here:
                here, rest = here[key], rest[n:]
                break
        else:
            raise InputError.unknown("figure", _joined(rest), here, where=path)
    return here


def _joined(keys: list[str | int]) -> str:
    joined = "".join(f"[{k}]" if isinstance(k, int) else f".{k}" for k in keys)
    return joined.removeprefix(".")
