"""The disturbance that the nominal closed loop amplifies most.

The H-infinity norm is |G(jw)| at its peak: with the singular value decomposition
G(jw) = U S V', the sinusoid w(t) = Re(v e^{jwt}), v the first column of V, gives the output
Re(G v e^{jwt}), larger by the factor |G(jw)|. From the zero state and over a finite time the
gain is less, and tends to it as the sinusoid gets longer.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from cosim.core import InputError
from cosim.hinf import delay_lti
from cosim.hinf.certificate import known_keys, number
from cosim.models import DelaySystem

if TYPE_CHECKING:
    from cosim.hinf.delay_lti.closed_loop import ClosedLoop

_AGREE = 1e-6
_DIGITS = 6


@dataclass(frozen=True)
class WorstCase:
    """w_k(t) = amplitude[k] cos(omega t + phase[k]).

    Attributes
    ----------
    omega : angular frequency [rad/s]; 0 is a constant.
    amplitude, phase : one per entry of w; |amplitude| = 1, phase in [rad].
    gain : |G(j omega) v| to six digits, the amplification in the steady state.
    """

    omega: float
    amplitude: tuple[float, ...]
    phase: tuple[float, ...]
    gain: float


def worst_case(loop: ClosedLoop, omega: float) -> WorstCase:
    """Find the sinusoid that the loop amplifies most at `omega` [rad/s].

    Of directions whose gains agree to 1e-6, the unit vector nearest to an entry of w is taken.
    Frequency, amplitudes, phases and gain have six digits, so that the rounding of a machine
    does not change a run.

    Raises
    ------
    InputError : the loop has no w or no z, or `omega` is no frequency >= 0.
    """
    if not (math.isfinite(omega) and omega >= 0):
        raise InputError(
            "not a frequency", where="omega", expected="a finite number >= 0", got=repr(omega)
        )
    omega = _rounded(omega)
    G = loop.transfer(omega)
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
    return WorstCase(omega, amplitude, phase, _rounded(float(np.linalg.norm(G @ v))))


def worst_case_at(system: DelaySystem, K: ArrayLike, omega: float | None) -> WorstCase | None:
    """Return the worst case of `system` with u = K x at `omega` [rad/s]; None for None."""
    return None if omega is None else worst_case(delay_lti.close(system, K), omega)


def worst_case_from_json(data: Any, where: str, size: int) -> WorstCase:
    """Read a worst case from the values of its `dataclasses.asdict`; w has `size` entries.

    Raises
    ------
    InputError : a missing or unknown key, or anything but a number.
    """
    keys = ("omega", "amplitude", "phase", "gain")
    known_keys(data, where, keys, required=keys)
    entries = {}
    for key in ("amplitude", "phase"):
        if not isinstance(data[key], list) or len(data[key]) != size:
            raise InputError("one per entry of w", where=f"{where}.{key}", expected=f"{size}")
        entries[key] = tuple(number(x, f"{where}.{key}[{k}]") for k, x in enumerate(data[key]))
    omega, gain = (number(data[key], f"{where}.{key}") for key in ("omega", "gain"))
    return WorstCase(omega, entries["amplitude"], entries["phase"], gain)


def _rounded(value: float) -> float:
    """Round `value` to `_DIGITS` significant digits."""
    return float(f"{value:.{_DIGITS - 1}e}")
