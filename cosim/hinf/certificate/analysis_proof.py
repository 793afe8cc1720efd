"""The proof, in rational arithmetic, of what a given gain guarantees: Theorem 1 and beyond.

The conditions of `analysis_lmi`, written again block by block from the functional, apart from
the solver's arrays. With the doubles of system and gain taken exactly, A_i + phi_i B K exact,
delays of zero folded into x(t) (they are no delays), and order N (0 where any age is allowed):

    -Phi > 0,  P + diag(0, (2k+1)/dj Qj) > 0,  Qj > 0 (none where any age is allowed),
    Rj > 0,  gamma > 0.

-Phi > 0 implies every eps > 0 and, with gamma > 0, gamma > |D1|.

At order 0 the terms of each delay grow with it, so what holds at dj holds for every constant
delay up to dj. From order 1 on the functional belongs to its delay, and the claim is about
exactly that one; or, with `lower`, about every constant delay of a box: there -Phi > 0 is shown
at every corner, with the same P, Q, R. In between it follows, since y is affine in the delays
and f and v are without them, so that Phi is affine in them but for dj^2 f'Rj f, convex by
Rj > 0. P + diag(..) > 0 at the upper ends holds below them, by Qj > 0. (At dj = 0, xj = x,
W_j0 = x and the other W_jk = 0: the same sums, with V = x'P x.)
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import flint

from cosim.core import InputError
from cosim.hinf.certificate.block_multipliers import Blocks, scalings
from cosim.hinf.certificate.proof import CertificateCheck, claim_of, require_size
from cosim.hinf.certificate.rational import (
    exact,
    exact_matrix,
    first_bad_matrix,
    first_bad_pivot,
    identity,
    lower_triangle,
    to_text,
)

if TYPE_CHECKING:
    from cosim.models import DelaySystem, Matrix

EXACTLY = "constant, exactly d"
"""The text of a claim about exactly one delay."""

MAX_BOX = 4
"""Most delays of a claim that covers smaller ones: it has two corners for each, multiplied."""

MAX_ORDER = 12
"""Highest order; beyond order 3 gamma changes in the fifth digit."""


@dataclass(frozen=True)
class AnalysisVariables:
    """A solution as floats: P; Q, R one per positive delay (Q None where any age is allowed).

    P is square with n + n sum_j N_j rows, N_j the order, 0 where any age is allowed. `eps` is one
    number, or a tuple of one per block of F; None without uncertainty. `gamma` is None for
    stability alone. `lower`: the least value [s] of each positive delay that is covered, None for
    any age; None as a whole where only the delays themselves are covered.
    """

    order: int
    P: Matrix
    Q: tuple[Matrix | None, ...]
    R: tuple[Matrix, ...]
    eps: float | tuple[float, ...] | None
    gamma: float | None
    lower: tuple[float | None, ...] | None = None


@dataclass(frozen=True)
class ExactAnalysis:
    """The variables as rationals, `fmpq_mat` and `fmpq`; see `AnalysisVariables`.

    lower : the least of each positive delay that is claimed, None for any age; None as a whole
        where the claim is about exactly these delays, or is that of order 0.
    """

    order: int
    P: Any
    Q: tuple[Any, ...]
    R: tuple[Any, ...]
    eps: Any
    gamma: Any
    lower: tuple[Any, ...] | None = None

    def matrices(self) -> list[tuple[str, Any]]:
        """Return every matrix with its name: all must be symmetric."""
        several = [(f"Q[{j}]", Q) for j, Q in enumerate(self.Q) if Q is not None]
        return [("P", self.P), *several, *((f"R[{j}]", R) for j, R in enumerate(self.R))]


@dataclass(frozen=True)
class ExactLoop:
    """The closed loop, exactly: one entry of A, H, D for x(t) and for every positive delay."""

    A: list[Any]
    H: list[Any]
    D: list[Any]
    C: Any
    D1: Any
    E: Any
    blocks: Blocks
    d: list[Any]
    orders: list[int]


def orders_of(system: DelaySystem, order: int) -> list[int]:
    """Return the order of every positive delay: 0 where any age is allowed."""
    return [0 if delay.any_age else order for delay in system.delays if delay.d > 0]


def analysis_claim(system: DelaySystem, v: ExactAnalysis) -> dict[str, Any]:
    """Return the claim of a certificate: as `claim_of`, with the order and the delays covered."""
    claim = claim_of(system, v.gamma)
    late = 0
    for delay_claim, delay in zip(claim["delays"], system.delays, strict=True):
        lower = None if v.lower is None else v.lower[late] if delay.d > 0 else 0
        if v.order > 0 and not delay.any_age:
            delay_claim["age"] = EXACTLY if lower is None else "constant, up to d"
            if lower is not None and lower != 0:
                delay_claim["age"] = f"constant, from {to_text(lower)} to d"
        late += delay.d > 0
    return claim | {"order": v.order}


def covers_smaller(claim: dict[str, Any]) -> bool:
    """Whether a claim covers every delay from zero up to the system's."""
    return all(delay["age"] != EXACTLY and "from" not in delay["age"] for delay in claim["delays"])


def analysis_proved(system: DelaySystem, gain: Matrix, v: ExactAnalysis) -> CertificateCheck:
    """Prove the claim of `analysis_claim` for u = K x(t-d_f), or return why it is not proved.

    Parameters
    ----------
    system : its doubles are taken exactly.
    gain : (m, n) K, its doubles taken exactly.
    v : symmetric matrices and numbers that fit the system.

    Raises
    ------
    InputError : more than `MAX_ROWS` rows.
    """
    reason = _failure(system, gain, v)
    claim = analysis_claim(system, v)
    return CertificateCheck(valid=reason is None, reason=reason, claim=claim)


def _failure(system: DelaySystem, gain: Matrix, v: ExactAnalysis) -> str | None:
    n, orders = system.A.shape[0], orders_of(system, v.order)
    rows = n * (1 + len(orders) + sum(orders)) + system.E.shape[1] + system.C.shape[1]
    require_size(rows)
    if v.gamma is not None and not v.gamma > 0:
        return "gamma is not positive"
    if sum(low is not None for low in v.lower or ()) > MAX_BOX:
        raise InputError(
            "too many delays to be covered at once",
            where="variables.lower",
            expected=f"at most {MAX_BOX} numbers",
            got=str(len(v.lower or ())),
        )
    loop = exact_loop(system, gain, orders)
    positive = [(f"Q[{j}]", Q) for j, Q in enumerate(v.Q) if Q is not None]
    positive += [(f"R[{j}]", R) for j, R in enumerate(v.R)]
    positive.append(("P, with what Q adds to it,", _functional(loop, v)))
    name = first_bad_matrix(positive)
    if name is not None:
        return f"{name} is not positive definite"
    for delays in _corners(loop.d, v.lower):
        lower, names = minus_phi(replace(loop, d=delays), v)
        bad = first_bad_pivot(lower)
        if bad is not None:
            at = "" if delays == loop.d else f" at delays {', '.join(map(str, delays))}"
            return (
                f"-Phi is not positive definite{at}: pivot {bad + 1} of {len(lower)}, "
                f"in the rows of {names[bad]}, is not positive"
            )
    return None


def _corners(upper: list[Any], lower: tuple[Any, ...] | None) -> list[list[Any]]:
    """The corners of the box of delays that is claimed, its upper ends first."""
    if lower is None:
        return [upper]
    ends = [
        (d,) if low is None or low == d else (d, low) for d, low in zip(upper, lower, strict=True)
    ]
    return [list(corner) for corner in itertools.product(*ends)]


def exact_loop(system: DelaySystem, gain: Matrix, orders: list[int]) -> ExactLoop:
    """Return the loop with u = K sum_i S_i x(t-d_i), exactly, delays of zero in x(t)."""
    B, D2 = exact_matrix(system.B), exact_matrix(system.D2)
    at_once, *late = [exact_matrix(gain * selection) for selection in system.selections]
    A, H = [exact_matrix(system.A) + B * at_once], [exact_matrix(system.H)]
    D = [exact_matrix(system.D) + D2 * at_once]
    for delay, selected in zip(system.delays, late, strict=True):
        own, out = exact_matrix(delay.A) + B * selected, D2 * selected
        if delay.d > 0:
            A.append(own)
            H.append(exact_matrix(delay.H))
            D.append(out)
        else:
            A[0], H[0], D[0] = A[0] + own, H[0] + exact_matrix(delay.H), D[0] + out
    return ExactLoop(
        A,
        H,
        D,
        exact_matrix(system.C),
        exact_matrix(system.D1),
        exact_matrix(system.E),
        system.blocks,
        [exact(delay.d) for delay in system.delays if delay.d > 0],
        orders,
    )


def _functional(loop: ExactLoop, v: ExactAnalysis) -> Any:
    """P + diag(0, (2k+1)/dj Qj): V is at least this form, by Bessel's inequality on Qj."""
    n, whole = loop.A[0].nrows(), flint.fmpq_mat(v.P)
    row = n
    for j, order in enumerate(loop.orders):
        for k in range(order):
            _add(whole, row, row, (2 * k + 1) / loop.d[j] * v.Q[j])
            row += n
    return whole


def _add(whole: Any, row: int, column: int, block: Any) -> None:
    for a in range(block.nrows()):
        for b in range(block.ncols()):
            whole[row + a, column + b] += block[a, b]


def minus_phi(  # noqa: C901 - one table, read from top to bottom
    loop: ExactLoop, v: ExactAnalysis
) -> tuple[list[list[Any]], list[str]]:
    """Return the lower triangle of -Phi, and the block name of every row.

    Linear maps of the vector (x, x1.., W.., w, p) are dictionaries from a block's name to the
    matrix that acts on it; Phi is a sum of products of such maps.
    """
    n, later = loop.A[0].nrows(), range(len(loop.d))
    one = identity(n)
    sizes = {"x": n} | {f"x{j}": n for j in later}
    sizes |= {f"W{j},{k}": n for j in later for k in range(loop.orders[j])}
    on = ["x", *(f"x{j}" for j in later)]
    f = dict(zip(on, loop.A, strict=True))
    if v.gamma is not None:
        sizes["w"] = loop.C.ncols()
        f["w"] = loop.C
    if loop.blocks:
        sizes["p"] = loop.E.ncols()
        f["p"] = loop.E

    order = {name: place for place, name in enumerate(sizes)}
    t: dict[tuple[str, str], Any] = {}

    def subtract(left: dict[str, Any], middle: Any, right: dict[str, Any]) -> None:
        """-(left' middle right), its blocks above and on the diagonal."""
        for a, M in left.items():
            for b, N in right.items():
                if order[a] <= order[b]:
                    term = M.transpose() * middle * N
                    t[a, b] = t[a, b] - term if (a, b) in t else -term

    state = [({"x": one}, f)]
    for j in later:
        d, Q, R = loop.d[j], v.Q[j], v.R[j]
        if Q is not None:
            subtract({"x": one}, Q, {"x": one})
            subtract({f"x{j}": one}, -Q, {f"x{j}": one})
        subtract(f, d * d * R, f)
        for k in range(loop.orders[j] + 1):
            # the integral of L_k x' over the delay, by parts
            change = {"x": one, f"x{j}": (-1) ** (k + 1) * one}
            for i in range(k):
                if (k + i) % 2:
                    change[f"W{j},{i}"] = -2 * (2 * i + 1) * one
            subtract(change, -(2 * k + 1) * R, change)
            if k < loop.orders[j]:
                state.append(({f"W{j},{k}": d * one}, change))
    for a, (_, rate) in enumerate(state):
        for b, (value, _) in enumerate(state):
            block = _block(v.P, b * n, a * n, n)
            subtract(value, block, rate)
            subtract(rate, block.transpose(), value)
    if loop.blocks:
        q = dict(zip(on, loop.H, strict=True))
        L_p, L_q = scalings(loop.blocks, v.eps)
        subtract(q, L_q, q)
        p = {"p": identity(sizes["p"])}
        subtract(p, -L_p, p)
    if v.gamma is not None:
        z = dict(zip(on, loop.D, strict=True)) | {"w": loop.D1}
        subtract(z, 1 / v.gamma * identity(loop.D1.nrows()), z)
        w = {"w": identity(sizes["w"])}
        subtract(w, -v.gamma * identity(sizes["w"]), w)
    names = [name for name in sizes for _ in range(sizes[name])]
    return lower_triangle(list(sizes), sizes, t), names


def _block(matrix: Any, row: int, column: int, n: int) -> Any:
    entries = [matrix[row + a, column + b] for a in range(n) for b in range(n)]
    return flint.fmpq_mat(n, n, entries)
