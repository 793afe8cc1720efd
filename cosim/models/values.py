"""Values: records that cannot change after they are made, and are equal where their content is.

A frozen dataclass keeps its fields, but an array in a field could still be written, and
`setflags(write=True)` takes back numpy's own protection. The arrays of a value lie in `bytes`,
which nothing makes writable.
"""

from __future__ import annotations

from dataclasses import fields
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """Return a copy, row by row, that can never be written; no copy of one that already is."""
    flags = array.flags  # an array that was unpickled lies in bytes, and can be written
    if isinstance(array.base, bytes) and flags.c_contiguous and not flags.writeable:
        return array
    return np.ndarray(array.shape, array.dtype, buffer=array.tobytes())


def frozen(value: Any) -> Any:
    """Return a field of a value: arrays read-only, lists as tuples, what they contain likewise."""
    if isinstance(value, np.ndarray):
        return read_only(value)
    if type(value) in (list, tuple):
        return tuple(map(frozen, value))
    return value


class Value:
    """Base of a frozen dataclass (`eq=False`) with arrays: equal and hashed by content.

    Copies are the object itself, and what is unpickled is as read-only as what was pickled.
    """

    def __post_init__(self) -> None:
        for field in fields(self):  # type: ignore[arg-type]  # of every dataclass below this
            object.__setattr__(self, field.name, frozen(getattr(self, field.name)))

    def content(self) -> tuple[Any, ...]:
        """Return what makes two of them equal, hashable: every field, arrays as numbers."""
        return tuple(_comparable(getattr(self, field.name)) for field in fields(self))  # type: ignore[arg-type]

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        return type(self) is type(other) and self.content() == other.content()

    def __hash__(self) -> int:
        return hash(self.content())

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, _memo: dict[int, Any]) -> Self:
        return self

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields alone: what was computed of them is computed again where needed."""
        return {field.name: getattr(self, field.name) for field in fields(self)}  # type: ignore[arg-type]

    def __setstate__(self, state: dict[str, Any]) -> None:
        for name, value in state.items():
            object.__setattr__(self, name, frozen(value))


def _comparable(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        # adding zero makes -0.0 the 0.0 that it equals
        return (value.shape, (value + 0).tobytes())
    if isinstance(value, tuple) and type(value) is tuple:
        return tuple(map(_comparable, value))
    return value
