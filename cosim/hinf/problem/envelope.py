"""Uncertainty matrices E and H that cover the vehicle over an operating envelope, proved.

The vehicle's f(x) is A x plus what depends on the state, and that part is exactly

    dA(x) x,   dA(x) = [ 0  J(psi) - I ]        J(psi) - I acts on (u, v) alone,
                       [ 0  Q(nu)      ]        Q(nu) nu = M^-1 h(nu), Q linear in nu.

With |psi| <= psi_bar, |u| <= u_bar, ... two norms bound it:

* J(psi) - I has norm 2 |sin(psi/2)|, largest at psi_bar;
* S^-1 Q(nu) T^-1 is linear in nu and a norm is convex, so its largest value over the box is
  taken at one of the 16 vertices. Each vertex is checked in exact rational arithmetic:
  q^2 I - N N' > 0 for the rounded q that is used.

Hence dA(x) = E F H with F = diag(F1, F2), |F1| <= 1, |F2| <= 1, so F'F <= I, for

    E = [ sqrt(k) I2  0           ]  rows (x, y), (u, v, w, r)
        [ 0           c sqrt(q) S ]

    H = [ sqrt(k) I2 on (u, v)    ]      k = 2 sin(psi_bar/2)
        [ (1/c) sqrt(q) T on nu   ]

S and T (diagonal, positive), the split c, and the shares of the coefficient of a product such
as v r in its two columns of Q are free: the bound holds for any of them. They affect gamma,
since the LMI has one multiplier for both blocks and all entries.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from fractions import Fraction
from functools import lru_cache
from types import MappingProxyType

import flint
import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.hinf.exact import exact, norm_is_below
from cosim.models import total, velocity_coefficients

_AXES = "uvwr"


@dataclass(frozen=True)
class Envelope:
    """Bounds on |u|, |v|, |w| [m/s], |r| [rad/s] and |psi| [rad], each positive."""

    u: float
    v: float
    w: float
    r: float
    psi: float

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            top = math.pi if field.name == "psi" else math.inf
            if not (math.isfinite(value) and 0 < value <= top):
                raise InputError(
                    "a bound of the envelope is out of range",
                    where=f"envelope.{field.name}",
                    expected="a positive number" + (" up to pi" if field.name == "psi" else ""),
                    got=repr(value),
                )

    @property
    def velocity(self) -> tuple[float, float, float, float]:
        """(u, v, w, r)."""
        return self.u, self.v, self.w, self.r


@dataclass(frozen=True)
class Scaling:
    """Free factors of the factorisation: S (rows), T (columns), and the split c.

    The defaults are those of least gamma, rounded, with a multiplier of the LMI per entry (eps
    E E' and eps (H'H)^-1 as variables, coupled by the vertices), for |u|, |v| <= 0.3, |w| <=
    0.2, |r| <= 0.06, |psi| <= 0.35 and a loop delay of 1.25 s. With them gamma is 0.1 % above
    that of free multipliers for that box (0.4 % at delays of 0.05 and 0.5 s), 2 % for half of
    it, 27 % for |u|, |v| <= 0.5, |w| <= 0.3, |r| <= 0.1.
    """

    rows: tuple[float, float, float, float] = (1.0, 0.67, 0.48, 0.8)
    columns: tuple[float, float, float, float] = (0.39, 0.65, 1.18, 1.0)
    split: float = 0.45


_FIRST_SHARE: Mapping[tuple[int, str], Fraction] = MappingProxyType(
    {
        (0, "vr"): Fraction(1),
        (1, "vw"): Fraction(1, 4),
        (1, "wr"): Fraction(1, 4),
        (2, "uw"): Fraction(0),
        (2, "vr"): Fraction(0),
    }
)
"""Share of a product's coefficient in the column of its first factor; others: half.

Found with the scaling: v r in the surge row, for example, is small because of r, so it is
written as (1.153 r) v."""


@dataclass(frozen=True)
class Uncertainty:
    """E (8, 6) and H (6, 8), and the two proved bounds they are made of."""

    E: NDArray[np.float64]
    H: NDArray[np.float64]
    kinematic: float
    quadratic: float


def auv_uncertainty(
    envelope: Envelope, parameters: Mapping[str, float], scaling: Scaling | None = None
) -> Uncertainty:
    """Return E and H of the vehicle for an envelope, rounded outward.

    `parameters` maps the names of `cosim.models.auv.TABLE_1` to numbers.
    """
    scaling = scaling or Scaling()
    kinematic = _up(float((2 * (flint.arb(envelope.psi) / 2).sin()).upper()))
    quadratic = _quadratic_bound(envelope, tuple(sorted(parameters.items())), scaling)
    E, H = np.zeros((8, 6)), np.zeros((6, 8))
    # The product of the two square roots, as doubles, must not fall below the bound.
    k = _up(math.sqrt(kinematic))
    root = _up(math.sqrt(quadratic))
    E[0, 0] = E[1, 1] = H[0, 4] = H[1, 5] = k
    for i in range(4):
        E[4 + i, 2 + i] = _up(root * scaling.split * scaling.rows[i])
        H[2 + i, 4 + i] = _up(root / scaling.split * scaling.columns[i])
    return Uncertainty(E, H, kinematic, quadratic)


def quadratic_part(
    nu: Sequence[Fraction | float], coefficients: Sequence[Mapping[str, Fraction]]
) -> list[list[Fraction]]:
    """Return Q(nu) (4, 4), exact, with Q(nu) nu the quadratic part of f.

    Products are shared between columns as in `_FIRST_SHARE`.
    """
    Q = [[Fraction(0)] * 4 for _ in range(4)]
    speeds = [Fraction(value) for value in nu]
    for i, row in enumerate(coefficients):
        for product, c in row.items():
            a, b = (_AXES.index(letter) for letter in product)
            # a square has both shares in one column
            first = _FIRST_SHARE.get((i, product), Fraction(1, 2))
            Q[i][a] += first * c * speeds[b]
            Q[i][b] += (1 - first) * c * speeds[a]
    return Q


@lru_cache(maxsize=64)
def _quadratic_bound(
    envelope: Envelope, parameters: tuple[tuple[str, float], ...], scaling: Scaling
) -> float:
    """Return q with |S^-1 Q(nu) T^-1| <= q on the whole box, proved at the 16 vertices."""
    coefficients = velocity_coefficients(dict(parameters))
    S = [Fraction(value) for value in scaling.rows]
    T = [Fraction(value) for value in scaling.columns]
    vertices = []
    # Q(-nu) = -Q(nu): half of the vertices are enough
    for signs in itertools.product((1, -1), repeat=3):
        nu = [
            Fraction(bound) * sign
            for bound, sign in zip(envelope.velocity, (1, *signs), strict=True)
        ]
        Q = quadratic_part(nu, coefficients)
        vertices.append([[Q[i][j] / S[i] / T[j] for j in range(4)] for i in range(4)])
    q = max(_norm(N) for N in vertices)
    exactly = [_rational(N) for N in vertices]
    while not all(norm_is_below(N, exact(q)) for N in exactly):
        q *= 1 + 1e-13
    return q


def _norm(N: list[list[Fraction]]) -> float:
    """Compute |N|: repeated squares of N N' tend to the projection on its first eigenvector.

    In plain arithmetic and one order, so that E and H are the same doubles on every machine.
    """
    G = [[float(sum(a * b for a, b in zip(row, other, strict=True))) for other in N] for row in N]
    P = G
    for _ in range(40):
        scale = max(abs(value) for row in P for value in row) or 1.0
        P = [[value / scale for value in row] for row in P]
        P = [[total(a * b for a, b in zip(row, other, strict=True)) for other in P] for row in P]
    v = max(P, key=lambda row: total(value * value for value in row))
    length = total(value * value for value in v)
    image = [total(g * value for g, value in zip(row, v, strict=True)) for row in G]
    reached = total(a * b for a, b in zip(v, image, strict=True))
    return math.sqrt(reached / length) if length else 0.0


def _rational(N: list[list[Fraction]]) -> flint.fmpq_mat:
    return flint.fmpq_mat([[flint.fmpq(x.numerator, x.denominator) for x in row] for row in N])


def _up(value: float) -> float:
    """Return a double above `value` by a few units in the last place: rounding goes outward."""
    return value * (1 + 4 * math.ulp(1.0))
