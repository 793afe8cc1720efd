"""The H-infinity norm of a system with internal delays, and its proof.

Where the system is a delay differential equation whose disturbance acts at once, or its transpose
is (`cosim.hinf.response.retarded`), the norm is that of `cosim.hinf.nominal`, and may be proved in
ball arithmetic. Otherwise (inputs and outputs late in different ways, direct terms late, neutral
systems) the same branch and bound works on M(s) of `cosim.hinf.response.blocks`.
"""

from __future__ import annotations

import numpy as np

from cosim.core import InputError
from cosim.hinf.nominal import (
    ROOTS,
    NormResult,
    hinf_norm,
    norm_between,
)
from cosim.hinf.response.blocks import Blocks, Reals, balanced
from cosim.hinf.response.high_frequency import HighFrequency
from cosim.hinf.response.retarded import plain_of
from cosim.hinf.response.roots import is_stable, roots_of

_ABOVE = (1e-8, 1e-6, 1e-4, 1e-2)


def norm_of(blocks: Blocks) -> NormResult | None:
    """Compute the H-infinity norm, the greatest gain over all frequencies.

    Returns
    -------
    The norm, its frequency and an upper bound, or None where the system is not asymptotically
    stable.

    Raises
    ------
    InputError : no input or no output.
    NotAchievableError : characteristic roots that cannot be found.
    """
    if not blocks.D.size:
        raise InputError("this system has no gain", where="system", expected="inputs and outputs")
    if not blocks.order and not blocks.delays.size:
        gain = float(np.linalg.norm(blocks.D, 2))
        return NormResult(gain, 0.0, gain)
    roots = roots_of(blocks, ROOTS)
    if (roots.size and not roots[0].real < 0.0) or (blocks.is_neutral and not is_stable(blocks)):
        return None
    if not blocks.is_neutral and blocks.order:
        plain = plain_of(blocks)
        if plain is not None:
            return hinf_norm(plain.loop(), roots)
    high = HighFrequency(balanced(blocks)[0])
    if not roots.size:
        roots = np.array([-1.0 + 1j]) / blocks.delays.max()
    return norm_between(high.blocks, _Bounds(high), roots)


def norm_proved_of(blocks: Blocks, norm: NormResult) -> float | None:
    """Return a number near the norm that it is proved to lie below; None without a proof.

    The proof is in ball arithmetic and shows stability as well. None also for systems that no
    `DelaySystem` has the norm of.
    """
    if blocks.is_neutral or not blocks.order or not norm.value > 0.0:
        return None
    plain = plain_of(blocks)
    system = None if plain is None else plain.system()
    if system is None:
        return None
    from cosim.hinf.nominal import norm_proved  # noqa: PLC0415 - ball arithmetic is slow to import

    K = np.zeros((0, blocks.order))
    levels = (norm.value * (1.0 + share) for share in _ABOVE)
    return next((level for level in levels if norm_proved(system, K, level)), None)


class _Bounds:
    """What `cosim.hinf.nominal.norm` needs, with M for H, [B; Dv] for C and [C  Dw E] for D."""

    def __init__(self, high: HighFrequency) -> None:
        s = high.blocks
        self.high = high
        late = s.Dw.any() and s.Dv.any()
        self.direct = 0.0 if late else high.direct
        # something to measure frequencies by, also without a state
        self.a = max(high.a, float((1.0 / s.delays).max(initial=0.0)))
        self.through = max(high.through, self.a * (high.direct if late else 0.0))
        into = np.vstack([s.Bw, s.Dvw])

        def size(M: Reals) -> float:
            return float(np.linalg.norm(M, 2)) if M.size else 0.0

        self.constants = (
            1.0 + size(into * s.delays),
            size(into * s.delays**2),
            size(s.Dw * s.delays),
            size(s.Dw * s.delays**2),
        )

    def beyond(self, w: float) -> float:
        return self.high.beyond(w)
