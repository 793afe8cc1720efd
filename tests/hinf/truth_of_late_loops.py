"""Closed forms of L = k e^{-s tau} / (s + a) and of its unit feedback, in forty digits.

T = L / (1 + L) = sum_j (-1)^(j+1) k^j e^{-j s tau} / (s + a)^j, so that each term of the step
response is a regularised incomplete gamma function; only finitely many have begun at any time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import mpmath
import numpy as np
from numpy.typing import NDArray

_DIGITS = 40


@dataclass(frozen=True)
class LateLoop:
    """L = k e^{-s tau} / (s + a), k > a >= 0."""

    k: float
    a: float
    tau: float

    def step(self, times: Any) -> NDArray[np.float64]:
        """The step response of T."""
        with mpmath.workdps(_DIGITS):
            return np.array([float(self._step(float(t))) for t in times])

    def _step(self, t: float) -> Any:
        k, a, tau = (mpmath.mpf(x) for x in (self.k, self.a, self.tau))
        total, j = mpmath.mpf(0), 1
        while (x := mpmath.mpf(t) - j * tau) > 0:
            if a:
                term = (k / a) ** j * mpmath.gammainc(j, 0, a * x, regularized=True)
            else:
                term = (k * x) ** j / mpmath.factorial(j)
            total, j = total - (-1) ** j * term, j + 1
        return total

    def closed_response(self, omega: Any) -> NDArray[np.complex128]:
        """T(j omega)."""
        with mpmath.workdps(_DIGITS):
            return np.array([complex(self._closed(mpmath.mpf(float(w)))) for w in omega])

    def _closed(self, w: Any) -> Any:
        late = self.k * mpmath.exp(-1j * w * mpmath.mpf(self.tau))
        return late / (1j * w + mpmath.mpf(self.a) + late)

    def crossing(self) -> Any:
        """The frequency with |L| = 1."""
        return mpmath.sqrt(mpmath.mpf(self.k) ** 2 - mpmath.mpf(self.a) ** 2)

    def phase_margin(self) -> float:
        """[rad]."""
        with mpmath.workdps(_DIGITS):
            w = self.crossing()
            lag = w * mpmath.mpf(self.tau) + mpmath.atan2(w, mpmath.mpf(self.a))
            return float(mpmath.pi - lag)

    def delay_margin(self) -> float:
        """The further delay [s] that ends stability."""
        with mpmath.workdps(_DIGITS):
            w = self.crossing()
            lag = w * mpmath.mpf(self.tau) + mpmath.atan2(w, mpmath.mpf(self.a))
            return float((mpmath.pi - lag) / w)

    def norm(self) -> float:
        """The greatest |T(j omega)|."""
        omega = np.linspace(0.0, 20.0 / self.tau, 20001)[1:]
        late = self.k * np.exp(-1j * omega * self.tau)
        gains = np.abs(late / (1j * omega + self.a + late))
        with mpmath.workdps(_DIGITS):
            at_rest = mpmath.mpf(self.k) / (mpmath.mpf(self.k) + mpmath.mpf(self.a))
            peak = omega[int(np.argmax(gains))]
            if gains.max() <= float(at_rest):
                return float(at_rest)
            top = mpmath.findroot(
                lambda w: mpmath.diff(lambda x: abs(self._closed(x)) ** 2, w), mpmath.mpf(peak)
            )
            return float(abs(self._closed(top)))

    def ultimate_gain(self) -> float:
        """The factor by which L may grow: 1 / |L| where its phase is -pi."""
        with mpmath.workdps(_DIGITS):
            a, tau = mpmath.mpf(self.a), mpmath.mpf(self.tau)
            start = math.pi / 2 / self.tau if not self.a else 2.0 / self.tau
            w = mpmath.findroot(lambda w: w * tau + mpmath.atan2(w, a) - mpmath.pi, start)
            return float(mpmath.sqrt(w**2 + a**2) / mpmath.mpf(self.k))
