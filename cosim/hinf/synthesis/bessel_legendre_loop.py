"""One step of a design of order N, in floating point: a gain, its multipliers, the next gain."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from cosim.hinf.lmi import AnalysisLmi, BesselLegendreLmi, multipliers_of, scalar_multipliers
from cosim.hinf.synthesis.greatest_delays import with_delays
from cosim.hinf.synthesis.synthesis import GAIN_DIGITS
from cosim.models import DelaySystem

Gain = NDArray[np.float64]

SCALES = (0.02, 0.1, 0.5, 2.0)
"""Scalar multipliers to start from, in units of the longest delay."""

_SMALLEST_STEP = 1e-3
_TRIES = 40  # near its end a continuation creeps


class Loop:
    """Design and analysis of gains for one system at one order, in floating point."""

    def __init__(self, system: DelaySystem, order: int, gamma: float | None) -> None:
        self.system, self.order, self.gamma = system, order, gamma
        self._delays = [delay.d for delay in system.delays]

    def at(self, delays: Sequence[float]) -> Loop:
        """Return the same for other delays [s]."""
        return Loop(with_delays(self.system, delays), self.order, self.gamma)

    def is_feasible(self, K: Gain) -> bool:
        """Whether the solver finds the analysis LMI of K feasible."""
        found = self._analysis(K).margin(self._delays, self.gamma)
        return found is not None and found[0] > 0

    def improved_gain(self, K: Gain, at: Loop | None = None) -> tuple[float, Gain] | None:
        """Return (margin, gain) for the delays of `at`, designed with the multipliers of K here."""
        found = self._analysis(K).margin(self._delays, self.gamma)
        if found is None:
            return None
        lmi = BesselLegendreLmi((at or self).system, self.order, K, self.gamma)
        return rounded(lmi.central(multipliers_of(found[1], self.system), self.gamma))

    def initial_gains(self) -> list[Gain]:
        """Return the gains found with scalar multipliers."""
        gains = []
        for scale in SCALES:
            multipliers = scalar_multipliers(scale * max(self._delays), self.system, self.order)
            lmi = BesselLegendreLmi(
                self.system, self.order, np.zeros(self.system.B.T.shape), self.gamma
            )
            found = rounded(lmi.central(multipliers, self.gamma))
            if found is not None and found[0] > 0:
                gains.append(found[1])
        return gains

    def _analysis(self, K: Gain) -> AnalysisLmi:
        return AnalysisLmi(self.system, K, self.order, performance=self.gamma is not None)


def continue_gain(
    loop_at: Callable[[float], Loop], K: Gain, start: float, end: float
) -> list[tuple[float, Gain]]:
    """Follow a gain from the parameter value `start` towards `end`: (value, gain) per step.

    `loop_at` gives the loop at a value (a delay, a share of all delays); K is feasible at `start`.
    """
    passed, factor, tries = [(start, K)], 2.0, 0
    while passed[-1][0] < end and factor > 1 + _SMALLEST_STEP and tries < _TRIES:
        tries += 1
        at, K = passed[-1]
        there = min(at * factor, end)
        found = loop_at(at).improved_gain(K, loop_at(there))
        if found is not None and found[0] > 0 and loop_at(there).is_feasible(found[1]):
            passed.append((there, found[1]))
            factor = min(factor**1.5, 2.0)
        elif loop_at(there).is_feasible(K):
            passed.append((there, K))
        else:
            factor = float(np.sqrt(factor))
    return passed


def rounded(found: tuple[float, Gain] | None) -> tuple[float, Gain] | None:
    """Round K to `GAIN_DIGITS` significant digits of its largest entry; the rest is noise."""
    if found is None or not found[1].any():
        return found
    K = found[1]
    digits = GAIN_DIGITS - 1 - int(np.floor(np.log10(np.abs(K).max())))
    return found[0], np.round(K, digits) + 0.0
