"""Locate parts of a scenario in its files, for messages.

A scenario may be merged from several files and from settings of the command line; a key is
located in the last layer that contains it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import NamedTuple

from cosim.core import InputError
from cosim.scenario.locate import place_of

Path = tuple[str | int, ...]


class Layer(NamedTuple):
    """A file with its text, or a setting with the `path` that it sets."""

    where: str
    text: str
    path: Path | None = None


class Copied(NamedTuple):
    """Where in the file a copy is written, and which copy it is, in words."""

    path: Path
    label: str


def key(path: Sequence[str | int]) -> str:
    """Format a path: `links.up.delay`, `connections[0].to`."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path)[1:]


@dataclass(frozen=True)
class Origin:
    """The layers of a scenario, the base first.

    copies : by the path of a part of the scenario that was written once for several.
    """

    layers: tuple[Layer, ...] = ()
    copies: Mapping[Path, Copied] = field(default_factory=dict)

    def place(self, path: Sequence[str | int]) -> str | None:
        """Return file and line of a key, or the setting that it comes from; None if unknown.

        For a missing key, the place of the table that should contain it.
        """
        path = tuple(path)
        depth, own = self._deepest(path)
        for most in range(len(path), 0, -1) if self.copies and depth < len(path) else ():
            copied = self.copies.get(path[:most])
            if copied is not None:
                _, words = self._deepest((*copied.path, *path[most:]))
                return own if words is None else words + copied.label
        return own or (self.layers[-1].where if self.layers else None)

    def _deepest(self, path: Path) -> tuple[int, str | None]:
        """Return how much of a path stands in the layers, and where."""
        best: tuple[int, str] | None = None
        for layer in self.layers:
            depth, words = _found(layer, path)
            if words is not None and (best is None or depth >= best[0]):
                best = depth, words
        return best or (0, None)


def _found(layer: Layer, path: Sequence[str | int]) -> tuple[int, str | None]:
    if layer.path is not None:
        depth = min(len(layer.path), len(path))
        inside = tuple(path[:depth]) == layer.path[:depth]
        return (len(path), layer.where) if inside and len(path) >= len(layer.path) else (0, None)
    found = place_of(layer.text, path)
    return (found.depth, f"{layer.where}:{found.line}") if found else (0, None)


NOWHERE = Origin()


class _PlacedError(InputError):
    """An error with the place in the scenario."""


@dataclass
class Findings:
    """Raises the first error, or collects all of them; adds where in the scenario they are.

    Parameters
    ----------
    origin : locates the parts of the scenario.
    collect : go on after an error; what depends on the faulty part is skipped.
    """

    origin: Origin = NOWHERE
    collect: bool = False
    errors: list[InputError] = field(default_factory=list)

    @contextmanager
    def at(self, *path: str | int) -> Iterator[None]:
        """Locate errors raised inside at this path of the scenario; one located already stays."""
        try:
            yield
        except InputError as error:
            placed = error if isinstance(error, _PlacedError) else self.placed(error, path)
            if not self.collect:
                raise placed from error
            self.errors.append(placed)

    def placed(self, error: InputError, path: Sequence[str | int]) -> InputError:
        """Return the error with file, line and key in front; of a key below `path`, its line."""
        below = (error.where or "").removeprefix(f"{key(path)}.").partition(":")[0]
        if error.where and error.where.startswith(f"{key(path)}.{below}"):
            path = (*path, *below.split("."))
        place = self.origin.place(path)
        if place is None:
            return error
        words = key(path)
        inner = error.where if error.where and error.where != words else None
        location = inner if inner and inner.startswith(words) else words
        if inner and inner != location:
            location = f"{location}: {inner}"
        return _PlacedError(
            error.what,
            where=f"{place}: {location}",
            expected=error.expected,
            got=error.got,
            hint=error.hint,
        )
