"""Damping for `checker.py`: roots counted with integers; the prover's damping.py derives it.

Complex numbers are pairs of integers in units of 2^-96. Points, steps and inverses come from
floating point, which decides nothing: what they prove is verified in integers and fractions, with
every error counted. The ray lies a little outside the sector, where its direction is rational.
"""
# mypy: ignore-errors
# ruff: noqa: ANN001, ANN201, ANN204, B905, D102, D103, N817

from __future__ import annotations

import math
from fractions import Fraction as F
from math import isqrt

from .arithmetic import need

UNIT = 2**96
STEPS = 5_000


class C:
    """A Gaussian integer."""

    __slots__ = ("x", "y")

    def __init__(self, x, y=0):
        self.x, self.y = x, y

    def __add__(self, z):
        return C(self.x + z.x, self.y + z.y)

    def __mul__(self, z):
        return C(self.x * z.x - self.y * z.y, self.x * z.y + self.y * z.x)

    def __floordiv__(self, k):
        return C(self.x // k, self.y // k)

    def arg(self):
        """The argument, to the last digits of a double."""
        most = max(self.x.bit_length(), self.y.bit_length(), 1)
        shift = 2 ** max(most - 900, 0)
        return math.atan2(float(self.y // shift), float(self.x // shift))


def exp(x, y):
    """Return e^(x + jy) in units, to 2 units in either part, for |x| <= 21 and |y| < 2^38.

    Taylor's series to 60 terms at z / 2^k, |z| / 2^k < 1/2, errs by less than 2^10 in units of
    2^-256; each square multiplies an error by 2|v| < 2 e^(|x|/2^i) and adds 2: 2^90 in all.
    """
    k, one = int(abs(x) + abs(y)).bit_length() + 1, 2**256
    need(abs(x) <= 21 and k < 40, "an exponent too great")
    z = C(int(x * one / 2**k // 1), int(y * one / 2**k // 1))
    term = value = C(one)
    for i in range(1, 61):
        term = term * z // one // i
        value = value + term
    for _ in range(k):
        value = value * value // one
    return value // (one // UNIT)


def product(A, B):
    return [[sum((x * y for x, y in zip(a, b)), C(0)) for b in zip(*B)] for a in A]


def size(A, unit):
    """Return the Frobenius norm, rounded up."""
    return F(isqrt(sum(z.x**2 + z.y**2 for row in A for z in row)) + 1, unit)


def determinant(A):
    """Return det A, exactly: elimination without fractions (Bareiss)."""
    A, sign, last, n = [row[:] for row in A], 1, C(1), len(A)
    for k in range(n - 1):
        first = next((i for i in range(k, n) if A[i][k].x or A[i][k].y), None)
        need(first is not None, "H is singular at a point")
        if first != k:
            A[k], A[first], sign = A[first], A[k], -sign
        divisor = last.x**2 + last.y**2
        for i in range(k + 1, n):
            for j in range(k + 1, n):
                z = A[k][k] * A[i][j] + C(-1) * A[i][k] * A[k][j]
                A[i][j] = z * C(last.x, -last.y) // divisor
        last = A[k][k]
    return C(sign) * A[-1][-1]


def inverse(A):
    """Return about A^-1, in floating point."""
    n = len(A)
    rows = [
        [*(complex(z.x / UNIT, z.y / UNIT) for z in row), *(float(i == j) for j in range(n))]
        for i, row in enumerate(A)
    ]
    for k in range(n):
        best = max(range(k, n), key=lambda i: abs(rows[i][k]))
        rows[k], rows[best] = rows[best], rows[k]
        rows[k] = [x / rows[k][k] for x in rows[k]]
        for i in range(n):
            if i != k:
                rows[i] = [x - rows[i][k] * y for x, y in zip(rows[i], rows[k])]
    return [row[n:] for row in rows]


def balance(matrices, n):
    """Return t_i, powers of two, for which A_ij t_j / t_i are small; the roots are the same."""
    T = [F(1)] * n
    for k in [*range(n)] * 10:
        each = [(i, j, float(abs(x) * T[j] / T[i])) for A in matrices for (i, j), x in A.items()]
        row = sum(x for i, j, x in each if i == k != j)
        column = sum(x for i, j, x in each if j == k != i)
        if row > 0 and column > 0:
            T[k] *= F(2) ** round(math.log2(row / column) / 2)
    return T


class Walk:
    """The turn of det H along straight parts, step by step."""

    def __init__(self, s, within):
        self.n, self.within, merged, T = s.n, within, {}, balance(s.A, s.n)
        for d, A in zip(s.d, s.A):
            same = type(A)({(i, j): x * T[j] / T[i] for (i, j), x in A.items()})
            merged[d] = merged.get(d, type(A)()) + same
        self.d = list(merged)
        self.A = [
            [[C(int(A.get((i, j), 0) * UNIT // 1)) for j in range(s.n)] for i in range(s.n)]
            for A in merged.values()
        ]
        self.sizes = [size(A, UNIT) + F(s.n, UNIT) for A in self.A]
        # of H in Frobenius norm: 2 units of e times |A|, one of A times e, floors
        self.error = F(2**33 * s.n * (len(self.d) + 1), UNIT) + 4 * sum(self.sizes) / UNIT
        # y below pi / 2 / sqrt(n): sin y > y - y^3 / 6
        y = F(1.5 / math.sqrt(s.n) - 1e-9)
        need(s.n * y**2 < F(9, 4), "the root of n")
        self.longest, self.turned, self.last, self.steps = y - y**3 / 6, 0.0, None, 0

    def growth(self, real):
        """Return e^(-d Re s) for each delay, rounded up, where Re s >= real, or >= -within."""
        return [F(exp(-d * max(real, -self.within), F(0)).x + 2, UNIT) for d in self.d]

    def slope(self, of_A, shifts, real):
        return of_A + sum(x * e for x, e in zip(shifts, self.growth(real)))

    def at(self, re, im):
        shifts = [exp(-d * re, -d * im) for d in self.d]
        n, s = self.n, C(int(re * UNIT // 1), int(im * UNIT // 1))
        H = [[s if i == j else C(0) for j in range(n)] for i in range(n)]
        for e, A in zip(shifts, self.A):
            H = [[h + C(-1) * e * a // UNIT for h, a in zip(*rows)] for rows in zip(H, A)]
        det = determinant(H)
        need(det.x or det.y, "a root on the boundary")
        if self.last is not None:
            self.turned += (det * C(self.last.x, -self.last.y)).arg()
        self.last = det
        return H

    def along(self, start, way, end):
        """Follow start + t way, |way| = 1, for t from 0 to `end`."""
        t = F(0)
        while True:
            re, im = (x + t * v for x, v in zip(start, way))
            H = self.at(re, im)
            if t == end:
                return
            S = [[C(int(z.real * 2**80), int(z.imag * 2**80)) for z in row] for row in inverse(H)]
            rest = product(S, H)
            for i in range(self.n):
                rest[i][i] = rest[i][i] + C(-UNIT * 2**80)
            of_A = size(S, 2**80)
            known = size(rest, UNIT * 2**80) + 2 * self.error * of_A
            of_delays = [
                d * (size(product(S, A), UNIT * 2**80) + F(self.n, UNIT) * of_A)
                for d, A in zip(self.d, self.A)
            ]
            room = self.longest - known
            need(room > 0, "a root on the boundary, or as good as")
            h = room / self.slope(of_A, of_delays, re)
            h = room / self.slope(of_A, of_delays, re + h * way[0])
            h = min(F(float(h) * 0.999), end - t)
            ahead = self.slope(of_A, of_delays, re + h * way[0])
            need(h > 0 and known + h * ahead <= self.longest, "a step that proves nothing")
            self.steps += 1
            need(self.steps <= STEPS, "too many steps")
            t += h


def damped(s, ratio, within):
    """Refuse unless every root with Re s >= -within has a damping ratio above `ratio`."""
    need(0 < ratio < 1 and within > 0 and not any(s.sampled), "no damping, or a sampled age")
    need(within * max(s.d) <= F(21), "within is too great")
    # (1 - q^2, 2 q) / (1 + q^2) at a ratio above: q^2 <= (1 - ratio) / (1 + ratio)
    q = F(isqrt(int((1 - ratio) / (1 + ratio) * 2**160 // 1)), 2**80)
    need(q > 0, "a ratio as good as 1")
    cosine, sine = (1 - q**2) / (1 + q**2), 2 * q / (1 + q**2)
    walk = Walk(s, within)
    walk.along((F(0), F(0)), (-cosine, sine), within / cosine)
    a = sum(x * e for x, e in zip(walk.sizes, walk.growth(-within)))
    corner, height = within * sine / cosine, F(math.ceil(4 * s.n * a))
    # sqrt(n) asin(a / |Z|) is below 1/2
    need(height**2 >= 4 * s.n * a**2, "the arc")
    walk.along((-within, corner), (F(0), F(1)), height)
    angle = s.n * math.atan2(corner + height, -within)
    roots = (angle + math.remainder(walk.last.arg() - angle, 2 * math.pi) - walk.turned) / math.pi
    need(abs(roots) < 0.1, f"{roots:.0f} roots with Re s >= -within have no greater damping ratio")
