"""Characteristic roots counted in ball arithmetic: the argument principle for det H.

    H(s) = s I - sum_i A_i e^{-s d_i}

A path leads from the real axis through the upper half-plane to a point Z and closes with the arc
|s| = |Z| from Z to the positive real axis. The roots are symmetric about the real axis, so that the
path and its mirror image enclose a region whose roots the half path counts. A root with
Re s >= real has |s| <= a = sum_i |A_i| e^{-real d_i} (Frobenius norms): where |Z| > a, none with
that real part lies beyond the arc.

A. Steps. From c to c' with |c' - c| <= h, S = H(c)^-1 and e_i the greatest e^{-d_i Re s} between,

       |S (H(s) - H(c))| <= rho = h (|S| + sum_i d_i e_i |S A_i|) < 1,

   so that det H(s)/det H(c) = det(I + E) with |E| <= rho is not zero, and its phase, the sum of
   those of n eigenvalues, is below sqrt(n) asin(rho), asin(x)/x being increasing. This is kept
   below pi: then the principal argument of det H(c')/det H(c) is the whole turn.
B. Arc. det H(s) = s^n det(I - A(s)/s) has the phase n arg s, but for one that is 0 on the real
   axis and below sqrt(n) asin(a/|Z|) < pi everywhere.
C. Count. The roots in the region are as many as

       (n arg Z + arg(det H(Z)/Z^n) - the turn of A from the axis to Z) / pi.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

import flint

from cosim.hinf.exact.ball_matrices import balls, size

_MOST_STEPS = 10_000
_BALANCING_ROUNDS = 10
_SMALL_COUPLING = 2.0**-20  # of states that act one way only, against their fastest rate
_ON_THE_BOUNDARY = "a root on the boundary of the region, or as good as"
_BEYOND_DOUBLES = "numbers that leave the range of doubles"


class NotCountedError(ArithmeticError):
    """The roots right of a path cannot be counted; the reason in words."""


class Contour:
    """det H along paths, at the precision at which it is made (`ball_precision`).

    Parameters
    ----------
    terms : A_i, `fmpq_mat` (n, n), by delay d_i [s], a double taken exactly.
    """

    def __init__(self, terms: Mapping[float, Any]) -> None:
        self.delays = [flint.arb(d) for d in terms]
        self.A = [balls(A) for A in terms.values()]
        self.n = self.A[0].nrows()
        self.eye = flint.acb_mat([[int(i == j) for j in range(self.n)] for i in range(self.n)])
        self._root = flint.arb(self.n).sqrt()

    @classmethod
    def balanced(cls, terms: Mapping[float, Any]) -> Contour:
        """Return the contour of T^-1 A_i T, which has the same det H and allows longer steps.

        Raises
        ------
        NotCountedError : numbers too large for doubles.
        """
        try:
            return cls(_balanced(terms))
        except OverflowError:
            raise NotCountedError(_BEYOND_DOUBLES) from None

    def late(self, s: Any) -> list[Any]:
        """Return the factors e^{-s d_i} at a point."""
        return [(-s * d).exp() for d in self.delays]

    def at(self, s: Any, shifts: Sequence[Any] | None = None) -> Any:
        """Return H(s); `shifts` are the factors at s if they are known."""
        H = s * self.eye
        for A, e in zip(self.A, shifts or self.late(s), strict=True):
            H = H - A * e
        return H

    def farthest(self, real: Any) -> Any:
        """Return a: no root with Re s >= real has a greater modulus."""
        shifted = zip(self.A, self.late(real), strict=True)
        return sum((size(A) * e for A, e in shifted), flint.arb(0))

    def longest(self, phase: Any) -> Any:
        """Return a rho <= 1 with sqrt(n) asin(rho) < phase, phase <= pi."""
        share = phase / self._root
        most = share.sin() if share < flint.arb.pi() / 2 else flint.arb(1)
        return most * flint.arb("0.999")

    def closes_at(self, Z: Any, a: Any) -> bool:
        """Whether part B is shown at Z."""
        radius = abs(Z)
        return bool(a < radius and self._root * (a / radius).asin() < 3)

    def roots(self, Z: Any, det: Any, turned: Any) -> Any:
        """Return part C, a ball about a whole number; det = det H(Z), `turned` as of part A."""
        beyond = (det / Z**self.n).arg()
        return (self.n * Z.arg() + beyond - turned) / flint.arb.pi()

    def count(self, corners: Sequence[Any]) -> int:
        """Count the roots right of a path through `corners`, from the last one straight upwards.

        corners : `acb`, the first on the real axis, none left of the last.

        Raises
        ------
        NotCountedError : a root on the path, or as good as, or too many steps.
        """
        last = corners[-1]
        try:
            a = self.farthest(last.real)
            height = float(a.upper()) or 1.0
            while not self.closes_at(last + flint.acb(0, height), a):
                height *= 1.25
                if not math.isfinite(height):
                    raise NotCountedError(_BEYOND_DOUBLES)
            Z = last + flint.acb(0, height)
            turned, det = self._turn([*corners, Z])
            return _whole(self.roots(Z, det, turned))
        except (ZeroDivisionError, OverflowError):  # H is singular at a point, or as good as
            raise NotCountedError(_ON_THE_BOUNDARY) from None

    def within(self, corners: Sequence[Any]) -> int:
        """Count the roots within a polygon, its corners counter-clockwise.

        Raises
        ------
        NotCountedError : as `count`.
        """
        try:
            turned, _ = self._turn([*corners, corners[0]])
        except (ZeroDivisionError, OverflowError):
            raise NotCountedError(_ON_THE_BOUNDARY) from None
        return _whole(turned / (2 * flint.arb.pi()))

    def _turn(self, corners: Sequence[Any]) -> tuple[Any, Any]:
        """Return the turn of det H along straight lines through `corners`, and det H at the end."""
        last, turned, steps = None, flint.arb(0), 0
        for start, end in pairwise(corners):
            for _, det in self.walk(start, end):
                steps += 1
                if steps > _MOST_STEPS:
                    raise NotCountedError(
                        f"more than {_MOST_STEPS} steps: within is great, or a root too near"
                    )
                turned += (det / last).arg() if last is not None else 0
                last = det
        return turned, last

    def walk(self, start: Any, end: Any) -> Iterator[tuple[Any, Any]]:
        """Yield s and det H(s) at points from `start` straight to `end`, in steps of part A.

        Raises
        ------
        NotCountedError : a step that leads nowhere.
        """
        length = abs(end - start)
        way = (end - start) / length
        t, left, longest = 0.0, -way.real, self.longest(flint.arb.pi())
        while True:
            c = start + flint.arb(t) * way
            H = self.at(c)
            S = H.inv()
            yield c, H.det()
            sizes = [d * size(S * A) for d, A in zip(self.delays, self.A, strict=True)]
            of_S = size(S)
            h = longest / self._slope(of_S, sizes, c.real)
            # where e_i is that of the longest step, it is as great on a shorter one
            h = longest / self._slope(of_S, sizes, c.real - h * left)
            if flint.arb(t) + h >= length:
                yield end, self.at(end).det()
                return
            following = t + 0.999 * float(h.mid())
            if not (following > t and flint.arb(following) - flint.arb(t) <= h):
                raise NotCountedError(_ON_THE_BOUNDARY)
            t = following

    def _slope(self, of_S: Any, sizes: list[Any], real: Any) -> Any:
        """Return rho / h with the e_i at this real part."""
        shifted = zip(self.late(real), sizes, strict=True)
        return of_S + sum((e * x for e, x in shifted), flint.arb(0))


def _whole(roots: Any) -> int:
    """Return the whole number that a ball encloses."""
    number = roots.unique_fmpz()
    if number is None:
        raise NotCountedError(_ON_THE_BOUNDARY)
    return int(number)


def _balanced(terms: Mapping[float, Any]) -> dict[float, Any]:
    """Return T^-1 A_i T by delay, T one diagonal of powers of two: det H is the same.

    States in very different units make norms large, and steps short. Osborne's iteration on the
    sum of the sizes; which T it finds is of no account to a proof. A state that acts on no other
    one, or that none acts on, leaves det H as it is whatever its coupling, which is made small.
    """
    matrices = list(terms.values())
    n = matrices[0].nrows()
    exponents = [0] * n
    sizes = [
        [sum(abs(float(A[i, j])) for A in matrices) * (i != j) for j in range(n)] for i in range(n)
    ]
    least = _SMALL_COUPLING * max(sum(abs(float(A[i, i])) for A in matrices) for i in range(n))
    for i in list(range(n)) * _BALANCING_ROUNDS:
        row, column = sum(sizes[i]) or least, sum(line[i] for line in sizes) or least
        if row > 0 and column > 0:
            k = round(math.log2(row / column) / 2)
            exponents[i] += k
            sizes[i] = [x * 2.0**-k for x in sizes[i]]
            for line in sizes:
                line[i] *= 2.0**k
    T = [flint.fmpq(2) ** k for k in exponents]
    both = [(i, j) for i in range(n) for j in range(n)]
    return {
        d: flint.fmpq_mat(n, n, [A[i, j] * T[j] / T[i] for i, j in both]) for d, A in terms.items()
    }
