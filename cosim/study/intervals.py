"""Confidence intervals of many shares or means at once: those of `summary`, for arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit

Reals = NDArray[np.float64]


def wilson(share: Reals, of: Reals, confidence: float) -> tuple[Reals, Reals]:
    """Return Wilson's interval of each share out of `of` > 0."""
    z = ndtri(0.5 + 0.5 * confidence)
    centre = (share + z * z / (2.0 * of)) / (1.0 + z * z / of)
    spread = np.sqrt(share * (1.0 - share) / of + z * z / (4.0 * of * of))
    half = z * spread / (1.0 + z * z / of)
    return np.maximum(centre - half, 0.0), np.minimum(centre + half, 1.0)


def student(mean: Reals, variance: Reals, of: Reals, confidence: float) -> tuple[Reals, Reals]:
    """Return Student's interval of each mean of `of` values; NaN for fewer than two.

    variance : of the values, with of - 1 in the denominator.
    """
    several = of > 1
    half = np.full(mean.shape, np.nan)
    t = stdtrit(np.where(several, of - 1.0, 1.0), 0.5 + 0.5 * confidence)
    np.sqrt(variance / of, where=several, out=half)
    half *= t
    return mean - half, mean + half
