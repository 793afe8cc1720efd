"""What is known of a nominal loop that is not shown to be stable: unstable by proof, or undecided.

Unstable: a square about the computed root, right of the imaginary axis, has a root in it, counted
in balls (`cosim.hinf.exact.contour`). The doubles of system and K are taken exactly.

A root on the imaginary axis cannot be told from one beside it in floating point. The loop is then
undecided, also where A_0 + ... + A_N is singular in rational arithmetic, which is a root at 0: it
does not go to rest, but whether it stays bounded is another matter.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Literal

import flint

from cosim.core import NotAchievableError
from cosim.hinf.certificate import exact_terms
from cosim.hinf.delay_lti.closed_loop import close
from cosim.hinf.delay_lti.roots import characteristic_roots
from cosim.hinf.exact import Contour, NotCountedError, ball_precision
from cosim.models import DelaySystem, Matrix

Verdict = Literal["unstable", "undecided"]
"""What is known of a loop that is not proved stable."""

_BITS = 256
_SQUARE = ((-1, -1), (1, -1), (1, 1), (-1, 1))
_SHARES = (0.8, 0.4)
"""Half widths of the squares tried, against the distance of the root from the axis."""


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
    terms = {d: A for d, (A, _) in exact_terms(system, K).items()}
    with ball_precision(_BITS):
        for share in _SHARES:
            r = share * root.real
            corners = [flint.acb(root.real + r * x, root.imag + r * y) for x, y in _SQUARE]
            with suppress(NotCountedError):
                if r > 0 and Contour.balanced(terms).within(corners):
                    return True
    return False
