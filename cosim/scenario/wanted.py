"""Which figures of an outcome are wanted: the others need not be computed."""

from __future__ import annotations

from collections.abc import Iterable

from cosim.scenario.key_paths import split


class Wanted:
    """The figures that are wanted, by their paths in the JSON of an outcome; None: all."""

    def __init__(self, paths: Iterable[str] | None = None) -> None:
        self._all = paths is None
        self._figures = set()
        for path in paths or ():
            first, *more = (str(key) for key in split(path))
            self._all |= first == "metrics" and not more
            self._figures.add(f"metrics.{more[0]}" if first == "metrics" and more else first)

    def has(self, *figures: str) -> bool:
        """Whether any of these is wanted: `metrics.NAME`, or another key of the JSON."""
        return self._all or not self._figures.isdisjoint(figures)


ALL_FIGURES = Wanted()
"""Everything that an outcome contains."""
