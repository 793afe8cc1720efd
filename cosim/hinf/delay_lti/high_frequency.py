"""What a response can be at high frequency: a bound of its direct part, and of the rest.

    G = D + Dw E F Dv + R,  F = (I - Dvw E)^-1
    |R(s)| <= |[C, Dw E F Cv]| |[B, Bw E F Dv]| / (|s| - a),  a = |A| + |Bw E F Cv|,  Re s >= 0

E = diag(e^{-s tau}) has entries of modulus one at most, so that the entries of F are at most those
of (I - |Dvw|)^-1 where the spectral radius of |Dvw| is below one; states are in balanced units.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from cosim.hinf.delay_lti.blocks import Blocks, Reals


class HighFrequency:
    """Bounds of |G(s)| for Re s >= 0 and |s| > a; `blocks` in balanced units."""

    def __init__(self, blocks: Blocks) -> None:
        self.blocks = blocks

    @cached_property
    def through_delays(self) -> Reals | None:
        """(I - |Dvw|)^-1, a bound of the entries of F; None where there is none."""
        Dvw = np.abs(self.blocks.Dvw)
        if np.abs(np.linalg.eigvals(Dvw)).max(initial=0.0) >= 1.0 - 1e-9:
            return None
        return np.asarray(np.linalg.inv(np.eye(len(Dvw)) - Dvw), dtype=np.float64)

    @cached_property
    def direct(self) -> float:
        """A bound of |D + Dw E F Dv|: |G| at infinite frequency; infinite without `through_delays`.

        Attained by a constant D, and by one delay or none in every path.
        """
        s, F = self.blocks, self.through_delays
        if not s.D.size:
            return 0.0
        if not s.Dw.any() or not s.Dv.any():
            return float(np.linalg.norm(s.D, 2))
        if F is None:
            return math.inf
        return float(np.linalg.norm(np.abs(s.D) + np.abs(s.Dw) @ F @ np.abs(s.Dv), 2))

    @cached_property
    def a(self) -> float:
        """Above this frequency the states follow no more."""
        return self._sizes[0]

    @cached_property
    def through(self) -> float:
        """A bound of |R| (|s| - a)."""
        return self._sizes[1]

    def beyond(self, w: float) -> float:
        """Return a bound of |G(s)| for Re s >= 0, |s| >= w, w > a."""
        return self.direct + self.through / (w - self.a) if self.through else self.direct

    @cached_property
    def _sizes(self) -> tuple[float, float]:
        s, F = self.blocks, self.through_delays
        if F is None:
            return math.inf, math.inf
        late_in = np.abs(s.Bw) @ F

        def size(M: Reals) -> float:
            return float(np.linalg.norm(M, 2)) if M.size else 0.0

        into = size(s.B) + size(late_in @ np.abs(s.Dv))
        out = size(s.C) + size(np.abs(s.Dw) @ F @ np.abs(s.Cv))
        return size(s.A) + size(late_in @ np.abs(s.Cv)), into * out

    def last(self, level: float) -> float:
        """Return a frequency beyond which |G| < level; infinite where there is none."""
        room = level - self.direct
        if not room > 0.0:
            return math.inf
        return self.a + self.through / room
