"""Where in which file something stands, for messages that point at it.

A scenario may be put together from several files and from settings of the command line; the
last layer that speaks of a key is where it stands.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import NamedTuple

from cosim.core import InputError
from cosim.scenario.locate import place_of

Path = tuple[str | int, ...]


class Layer(NamedTuple):
    """One file with its text, or one setting: then `path` is what it sets."""

    where: str
    text: str
    path: Path | None = None


def key(path: Sequence[str | int]) -> str:
    """A path as people write it: `links.up.delay`, `connections[0].to`."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path)[1:]


@dataclass(frozen=True)
class Origin:
    """The layers of a scenario, from the base to the last word."""

    layers: tuple[Layer, ...] = ()

    def place(self, path: Sequence[str | int]) -> str | None:
        """File and line of a key, or the setting that it comes from; None where nothing is known.

        Of a key that is nowhere, the place of what it would stand in.
        """
        best: tuple[int, str] | None = None
        for layer in self.layers:
            depth, words = _found(layer, path)
            if words is not None and (best is None or depth >= best[0]):
                best = depth, words
        return best[1] if best else (self.layers[-1].where if self.layers else None)


def _found(layer: Layer, path: Sequence[str | int]) -> tuple[int, str | None]:
    if layer.path is not None:
        depth = min(len(layer.path), len(path))
        inside = tuple(path[:depth]) == layer.path[:depth]
        return (len(path), layer.where) if inside and len(path) >= len(layer.path) else (0, None)
    found = place_of(layer.text, path)
    return (found.depth, f"{layer.where}:{found.line}") if found else (0, None)


NOWHERE = Origin()


@dataclass
class Findings:
    """Raises the first fault, or, where all are wanted, collects them.

    Parameters
    ----------
    origin : where the parts of the scenario stand.
    collect : go on after a fault; what depends on the faulty part is passed over.
    """

    origin: Origin = NOWHERE
    collect: bool = False
    errors: list[InputError] = field(default_factory=list)

    @contextmanager
    def at(self, *path: str | int) -> Iterator[None]:
        """What is refused inside is about the part of the scenario at this path."""
        try:
            yield
        except InputError as error:
            placed = self.placed(error, path)
            if not self.collect:
                raise placed from error
            self.errors.append(placed)

    def placed(self, error: InputError, path: Sequence[str | int]) -> InputError:
        """The same error with file, line and key in front."""
        place = self.origin.place(path)
        if place is None:
            return error
        words = key(path)
        inner = error.where if error.where and error.where != words else None
        location = inner if inner and inner.startswith(words) else words
        if inner and inner != location:
            location = f"{location}: {inner}"
        return InputError(
            error.what,
            where=f"{place}: {location}",
            expected=error.expected,
            got=error.got,
            hint=error.hint,
        )
