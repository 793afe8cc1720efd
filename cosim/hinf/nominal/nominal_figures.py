"""Figures of the nominal loop, computed without the LMI, to compare its gamma with."""

from __future__ import annotations

import math
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cosim.core import InputError, NotAchievableError
from cosim.hinf.nominal.closed_loop import close
from cosim.hinf.nominal.delay_margins import delay_margin
from cosim.hinf.nominal.norm import ROOTS, NormResult, hinf_norm
from cosim.hinf.nominal.norm_proof import norm_proved
from cosim.hinf.nominal.roots import characteristic_roots
from cosim.hinf.nominal.threads import one_thread
from cosim.models import DelaySystem

_BEYOND_DOUBLES = (ArithmeticError, np.linalg.LinAlgError)
"""What numbers far from one, or a root all but on the axis, end a computation with."""

BEYOND = "numbers that leave the range of doubles"
"""Why a figure is missing, in messages."""

# relative distances of the bounds tried: for a flat gain a close bound takes too long
_ABOVE = (1e-8, 1e-6, 1e-4, 1e-2)
# the same where the gain only tends to its norm: each closer bound takes three times the work
_ABOVE_LIMIT = (1e-2, 1e-3, 1e-4, 1e-5)


class NominalFigures(NamedTuple):
    """Figures of the nominal loop at its present delays, all taken as constants.

    abscissa : spectral abscissa [1/s], computed. None where no root could be found.
    exact_norm : H-infinity norm from w to z, computed: a gain that is attained. None if the
        loop is not stable, or there is no w or no z, or the numbers leave the range of doubles.
    exact_norm_upper : a number that the norm is proved to lie below, by ball arithmetic, and
        the loop proved stable with it; within 1e-8 of `exact_norm` where the gain has a peak,
        less close where it is flat or attained at infinite frequency only. None without a proof.
    norm_frequency : where the norm is attained [rad/s]; None at infinite frequency.
    delay_margin : for each delay the value [s] at which stability is first lost, the others
        kept; None: never lost, or not stable at present. None as a whole where a root comes too
        close to the axis to decide.
    """

    abscissa: float | None
    exact_norm: float | None
    exact_norm_upper: float | None
    norm_frequency: float | None
    delay_margin: tuple[float | None, ...] | None

    @classmethod
    def of(cls, record: Any) -> NominalFigures:
        """Return the figures that a design or an analysis has among its attributes."""
        return cls(**{name: getattr(record, name) for name in cls._fields})

    @classmethod
    def unknown(cls) -> NominalFigures:
        """Return the figures of a loop none of whose roots could be found."""
        return cls(None, None, None, None, None)


@one_thread
def nominal_figures_of(system: DelaySystem, K: ArrayLike, *, quick: bool = False) -> NominalFigures:
    """Compute the figures of `system` with u = K x; its E, H are ignored.

    quick : without the proof of the norm and without delay margins.

    Raises
    ------
    InputError : K (m, n) does not fit.
    NotAchievableError : roots that cannot be found (see `characteristic_roots`).
    """
    loop = close(system, K)
    roots = characteristic_roots(loop, ROOTS if system.has_performance else 1)
    abscissa = float(roots[0].real)
    peak = None
    if system.has_performance:
        with suppress(*_BEYOND_DOUBLES), np.errstate(over="raise", invalid="raise"):
            peak = hinf_norm(loop, roots)
    finite = peak is not None and math.isfinite(peak.frequency)
    margins = None
    # also a root too close to the axis to decide
    with suppress(NotAchievableError, *_BEYOND_DOUBLES):
        margins = None if quick else delay_margin(system, K, abscissa)
    return NominalFigures(
        abscissa=abscissa,
        exact_norm=None if peak is None else peak.value,
        exact_norm_upper=None if peak is None or quick else _proved_above(system, K, peak),
        norm_frequency=peak.frequency if peak is not None and finite else None,
        delay_margin=margins,
    )


def figures_if_known(system: DelaySystem, K: ArrayLike) -> tuple[NominalFigures, str | None]:
    """Return the figures of a loop, and why none could be computed; no proof depends on them.

    system, K : finite numbers that fit each other.
    """
    try:
        with np.errstate(all="ignore"):
            return nominal_figures_of(system, K), None
    except NotAchievableError as error:
        return NominalFigures.unknown(), f"the roots of the nominal loop: {error.what}"
    except (InputError, *_BEYOND_DOUBLES) as error:  # B K, of finite numbers, is not finite
        what = error.what if isinstance(error, InputError) else str(error)
        return NominalFigures.unknown(), f"{BEYOND} ({what}): choose other units"


def _proved_above(system: DelaySystem, K: ArrayLike, peak: NormResult) -> float | None:
    """Return the least of a few bounds of the norm that is proved; None if none is."""
    norm, best = peak.value, None
    if not norm > 0.0:
        return None
    if math.isfinite(peak.frequency):
        levels = (norm * (1.0 + share) for share in _ABOVE)
        return next((level for level in levels if norm_proved(system, K, level)), None)
    for share in _ABOVE_LIMIT:
        level = norm * (1.0 + share)
        if not norm_proved(system, K, level):
            break
        best = level
    return best
