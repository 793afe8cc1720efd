"""Propose gains where more is known of an age than its bound.

1. Theorem 2, for any age up to a bound, proposes gains: for the bounds as they are and for shorter
   ones, since an age that is sampled, or never as long as its bound for long, bears a gain that is
   made for a shorter one.
2. The LMI of the ages themselves (`ages_synthesis_lmi`) designs further ones, with the multiplier
   b searched, where it has no more than `MOST_ROWS` rows.

All are analysed with the ages of the system, and what is claimed is the best analysis.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from cosim.core import NotAchievableError
from cosim.hinf.lmi import GainLmi, Multiplier, scalar_multiplier
from cosim.hinf.problem import of_any_age
from cosim.hinf.synthesis import theorem_2_gamma
from cosim.hinf.synthesis.bessel_legendre_gains import rounded
from cosim.hinf.synthesis.conditions import MOST_ROWS
from cosim.hinf.synthesis.result import Result
from cosim.hinf.theorems import functionals_of
from cosim.models import DelaySystem, Matrix

_SHARES = (1.0, 0.7, 0.5, 0.35, 0.25, 0.15)
"""Bounds for which gains are designed, as shares of those of the known ages."""

_LEAST_B = 1 / 100  # of the search for b, as a share of the longest delay
_WELL_ABOVE = 1.1  # a gain of great margin is taken at this multiple of the least gamma


def gains_for_shorter_ages(
    system: DelaySystem,
    k1: Sequence[float],
    k2: Sequence[float],
    failures: list[str],
    *,
    search: bool,
) -> Iterator[Matrix]:
    """Yield the gains of Theorem 2 for shorter and shorter ages; add to `failures` what fails."""
    for share in _SHARES:
        try:
            yield theorem_2_gamma.design(of_any_age(system, share), k1, k2, search=search).K
        except NotAchievableError as error:
            failures.append(f"Theorem 2 at {share:g} of the ages: {error.what}")


def is_past_the_best(made: Sequence[Result]) -> bool:
    """Whether the last of analyses for shorter and shorter ages is worse than the one before."""
    proved = [one.gamma for one in made if one.certificate is not None and one.gamma is not None]
    return made[-1].certificate is not None and len(proved) > 1 and proved[-1] >= proved[-2]


def nearest_to_a_goal(made: Sequence[Result]) -> tuple[Matrix, float] | None:
    """Return the gain whose analysis came to the least gamma, proved or not, and this gamma."""
    leasts = [(one.K, one.least_gamma) for one in made if one.K is not None]
    bounded = [(K, least) for K, least in leasts if least is not None]
    return min(bounded, key=lambda pair: pair[1], default=None)


def gains_of_the_ages(
    system: DelaySystem, order: int, start: tuple[Matrix, float | None] | None
) -> Iterator[Matrix]:
    """Yield gains of the LMI of the ages, the best first; none where it is too large.

    start : a gain and its gamma, which set the units; None: none is known.
    """
    n, m = system.B.shape
    K, reference = np.zeros((m, n)), None
    if system.has_performance:
        reference = float(np.linalg.norm(system.D1, 2)) or 1.0
    if start is not None:
        K, reference = start
    lmi = GainLmi(system, order, K, reference, [functionals_of(x)[0] for x in system.delays])
    if lmi.rows > MOST_ROWS:
        return
    tried = _tried(lmi, system)
    tried.sort(key=lambda item: item[0])
    for value, b, gain in tried[:2]:
        inside = None
        if system.has_performance:
            inside = lmi.central(scalar_multiplier(b, system), _WELL_ABOVE * value)
        for proposal in ((value, gain), inside):
            proposed = rounded(proposal)
            if proposed is not None:
                yield proposed[1]


def _stable_gain(lmi: GainLmi, multiplier: Multiplier) -> tuple[float, Matrix] | None:
    """Return minus the greatest margin of stability and its gain; None where it is not positive."""
    centre = lmi.central(multiplier, None)
    return None if centre is None or centre[0] <= 0 else (-centre[0], centre[1])


def _tried(lmi: GainLmi, system: DelaySystem) -> list[tuple[float, float, Matrix]]:
    """Return what is to be small, b [s] and the gain, of every b on the way to the best."""
    longest = max(delay.d for delay in system.delays)
    tried: list[tuple[float, float, Matrix]] = []
    for step in (2.0, 0.5):
        b = longest if step > 1 else longest * step
        best = min((value for value, _, _ in tried), default=np.inf)
        while _LEAST_B < b / longest < 1 / _LEAST_B:
            at = scalar_multiplier(b, system)
            proposal = lmi.least_gamma(at) if system.has_performance else _stable_gain(lmi, at)
            if proposal is None or proposal[0] >= best:
                break
            best = proposal[0]
            tried.append((best, b, proposal[1]))
            b *= step
    return tried
