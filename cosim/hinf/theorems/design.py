"""The inequality that designs a gain for the functional of `cosim.hinf.theorems.ages`.

In -Phi an unknown K would be multiplied by P and R. So x' is kept as a row r, tied to the loop by a
multiplier (Finsler's lemma, the descriptor method of Fridman) with given m, linear in all rows,

    2 m'U (sum_i A_i x(t - tau_i) + B K x(t - tau_f) + C w + E p - r),    m = x + S_0'r + ...,

added to V'. With every row x = X xh but those of w and p, U'X = I and Y = K X, the matrices of the
functional become ones of the same shape and signs, and the whole is linear in them, X (n, n; not
symmetric) and Y, with z, q by Schur complements and p = eh ph, eh = 1/eps, one for each block of F:

    -Phi = -V' - He mh'(sum_i A_i X xh_i + B Y xh_f + C w + eh E ph - X rh)
           - He z'(D X xh + D2 Y xh_f + D1 w) + gamma (w'w + z'z)
           - He h'(sum_i H_i X xh_i) + eh (h'h + ph'ph) > 0.

**What is lost.** It is convex for a given m only. m = x + b r, one number b for all, is the usual
choice. At a gain whose analysis is proved nothing is lost with that of `multiplier_of`: there
Phi < 0 of the analysis follows with U = P_00, U_0 = sum dj^2 Rj, U_jk = dj P_k0 (the coupling of x'
in Phi, and its own block), so that with

    S_0' = sum dj^2 Rj P_00^-1,   S_jk' = dj P_0k P_00^-1

there is a solution at that gamma with that K. Analysis and design in turn only improve a gain.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from cosim.hinf.exact import exact_matrix
from cosim.hinf.theorems.ages import Age, Corner, rows_of_corner, subtract_derivative
from cosim.hinf.theorems.inequality import Inequality, Signal

if TYPE_CHECKING:
    from cosim.models import DelaySystem


def minus_phi_of_design(
    system: DelaySystem,
    ages: Sequence[Age],
    multiplier: Mapping[str, Any],
    corner: Sequence[Corner],
    *,
    bounded: bool,
) -> Inequality:
    """Return -Phi at a corner in X, Y, gamma, eps[b] (eh above) and the unknowns of the ages.

    Parameters
    ----------
    ages : of every positive delay, with the whole state.
    multiplier : S_0' by the name "r", and S' of other rows by theirs; `fmpq_mat` (n, n).
    bounded : whether there is a gamma.
    """
    n = len(system.A)
    rows = {"x": n} | {name: n for age in ages for name in age.names}
    rows |= {"w": system.C.shape[1]} if bounded else {}
    rows |= {"p": system.E.shape[1]} if system.blocks else {}
    rows |= {"r": n} | ({"z": len(system.D)} if bounded else {})
    rows |= {"h": len(system.H)} if system.blocks else {}
    form = Inequality("-Phi of a design", rows | rows_of_corner(ages, corner))
    xi = [form.row(name) for name in rows]
    x, r = form.row("x"), form.row("r")
    subtract_derivative(form, ages, corner, r, xi)

    m = sum((S * form.row(name) for name, S in multiplier.items()), x)
    remaining = iter(ages)
    on = [x, *(form.row(f"x{next(remaining).j}") if delay.d > 0 else x for delay in system.delays)]
    acts = [bool(system.immediate_feedback), *(bool(delay.feedback) for delay in system.delays)]
    acting = next(each for each, acted in zip(on, acts, strict=True) if acted)

    def through(unknown: str, left: Signal, M: Any, right: Signal) -> None:
        """Subtract He(left'M U right)."""
        form.twice(unknown, exact_matrix(M).transpose() * left, right, -1)

    for A, each in zip([system.A, *(delay.A for delay in system.delays)], on, strict=True):
        through("X", m, A, each)
    form.twice("X", m, r)
    through("Y", m, system.B, acting)
    if bounded:
        w, z = form.row("w"), form.row("z")
        through("X", z, system.D, x)
        through("Y", z, system.D2, acting)
        form.twice(None, m, exact_matrix(system.C) * w, -1)
        form.twice(None, z, exact_matrix(system.D1) * w, -1)
        form.number("gamma", w)
        form.number("gamma", z)
    if system.blocks:
        p, h = form.row("p"), form.row("h")
        for H, each in zip([system.H, *(delay.H for delay in system.delays)], on, strict=True):
            through("X", h, H, each)
        for b, (columns, of_H) in enumerate(system.blocks):
            eh, p_b = f"eps[{b}]", p.rows(columns)
            form.twice(eh, m, exact_matrix(system.E[:, columns]) * p_b, -1, is_number=True)
            form.number(eh, p_b)
            form.number(eh, h.rows(of_H))
    return form
