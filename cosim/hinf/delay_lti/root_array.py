"""Characteristic roots as an array that draws itself."""

from __future__ import annotations

from typing import Any, Self

import numpy as np


class CharacteristicRoots(np.ndarray[tuple[int], np.dtype[np.complex128]]):
    """Rightmost characteristic roots [1/s], an array of complex numbers with `plot`."""

    def __new__(cls, roots: Any) -> Self:
        """Return the roots as such an array."""
        return np.asarray(roots, dtype=np.complex128).view(cls)

    def plot(self, ax: Any = None) -> Any:
        """Draw them in the complex plane; return matplotlib's axes.

        Raises
        ------
        InputError : matplotlib is not installed.
        """
        from cosim.hinf.delay_lti.pictures import draw_roots  # noqa: PLC0415 - matplotlib

        return draw_roots(np.asarray(self), ax)
