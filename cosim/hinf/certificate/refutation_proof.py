"""Farkas' lemma for the LMI of Theorem 2, in rational arithmetic: that it has no solution.

At fixed k1, k2, delays and gamma, -Omega of `exact_lmi` is affine in v = (X, Y, Qbar, Rbar, eps).
Multipliers W >= 0, Z_X > 0 and Z_Qj > 0 (none where any age is allowed: Qbar_j = 0) with

    <W, -Omega(v)> + <Z_X, X> + sum_j <Z_Qj, Qbar_j> = c   for every v,   c <= 0,

leave no v with -Omega > 0, X > 0, Qbar > 0: the left side would be positive.

W is given as Z on the rows other than m_j. -Omega has -dj k1j Rbar_j, -dj k2j Rbar_j and
dj Rbar_j at (x,mj), (xj,mj) and (mj,mj): row m_j times k1j on row x, times k2j on row xj, leaves
rows m_j out. So with T = [I, M], M[x, mj] = k1j I, M[xj, mj] = k2j I, a Z > 0 makes
W = T'Z T >= 0, and not zero.

The equalities are not taken from any table here: -Omega is evaluated exactly at the unit vectors
of v by the very function that proves solutions.

Other k1, k2 are another matter. But where there is no solution there is none at greater delays or
a smaller gamma either: rows r_j and m_j taken out, Omega grows with every dj, and falls with
gamma.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import flint

from cosim.hinf.certificate.block_multipliers import joined
from cosim.hinf.certificate.exact_lmi import ExactVariables, minus_omega
from cosim.hinf.certificate.proof import CertificateCheck, require_size, uncertainty_claim
from cosim.hinf.certificate.rational import first_bad_matrix, to_text

if TYPE_CHECKING:
    from cosim.models import DelaySystem

Entries = dict[tuple[int, int], Any]
"""Entries of a symmetric matrix on and below the diagonal, zeros left out."""


@dataclass(frozen=True)
class Place:
    """Where the LMI is refuted: rationals, k1 and k2 one per delay; gamma None: stability."""

    k1: tuple[Any, ...]
    k2: tuple[Any, ...]
    gamma: Any


@dataclass(frozen=True)
class Multipliers:
    """`flint.fmpq_mat`: Z on the rows of the LMI but m_j; Q one per delay, None: any age."""

    Z: Any
    X: Any
    Q: tuple[Any, ...]

    def matrices(self) -> list[tuple[str, Any]]:
        """Return every multiplier with its name: all must be symmetric and positive."""
        several = [(f"Q[{j}]", Q) for j, Q in enumerate(self.Q) if Q is not None]
        return [("Z", self.Z), ("X", self.X), *several]


class AffineLmi:
    """-Omega at a place, entry by entry: its constant, and its part by each unknown.

    Attributes
    ----------
    rows : the block of every row that Z has, those of m_j left out.
    constant : entries where all unknowns are zero.
    parts : by (name, i, j), an entry on or below the diagonal of a symmetric unknown: X, Q1..,
        R1.., or any entry of Y, or (eps, i, 0) for block i of F.
    """

    def __init__(self, system: DelaySystem, place: Place) -> None:
        self._system, self._place = system, place
        self._lift: list[list[tuple[int, Any]]] = []
        zero = self._at(None, 0, 0)
        self.constant = zero
        self.parts: dict[tuple[str, int, int], Entries] = {}
        for key in self._keys():
            there = self._at(*key)
            changed = {k: there.get(k, 0) - zero.get(k, 0) for k in {*there, *zero}}
            self.parts[key] = {k: value for k, value in changed.items() if value != 0}

    def against(self, Z: Any, entries: Entries) -> Any:
        """Return <T'Z T, these entries>."""
        total = flint.fmpq(0)
        for (i, j), value in entries.items():
            there = flint.fmpq(0)
            for a, left in self._lift[i]:
                for b, right in self._lift[j]:
                    there += left * right * Z[a, b]
            total += value * there * (1 if i == j else 2)
        return total

    def _keys(self) -> Iterator[tuple[str, int, int]]:
        n, m = self._system.B.shape
        late = [delay.d > 0 for delay in self._system.delays]
        names = ["X"]
        names += [f"Q{j}" for j, x in enumerate(self._system.delays, 1) if not x.any_age]
        names += [f"R{j}" for j, is_late in enumerate(late, 1) if is_late]
        for name in names:
            yield from ((name, i, j) for i in range(n) for j in range(i + 1))
        yield from (("Y", i, j) for i in range(m) for j in range(n))
        yield from (("eps", i, 0) for i in range(len(self._system.blocks)))

    def _at(self, name: str | None, i: int, j: int) -> Entries:
        """-Omega where one unknown is a unit (of a symmetric one, two entries), the others zero."""
        n, m = self._system.B.shape

        def unit(own: str, rows: int) -> Any:
            matrix = flint.fmpq_mat(rows, n)
            if own == name:
                matrix[i, j] = 1
                if own != "Y":
                    matrix[j, i] = 1
            return matrix

        N = len(self._system.delays)
        blocks = range(len(self._system.blocks))
        eps = joined([flint.fmpq(int(name == "eps" and i == k)) for k in blocks])
        variables = ExactVariables(
            X=unit("X", n),
            Q=tuple(unit(f"Q{k}", n) for k in range(1, N + 1)),
            R=tuple(unit(f"R{k}", n) for k in range(1, N + 1)),
            eps=eps,
            k1=self._place.k1,
            k2=self._place.k2,
            gamma=self._place.gamma,
        )
        lmi = minus_omega(self._system, unit("Y", m), variables)
        if not self._lift:
            self._make_lift(lmi.row_names)
        rows = enumerate(lmi.lower)
        return {(a, b): x for a, row in rows for b, x in enumerate(row) if x != 0}

    def _make_lift(self, names: list[str]) -> None:
        """Columns of T: what each row of the LMI is in rows of Z."""
        kept = [index for index, name in enumerate(names) if not name.startswith("m")]
        self.rows = [names[index] for index in kept]
        n = self._system.A.shape[0]
        seen: dict[str, int] = {}
        for name in names:
            a = seen.get(name, 0)
            seen[name] = a + 1
            if name.startswith("m"):
                j = int(name[1:])
                self._lift.append([(a, self._place.k1[j - 1]), (j * n + a, self._place.k2[j - 1])])
            else:
                self._lift.append([(self.rows.index(name) + a, flint.fmpq(1))])


def refutation_claim(system: DelaySystem, place: Place) -> dict[str, Any]:
    """Return the claim of a refutation as JSON values."""
    return {
        "property": "no X, Y, Q, R, eps meets the LMI of Theorem 2 at these k1, k2",
        "gamma": None if place.gamma is None else to_text(place.gamma),
        "k1": [to_text(value) for value in place.k1],
        "k2": [to_text(value) for value in place.k2],
        "delays": [
            {
                "d": delay.d,
                "age": ("any age up to it" if delay.any_age else "constant") + ", it or more",
                "feedback": delay.feedback,
            }
            for delay in system.delays
        ],
        **uncertainty_claim(system),
        "inputs": "doubles",
    }


def refuted(system: DelaySystem, place: Place, multipliers: Multipliers) -> CertificateCheck:
    """Prove the claim of `refutation_claim`, or return why it is not proved.

    Raises
    ------
    InputError : the LMI has more than `MAX_ROWS` rows.
    """
    reason = _failure(system, place, multipliers)
    return CertificateCheck(
        valid=reason is None, reason=reason, claim=refutation_claim(system, place)
    )


def _failure(system: DelaySystem, place: Place, multipliers: Multipliers) -> str | None:
    n, N = system.A.shape[0], len(system.delays)
    rows = (1 + 2 * N) * n + system.H.shape[0] + system.C.shape[1] + system.D.shape[0]
    require_size(rows, done="refuted")
    if any(value == 0 for value in place.k2):
        return "a k2 is 0"
    bad = first_bad_matrix(multipliers.matrices())
    if bad is not None:
        return f"the multiplier {bad} is not positive definite"
    lmi = AffineLmi(system, place)
    if multipliers.Z.nrows() != len(lmi.rows):
        return f"the multiplier Z has {multipliers.Z.nrows()} rows, the LMI {len(lmi.rows)}"
    for (name, i, j), entries in lmi.parts.items():
        total = lmi.against(multipliers.Z, entries)
        own = multipliers.X if name == "X" else None
        if name.startswith("Q"):
            own = multipliers.Q[int(name[1:]) - 1]
        if own is not None:
            total += own[i, j] * (1 if i == j else 2)
        if total != 0:
            return f"the multipliers do not cancel {name}[{i}][{j}]"
    if lmi.against(multipliers.Z, lmi.constant) > 0:
        return "the multipliers leave a positive constant"
    return None
