"""Proof that the nominal loop is stable and that no frequency has a gain above a level.

Symbols as in `delay_lti.norm`; `delay_lti.norm_intervals` finds the intervals. The
doubles of the system and of K are taken exactly, A + B K is formed in rationals, and everything
after that is ball arithmetic (`flint.arb`), which encloses its own rounding. Stability is part of
the proof, not an assumption.

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
C. Stability. The intervals are steps up the imaginary axis for `cosim.hinf.exact.contour`: on each,
   det H turns by less than sqrt(n) asin(rho) from its centre. This is kept below pi/2, so that from
   centre to centre it turns by less than pi. Between them, the arc |s| = W and the imaginary axis
   enclose every root with Re s >= 0: their number is proved to be below 1/2.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import flint

from cosim.hinf.exact import Contour, balls, below, exact_matrix, floats, size
from cosim.hinf.theorems import Loop
from cosim.models import DelaySystem, Matrix

NORM_BITS = 128
"""Working precision of the balls."""

MAX_STEPS = 1000
"""Most intervals of a proof."""


def exact_terms(system: DelaySystem, gain: Matrix) -> dict[float, tuple[Any, Any]]:
    """Return (A_i, D_i) of u = K x by delay, `fmpq_mat`: d = 0 first, equal delays merged."""
    loop = Loop.of(system, gain)
    terms: dict[float, tuple[Any, Any]] = {}
    for d, A, D in zip([0.0, *(x.d for x in loop.delays)], loop.A, loop.D, strict=True):
        terms[d] = (terms[d][0] + A, terms[d][1] + D) if d in terms else (A, D)
    return terms


class NormProof:
    """The loop and its constants in balls; to be used at `NORM_BITS` of precision.

    system, K : as of `norm_proved`. level : a double, or a `fmpq`.
    """

    def __init__(self, system: DelaySystem, K: Any, level: float) -> None:
        terms = exact_terms(system, K)
        self.level = flint.arb(level)
        self.contour = Contour({d: A for d, (A, _) in terms.items()})
        self.C, self.D1 = balls(exact_matrix(system.C)), balls(exact_matrix(system.D1))
        self.D = [balls(D) for _, D in terms.values()]
        delays, matrices = self.contour.delays, self.contour.A
        a, b = [size(A) for A in matrices], [size(D) for D in self.D]
        zero = flint.arb(0)
        self.L1 = 1 + sum((d * x for d, x in zip(delays, a, strict=True)), zero)
        self.L2 = sum((d * d * x for d, x in zip(delays, a, strict=True)), zero)
        self.M1 = sum((d * x for d, x in zip(delays, b, strict=True)), zero)
        self.M2 = sum((d * d * x for d, x in zip(delays, b, strict=True)), zero)
        self.a, self.through = sum(a, zero), sum(b, zero) * size(self.C)
        self.second = size(self.D1) * sum(b, zero) * sum((size(A * self.C) for A in matrices), zero)
        P = [self.D1.transpose() * D * self.C for D in self.D]
        self.first = size(P[0] - P[0].transpose()) + 2 * sum(map(size, P[1:]), zero)
        self.longest = self.contour.longest(flint.arb.pi() / 2)

    def failure(self, steps: Sequence[tuple[float, float]], end: float) -> str | None:
        """Return what the intervals [c-h, c+h] of `steps` do not prove; None: all is proved.

        They start at c = 0, in order, without a gap, and reach `end`, W of part B.
        """
        if not 0 < len(steps) <= MAX_STEPS or steps[0][0] != 0.0:
            return f"not 1 to {MAX_STEPS} intervals from 0 on"
        try:
            return self._failure(steps, end)
        except ZeroDivisionError:  # H is singular at a centre, or as good as
            return "a root on the imaginary axis, or as good as"

    def _failure(self, steps: Sequence[tuple[float, float]], end: float) -> str | None:
        if not self.ends_at(end):
            return f"the gain beyond {end:g} rad/s is not below gamma"
        last, done, turned = self.point(0.0), 0.0, flint.arb(0)
        for c, h in steps:
            point = self.point(c)
            if not (h > 0 and c >= last.c and flint.arb(c) - flint.arb(h) <= done):
                return f"a gap below {c:g} rad/s"
            if not self.covers(point, h):
                return f"the gain about {c:g} rad/s is not below gamma"
            turned += (point.det / last.det).arg()
            last, done = point, math.nextafter(c + h, 0.0)
        if not abs(flint.arb(end) - flint.arb(last.c)) <= flint.arb(steps[-1][1]):
            return "the last interval does not contain the end"
        stable = self.without_roots(turned, last, end)
        return None if stable else "the loop is not shown to be stable"

    def ends_at(self, w: float) -> bool:
        """Part B at W, and the phase on the arc."""
        W = flint.arb(w)
        closes = self.contour.closes_at(flint.acb(0, W), self.a)
        return closes and below(self.D1, self.level**2 - self._beyond(W))

    def _beyond(self, W: Any) -> Any:
        """Return the terms that part B adds to D1'D1 at W."""
        rest = W - self.a
        return self.first / W + 2 * self.second / (W * rest) + (self.through / rest) ** 2

    def without_roots(self, turned: Any, last: NormPoint, end: float) -> bool:
        """Part C, given the turn from 0 to `last`."""
        Z = flint.acb(0, end)
        det = self.contour.at(Z).det()
        return bool(self.contour.roots(Z, det, turned + (det / last.det).arg()) < 0.5)

    def point(self, c: float) -> NormPoint:
        """Return H and G with their derivatives at jc."""
        j, loop = flint.acb(0, 1), self.contour
        shifts = loop.late(flint.acb(0, c))
        H = loop.at(flint.acb(0, c), shifts)
        H1, D, D1 = loop.eye * j, self.D[0], self.D[0] * 0
        for d, e, A, Di in list(zip(loop.delays, shifts, loop.A, self.D, strict=True))[1:]:
            H1 = H1 + A * (j * d * e)
            D, D1 = D + Di * e, D1 - Di * (j * d * e)
        S = H.inv()
        SC, DS = S * self.C, D * S
        G, slope = DS * self.C + self.D1, D1 * SC - DS * (H1 * SC)
        sizes = (size(S), size(SC), size(DS))
        return NormPoint(c, H.det(), G, slope, sizes, floats(G), floats(slope))

    def covers(self, point: NormPoint, h: float) -> bool:
        """Part A on [c-h, c+h], in balls."""
        step = flint.arb(h)
        if not step * self.L1 * point.sizes[0] < self.longest:
            return False
        constants = (self.L1, self.L2, self.M1, self.M2)
        more = step**2 * bend(step, point.sizes, constants) / 2
        room, change = self.level - more, point.slope * step
        return bool(
            room > 0 and below(point.G + change, room**2) and below(point.G - change, room**2)
        )


class NormPoint(NamedTuple):
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


def bend(h: Any, sizes: Sequence[Any], constants: Sequence[Any]) -> Any:
    """Return b of part A, for floats or balls."""
    S, SC, DS = sizes
    L1, L2, M1, M2 = constants
    g = 1 / (1 - h * L1 * S)
    dr = g * (DS + h * M1 * S)
    return g * SC * (M2 + 2 * M1 * g * S * L1 + dr * (2 * L1**2 * g * S + L2))
