"""Numbers as plotly takes them: little-endian in base64, four bytes where the eye needs no more."""

from __future__ import annotations

import base64

import numpy as np
from numpy.typing import NDArray

LARGEST = 1e150
"""Beyond it the arithmetic of a drawing overflows; such values are drawn there."""


def packed(values: NDArray[np.float64], tolerance: float) -> dict[str, str]:
    """A typed array for plotly.

    tolerance : largest error that four bytes may make; if they make more, eight are taken.
    """
    drawn = np.clip(values, -LARGEST, LARGEST)
    with np.errstate(over="ignore", invalid="ignore"):
        short = drawn.astype("<f4")
        wrong = np.abs(short.astype(np.float64) - drawn)
    close = not np.nanmax(wrong, initial=0.0) > tolerance
    data, kind = (short, "f4") if close else (drawn.astype("<f8"), "f8")
    return {"dtype": kind, "bdata": base64.b64encode(data.tobytes()).decode("ascii")}


def packed_times(t: NDArray[np.float64]) -> dict[str, str]:
    """Times: exact to a thousandth of their least distance."""
    steps = np.diff(t)
    steps = steps[steps > 0]
    return packed(t, float(steps.min()) * 1e-3 if steps.size else 0.0)


def packed_values(values: NDArray[np.float64]) -> dict[str, str]:
    """Values: exact to a hundred-thousandth of their span."""
    finite = values[np.isfinite(values)]
    return packed(values, float(np.ptp(finite / 2)) * 2e-5 if finite.size else 0.0)
