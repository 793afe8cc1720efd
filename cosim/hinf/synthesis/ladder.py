"""The ladder of every design and analysis: from what a solver finds up to what is proved.

A solver's optimum lies on the boundary, where nothing can be proved. So each condition is tried
at levels a little above its least gamma, or below its greatest delay, until one is proved. What
holds at a gamma holds at a greater one: where the last level fails, the others would too. The
last levels are far off: where the optimum is approached only as the gain grows without bound, a
proof needs room, and a proved bound of twice the optimum is better than none. Where a gamma is
proved already, only levels clearly below it are worth a proof.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

from cosim.hinf.exact import rounded_up

NEAR = (1e-5, 5e-5, 1e-4, 3e-4, 2e-3, 1e-2, 5e-2)
"""Shares above a least gamma at which it is proved as a rule."""
FAR = (0.3, 1.0, 9.0)
"""Shares tried where none of `NEAR` is proved."""
_FINE = (2e-6, 1e-5, 5e-5)
_COARSE = (3e-4, 2e-3, 1e-2, 5e-2, *FAR)
"""Shares above the least gamma of an analysis; of the fine ones fewer are tried where it costs."""
_MEDIUM, _COSTLY = 150, 500
"""Unknowns from which one fine level is tried, where a proof takes half a second; and none, where
it takes seconds."""
_WIDE, _WORTH_WIDE = (2e-3, 1e-2), 0.02
"""The same for a proof for smaller delays too, where it takes seconds, and what it must gain."""
_COSTLY_IF_WIDE, _MOST_IF_WIDE = 500, 1500
"""Unknowns, counted at every corner, from which it takes so long that the last share alone is
tried, and up to which it is."""
BELOW = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 5e-2)
"""Shares below a greatest delay."""

_CLEARLY = 1e-3
"""Share by which a gamma must be less than a proved one to be worth a proof."""

_FAILURES = 2
"""Failures at near levels after which the furthest is tried."""

Level = TypeVar("Level")
Found = TypeVar("Found")


def levels_above(least: float, shares: Iterable[float] = NEAR) -> list[float]:
    """Return the gammas to prove above a least gamma, in the order in which to try them."""
    return [rounded_up(least * (1 + share)) for share in shares]


def delays_below(longest: float, *, itself: bool) -> list[float]:
    """Return the delays [s] to prove below a greatest one, first `longest` `itself`."""
    return [longest * (1 - share) for share in ((0.0, *BELOW) if itself else BELOW)]


def first_proved(
    levels: Iterable[Level], prove: Callable[[Level], tuple[Found | None, str]]
) -> tuple[Found | None, str]:
    """Return the first proof, or None and why the last level has none.

    levels : what to prove, the best first.
    prove : returns the proof of a level, or None and the reason.
    """
    reason = ""
    for level in levels:
        proof, reason = prove(level)
        if proof is not None:
            return proof, ""
    return None, reason


def least_proved(
    levels: Sequence[float], prove: Callable[[float], tuple[Found | None, str]]
) -> tuple[tuple[float, Found] | None, str]:
    """Return the least level that is proved with its proof, or None and why the last has none.

    levels : one gamma or more, in ascending order. They are tried in turn, but the last one after
        `_FAILURES`: where that is not proved either, the others are left out.
    """
    *near, last = levels
    at_last: tuple[Found | None, str] | None = None
    for failures, level in enumerate(near):
        if failures == _FAILURES:
            at_last = prove(last)
            if at_last[0] is None:
                break
        proof, _ = prove(level)
        if proof is not None:
            return (level, proof), ""
    proof, reason = at_last or prove(last)
    return (None, reason) if proof is None else ((last, proof), "")


def clearly_below(levels: Iterable[float], proved: float | None) -> list[float]:
    """Return the levels that are worth a proof where a gamma is `proved` already."""
    return [x for x in levels if proved is None or x < proved * (1 - _CLEARLY)]


def levels_of_analysis(
    least: float, unknowns: int, below: float | None, corners: int
) -> list[float]:
    """Return the gammas to prove above the least one; none where that is not worth its cost.

    corners : of a proof for smaller delays too, which takes longer; 0: of these delays.
    """
    fine = () if unknowns > _COSTLY else _FINE[:1] if unknowns > _MEDIUM else _FINE
    shares = (*fine, *_COARSE)
    if corners and unknowns > _MEDIUM:
        cost = unknowns * corners
        much = below is None or least < below * (1.0 - _WORTH_WIDE)
        shares = _WIDE[cost > _COSTLY_IF_WIDE :] if much and cost < _MOST_IF_WIDE else ()
    return clearly_below((float(f"{least * (1 + share):.7g}") for share in shares), below)
