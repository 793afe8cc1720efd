"""Damping, proved: a sector for the roots of the nominal loop, cut off at the left.

No sector holds all roots of a loop with a delay (docs/explanation/theory.md), but one can hold
those that matter: every root of det H(s), H(s) = s I - sum_i A_i e^{-s d_i}, with Re s >= -sigma
(`within`) has a damping ratio -Re s / |s| above zeta. F = 0 there, and every age is constant,
exactly d. The doubles of the system and of K are taken exactly; the rest is ball arithmetic
(`flint.arb`), which encloses its own rounding.

A root in the excluded region {Re s >= -sigma, -Re s <= zeta |s|} has |s| <= a,
a = sum_i |A_i| e^{sigma d_i} (Frobenius norms). The roots are symmetric about the real axis, and
so the upper half of the region's boundary is enough: the ray s = t (-zeta + j sqrt(1 - zeta^2))
from 0 to Re s = -sigma, from there upwards to a point Z with |Z| > a, and the arc |s| = |Z| from Z
to the positive real axis.

A. Steps, on the ray and upwards. From c to c' with |c' - c| <= h, S = H(c)^-1 and e_i the greatest
   e^{-d_i Re s} on the way,

       |S (H(s) - H(c))| <= rho = h (|S| + sum_i d_i e_i |S A_i|) < 1,

   so that det H(s)/det H(c) = det(I + E) with |E| <= rho is not zero, and its phase, the sum of
   those of n eigenvalues, is below sqrt(n) asin(rho). This is kept below pi: then the principal
   argument of det H(c')/det H(c) is the whole turn.
B. Arc. det H(s) = s^n det(I - A(s)/s) has the phase n arg s, but for one that is 0 on the real
   axis and below sqrt(n) asin(a/|Z|) < pi everywhere.
C. The argument principle: the roots in the region are as many as

       (n arg Z + arg(det H(Z)/Z^n) - the turn of A from 0 to Z) / pi,

   an integer, proved to be below 1/2.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import flint

from cosim.core import InputError
from cosim.hinf.certificate.document import ProvedValue
from cosim.hinf.certificate.norm_proof import exact_terms
from cosim.hinf.certificate.system_json import known_keys
from cosim.hinf.exact import ball_precision, balls, exact, from_text, size, to_text

if TYPE_CHECKING:
    from cosim.models import DelaySystem, Matrix

_BITS = 128
_MOST_STEPS = 10_000
_ROUNDS = 10  # of balancing
_LARGEST_GROWTH = 1e9
_ON_THE_BOUNDARY = "a root on the boundary of the region, or as good as"
_KEYS = ("ratio", "within")


@dataclass(frozen=True, eq=False)
class Damping(ProvedValue):
    """A bound of damping ratios; it is its own proof, which needs no further numbers (`fmpq`).

    ratio : zeta, between 0 and 1.
    within : sigma [1/s], positive: the bound is for roots with Re s >= -within.
    """

    ratio: Any
    within: Any

    def claim(self) -> dict[str, Any]:
        """Return the claim that is proved if `failure` returns None."""
        return {
            "property": "nominal loop (F = 0, every age constant, exactly d): every characteristic "
            "root s with Re s >= -within has a damping ratio -Re s / |s| > ratio",
            **self.to_json(),
        }

    def to_json(self) -> dict[str, Any]:
        """Return the JSON values that `damping_from_json` reads."""
        return {"ratio": to_text(self.ratio), "within": to_text(self.within)}

    def failure(self, system: DelaySystem, gain: Matrix) -> str | None:
        """Return why it is not proved; None if it is."""
        if not 0 < self.ratio < 1:
            return "the ratio is not between 0 and 1"
        if not self.within > 0:
            return "within is not positive"
        if any(delay.sampled for delay in system.delays):
            return "a sampled age is not constant: its loop has no characteristic roots"
        if exceeds_growth(self.within, system):
            return "within is too great for the longest delay"
        with ball_precision(_BITS):
            try:
                return _Sector(system, gain, self).failure()
            except (ZeroDivisionError, OverflowError):  # H is singular at a point, or as good as
                return _ON_THE_BOUNDARY


def damping_from_json(data: Any, system: DelaySystem, where: str) -> Damping:
    """Read what `Damping.to_json` wrote; an `InputError` for anything else."""
    del system
    known_keys(data, where, _KEYS, required=_KEYS)
    return Damping(*(from_text(data[key], f"{where}.{key}") for key in _KEYS))


def checked_damping(
    system: DelaySystem, ratio: float | None, within: float | None, prefix: str = ""
) -> Damping | None:
    """Return the damping that is asked for, by doubles; None where neither is given.

    Raises
    ------
    InputError : one without the other, a number out of range, or a sampled age.
    """
    if ratio is None and within is None:
        return None
    for name, value in (("damping", ratio), ("within", within)):
        if value is None:
            raise InputError(
                "damping is asked for roots with Re s >= -within: give both",
                where=f"{prefix}{name}",
                expected="a ratio between 0 and 1 (damping) and a positive number of 1/s (within)",
                got="damping alone" if name == "within" else "within alone",
                hint="no sector holds the roots of a loop with a delay all the way to the left",
            )
    if not (ratio is not None and math.isfinite(ratio) and 0 < ratio < 1):
        raise InputError(
            "not a damping ratio",
            where=f"{prefix}damping",
            expected="a number between 0 and 1",
            got=repr(ratio),
        )
    if not (within is not None and math.isfinite(within) and within > 0):
        raise InputError(
            "not a bound of real parts",
            where=f"{prefix}within",
            expected="a positive number of 1/s",
            got=repr(within),
        )
    if any(delay.sampled for delay in system.delays):
        raise InputError(
            "damping is that of characteristic roots, which a loop with a sampled age has not",
            where=f"{prefix}damping",
            expected="ages that are constant, or taken at their greatest value",
            hint="ask for a rate of decay, or leave out sampled",
        )
    asked = Damping(exact(ratio), exact(within))
    if exceeds_growth(asked.within, system):
        longest = max(delay.d for delay in system.delays)
        raise InputError(
            f"the roots are asked for too far to the left for a delay of {longest:g} s",
            where=f"{prefix}within",
            expected=f"at most {math.log(_LARGEST_GROWTH) / longest:.4g} 1/s",
            got=f"{within:g}",
        )
    return asked


def exceeds_growth(within: Any, system: DelaySystem) -> bool:
    """Whether e^{within d} of the longest delay is too great for a proof."""
    longest = max((delay.d for delay in system.delays), default=0.0)
    return bool(within * exact(longest) > exact(math.log(_LARGEST_GROWTH)))


def _balanced(matrices: list[Any]) -> list[Any]:
    """Return T^-1 A T of each `fmpq_mat`, T one diagonal of powers of two: det H is the same.

    States in very different units make norms large, and steps short. Osborne's iteration on the
    sum of the sizes; which T it finds is of no account to the proof.
    """
    n = matrices[0].nrows()
    exponents = [0] * n
    sizes = [
        [sum(abs(float(A[i, j])) for A in matrices) * (i != j) for j in range(n)] for i in range(n)
    ]
    for i in list(range(n)) * _ROUNDS:
        row, column = sum(sizes[i]), sum(line[i] for line in sizes)
        if row > 0 and column > 0:
            k = round(math.log2(row / column) / 2)
            exponents[i] += k
            sizes[i] = [x * 2.0**-k for x in sizes[i]]
            for line in sizes:
                line[i] *= 2.0**k
    T = [flint.fmpq(2) ** k for k in exponents]
    both = [(i, j) for i in range(n) for j in range(n)]
    return [flint.fmpq_mat(n, n, [A[i, j] * T[j] / T[i] for i, j in both]) for A in matrices]


class _Part(NamedTuple):
    """A straight part of the boundary: `start` + t `way`, t from 0 to `end`; all of them balls."""

    start: Any
    way: Any
    end: Any


class _Sector:
    """The loop and the boundary in balls; to be used at `_BITS` of precision."""

    def __init__(self, system: DelaySystem, gain: Matrix, asked: Damping) -> None:
        terms = exact_terms(system, gain)
        self._n = n = system.A.shape[0]
        self._delays = [flint.arb(d) for d in terms]
        self._A = [balls(A) for A in _balanced([A for A, _ in terms.values()])]
        self._eye = flint.acb_mat([[int(i == j) for j in range(n)] for i in range(n)])
        self._ratio, self._within = flint.arb(asked.ratio), flint.arb(asked.within)
        self._root = flint.arb(n).sqrt()
        # largest rho <= 1 with sqrt(n) asin(rho) < pi
        most = (flint.arb.pi() / self._root).sin() if n > 4 else flint.arb(1)
        self._longest = most * flint.arb("0.999")

    def failure(self) -> str | None:
        """Return why there may be a root in the excluded region; None: there is none."""
        a = flint.arb(0)
        for d, A in zip(self._delays, self._A, strict=True):
            a += size(A) * (d * self._within).exp()
        upwards = (1 - self._ratio**2).sqrt()
        ray = flint.acb(-self._ratio, upwards)
        corner = flint.acb(-self._within, upwards * self._within / self._ratio)
        height = float(a.upper()) or 1.0
        while not self._ends_at(corner + flint.acb(0, height), a):
            height *= 1.25
            if not math.isfinite(height):
                return "numbers that leave the range of doubles"
        last, turned = None, flint.arb(0)
        parts = (
            _Part(flint.acb(0), ray, self._within / self._ratio),
            _Part(corner, flint.acb(0, 1), flint.arb(height)),
        )
        steps = 0
        for part in parts:
            for det in self._determinants(part):
                steps += 1
                if det is None:
                    return _ON_THE_BOUNDARY
                if steps > _MOST_STEPS:
                    return f"more than {_MOST_STEPS} steps: within is great, or a root too near"
                turned += (det / last).arg() if last is not None else 0
                last = det
        Z = corner + flint.acb(0, height)
        roots = (self._n * Z.arg() + (last / Z**self._n).arg() - turned) / flint.arb.pi()
        if roots < 0.5:
            return None
        count = roots.unique_fmpz()
        return (
            _ON_THE_BOUNDARY
            if count is None
            else f"{count} characteristic roots with Re s >= -within have no greater damping ratio"
        )

    def _ends_at(self, Z: Any, a: Any) -> bool:
        """Part B at Z."""
        radius = abs(Z)
        return bool(a < radius and self._root * (a / radius).asin() < 3)

    def _determinants(self, part: _Part) -> Iterator[Any]:
        """Yield det H at points of a part, with steps between them as in part A; None: none."""
        t, left = 0.0, -part.way.real
        while True:
            c = part.start + flint.arb(t) * part.way
            H = self._H(c)
            S = H.inv()
            yield H.det()
            sizes = [d * size(S * A) for d, A in zip(self._delays, self._A, strict=True)]
            whole = size(S)
            h = self._longest / self._slope(whole, sizes, c.real)
            # where e_i is that of the longest step, it is as great on a shorter one
            h = self._longest / self._slope(whole, sizes, c.real - h * left)
            if flint.arb(t) + h >= part.end:
                yield self._H(part.start + part.end * part.way).det()
                return
            following = t + 0.999 * float(h.mid())
            if not (following > t and flint.arb(following) - flint.arb(t) <= h):
                yield None
                return
            t = following

    def _slope(self, whole: Any, sizes: list[Any], real: Any) -> Any:
        """Return rho / h with the e_i at this real part."""
        late = zip(self._delays, sizes, strict=True)
        return whole + sum(((-real * d).exp() * x for d, x in late), flint.arb(0))

    def _H(self, s: Any) -> Any:
        H = s * self._eye
        for d, A in zip(self._delays, self._A, strict=True):
            H = H - A * (-s * d).exp()
        return H
