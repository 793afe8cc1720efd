"""Certificates changed entry by entry, to see that every entry counts."""

from __future__ import annotations

import copy
from collections.abc import Callable, Container, Iterator
from typing import Any

from cosim.core import InputError
from cosim.hinf import check_certificate


def leaves(
    data: Any, path: tuple[Any, ...] = (), without: Container[str] = ()
) -> Iterator[tuple[Any, ...]]:
    """The path of every number, flag or word, but for what stands under the keys `without`."""
    for key, value in data.items() if isinstance(data, dict) else enumerate(data):
        if key in without:
            continue
        if isinstance(value, dict | list):
            yield from leaves(value, (*path, key), without)
        else:
            yield (*path, key)


def changed(data: Any, path: tuple[Any, ...], change: Callable[[Any], Any]) -> Any:
    """A copy with one entry changed."""
    result = copy.deepcopy(data)
    place = result
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = change(place[path[-1]])
    return result


def refused(data: Any) -> bool:
    """Whether the prover refuses it: not proved, or no certificate at all."""
    try:
        return not check_certificate(data).valid
    except InputError:
        return True
