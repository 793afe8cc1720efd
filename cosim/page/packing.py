"""Pack numbers and texts for plotly.js.

Numbers are little-endian in base64, in four bytes where no difference can be seen.
"""

from __future__ import annotations

import base64

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]
LARGEST = 1e150
"""Greater values overflow the arithmetic of a drawing; they are drawn at this one."""


def plain(text: str) -> str:
    """Escape text so that plotly finds no tags and no placeholders in it."""
    return text.replace("&", "&amp;").replace("<", "&lt;").replace("%{", "% {")


def packed(values: Reals, tolerance: float) -> dict[str, str]:
    """Pack values for plotly, in four bytes each if no error exceeds the tolerance, else eight."""
    drawn = np.clip(values, -LARGEST, LARGEST)
    with np.errstate(over="ignore", invalid="ignore"):
        short = drawn.astype("<f4")
        wrong = np.abs(short.astype(np.float64) - drawn)
    close = not np.nanmax(wrong, initial=0.0) > tolerance
    data, kind = (short, "f4") if close else (drawn.astype("<f8"), "f8")
    return {"dtype": kind, "bdata": base64.b64encode(data.tobytes()).decode("ascii")}


def packed_times(t: Reals) -> dict[str, str]:
    """Pack times, exact to a thousandth of their least distance."""
    steps = np.diff(t)
    steps = steps[steps > 0]
    return packed(t, float(steps.min()) * 1e-3 if steps.size else 0.0)


def packed_values(values: Reals) -> dict[str, str]:
    """Pack values, exact to a hundred-thousandth of their span."""
    finite = values[np.isfinite(values)]
    return packed(values, float(np.ptp(finite / 2)) * 2e-5 if finite.size else 0.0)
