"""A signal by name with its values, and signals on a common time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Integers = NDArray[np.int64]

Align = str | float | NDArray[np.float64]
"""A common time base: "union", a topic, a period [s], or instants [s]."""

Between = Literal["hold", "interpolate"]
"""Values between rows: the last one, or on a line where the signal's own `hold` is continuous."""

Index = Literal["seconds", "timedelta"]
"""The time of a data frame: seconds as doubles, or exact nanoseconds."""


@dataclass(frozen=True, slots=True)
class Column:
    """A signal by name: values, and where they are present; elsewhere they mean nothing."""

    name: str
    unit: str | None
    description: str | None
    values: NDArray[Any]
    present: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Joined:
    """Columns on a common time.

    Attributes
    ----------
    where : the trace or topic they are of.
    time_ns : instants [ns], (m,).
    """

    where: str
    time_ns: Integers
    columns: Sequence[Column]
