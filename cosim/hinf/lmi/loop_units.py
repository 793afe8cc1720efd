"""The units in which a loop is given to a solver: its states balanced, its own unit of time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import scipy

from cosim.hinf.lmi.svec import Array

if TYPE_CHECKING:
    from cosim.models import DelaySystem


def own_units(loop: Sequence[Array]) -> tuple[Array, float]:
    """Return (n,) factors that balance the states of a loop, and its unit of time [s]."""
    speed = np.asarray(sum(np.abs(M) for M in loop))
    _, (scales, _) = scipy.linalg.matrix_balance(speed, permute=False, separate=True)
    back = 1.0 / np.asarray(scales, dtype=np.float64)
    rate = sum(float(np.linalg.norm(back[:, None] * M / back, 2)) for M in loop)
    return back, 1.0 / (rate or 1.0)


def closed_loop(system: DelaySystem, K: Array) -> list[Array]:
    """Return A of x(t) and of every delay with u = K sum_i S_i x(t - d_i) put in."""
    A = [system.A, *(delay.A for delay in system.delays)]
    pairs = zip(A, system.selections, strict=True)
    return [M + system.B @ (K * S) if S.any() else M for M, S in pairs]


def eps_units(system: DelaySystem, channel: Array, name: str = "eps") -> dict[str, float]:
    """Return the unit of the multiplier of every block of F by its name, for these units of p."""
    blocks = enumerate(system.blocks)
    return {f"{name}[{b}]": float(channel[columns][0] ** -2) for b, (columns, _) in blocks}


def channel_units(system: DelaySystem, back: Array, T: float) -> Array:
    """Return (s,) units of p = F q that make the norms of E and H equal in each block of F.

    So its eps is of the size of the others. A block that is alone keeps its units.

    Parameters
    ----------
    back, T : `own_units`.
    """
    units = np.ones(system.E.shape[1])
    E = T * back[:, None] * system.E
    H = [M / back for M in (system.H, *(delay.H for delay in system.delays))]
    for p, q in system.blocks if len(system.blocks) > 1 else ():
        size = float(np.linalg.norm(E[:, p])), float(np.linalg.norm([M[q] for M in H]))
        if min(size) > 0:
            units[p] = np.exp2(np.round(np.log2(size[1] / size[0]) / 2))
    return units
