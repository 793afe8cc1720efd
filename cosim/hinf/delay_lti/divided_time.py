"""What proved rates bound over a recorded division of time into touch and outages.

With V' <= -2 alpha V in touch and V' <= 2 beta V out of touch, V(t) <= V(s) e^{g(s,t)},
g(s,t) = 2 beta T_out - 2 alpha T_touch between s and t, for every s < t. The greatest g(s,t) over
the s before t is what outages have cost and touch has not made up yet: the `deficit` at t. It rises
at 2 beta and falls at 2 alpha, never below zero. While it is zero, V is below every earlier bound:
the guarantee is held. From the beginning of an outage it is suspended, and regained where the
deficit is zero again. For any rate 0 < l <= alpha with g(s,t) <= c - 2 l (t - s),

    |z|_2 <= gamma e^{c/2} (alpha/l)^{1/2} |w|_2 from rest, and with |w| <= w0
    V(t) <= gamma w0^2 e^c / (2 l) + V(0) e^{c - 2 l t};

docs/explanation/outages.md derives all of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.core import InputError

if TYPE_CHECKING:
    from cosim.hinf.certificate import Outages

_RATES = 200
"""Rates l that are tried for the plain gain, evenly in their logarithm."""


@dataclass(frozen=True)
class OutageBound:
    """What holds over one run, or one recording.

    Attributes
    ----------
    share_needed, share_had : of the time in touch; with less, V need not fall in the long run.
    touch_s, out_s : time in each mode [s].
    longest_outage_s : [s]; 0 without one.
    exponent : V at the end is at most e^{exponent} V(0), with w = 0.
    greatest_exponent : the greatest of it over the run, from any s to any t: the largest deficit.
    guaranteed_share : of the time in which the guarantee was held.
    suspensions_s : beginning and end [s] of each time in which it was not; one that lasts to the
        end of the run has the end None.
    gain_factor : the gain without weights is at most this times gamma; None where none is bounded.
    """

    share_needed: float
    share_had: float
    touch_s: float
    out_s: float
    longest_outage_s: float
    exponent: float
    greatest_exponent: float
    guaranteed_share: float
    suspensions_s: tuple[tuple[float, float | None], ...]
    gain_factor: float | None

    @property
    def decays(self) -> bool:
        """Whether the bound on V at the end is below V(0)."""
        return self.exponent < 0


def outage_bound(outages: Outages, times: ArrayLike, touch: ArrayLike) -> OutageBound:
    """Return what proved rates bound over a division of time.

    Parameters
    ----------
    times : (n + 1,) the instants [s] between which the mode does not change, increasing.
    touch : (n,) whether each interval is in touch: the feedback at most as old as designed for. It
        must be true nowhere else; out of touch the proved fallback acts.

    Raises
    ------
    InputError : lengths that do not fit, or instants out of order.

    Examples
    --------
    >>> from fractions import Fraction
    >>> from types import SimpleNamespace
    >>> from cosim.hinf.delay_lti.divided_time import outage_bound
    >>> rates = SimpleNamespace(alpha=0.3, beta=0.2, share=0.4)
    >>> found = outage_bound(rates, [0, 10, 13, 40], [True, False, True])
    >>> round(found.greatest_exponent, 3), found.suspensions_s
    (1.2, ((10.0, 15.0),))
    """
    t, there = np.asarray(times, np.float64), np.asarray(touch, np.bool_)
    if t.shape != (there.size + 1,) or not there.size or (np.diff(t) < 0).any():
        raise InputError(
            "not a division of time",
            where="times, touch",
            expected="increasing instants, and one mode between each two",
            got=f"{t.size} instants, {there.size} modes",
        )
    t, there = _merged(t, there)
    alpha, beta = float(outages.alpha), float(outages.beta)
    length = np.diff(t)
    rise = np.where(there, -2 * alpha, 2 * beta) * length
    deficits, suspensions, since = 0.0, [], None
    greatest = guaranteed = 0.0
    columns = (t[:-1], length, there, rise)
    for begin, span, in_touch, change in zip(*(x.tolist() for x in columns), strict=True):
        if not in_touch and since is None:
            since = begin
        after = deficits + change
        if in_touch and after <= 0:
            made_up = deficits / (2 * alpha)
            guaranteed += span - made_up
            if since is not None:
                suspensions.append((since, begin + made_up))
                since = None
        deficits = max(after, 0.0)
        greatest = max(greatest, deficits)
    if since is not None:
        suspensions.append((since, None))
    total, in_touch = float(length.sum()), float(length[there].sum())
    lost = length[~there]
    return OutageBound(
        share_needed=float(outages.share),
        share_had=in_touch / total if total else 1.0,
        touch_s=in_touch,
        out_s=total - in_touch,
        longest_outage_s=float(lost.max()) if lost.size else 0.0,
        exponent=float(rise.sum()),
        greatest_exponent=greatest,
        guaranteed_share=guaranteed / total if total else 1.0,
        suspensions_s=tuple(suspensions),
        gain_factor=_gain_factor(alpha, length, rise),
    )


def _merged(
    t: NDArray[np.float64], there: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the same division without instants at which nothing changes."""
    first = np.flatnonzero(np.diff(there.astype(np.int8), prepend=2))
    return np.append(t[first], t[-1]), there[first]


def _gain_factor(
    alpha: float, length: NDArray[np.float64], rise: NDArray[np.float64]
) -> float | None:
    """Return the least e^{c/2} (alpha/l)^{1/2} over the rates l that are tried."""
    best = math.inf
    for rate in np.geomspace(1e-4 * alpha, alpha, _RATES):
        steps = rise + 2 * rate * length
        total = np.concatenate(([0.0], np.cumsum(steps)))
        c = float((total - np.minimum.accumulate(total)).max())
        best = min(best, c / 2 + math.log(alpha / rate) / 2)
    return math.exp(best) if best < math.log(1e12) else None
