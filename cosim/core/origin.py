"""Locate the keys of files, for messages.

A scenario may be merged from several files and from settings of the command line; a key is
located in the last layer that contains it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import NamedTuple

from cosim.core.errors import InputError
from cosim.core.locate import place_of

KeyPath = tuple[str | int, ...]
"""The keys that lead to a value; a number is a place in a list."""


class Layer(NamedTuple):
    """A file with its text, or a setting with the `path` that it sets."""

    where: str
    text: str
    path: KeyPath | None = None


class Copied(NamedTuple):
    """Where in the file a copy is written, and which copy it is, in words."""

    path: KeyPath
    label: str


def dotted(path: Sequence[str | int]) -> str:
    """Format a path: `links.up.delay`, `connections[0].to`."""
    return "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in path).removeprefix(".")


@dataclass(frozen=True)
class Origin:
    """The layers of a file, the base first.

    copies : by the path of a part that was written once for several.
    """

    layers: tuple[Layer, ...] = ()
    copies: Mapping[KeyPath, Copied] = field(default_factory=dict)

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

    def located(self, path: Sequence[str | int], inner: str) -> str | None:
        """Return file, line and key of a part of a value, or of a key that `inner` names."""
        words = dotted(path)
        below = inner.removeprefix(f"{words}.").partition(":")[0]
        if words and inner.startswith(f"{words}.{below}"):
            path = (*path, *below.split("."))
        if inner and not inner.startswith(words):
            inner = words + inner if inner.startswith("[") else f"{words}: {inner}"
        place = self.place(path)
        return place and ": ".join(filter(None, (place, inner or words)))

    def _deepest(self, path: KeyPath) -> tuple[int, str | None]:
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
"""Of what is in no file: nothing is located."""


class PlacedError(InputError):
    """An error with its place in the file."""


@dataclass(frozen=True)
class Values(Origin):
    """Values that are in no file, such as JSON: a key is located by its name below `name`."""

    name: str = ""

    def place(self, path: Sequence[str | int]) -> str:
        """Return the key, as in `system.delays[0].d`."""
        return dotted((self.name, *path) if self.name else path)

    def located(self, path: Sequence[str | int], inner: str) -> str:
        """Return the key and the part of its value."""
        return self.place(path) + (
            inner if inner.startswith("[") else f": {inner}" if inner else ""
        )


def placed(error: InputError, path: Sequence[str | int], origin: Origin) -> InputError:
    """Return the error with file, line and key in front; of a key below `path`, its line.

    error : its `where` is None, a key, or a part of the value: `[0][1]`, `column 3`.
    """
    where = origin.located(path, error.where or "")
    if where is None:
        return error
    return PlacedError(
        error.what, where=where, expected=error.expected, got=error.got, hint=error.hint
    )


@dataclass
class Findings:
    """Raises the first error, or collects all of them; adds where in the file they are.

    Parameters
    ----------
    origin : locates the keys of the file.
    collect : go on after an error; what depends on the faulty part is skipped.
    """

    origin: Origin = NOWHERE
    collect: bool = False
    errors: list[InputError] = field(default_factory=list)

    @contextmanager
    def at(self, *path: str | int) -> Iterator[None]:
        """Locate errors raised inside at this path of the file; one located already stays."""
        try:
            yield
        except InputError as error:
            found = error if isinstance(error, PlacedError) else placed(error, path, self.origin)
            if not self.collect:
                raise found from error
            self.errors.append(found)
