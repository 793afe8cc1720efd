"""Figures of the nominal loop, computed without the LMI, to compare its gamma with."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.core import InputError, NotAchievableError
from cosim.hinf import delay_lti
from cosim.hinf.delay_lti.threads import one_thread
from cosim.models import DelaySystem, Matrix, Value

T = TypeVar("T")

_BEYOND_DOUBLES = (ArithmeticError, np.linalg.LinAlgError)
"""What numbers far from one, or a root all but on the axis, end a computation with."""

_UNDECIDED = (NotAchievableError, *_BEYOND_DOUBLES)
"""The same, with a root too close to the axis to decide."""

BEYOND = "numbers that leave the range of doubles"
"""Why a figure is missing, in messages."""

# relative distances of the bounds tried: for a flat gain a close bound takes too long
_ABOVE = (1e-8, 1e-6, 1e-4, 1e-2)
# the same where the gain only tends to its norm: each closer bound takes three times the work
_ABOVE_LIMIT = (1e-2, 1e-3, 1e-4, 1e-5)


def _computed_once(figure: Callable[[NominalFigures], T]) -> cached_property[T]:
    """Decorate a figure that is computed when it is first read, whoever reads it, the same."""

    @one_thread
    def computed(figures: NominalFigures) -> T:
        with np.errstate(all="ignore"):
            return figure(figures)

    return cached_property(computed)


@dataclass(frozen=True, eq=False)
class NominalFigures(Value):
    """Figures of the nominal loop at its present delays, all taken as constants.

    Each is computed once, when it is first read, or is that of a file (`with_values`).

    Attributes
    ----------
    system : its E, H are ignored.
    K : (m, n) of u = K x.
    """

    system: DelaySystem
    K: Matrix

    @classmethod
    def with_values(
        cls, system: DelaySystem, K: Matrix, values: Mapping[str, Any]
    ) -> NominalFigures:
        """Return figures that are known, by name; those without a value are None."""
        made = cls(system, K)
        made.__dict__.update({name: values.get(name) for name in FIGURES})
        return made

    def with_output(self, system: DelaySystem) -> NominalFigures:
        """Return the figures of the same loop with the z of this system: it has the same roots."""
        made = NominalFigures(system, self.K)
        if system.has_performance == self.system.has_performance:
            made.__dict__["_roots"] = self._roots
        return made

    def content(self) -> tuple[Any, ...]:
        """Return all figures: what makes two of them equal."""
        return tuple(getattr(self, name) for name in FIGURES)

    def __getstate__(self) -> dict[str, Any]:
        """Return the loop, with the figures that are known."""
        return {name: self.__dict__[name] for name in _KEPT if name in self.__dict__}

    @_computed_once
    def _loop(self) -> delay_lti.ClosedLoop:
        return delay_lti.close(self.system, self.K)

    @_computed_once
    def _roots(self) -> NDArray[np.complex128]:
        count = delay_lti.ROOTS if self.system.has_performance else 1
        return delay_lti.characteristic_roots(self._loop, count)

    @_computed_once
    def abscissa(self) -> float | None:
        """Spectral abscissa [1/s], computed; None where no root could be found."""
        return float(self._roots[0].real)

    @_computed_once
    def _peak(self) -> delay_lti.NormResult | None:
        if not self.system.has_performance:
            return None
        with suppress(*_BEYOND_DOUBLES), np.errstate(over="raise", invalid="raise"):
            return delay_lti.hinf_norm(self._loop, self._roots)
        return None

    @_computed_once
    def exact_norm(self) -> float | None:
        """H-infinity norm from w to z, computed: a gain that is attained.

        None if the loop is not stable, or there is no w or no z, or the numbers leave the range
        of doubles.
        """
        return None if self._peak is None else self._peak.value

    @_computed_once
    def norm_frequency(self) -> float | None:
        """Where the norm is attained [rad/s]; None at infinite frequency."""
        finite = self._peak is not None and math.isfinite(self._peak.frequency)
        return self._peak.frequency if self._peak is not None and finite else None

    @_computed_once
    def exact_norm_upper(self) -> float | None:
        """A number that the norm is proved to lie below, by ball arithmetic; None without a proof.

        The loop is proved stable with it. Within 1e-8 of `exact_norm` where the gain has a peak,
        less close where it is flat or attained at infinite frequency only.
        """
        norm, at = self.exact_norm, self.norm_frequency
        with suppress(*_BEYOND_DOUBLES):
            return None if norm is None else _proved_above(self.system, self.K, norm, at)
        return None

    @_computed_once
    def delay_margin(self) -> tuple[float | None, ...] | None:
        """For each delay the value [s] at which stability is first lost, the others kept.

        None: never lost, or not stable at present. None as a whole where a root comes too close
        to the axis to decide.
        """
        count = len(self.system.delays)
        with suppress(*_UNDECIDED):
            return tuple(self._margin_of(index) for index in range(count))
        return None

    @one_thread
    def margin_of(self, index: int) -> float | None:
        """Return the delay margin of one delay, from 0; None also where it cannot be decided."""
        with suppress(*_UNDECIDED), np.errstate(all="ignore"):
            return self._margin_of(index)
        return None

    def _margin_of(self, index: int) -> float | None:
        if self.abscissa is None:
            return None
        return delay_lti.margin_of_delay(self.system, self.K, index, self.abscissa)

    @_computed_once
    def worst_case(self) -> delay_lti.WorstCase | None:
        """The sinusoid that the loop amplifies most; None without `norm_frequency`."""
        with suppress(*_BEYOND_DOUBLES):
            return delay_lti.worst_case_at(self.system, self.K, self.norm_frequency)
        return None


FIGURES = (
    "abscissa",
    "exact_norm",
    "exact_norm_upper",
    "norm_frequency",
    "delay_margin",
    "worst_case",
)
_KEPT = ("system", "K", *FIGURES)


class HasFigures:
    """Base of a record whose nominal loop has these figures: they are attributes of its own."""

    figures: NominalFigures

    @property
    def abscissa(self) -> float | None:
        """See `NominalFigures`."""
        return self.figures.abscissa

    @property
    def exact_norm(self) -> float | None:
        """See `NominalFigures`."""
        return self.figures.exact_norm

    @property
    def exact_norm_upper(self) -> float | None:
        """See `NominalFigures`."""
        return self.figures.exact_norm_upper

    @property
    def norm_frequency(self) -> float | None:
        """See `NominalFigures`."""
        return self.figures.norm_frequency

    @property
    def delay_margin(self) -> tuple[float | None, ...] | None:
        """See `NominalFigures`."""
        return self.figures.delay_margin

    @property
    def worst_case(self) -> delay_lti.WorstCase | None:
        """See `NominalFigures`."""
        return self.figures.worst_case


def nominal_figures_of(system: DelaySystem, K: ArrayLike) -> NominalFigures:
    """Return the figures of `system` with u = K x; its roots are found at once.

    Raises
    ------
    InputError : K (m, n) does not fit.
    NotAchievableError : roots that cannot be found (see `characteristic_roots`).
    """
    figures = NominalFigures(system, np.array(K, dtype=np.float64))
    figures.abscissa  # noqa: B018 - computed here, where its failure is told
    return figures


def figures_if_known(system: DelaySystem, K: ArrayLike) -> tuple[NominalFigures, str | None]:
    """Return the figures of a loop, and why none could be computed; no proof depends on them.

    system, K : finite numbers that fit each other.
    """
    try:
        return nominal_figures_of(system, K), None
    except NotAchievableError as error:
        why = f"the roots of the nominal loop: {error.what}"
    except (InputError, *_BEYOND_DOUBLES) as error:  # B K, of finite numbers, is not finite
        what = error.what if isinstance(error, InputError) else str(error)
        why = f"{BEYOND} ({what}): choose other units"
    return NominalFigures.with_values(system, np.array(K, dtype=np.float64), {}), why


def _proved_above(system: DelaySystem, K: ArrayLike, norm: float, at: float | None) -> float | None:
    """Return the least of a few bounds of the norm that is proved; None if none is.

    at : where it is attained [rad/s]; None at infinite frequency.
    """
    best = None
    if not norm > 0.0:
        return None
    if at is not None:
        levels = (norm * (1.0 + share) for share in _ABOVE)
        return next((level for level in levels if delay_lti.norm_proved(system, K, level)), None)
    for share in _ABOVE_LIMIT:
        level = norm * (1.0 + share)
        if not delay_lti.norm_proved(system, K, level):
            break
        best = level
    return best
