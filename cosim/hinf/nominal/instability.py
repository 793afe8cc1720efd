"""What is known of a nominal loop that is not shown to be stable: unstable by proof, or undecided.

Unstable: det H(s), H(s) = s I - sum_i A_i e^{-s d_i}, has a zero with Re s > 0. About the computed
root m, with r = Re m / 2, balls cover the circle |s - m| = r. If |det H| is greater on all of them
than at m, then det H has a zero within: otherwise 1 / det H were regular there, and at m greater
than anywhere on the circle. The doubles of system and K are taken exactly.

A root on the imaginary axis cannot be told from one beside it in floating point. The loop is then
undecided, also where A_0 + ... + A_N is singular in rational arithmetic, which is a root at 0: it
does not go to rest, but whether it stays bounded is another matter.
"""

from __future__ import annotations

import math
from typing import Any, Literal

import flint

from cosim.core import NotAchievableError
from cosim.hinf.certificate import exact_terms
from cosim.hinf.exact import ball_precision, balls
from cosim.hinf.nominal.closed_loop import close
from cosim.hinf.nominal.roots import characteristic_roots
from cosim.models import DelaySystem, Matrix

Verdict = Literal["unstable", "undecided"]

_BITS = 256
_ARCS = (32, 256, 2048)


def verdict_of(system: DelaySystem, K: Matrix, abscissa: float) -> tuple[Verdict, str]:
    """Return what is known of a loop u = K x (m, n) whose abscissa is not negative, and why."""
    if abscissa > 0 and unstable_proved(system, K):
        return "unstable", (
            f"the nominal loop is not stable: its rightmost root has real part {abscissa:.6g} "
            "(proved to be positive)"
        )
    if root_at_zero(system, K):
        return "undecided", "a root of the nominal loop is 0, exactly: it does not return to rest"
    return "undecided", (
        f"the rightmost root of the nominal loop has real part {abscissa:.6g}, as computed: "
        "rounding leaves open on which side of the imaginary axis it lies"
    )


def root_at_zero(system: DelaySystem, K: Matrix) -> bool:
    """Whether 0 is a root of the loop: the sum of all its A_i is singular, in rationals."""
    first, *others = (A for A, _ in exact_terms(system, K).values())
    return bool(sum(others, first).det() == 0)


def unstable_proved(system: DelaySystem, K: Matrix) -> bool:
    """Prove that the loop has a root with a positive real part; False decides nothing."""
    try:
        root = complex(characteristic_roots(close(system, K), 1)[0])
    except NotAchievableError:
        return False
    terms = [(flint.arb(d), A) for d, (A, _) in exact_terms(system, K).items()]
    with ball_precision(_BITS):
        middle, radius = flint.acb(root.real, root.imag), flint.arb(root.real) / 2
        if not radius > 0:
            return False
        loop = [(d, balls(A)) for d, A in terms]
        at_root = abs(_determinant(loop, middle))
        for arcs in _ARCS:
            half = flint.arb(math.pi / arcs)
            turns = (flint.arb(2 * k + 1) * flint.arb.pi() / arcs for k in range(arcs))
            pieces = (flint.arb(turn.mid(), (half * 1.01).upper()) for turn in turns)
            circle = (middle + radius * flint.acb(piece.cos(), piece.sin()) for piece in pieces)
            if all(abs(_determinant(loop, s)) > at_root for s in circle):
                return True
    return False


def _determinant(loop: list[tuple[Any, Any]], s: Any) -> Any:
    n = loop[0][1].nrows()
    H = flint.acb_mat([[s if i == j else flint.acb(0) for j in range(n)] for i in range(n)])
    for d, A in loop:
        H = H - A * (-s * d).exp()
    return H.det()
