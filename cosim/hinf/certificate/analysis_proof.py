"""The proof, in rational arithmetic, of what a given gain guarantees: Theorem 1 and beyond.

The inequalities are those of `cosim.hinf.theorems.ages`. At order 0 the terms of each delay grow
with it, so what holds at dj holds for every constant delay up to dj. From order 1 on the
functional belongs to its delay, and the claim is about exactly that one; or, with `lower`, about
every constant delay of a box: there -Phi > 0 is shown at every corner, with the same P, Q, R. In
between it follows, since y is affine in the delays and f and v are without them, so that Phi is
affine in them but for dj^2 f'Rj f, convex by Rj > 0. P + diag(..) > 0 at the upper ends holds
below them, by Qj > 0. (At dj = 0, xj = x, W_j0 = x and the other W_jk = 0: the same sums, with
V = x'P x.)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from cosim.core import InputError
from cosim.hinf.certificate.proof import CertificateCheck, claim_of, require_size
from cosim.hinf.exact import to_text
from cosim.hinf.theorems import (
    Age,
    Loop,
    age_inequalities,
    eps_by_name,
    first_failure,
    gamma_by_name,
    widest_functional,
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

    def by_name(self) -> dict[str, Any]:
        """Return the unknowns of the inequalities by name."""
        return dict(self.matrices()) | eps_by_name(self.eps) | gamma_by_name(self.gamma)

    def matrices(self) -> list[tuple[str, Any]]:
        """Return every matrix with its name: all must be symmetric."""
        several = [(f"Q[{j}]", Q) for j, Q in enumerate(self.Q) if Q is not None]
        return [("P", self.P), *several, *((f"R[{j}]", R) for j, R in enumerate(self.R))]


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
    loop = Loop.of(system, gain)
    ages = [
        Age(loop, j, widest_functional(x), v.order, v.lower[j] if v.lower else None)
        for j, x in enumerate(loop.delays)
    ]
    return first_failure(age_inequalities(loop, ages, bounded=v.gamma is not None), v.by_name())
