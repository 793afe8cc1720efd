"""A system with internal delays as a delay differential equation, where it is one.

    x'(t) = sum_k A_k x(t-h_k) + B_k u(t-h_k),  y(t) = sum_k C_k x(t-h_k) + D_k u(t-h_k)

h_k are the delays and sums of them: w = E (Cv x + Dv u + Dvw w) is substituted until no w is left,
which ends if no signal meets itself through delays alone. Otherwise the system is neutral.

Roots, norm and proofs are those of a loop whose disturbance acts at once. A delay that all inputs
or all outputs share changes neither roots nor norm and is left out; where inputs are late and
outputs are not, the transposed system has the same roots and norm.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cosim.core import InputError
from cosim.hinf.delay_lti.blocks import Blocks, Reals
from cosim.hinf.delay_lti.closed_loop import ClosedLoop
from cosim.models import Delay, DelaySystem

_SAME = 1e-15  # sums of delays that differ by rounding only, relative


class Term(NamedTuple):
    """What acts at one delay h [s]."""

    h: float
    A: Reals
    B: Reals
    C: Reals
    D: Reals


@dataclass(frozen=True, eq=False)
class Plain:
    """A loop with the roots and the norm of a system with internal delays.

    transposed : whether it is the loop of G(s)'.
    shift : the delay [s] that was left out, since all inputs or all outputs share it.
    """

    terms: tuple[Term, ...]
    transposed: bool
    shift: float

    def loop(self) -> ClosedLoop:
        """Return it as a closed loop, w for u and z for y."""
        delays = [term.h for term in self.terms]
        A, C = [term.A for term in self.terms], [term.C for term in self.terms]
        first = self.terms[0]
        if not (first.D.size and len(first.A)):
            return ClosedLoop(A, delays)
        return ClosedLoop(A, delays, first.B, C, first.D)

    def system(self) -> DelaySystem | None:
        """Return it as Eq. (7) without control; None if an output is late."""
        first, *rest = self.terms
        if any(term.C.any() for term in rest):
            return None
        delays = [Delay(term.h, term.A) for term in rest if term.A.any()]
        return DelaySystem(first.A, None, first.B, first.C, first.D, delays=delays)


def terms_of(blocks: Blocks) -> tuple[Term, ...]:
    """Return the terms by rising delay, the first at h = 0.

    Raises
    ------
    InputError : a neutral system.
    """
    if blocks.is_neutral:
        raise InputError(
            "a neutral system: a signal meets itself through delays alone",
            where="system",
            expected="a state in every feedback through a delay",
            hint="a filter in that loop makes it an ordinary delay differential equation",
        )
    n, m, p = blocks.order, blocks.inputs, blocks.outputs
    sums: dict[float, Reals] = {0.0: np.block([[blocks.A, blocks.B], [blocks.C, blocks.D]])}
    from_w = np.vstack([blocks.Bw, blocks.Dw])
    for h, W in _late(blocks):
        near = next((key for key in sums if abs(key - h) <= _SAME * h), h)
        sums[near] = sums.get(near, np.zeros((n + p, n + m))) + from_w @ W
    return tuple(
        Term(h, M[:n, :n], M[:n, n:], M[n:, :n], M[n:, n:])
        for h, M in sorted(sums.items())
        if h == 0.0 or M.any()
    )


def _late(blocks: Blocks) -> Iterator[tuple[float, Reals]]:
    """Yield h and the matrix (N, n + m) with which [x; u] of h ago acts on w."""
    direct = np.hstack([blocks.Cv, blocks.Dv])
    layer: dict[float, Reals] = {}
    for i, tau in enumerate(blocks.delays.tolist()):
        W = layer.setdefault(tau, np.zeros_like(direct))
        W[i] += direct[i]
    while layer:
        yield from layer.items()
        following: dict[float, Reals] = {}
        for h, W in layer.items():
            through = blocks.Dvw @ W
            for i in np.flatnonzero(through.any(axis=1)).tolist():
                key = h + float(blocks.delays[i])
                V = following.setdefault(key, np.zeros_like(direct))
                V[i] += through[i]
        layer = following


def plain_of(blocks: Blocks) -> Plain | None:
    """Return a loop of the same norm, whose disturbance acts at once; None if there is none.

    Raises
    ------
    InputError : a neutral system.
    """
    terms = terms_of(blocks)
    forms = [
        Plain(shifted, transposed, shift)
        for transposed in (False, True)
        for shifted, shift in [_unshifted(_transposed(terms) if transposed else terms)]
        if not any(term.B.any() or term.D.any() for term in shifted[1:])
    ]
    # outputs that are not late as well make Eq. (7)
    return min(forms, key=lambda one: one.system() is None, default=None)


def _transposed(terms: tuple[Term, ...]) -> tuple[Term, ...]:
    return tuple(Term(t.h, t.A.T, t.C.T, t.B.T, t.D.T) for t in terms)


def _unshifted(terms: tuple[Term, ...]) -> tuple[tuple[Term, ...], float]:
    """Return the terms without the delays that all inputs, and that all outputs, share."""
    total = 0.0
    for name in ("B", "C"):
        if any(term.D.any() for term in terms):
            break
        acting = [term.h for term in terms if getattr(term, name).any()]
        shift = min(acting, default=0.0)
        if shift and len(acting) == 1:
            moved = next(getattr(term, name) for term in terms if term.h == shift)
            nothing = np.zeros_like(moved)
            terms = tuple(
                term._replace(**{name: moved if term.h == 0.0 else nothing}) for term in terms
            )
            total += shift
    return tuple(t for t in terms if t.h == 0.0 or any(M.any() for M in t[1:])), total
