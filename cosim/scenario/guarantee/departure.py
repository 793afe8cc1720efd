"""One way in which a run is not what a proof is about: by place, with what was expected and got."""

from __future__ import annotations

from typing import Any, NamedTuple


class Departure(NamedTuple):
    """Why an assumption is not met.

    Attributes
    ----------
    place : a variable, a link, or a part of the loop.
    expected, got : in words.
    at_s : when it was first so [s]; None where it is so from the start to the end.
    """

    place: str
    expected: str
    got: str
    at_s: float | None = None

    def to_json(self) -> dict[str, Any]:
        """Return JSON values."""
        return {key: value for key, value in self._asdict().items() if value is not None}
