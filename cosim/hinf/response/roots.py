"""Characteristic roots of a system with internal delays: the zeros of det M(s).

Of a delay differential equation they are found and counted by `cosim.hinf.nominal`. Of a neutral
system, which has infinitely many near a vertical line, the eigenvalues of the collocated transport
of every channel are polished on M itself; nothing counts them.
"""

from __future__ import annotations

import math

import numpy as np
import scipy

from cosim.core import InputError, NotAchievableError
from cosim.hinf.nominal import ClosedLoop, Roots, characteristic_roots, collocation
from cosim.hinf.response.blocks import Blocks, Reals, balanced
from cosim.hinf.response.high_frequency import HighFrequency
from cosim.hinf.response.retarded import terms_of

_NODES = 60
_RESIDUAL = 1e-10


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
    found: list[complex] = []
    seeds = np.linalg.eigvals(_transport(blocks, _NODES))
    seeds = seeds[seeds.imag >= 0.0]
    for seed in seeds[np.argsort(-seeds.real, kind="stable")][: 4 * count + 30]:
        root = _polished(blocks, complex(seed))
        if root is None:
            continue
        near = 1e-8 * (abs(root) + 1.0 / float(blocks.delays.max()))
        if abs(root.imag) <= near:
            root = complex(root.real, 0.0)
        root = complex(root.real, abs(root.imag))
        if not any(abs(root - other) <= near for other in found):
            found.append(root)
    # many lie next to one line: there the slow ones come first
    step = 0.1 / float(blocks.delays.max())
    found.sort(key=lambda root: (-round(root.real / step), root.imag))
    pairs = [[r, r.conjugate()] if r.imag else [r] for r in found]
    whole = [root for pair in pairs for root in pair]
    end = count + (0 < count < len(whole) and whole[count - 1].imag > 0.0)
    return np.array(whole[:end], dtype=np.complex128)


def _transport(blocks: Blocks, nodes: int) -> Reals:
    """Return the matrix of x and of v_i at Chebyshev points of [-tau_i, 0), 0 left out."""
    n, N = blocks.order, blocks.delays.size
    _, D = collocation(nodes)
    size = n + N * nodes
    matrix = np.zeros((size, size))
    last = n + nodes * np.arange(1, N + 1) - 1  # where w_i stands
    matrix[:n, :n] = blocks.A
    matrix[:n, last] = blocks.Bw
    for i, tau in enumerate(blocks.delays.tolist()):
        own = slice(n + i * nodes, n + (i + 1) * nodes)
        matrix[own, own] = D[1:, 1:] * (2.0 / tau)
        first = D[1:, :1] * (2.0 / tau)
        matrix[own, :n] += first * blocks.Cv[i]
        matrix[own, last] += first * blocks.Dvw[i]
    return matrix


def _polished(blocks: Blocks, root: complex) -> complex | None:
    """Return the zero of det M that successive linear problems lead to from `root`, or None."""
    longest = float(blocks.delays.max())
    for _ in range(40):
        if not -root.real * longest < 200.0:
            return None
        M, slope = blocks.characteristic_matrix(root)
        mu = scipy.linalg.eigvals(M, slope)
        mu = mu[np.isfinite(mu)]
        if not mu.size:
            return None
        step = complex(mu[np.argmin(np.abs(mu))])
        root -= step
        if abs(step) <= 1e-15 * (abs(root) + 1.0):
            break
    M, _ = blocks.characteristic_matrix(root)
    late = np.abs(np.vstack([blocks.Bw, blocks.Dvw])) * math.exp(-root.real * longest)
    size = 1.0 + abs(root) + np.abs(blocks.A).sum() + np.abs(blocks.Cv).sum() + late.sum()
    return root if np.linalg.svd(M, compute_uv=False)[-1] <= _RESIDUAL * size else None
