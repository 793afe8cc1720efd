"""Proof that the nominal loop is stable and that no frequency has a gain above a level.

Symbols as in `cosim.hinf.nominal.norm`; the doubles of the system and of K are taken exactly,
A + B K is formed in rationals, and everything after that is ball arithmetic (`flint.arb`), which
encloses its own rounding. Stability is part of the proof, not an assumption.

A. Intervals. Steps cover [0, W] by intervals [c-h, c+h]. With S = S(jc), L1 = 1 + sum d_i |A_i|,
   L2 = sum d_i^2 |A_i|, M1 = sum d_i |D_i|, M2 = sum d_i^2 |D_i| and rho = h L1 |S| < 1, H is
   regular on the interval, |S(jw)| <= g |S|, |S(jw) C| <= g |S C| and
   |D(jw) S(jw)| <= g (|D S| + h M1 |S|), g = 1/(1-rho), and so (primes: d/dw)

       |G''| <= b = g|SC| (M2 + 2 M1 g|S| L1 + dr (2 L1^2 g|S| + L2)),  dr = g (|DS| + h M1|S|).

   G(jc) + (w-c) G'(jc) is affine in w and the norm convex, so
   |G(jw)| <= max |G(jc) +- h G'(jc)| + h^2 b / 2 on the interval.
B. Beyond W > a = sum |A_i|. |S| <= 1/(w-a) and S = (I + S A)/(jw) give, P_i = D1'D_i C,

       G*G <= D1'D1 + (|P_0 - P_0'| + 2 sum_{i>0} |P_i|)/w + 2 |D1| sum|D_i| sum|A_i C|/(w(w-a))
              + (sum|D_i| |C|/(w-a))^2,

   whose terms fall with w: once, at w = W, is enough.
C. Stability. On each interval det H(jw)/det H(jc) = det(I + E) with |E| <= rho (Frobenius), so
   that its phase, the sum of those of n eigenvalues, stays below sqrt(n) asin(rho), asin(x)/x
   being increasing. This is kept below pi/2: from centre to centre the phase of det H turns by
   less than pi, and the principal argument of the quotient is the whole turn, none missed. At
   R = W and on the arc |s| = R, Re s >= 0, det H(s) = s^n det(I - A(s)/s) has the phase n arg s
   to less than sqrt(n) asin(sum|A_i|/R) < pi. The argument principle then counts the roots with
   Re s >= 0 within R, and beyond R there are none: the count is an integer, proved below 1/2.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import flint
import numpy as np
from numpy.typing import ArrayLike

from cosim.core import InputError
from cosim.hinf.certificate import balls, below, exact_matrix, exact_terms, floats, size
from cosim.hinf.nominal.closed_loop import checked_matrix
from cosim.models import DelaySystem

_BITS = 128
_MOST_STEPS = 1000
_FARTHEST = 1e9  # W, against the sum of the rates


def norm_proved(system: DelaySystem, K: ArrayLike, level: float) -> bool:
    """Prove that the loop is stable and |G(jw)| < level for every real w.

    Parameters
    ----------
    system : Eq. (7), with w and z; its E, H are ignored. All delays are constants.
    K : (m, n) state feedback, its doubles taken exactly.
    level : the bound.

    Returns
    -------
    True if it is proved. False decides nothing: the bound may be wrong, the loop unstable, or
    too many intervals necessary.

    Raises
    ------
    InputError : no w or no z, K that does not fit, or a level that is no positive number.
    """
    n, m = system.B.shape
    gain = checked_matrix("K", K, m, n)
    if not system.has_performance:
        raise InputError("this system has no gain to bound", where="system", expected="C and D")
    if not (math.isfinite(level) and level > 0.0):
        raise InputError("not a level", where="level", expected="a number > 0", got=repr(level))
    with flint.ctx.workprec(_BITS):
        return _Proof(system, gain, level).holds()


class _Proof:
    """One attempt: the loop and its constants in balls."""

    def __init__(self, system: DelaySystem, K: Any, level: float) -> None:
        terms = exact_terms(system, K)
        self.level = flint.arb(level)
        self.n = system.A.shape[0]
        self.C, self.D1 = balls(exact_matrix(system.C)), balls(exact_matrix(system.D1))
        self.delays = [flint.arb(d) for d in terms]
        self.A = [balls(A) for A, _ in terms.values()]
        self.D = [balls(D) for _, D in terms.values()]
        self.eye = flint.acb_mat([[int(i == j) for j in range(self.n)] for i in range(self.n)])
        a, b = [size(A) for A in self.A], [size(D) for D in self.D]
        zero = flint.arb(0)
        self.L1 = 1 + sum((d * x for d, x in zip(self.delays, a, strict=True)), zero)
        self.L2 = sum((d * d * x for d, x in zip(self.delays, a, strict=True)), zero)
        self.M1 = sum((d * x for d, x in zip(self.delays, b, strict=True)), zero)
        self.M2 = sum((d * d * x for d, x in zip(self.delays, b, strict=True)), zero)
        self.a, self.through = sum(a, zero), sum(b, zero) * size(self.C)
        self.second = size(self.D1) * sum(b, zero) * sum((size(A * self.C) for A in self.A), zero)
        P = [self.D1.transpose() * D * self.C for D in self.D]
        self.first = size(P[0] - P[0].transpose()) + 2 * sum(map(size, P[1:]), zero)
        # largest rho with sqrt(n) asin(rho) < pi/2; for n = 1 that is 1
        self.longest = (flint.arb.pi() / (2 * flint.arb(self.n).sqrt())).sin() * flint.arb("0.999")

    def holds(self) -> bool:
        """Parts A, B and C."""
        try:
            end = self._end()
            return end is not None and self._swept(end)
        except ZeroDivisionError:  # H is singular at a centre, or as good as
            return False

    def _end(self) -> float | None:
        """Return W: the least of a few frequencies for part B and the phase on the arc; or None."""
        a = float(self.a.upper())
        w = 1.25 * a
        while 0.0 < w < _FARTHEST * a:
            W = flint.arb(w)
            ratio = self.a / W
            arc = ratio < 1 and flint.arb(self.n).sqrt() * ratio.asin() < 3
            if arc and below(self.D1, self.level**2 - self._beyond(W)):
                return w
            w *= 1.25
        return None

    def _beyond(self, W: Any) -> Any:
        """Return the terms that part B adds to D1'D1 at W."""
        rest = W - self.a
        return self.first / W + 2 * self.second / (W * rest) + (self.through / rest) ** 2

    def _swept(self, end: float) -> bool:
        """Parts A and C over [0, end]."""
        point, done, turned = self._at(0.0), 0.0, flint.arb(0)
        last, h = point, 0.0
        for _ in range(_MOST_STEPS):
            h = self._longest_step(point)
            if not flint.arb(point.c) - flint.arb(h) <= done:
                # a gap behind this interval: go nearer, or give up
                nearer = done + 0.9 * h
                if not done < nearer < point.c:
                    return False
                point = self._at(nearer)
                continue
            if not self._covers(point, h):
                return False
            turned += (point.det / last.det).arg()
            last, done = point, math.nextafter(point.c + h, 0.0)
            if done >= end:
                return self._without_roots(turned, last, end)
            point = self._at(done + h)
        return False

    def _without_roots(self, turned: Any, last: _Point, end: float) -> bool:
        """Part C, given the turn from 0 to `last`."""
        R = flint.acb(0, end)
        det = self._H(R)[0].det()
        turned += (det / last.det).arg()
        beyond = (det / R**self.n).arg()
        roots = flint.arb(self.n) / 2 + (beyond - turned) / flint.arb.pi()
        return bool(roots < 0.5)

    def _H(self, s: Any) -> tuple[Any, list[Any]]:
        """Return H(s) and the factors e^{-s d_i}."""
        late = [(-s * d).exp() for d in self.delays]
        H = s * self.eye
        for A, e in zip(self.A, late, strict=True):
            H = H - A * e
        return H, late

    def _at(self, c: float) -> _Point:
        """Return H and G with their derivatives at jc."""
        j = flint.acb(0, 1)
        H, late = self._H(flint.acb(0, c))
        H1, D, D1 = self.eye * j, self.D[0], self.D[0] * 0
        for d, e, A, Di in list(zip(self.delays, late, self.A, self.D, strict=True))[1:]:
            H1 = H1 + A * (j * d * e)
            D, D1 = D + Di * e, D1 - Di * (j * d * e)
        S = H.inv()
        SC, DS = S * self.C, D * S
        G, slope = DS * self.C + self.D1, D1 * SC - DS * (H1 * SC)
        sizes = (size(S), size(SC), size(DS))
        return _Point(c, H.det(), G, slope, sizes, floats(G), floats(slope))

    def _longest_step(self, point: _Point) -> float:
        """Return the longest h that part A allows about a point, in floating point."""
        constants = [float(x) for x in (self.L1, self.L2, self.M1, self.M2)]
        sizes = [float(x) for x in point.sizes]
        level = float(self.level) * (1.0 - 1e-13)
        h = float(self.longest) * (1.0 - 1e-12) / (constants[0] * sizes[0])
        shorter = np.cumprod([h, *([0.75] * 40)])
        ends = np.multiply.outer(shorter[:-1], np.multiply.outer([1.0, -1.0], point.change))
        tops = np.linalg.norm(point.gain + ends, 2, axis=(2, 3)).max(axis=1)  # one call for all
        for step, top in zip(shorter, tops, strict=False):
            if top + 0.5 * step * step * _bend(step, sizes, constants) < level:
                return float(step)
        return float(shorter[-1])

    def _covers(self, point: _Point, h: float) -> bool:
        """Part A on [c-h, c+h], in balls."""
        step = flint.arb(h)
        if not step * self.L1 * point.sizes[0] < self.longest:
            return False
        constants = (self.L1, self.L2, self.M1, self.M2)
        more = step**2 * _bend(step, point.sizes, constants) / 2
        room, change = self.level - more, point.slope * step
        return bool(
            room > 0 and below(point.G + change, room**2) and below(point.G - change, room**2)
        )


class _Point(NamedTuple):
    """H and G about jc.

    det : det H.
    G, slope : G and dG/dw; `gain` and `change` are these as floats.
    sizes : |S|, |S C|, |D S|.
    """

    c: float
    det: Any
    G: Any
    slope: Any
    sizes: tuple[Any, Any, Any]
    gain: Any
    change: Any


def _bend(h: Any, sizes: Sequence[Any], constants: Sequence[Any]) -> Any:
    """Return b of part A, for floats or balls."""
    S, SC, DS = sizes
    L1, L2, M1, M2 = constants
    g = 1 / (1 - h * L1 * S)
    dr = g * (DS + h * M1 * S)
    return g * SC * (M2 + 2 * M1 * g * S * L1 + dr * (2 * L1**2 * g * S + L2))
