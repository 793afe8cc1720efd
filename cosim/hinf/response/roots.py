"""Characteristic roots of a system with internal delays: the zeros of det M(s).

Of a delay differential equation they are found and counted by `cosim.hinf.nominal`. Of a neutral
system, which has infinitely many near a vertical line, the eigenvalues of the collocated transport
of every channel are polished on M itself; nothing counts them.
"""

from __future__ import annotations

import numpy as np

from cosim.core import InputError, NotAchievableError
from cosim.hinf.nominal import (
    ClosedLoop,
    Roots,
    characteristic_roots,
    collocated,
    distinct,
    polish,
)
from cosim.hinf.response.blocks import Blocks, balanced
from cosim.hinf.response.high_frequency import HighFrequency
from cosim.hinf.response.retarded import terms_of

_NODES = 60


def roots_of(blocks: Blocks, count: int = 10) -> Roots:
    """Compute the rightmost characteristic roots [1/s], rightmost first.

    Returns
    -------
    As `characteristic_roots`; empty where there is neither a state nor a feedback.

    Raises
    ------
    InputError : `count` is less than 1.
    NotAchievableError : roots that cannot all be found.
    """
    if count < 1:
        raise InputError("not a number of roots", where="count", expected=">= 1", got=str(count))
    if blocks.is_neutral:
        return _neutral_roots(balanced(blocks)[0], count)
    if not blocks.order:
        return np.zeros(0, dtype=np.complex128)
    terms = [term for term in terms_of(blocks) if term.h == 0.0 or term.A.any()]
    loop = ClosedLoop([term.A for term in terms], [term.h for term in terms])
    return characteristic_roots(loop, count)


def is_stable(blocks: Blocks) -> bool:
    """Whether every characteristic root has a negative real part.

    A neutral system has roots near the lines that its difference equation v = Dvw E v has; these
    must lie left of the axis, whatever small changes of the delays (strong stability), which is
    decided by a bound: the spectral radius of |Dvw| below one.

    Raises
    ------
    NotAchievableError : roots that cannot be found, or that bound is not enough.
    """
    roots = roots_of(blocks, 4)
    if roots.size and not roots.real.max() < 0.0:
        return False
    if blocks.is_neutral and HighFrequency(blocks).through_delays is None:
        if blocks.delays.size == 1:
            return False
        raise NotAchievableError(
            "the stability of this neutral system is not decided",
            where="system",
            expected="a spectral radius of |Dvw| below one",
            got="one or more: its roots may come as near the axis as one likes",
        )
    return True


def _neutral_roots(blocks: Blocks, count: int) -> Roots:
    """Return roots near the eigenvalues of the collocated system, polished."""
    from_w = np.vstack([blocks.Bw, blocks.Dvw])
    late = {tau: from_w * (blocks.delays == tau) for tau in set(blocks.delays.tolist())}
    seeds = np.linalg.eigvals(collocated(blocks.A, blocks.Cv, late, _NODES))
    seeds = seeds[seeds.imag >= 0.0]
    seeds = seeds[np.argsort(-seeds.real, kind="stable")][: 4 * count + 30]
    polished = [polish(blocks, complex(seed)) for seed in seeds]
    found = distinct(blocks, [root for root in polished if root is not None]).tolist()
    # many lie next to one line: there the slow ones come first
    step = 0.1 / float(blocks.delays.max())
    found.sort(key=lambda root: (-round(root.real / step), root.imag))
    pairs = [[r, r.conjugate()] if r.imag else [r] for r in found]
    whole = [root for pair in pairs for root in pair]
    end = count + (0 < count < len(whole) and whole[count - 1].imag > 0.0)
    return np.array(whole[:end], dtype=np.complex128)
