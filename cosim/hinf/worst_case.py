"""The disturbance that the nominal closed loop amplifies most.

The H-infinity norm is |G(jw)| at its peak: with the singular value decomposition
G(jw) = U S V', the sinusoid w(t) = Re(v e^{jwt}), v the first column of V, leaves the loop as
Re(G v e^{jwt}), larger by the factor |G(jw)|. From the zero state and over a finite time the
gain stays below it, and comes close the longer the sinusoid lasts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cosim.errors import InputError
from cosim.hinf.closed_loop import ClosedLoop

_AGREE = 1e-6
_DIGITS = 6


@dataclass(frozen=True)
class WorstCase:
    """w_k(t) = amplitude[k] cos(omega t + phase[k]).

    Attributes
    ----------
    omega : angular frequency [rad/s]; 0 is a constant.
    amplitude, phase : one per entry of w; |amplitude| = 1, phase in [rad].
    gain : |G(j omega) v|, what it is amplified by in the long run.
    """

    omega: float
    amplitude: tuple[float, ...]
    phase: tuple[float, ...]
    gain: float


def worst_case(loop: ClosedLoop, omega: float) -> WorstCase:
    """The direction that the loop amplifies most at `omega` [rad/s].

    Directions whose gains agree to 1e-6 count as one: of their space the unit vector nearest
    to an entry of w is taken. Frequency, amplitudes and phases have six digits, so that what
    differs from machine to machine does not reach a run.

    Raises
    ------
    InputError
        The loop has no w or no z, or `omega` is no frequency >= 0.
    """
    if not loop.has_performance or loop.C is None:
        raise InputError(
            "there is no disturbance to find",
            where="closed loop",
            expected="a disturbance w (C) and a performance output z (D)",
            got="a loop without one of them",
        )
    if not (math.isfinite(omega) and omega >= 0):
        raise InputError(
            "not a frequency", where="omega", expected="a finite number >= 0", got=repr(omega)
        )
    omega = _rounded(omega)
    G = transfer(loop, omega)
    _, sizes, rows = np.linalg.svd(G)
    space = rows[: int((sizes >= sizes[0] * (1 - _AGREE)).sum())]
    onto = space.conj().T @ space  # the projection; its column k is e_k as seen in the space
    share = np.real(np.diag(onto))
    k = int(np.flatnonzero(share >= share.max() - _AGREE)[0])
    v = onto[:, k] / math.sqrt(share[k])
    amplitude = tuple(round(float(abs(entry)), _DIGITS) for entry in v)
    phase = tuple(
        round(float(np.angle(entry)), _DIGITS) + 0.0 if size else 0.0
        for entry, size in zip(v, amplitude, strict=True)
    )
    return WorstCase(omega, amplitude, phase, float(np.linalg.norm(G @ v)))


def transfer(loop: ClosedLoop, omega: float) -> np.ndarray:
    """G(j omega) = D(j omega) (j omega I - A(j omega))^-1 C + D1, complex (p, q)."""
    s = np.asarray(1j * omega)
    H = s * np.eye(loop.order) - loop.state_matrix(s)
    through = loop.output_matrix(s) @ np.linalg.solve(H, np.asarray(loop.C, dtype=complex))
    G: np.ndarray = through + loop.D1
    return G


def _rounded(omega: float) -> float:
    """`omega` to `_DIGITS` significant digits."""
    return float(f"{omega:.{_DIGITS - 1}e}")
