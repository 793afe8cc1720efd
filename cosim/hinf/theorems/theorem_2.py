"""Theorem 2, corrected, for any number of delays: the inequality that designs a gain.

    V = x'Px + sum_j (int_{t-dj}^t x'Qj x + int_{-dj}^0 int_{t+th}^t x''Rj x')

Lemma 2 per delay with M1j = k1j P, M2j = k2j P; then multiply from both sides by X = P^-1 in
every x block, and by Rbar_j = Rj^-1 where the term dj x''Rj x' (row r_j) is removed by Lemma 3;
Qbar_j = X Qj X, Y = K X. The term dj M_j'Rj^-1 M_j becomes one in Rbar_j by itself, so that the
row which Lemma 3 gives it in the paper is not needed. Lemma 1 removes F(t) (row h) with an eps for
each block of F. Rows of x_j are multiplied by k2j, those of r_j by sqrt(dj): a congruence that
avoids roots and quotients. With e = x + sum_j dj r_j, He M = M + M', and phi_i = 1 for what the
feedback acts through,

    -Omega = -He(e'(sum_i (A_i X + phi_i B Y) x_i + C w) + h'sum_i H_i X x_i
                 + z'(D X x + D2 Y sum_i phi_i x_i + D1 w)
                 + sum_j (k1j x + k2j x_j)'X (x - x_j))
             + gamma (w'w + z'z) - sum_b eps_b (|E_b'e|^2 - |h_b|^2)
             - sum_j (x'Qbar_j x - x_j'Qbar_j x_j - dj r_j'Rbar_j r_j
                      + dj (k1j x + k2j x_j)'Rbar_j (k1j x + k2j x_j)).

The rows are s_j: with b the longest delay,

    r_j = db s_j,    r_b = s_b - sum_{j != b} dj s_j,    so that e = x + db s_b,

another congruence, after which nearly all entries are zero: a solver takes a fraction of the time.
k1, k2 and the delays are parameters: another choice gives other weights of the same terms.

At dj = 0 row s_j is zero and left out: there x(t-dj) = x(t), the terms with Rbar_j vanish, and
V' < 0 follows on the subspace xj = x without them. With Qbar_j = 0 it holds for every age up to
dj, however it varies. Misprints of the paper: Omega_12 needs k2^-1 A1 X, Omega_25 A1'.

A rate of decay is proved for the system of e^{rate t} x(t): A_0 + rate I, and growth_j times
everything that acts through delay j (`Shift`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from cosim.core import InputError
from cosim.hinf.exact import exact, exact_matrix, identity
from cosim.hinf.theorems.inequality import (
    HALF,
    Inequality,
    Shape,
    Signal,
    Sum,
    Weight,
    itself,
    product,
    shapes_of,
)
from cosim.hinf.theorems.proof import Theorem, require_size

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from cosim.models import DelaySystem, Matrix


@dataclass(frozen=True)
class Scalars:
    """k1, k2 and the delays d: one number per delay; k2 not zero, d not negative.

    Doubles for a solver, `fmpq` for a proof.
    """

    k1: tuple[Any, ...]
    k2: tuple[Any, ...]
    d: tuple[Any, ...]


@dataclass(frozen=True)
class Shift:
    """The system of e^{rate t} x(t): A_0 + rate I, and growth_j times A_j, B, H_j.

    rate : a `fmpq`.
    growth : one `fmpq` per delay, in place of e^{rate tau_j}; B where the feedback is delayed.
    """

    rate: Any
    growth: tuple[Any, ...]


@dataclass(frozen=True, eq=False)
class Theorem2(Theorem):
    """Theorem 2 at given k1, k2, of a given gain; the unknowns are X, Q[j], R[j], eps[b], gamma.

    k1, k2 : one `fmpq` per delay.
    shift : of a rate of decay; None: of the system itself.
    """

    k1: tuple[Any, ...]
    k2: tuple[Any, ...]
    shift: Shift | None = None

    def inequalities(
        self, system: DelaySystem, gain: Matrix, *, bounded: bool
    ) -> Iterator[Inequality]:
        """Yield what must be positive, -Omega last."""
        yield from positive(system)
        more: Any = {"gain": gain, "shift": self.shift}
        yield minus_omega(system, self.k1, self.k2, bounded=bounded, **more)

    def shapes(self, system: DelaySystem, gain: Matrix, *, bounded: bool) -> dict[str, Shape]:
        """Return the shape of every unknown, of Q_j where any age is allowed as well: it is 0."""
        require_size(_rows_to_prove(system, bounded=bounded))
        n = len(system.A)
        zeros = (f"Q[{j}]" for j, delay in enumerate(system.delays) if delay.any_age)
        shapes = shapes_of(self.inequalities(system, gain, bounded=bounded))
        return shapes | dict.fromkeys(zeros, Shape(n, n, symmetric=True, is_number=False))

    def obstacle(
        self, system: DelaySystem, gain: Matrix, unknowns: Mapping[str, Any]
    ) -> str | None:
        """Return which k2 is zero, or which Q is not where any age is allowed; None: nothing."""
        del gain
        if system.is_structured:
            raise InputError(
                "Theorem 2 is for the whole state, fed back at once or through one delay",
                where="system: feedback",
                expected="a system without feedback of single states, or another kind of "
                "certificate",
                hint='an analysis of the gain proves it: kind "analysis" or "ages"',
            )
        for j, delay in enumerate(system.delays):
            if self.k2[j] == 0:
                return f"k2[{j}] is 0"
            Q = unknowns[f"Q[{j}]"]
            if delay.any_age and Q != 0 * Q:
                return f"Q[{j}] is not exactly 0, as a delay of any age needs"
        return None


def _rows_to_prove(system: DelaySystem, *, bounded: bool) -> int:
    rows = (1 + 3 * len(system.delays)) * len(system.A) + len(system.H)
    return rows + (system.C.shape[1] + len(system.D) if bounded else 0)


def positive(system: DelaySystem) -> list[Inequality]:
    """Return what must be positive beside -Omega: X, and Q_j, R_j where -Omega does not say so."""
    n = len(system.A)
    names = ["X", *(f"Q[{j}]" for j, x in enumerate(system.delays) if not x.any_age)]
    # where dj > 0, R is a diagonal block of -Omega
    names += [f"R[{j}]" for j, x in enumerate(system.delays) if x.d == 0]
    return [itself(name, n) for name in names]


def _rows_of(system: DelaySystem, *, bounded: bool) -> dict[str, int]:
    n, delays = len(system.A), list(enumerate(system.delays, 1))
    rows = {"x": n} | {f"x{j}": n for j, _ in delays}
    rows |= {"w": system.C.shape[1], "z": len(system.D)} if bounded else {}
    rows |= {f"s{j}": n for j, delay in delays if delay.d > 0}
    return rows | ({"h": len(system.H)} if system.blocks else {})


def _e_and_rates(
    x: Signal, s: dict[int, Signal], d: Sequence[Weight], longest: int | None
) -> tuple[Sum, dict[int, Sum]]:
    """Return e and every r_j as sums of x and the rows s_j."""
    if longest is None:
        return [(1, x)], {}
    rates: dict[int, Sum] = {j: [(d[longest], each)] for j, each in s.items() if j != longest}
    others = [(product(-1, d[j]), s[j]) for j in rates]
    return [(1, x), (d[longest], s[longest])], rates | {longest: [(1, s[longest]), *others]}


def longest_delay(system: DelaySystem) -> int | None:
    """Return the index b of the longest delay, the first of them; None if all are zero."""
    lengths = [delay.d for delay in system.delays]
    return lengths.index(max(lengths)) if any(lengths) else None


def rates_from_rows(system: DelaySystem, form: Inequality) -> Any:
    """Return the `fmpq_mat` G: a vector with rows r_j is G times the same one with rows s_j."""
    names = [name for name, size in form.rows.items() for _ in range(size)]
    G, longest = identity(len(names)), longest_delay(system)
    for j, delay in enumerate(system.delays):
        if longest is None or j == longest or not delay.d:
            continue
        for i in range(form.rows["x"]):
            s_j, s_b = (names.index(f"s{k + 1}") + i for k in (j, longest))
            G[s_j, s_j] = exact(system.delays[longest].d)
            G[s_b, s_j] = -exact(delay.d)
    return G


def minus_omega(
    system: DelaySystem,
    k1: Sequence[Any],
    k2: Sequence[Any],
    *,
    bounded: bool,
    gain: Matrix | None = None,
    shift: Shift | None = None,
) -> Inequality:
    """Return -Omega in X, Q[j], R[j], eps[b], gamma, and in Y or, with a `gain`, for Y = K X.

    Parameters
    ----------
    system, gain : their doubles are taken exactly.
    k1, k2 : one `fmpq` per delay.
    bounded : whether there is a gamma to prove.
    shift : for a rate of decay, the shifted system is used.
    """
    form = minus_omega_of_scalars(system, bounded=bounded, gain=gain, shift=shift)
    return form.fixed(Scalars(tuple(k1), tuple(k2), tuple(exact(x.d) for x in system.delays)))


def minus_omega_of_scalars(  # noqa: C901 - one sum, read from top to bottom
    system: DelaySystem, *, bounded: bool, gain: Matrix | None = None, shift: Shift | None = None
) -> Inequality:
    """Return -Omega as `minus_omega`, its parameters `Scalars`; a delay of zero stays zero."""
    N = len(system.delays)
    A = [exact_matrix(M) for M in (system.A, *(x.A for x in system.delays))]
    H = [exact_matrix(M) for M in (system.H, *(x.H for x in system.delays))]
    acts = [bool(system.immediate_feedback), *(bool(x.feedback) for x in system.delays)]
    growth = [1, *((1,) * N if shift is None else shift.growth)]
    if shift is not None:
        A[0] += shift.rate * identity(len(system.A))
    form = Inequality("-Omega", _rows_of(system, bounded=bounded))
    x = [form.row("x"), *(form.row(f"x{j + 1}") for j in range(N))]
    s = {j: form.row(f"s{j + 1}") for j in range(N) if system.delays[j].d > 0}
    k1, k2, d = (
        [lambda p, j=j, name=name: getattr(p, name)[j] for j in range(N)]
        for name in ("k1", "k2", "d")
    )
    e, r = _e_and_rates(x[0], s, d, longest_delay(system))

    def from_e(unknown: str | None, M: Any, right: Signal, weight: Any) -> None:
        """Subtract weight He(e'M U right)."""
        to = M.transpose()
        form.sums(unknown, [(w, to * each) for w, each in e], [(1, right)], -weight)

    given = None if gain is None else exact_matrix(gain)
    B, D2 = (
        exact_matrix(M) if given is None else exact_matrix(M) * given for M in (system.B, system.D2)
    )
    of_u = "Y" if given is None else "X"
    for i, (each, grown) in enumerate(zip(x, growth, strict=True)):
        from_e("X", A[i], each, grown)
        if acts[i]:
            from_e(of_u, B, each, grown)
            if bounded:
                form.twice(of_u, D2.transpose() * form.row("z"), each, -1)
        if system.blocks:
            form.twice("X", H[i].transpose() * form.row("h"), each, -grown)
    if bounded:
        w, z = form.row("w"), form.row("z")
        form.twice("X", exact_matrix(system.D).transpose() * z, x[0], -1)
        form.sums(None, e, [(1, exact_matrix(system.C) * w)], -1)
        form.twice(None, z, exact_matrix(system.D1) * w, -1)
        form.number("gamma", w)
        form.number("gamma", z)
    for j, delay in enumerate(system.delays):
        both: Sum = [(k1[j], x[0]), (k2[j], x[j + 1])]
        form.sums("X", both, [(1, x[0] - x[j + 1])], -1)
        if not delay.any_age:
            form.square(f"Q[{j}]", x[0], -1)
            form.square(f"Q[{j}]", x[j + 1])
        if j in r:
            form.sums(f"R[{j}]", r[j], r[j], product(HALF, d[j]))
            form.sums(f"R[{j}]", both, both, product(-HALF, d[j]))
    E = exact_matrix(system.E).transpose()
    for b, (columns, of_H) in enumerate(system.blocks):
        eps, of_e = f"eps[{b}]", [(w, (E * each).rows(columns)) for w, each in e]
        form.sums(eps, of_e, of_e, -HALF, is_number=True)
        form.number(eps, form.row("h").rows(of_H))
    return form
